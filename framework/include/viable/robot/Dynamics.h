#pragma once

#include "viable/core/JointTypes.h"

namespace viable {

/** What one tick needs to know of the rigid-body dynamics at (q, qd):
    tau = M(q) qdd + b(q, qd)                                                      (paper, eq. 1)
M and b describe the nominal arm with its reflected rotor inertias and without friction. */
struct Dynamics {
    JointMatrix M;        ///< joint-space inertia incl. rotor inertia, symmetric, [kg m^2]
    JointVector b;        ///< Coriolis, centrifugal and gravity torque, [Nm]
    JointVector gravity;  ///< the gravity part of b, [Nm]
    Pose tool;            ///< pose of the tool frame in the base frame
    ToolJacobian J;       ///< tool twist (linear, angular; base frame) = J qd
};

}  // namespace viable
