#include "viable/plugin/PluginExport.h"

using viable::isFinite;

namespace {

const viable::ParameterSpec kParameters[] = {
    viable::parameter::number("share", "", "0.5", "How much of the desired torque is let through.")
        .atLeast(0)
        .upTo(1),
};

/** Lets a share of the torque beyond gravity through. */
class HalfTorque : public viable::SafetyFilter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        n_ = setup.size();
        tick_s_ = setup.tick_s;
        share_ = parameters.number("share");
    }
    void reset(const viable::MotionState&) override {}
    bool promisesLimits() const override { return false; }

    viable::FilterStatus filter(const viable::MotionState& nominal,
                                const viable::JointVector& torque, const viable::Dynamics& dynamics,
                                viable::FilterDecision& decision) override {
        if (!isFinite(nominal, n_) || !isFinite(torque, n_) || !isFinite(dynamics, n_))
            return viable::FilterStatus::InvalidInput;
        const viable::JointVector reduced = dynamics.gravity + share_ * (torque - dynamics.gravity);
        viable::JointVector acceleration;
        if (!calcForwardDynamics(dynamics, reduced, acceleration))
            return viable::FilterStatus::Faulted;
        holdAcceleration(nominal, dynamics, acceleration, tick_s_, decision);
        decision.joints.fill({});
        return viable::FilterStatus::Modified;
    }

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    double share_ = 0.5;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, HalfTorque, "half_torque", "Halves the torque beyond gravity.",
              kParameters)
