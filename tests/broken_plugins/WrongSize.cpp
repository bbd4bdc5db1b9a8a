#include "BrokenPlugin.h"

namespace {

class WrongSize : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override {
        const Eigen::Index size = decision.torque.size() - 1;
        decision.torque.setZero(size);
        decision.acceleration.setZero(size);
        decision.jerk.setZero(size);
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, WrongSize, "wrong_size",
              "Decides for one joint too few in every tick after the first after_ticks.", broken::kLateParameters)
