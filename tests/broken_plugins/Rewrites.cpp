#include "BrokenPlugin.h"

namespace {

/** Speeds up for ever, whatever it is given. */
class Rewrites : public broken::Filter {
public:
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override {
        decision.holdJerk(viable::JointVector::Constant(input.nominal.q.size(), 1.0));
        return viable::FilterStatus::Modified;
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Rewrites, "rewrites", "Holds a jerk of 1 rad/s^3 for ever.", viable::NoOptions)
