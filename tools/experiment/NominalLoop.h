#pragma once

#include "experiment/ConfiguredCase.h"

namespace viable::detail {

/** A nominal arm that its controller and its filter do not bring to rest. */
struct NominalSwing {
    int joint = 0;           ///< that moves most
    double stiffness = 0.0;  ///< of the controller's feedback there, per inertia [1/s^2]
    double damping = 0.0;    ///< likewise [1/s]
    bool needsJerk = false;  ///< with unlimited jerk and acceleration it comes to rest
    double jerk = 0.0;       ///< limit of the joint [rad/s^3]
};

/** Does the nominal arm come to rest at the start, each joint displaced by 5 mrad in turn, under a command that rests there?

Method: the acceleration that the controller's torque gives, as a function of position and velocity, is made linear by
difference quotients, the dynamics included. The sampled loop of it, of (14) with the filter's gamma where it has one, and of the
limits of jerk and acceleration of each joint is followed for 20 s: it swings where JointFollowing says so, where a joint
goes farther than a hundred times its displacement, or where the jerk at the end is more than a tenth of its limit, RMS.
Assumes: a controller's memory plays no part (it is reset before each quotient). Not asked: one that tells the jerk it wants,
which knows the limits. Empty, too, where a quotient cannot be had. The controller is reset. Throws Error (PluginFailed). */
std::optional<NominalSwing> findNominalSwing(const ConfiguredCase& configured);

}  // namespace viable::detail
