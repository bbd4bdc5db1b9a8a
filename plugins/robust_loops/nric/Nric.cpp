#include "Nric.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::jointNumbers("k_r", "Nms/rad", "600", "Gain on the whole error term.").atLeast(0),
    parameter::jointNumbers("k_p", "1/s", "20", "Weight of the position error.").atLeast(0),
    parameter::jointNumbers("k_i", "1/s^2", "8", "Weight of the integral of the position error.")
        .atLeast(0),
};

}  // namespace

void Nric::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    kr_ = parameters.jointNumbers("k_r");
    kp_ = parameters.jointNumbers("k_p");
    ki_ = parameters.jointNumbers("k_i");
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    integral_.setZero(n_);
}

void Nric::reset(const MotionState&) {
    integral_.setZero(n_);
}

TickStatus Nric::compute(const JointState& real, const MotionState& nominal,
                         const JointVector& filterTorque, JointVector& torque) {
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_))
        return TickStatus::InvalidInput;
    torque.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const double e = real.q[i] - nominal.q[i];
        const double de = real.qd[i] - nominal.qd[i];
        const auto calcTorque = [&](double integral) {
            return -kr_[i] * (de + kp_[i] * e + ki_[i] * integral);
        };
        const auto clampTotal = [&](double robust) {
            // Unchanged to the last bit where the limit does not act: a rounded
            // difference would look like saturation.
            const double total = filterTorque[i] + robust;
            if (total > torqueLimit_[i]) return torqueLimit_[i] - filterTorque[i];
            if (total < -torqueLimit_[i]) return -torqueLimit_[i] - filterTorque[i];
            return robust;
        };
        const double grown = integral_[i] + e * tick_s_;
        const double wanted = calcTorque(grown);
        const double possible = clampTotal(wanted);
        const bool saturated = possible != wanted;
        // Growing e pushes the torque towards -e: into the limit that cuts it, or away from it.
        const bool pushesFurther = saturated && ((wanted < possible) == (e > 0.0));
        if (pushesFurther) {
            torque[i] = clampTotal(calcTorque(integral_[i]));
        } else {
            integral_[i] = grown;
            torque[i] = possible;
        }
    }
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RobustLoop, viable::Nric, "nric",
              "Nonlinear robust internal-loop compensator: the real arm follows the nominal one.",
              viable::kParameters)
