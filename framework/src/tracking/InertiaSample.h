#pragma once

#include <complex>

#include "robot/PoseSampling.h"
#include "viable/plugin/RobustLoop.h"

namespace viable::detail {

/** However heavy the arm: what the paper's gains come to on a real Indy7, K_r, K_r K_p and K_r K_i
[Nms/rad, Nm/rad, Nm/(rad s)]. Real arms have flexible joints. */
inline constexpr double kStiffest = 600.0, kStiffestPosition = 600.0 * 20.0, kStiffestIntegral = 600.0 * 8.0;

/** And K_p however light the arm [1/s], as in experiments/panda_asymmetric_limits.yaml. */
inline constexpr double kFastestPosition = 100.0;

/** Poses in which the margins of a loop are looked for. */
inline constexpr int kMarginPoses = 256;

/** What the joints move over those poses, at least one of them. */
struct InertiaRange {
    JointVector least;     ///< with the other joints free, min 1 / (M^-1)_ii [kg m^2]
    JointVector greatest;  ///< max M_ii [kg m^2]
    double fastest = 0.0;  ///< largest eigenvalue of M^-1 diag(least)
};
InertiaRange findInertiaRange(const std::vector<PoseInertia>& samples);

/** Not active, or one number for each of n joints: torques finite and at least 0, velocities finite and above 0. */
bool isSound(const FrictionFeed& feed, int n);

/** Friction to be fed forward, without the rest of a feed that is not active. Throws Error (BadInput) where it does not fit n
joints. */
FrictionFeed expandFriction(const FrictionFeed& feed, int n);

/** K_r at the inertia M. No allocation. */
JointMatrix calcLoopGain(const LinearErrorLoop& loop, const JointMatrix& M);

/** The outermost pole of the sampled loop around a pose, over one tick: unstable from the size limitRadius() on. */
std::complex<double> calcOutermostPole(const LinearErrorLoop& loop, const PoseInertia& pose, double tick_s,
                                       int delayTicks);

/** 1, or a little more where a gain is zero: what it leaves alone stays where it is, poles at 1 but for rounding. */
double limitRadius(const LinearErrorLoop& loop);

/** Of not empty samples the poses in which a loop is nearest to instability: those of the fastest and the slowest mode of
M^-1 K_r and, with `looksEverywhere`, some whose poles lie farthest out. With a delay these are found by the poles at a
tick that is longer by the delay. Pointers into `samples`. */
std::vector<const PoseInertia*> findCriticalPoses(const std::vector<PoseInertia>& samples, const LinearErrorLoop& loop,
                                                  double tick_s, int delayTicks, bool looksEverywhere = true);

/** scaleNric() as a law, for a delay. */
LinearErrorLoop scaleConstantGains(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                                   int delayTicks = 0);

/** "k_r: [10.1, 4], k_p: [20, 20], k_i: [8, 8]": constant gains as the block of a robust loop takes them. */
std::string formatGains(const LinearErrorLoop& loop);

/** The mode of M^-1 K_r dt from which on the velocity loop, by differences over a tick and `delayTicks` later, is unstable:
its phase is -90 degrees - (1 + d) omega dt, its size c / (2 tan(omega dt / 2)). */
double calcLargestMode(int delayTicks);

}  // namespace viable::detail
