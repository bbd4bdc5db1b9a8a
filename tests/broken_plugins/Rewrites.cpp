#include "BrokenPlugin.h"

namespace {

/** Speeds up for ever, whatever it is given. */
class Rewrites : public broken::Filter {
public:
    viable::FilterStatus filter(const viable::MotionState& nominal, const viable::JointVector&,
                                const viable::Dynamics& dynamics, viable::FilterDecision& decision) override {
        const auto n = nominal.q.size();
        viable::holdJerk(nominal, dynamics, viable::JointVector::Constant(n, 1.0), tick_s_, decision);
        return viable::FilterStatus::Modified;
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Rewrites, "rewrites", "Holds a jerk of 1 rad/s^3 for ever.", nullptr)
