#pragma once

#include "viable/plugin/RobustLoop.h"

namespace viable {

/** Enough margin of a sampled loop. It stays stable with its torque times or divided by kEnoughGain (6 dB), and
turned in phase by kEnoughPhase_rad (35 degrees). */
inline constexpr double kEnoughGain = 2.0, kEnoughPhase_rad = 0.6109;

/** How far a robust loop is from instability, in the poses where it is nearest to it. */
struct LoopMargins {
    bool isStable = false;
    double gain = 1.0;       ///< least factor >= 1: the torque of all joints, times or divided by it, is too much
    double phase_rad = 0.0;  ///< least phase by which it may be turned
    int joint = 0;           ///< the joint that takes most part in that

    bool isEnough() const { return isStable && gain >= kEnoughGain && phase_rad >= kEnoughPhase_rad; }
};

/** The margins of `loop` on an arm.

Method: around a pose the sampled loop is M edd = tau_a. It reads e in every tick and takes its velocity as the
difference of two readings. It holds tau_a for a tick, `delayTicks` later. The loop's poles tell whether it is stable.
The eigenvalue loci of the open loop, n x n, over the unit circle give the margins where they pass -1. These are margins
against changes of all joints alike (MacFarlane and Postlethwaite, Int. J. Control 25, 1977). The poses are some of a
fixed sample of 256 within the limits. They have the poles that lie farthest out, and the fastest and the slowest mode
of M^-1 K_r.
Assumes: inertias as described; no friction, which only adds to the distance. Limits of the loop's torque do not act.
Not for a loop: it takes some 0.1 s. */
LoopMargins calcMargins(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks,
                        const LinearErrorLoop& loop);

/** Gains that an arm can carry in every pose within its position limits, with enough margin.

Method: K_r follows the inertia (LinearErrorLoop::inertiaRate), so that in every pose every velocity error decays alike.
The rate is half of what makes the sampled loop unstable, c / (2 dt) with c = 2 tan(pi / (4 + 4 delay)). It is lowered
until calcMargins() is enough. A payload makes the real arm heavier and the loop slower, which adds to that distance.
K_p is a tenth of that rate, at most 100 1/s, and K_i a tenth of K_p^2. Real arms have flexible joints. So the loop is
never stiffer than the paper's 600, 20 and 8 on the Indy7: K_r < 600 Nms/rad. At each joint's greatest inertia, K_r K_p
<= 600 x 20 and K_r K_i <= 600 x 8.
@param given  gains of size 0 are computed; the others, and the bounds, are kept. A given k_r is constant, and the
others follow from it as in scaleNric(), lowered until the margins are enough
@return       one gain per joint; finite. A gain that is not given is zero for an arm without a usable inertia matrix
Not for a loop: it takes some 0.2 s. */
LinearErrorLoop scaleGains(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks = 0,
                           const LinearErrorLoop& given = {});

/** Constant k_r of every joint with which the velocity part of such a loop just becomes unstable in some pose
[Nms/rad]. It is as large for each joint as its own least inertia allows, and zero for an arm without a usable
inertia matrix. */
JointVector findLargestGains(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks);

/** "3.1 dB and 24 degrees". */
std::string formatMargins(const LoopMargins& margins);

}  // namespace viable
