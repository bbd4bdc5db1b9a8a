#pragma once

#include <array>
#include <complex>
#include <vector>

#include "viable/core/JointTypes.h"

namespace viable::detail {

/** The error between real and nominal arm under Nric, tick by tick, around an inertia that stands still:
    M edd = tau_a - D de + w,   tau_a(k) = -K_r (de_m + K_p e_m + K_i sum of e_m dt),  held for a tick
with e_m the read position error and de_m its difference over a tick. */
struct FrozenLoop {
    JointMatrix inertia;  ///< of the real arm, rotors included
    JointVector damping;  ///< D, the arm's own [Nms/rad]
    JointMatrix kr;       ///< K_r, diagonal or not [Nms/rad]
    JointVector kp, ki;   ///< as NricOptions
    double tick_s = 0.0;
    int delayTicks = 0;  ///< from tau_a to the motors
};

/** What the loop is watched at, at the ticks. */
enum class LoopOutput { Position, Velocity, Torque, TorqueStep, IntegralTorque };
inline constexpr int kLoopOutputs = 5;

/** Peak gains, one matrix (joint of the output x joint of the input) per LoopOutput: the largest output that an input
of size 1 can cause, |out_i| <= sum_j gain_ij |in_j| (the l1 norm of the impulse response: Desoer and Vidyasagar,
Feedback Systems, 1975; Dahleh and Pearson, IEEE TAC 32, 1987). */
struct LoopGains {
    using PerOutput = std::array<Eigen::MatrixXd, kLoopOutputs>;
    PerOutput torque;  ///< of w, a torque that varies in any way, also within ticks
    PerOutput step;    ///< of w constant from the start
    /** For each of the asked ages: `torque` of what is no older, `step` from that age on. */
    std::vector<PerOutput> earlyTorque, lateStep;
    /** Of the rate of w [1/s], for w = 0 at the start; for the torque and its integral's part: of what they lack to -w. */
    PerOutput ramp;
    PerOutput reading;  ///< of an error of the position reading, any at each tick and before the first
    /** Total variation of the response to w, and that times its age [s], by spans of age, later ones longer: what an
    inertia does that was another in the past. */
    struct Variation {
        PerOutput total, aged;
    };
    std::vector<Variation> variations;
};

/** The pole of the loop over one tick with the largest absolute value. */
std::complex<double> calcOutermostPole(const FrozenLoop& loop);

/** Spectral radius of the loop over one tick: stable below 1. */
inline double calcSpectralRadius(const FrozenLoop& loop) {
    return std::abs(calcOutermostPole(loop));
}

/** Needs a stable loop. Response and integrals by the trapezoid rule: over ticks while the response is fast, over more
ticks at a time once all that turns fast has died out, until they add no more than 1e-6. `torque` is infinite where a
response takes more than 16,000 ticks to die out.
@param ages  growing [s] */
LoopGains calcGains(const FrozenLoop& loop, const std::vector<double>& ages = {});

}  // namespace viable::detail
