#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {broken::kAfterTicks};

class Contradicting : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        afterTicks_ = parameters.integer("after_ticks");
    }
    viable::FilterStatus filter(const viable::MotionState& nominal,
                                const viable::JointVector& torque, const viable::Dynamics& dynamics,
                                viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(nominal, torque, dynamics, decision);
        if (ticks_ > afterTicks_) {
            decision.held = viable::HeldQuantity::Jerk;
            decision.jerk.setConstant(1e11);  // the acceleration says nothing of this
        }
        return status;
    }

private:
    std::int64_t afterTicks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Contradicting, "contradicting",
              "Gives a jerk that does not belong to its acceleration after `after_ticks`.",
              kParameters)
