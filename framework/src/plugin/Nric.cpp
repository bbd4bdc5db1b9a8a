#include "viable/plugin/Nric.h"

#include <cmath>
#include <string>

#include "core/NumberText.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** The gains of `n` joints, checked. */
JointVector takeGains(const PerJoint& gains, const char* name, int n) {
    const std::string place = std::string("NricOptions::") + name;
    if (!gains.fits(n))
        throw badInput(place,
                       std::to_string(gains.count()) + " gains; the robot has " +
                           std::to_string(n) + " joints",
                       "Give one number for all joints, or one each.");
    const JointVector values = gains.expand(n);
    for (int i = 0; i < n; ++i)
        if (!(values[i] >= 0.0) || std::isinf(values[i]))
            throw badInput(place,
                           "the gain of joint " + std::to_string(i) + " is " +
                               detail::formatNumber(values[i]) + "; allowed is [0, inf)",
                           "Without the robust loop: leave it out.");
    return values;
}

}  // namespace

void Nric::configure(const RunSetup& setup, const Parameters& parameters) {
    configure(setup, NricOptions{parameters.jointNumbers("k_r"), parameters.jointNumbers("k_p"),
                                 parameters.jointNumbers("k_i")});
}

void Nric::configure(const RunSetup& setup, const NricOptions& options) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    kr_ = takeGains(options.kr, "kr", n_);
    kp_ = takeGains(options.kp, "kp", n_);
    ki_ = takeGains(options.ki, "ki", n_);
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
