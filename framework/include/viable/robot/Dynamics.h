#pragma once

#include "viable/core/JointTypes.h"

namespace viable {

/** The rigid-body dynamics at (q, qd), for one tick:
    tau = M(q) qdd + b(q, qd)                                                      (paper, eq. 1)
M and b describe the nominal arm with its reflected rotor inertias and without friction. */
struct Dynamics {
    JointMatrix M;        ///< joint-space inertia incl. rotor inertia, symmetric, [kg m^2]
    JointVector b;        ///< Coriolis, centrifugal and gravity torque, [Nm]
    JointVector gravity;  ///< the gravity part of b, [Nm]
    Pose tool;            ///< pose of the tool frame in the base frame
    ToolJacobian J;       ///< tool twist (linear, angular; base frame) = J qd
};

/** Mean distance of the tool from the joints' axes [m]; 1 where nothing turns. It is the size of the linear part of
J over that of the angular one. At this length an error of 1 rad weighs as much as it moves the tool. */
double calcLeverArm(const ToolJacobian& J);

/** True when every member belongs to n joints and is finite. */
bool isFinite(const Dynamics& dynamics, int n);

/** Torques and accelerations are clamped to this, so that no torque overflows what is computed from
it [Nm, rad/s^2]. */
inline constexpr double kLargestAcceleration = 1e100;

/** The acceleration that `torque` causes: qdd = M^-1 (tau - b), by L D L^T, at most kLargestAcceleration. No
allocation.
Returns false, with an unusable `qdd`, when M is not positive definite or an input is not finite. */
bool calcForwardDynamics(const Dynamics& dynamics, const JointVector& torque, JointVector& qdd);

/** The torque that causes `qdd`: tau = M qdd + b. No allocation. */
void calcInverseDynamics(const Dynamics& dynamics, const JointVector& qdd, JointVector& torque);

}  // namespace viable
