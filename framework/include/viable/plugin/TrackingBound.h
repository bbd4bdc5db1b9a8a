#pragma once

#include <string>
#include <vector>

#include "viable/core/PerJoint.h"
#include "viable/plugin/Nric.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** What the real arm may have that the nominal one has not: the set of disturbances that a TrackingBound
is for. All at once, in any combination, changing at any time within these sizes. Names and meaning are those
of the parameters of the simulated plants. */
struct DisturbanceSet {
    PerJoint frictionScale = 1.0;  ///< largest factor on the robot's friction figures; 0: no friction
    double breakawayRatio = 1.0;   ///< largest Fs / Fc
    PerJoint loadFriction = 0.0;   ///< friction per torque that the joint carries []
    PerJoint massError = 0.0;      ///< mass_factor lies in [1 - massError, 1 + massError]
    double payload_kg = 0.0;       ///< largest
    double payloadOffset_m = 0.0;  ///< farthest from the tool frame's origin
    double baseTilt_rad = 0.0;     ///< largest angle of the base against the vertical
    PerJoint torqueRipple_Nm = 0.0;
    PerJoint externalTorque_Nm = 0.0;  ///< pushes that are not fed to the nominal arm
    double torqueLimitFactor = 1.0;    ///< least motor torque over the robot's figure
    double encoderNoise_rad = 0.0;     ///< largest error of a reading besides its rounding to counts
    bool exactEncoder = false;         ///< readings are not rounded
    int delayTicks = 0;                ///< between the computed torque and the motors
};

/** How far the real arm can get from the nominal one at a tick, within a disturbance set. */
struct TrackingBound {
    JointVector position;  ///< of |q_real - q_nominal|, the true one [rad]
    JointVector velocity;  ///< of its rate [rad/s]
    JointVector measured;  ///< of |e| as the encoders show it: where a run trips [rad]
    JointVector torque;    ///< of |tau_c + tau_a|: what the motors must be able to give [Nm]
    JointVector torqueStep;  ///< of the change of tau_a in a tick [Nm]

    /** One source of error and what it adds to the position bound [rad]. */
    struct Part {
        std::string source;
        JointVector torque;    ///< largest torque that it puts on each joint [Nm]
        JointVector position;  ///< [rad]
    };
    std::vector<Part> parts;
};

}  // namespace viable
