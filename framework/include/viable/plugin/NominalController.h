#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

/** Input of a controller in a tick. */
struct ControllerInput {
    const MotionCommand& command;
    const MotionState& nominal;  ///< the nominal arm's state
    const Dynamics& dynamics;    ///< there
    Tick tick{};
};

/** Output of a controller in a tick; vectors have one finite entry per joint. */
struct ControllerOutput {
    JointVector torque;  ///< tau_d [Nm]
    /** The time derivative of the acceleration that `torque` gives, M^-1 (tau_d - b), by the controller's own law
    [rad/s^3]. A filter then takes it in place of a difference quotient (paper, eq. 14 and Remark 1). */
    JointVector accelerationRate;
    bool hasAccelerationRate = false;  ///< false at every call: for controllers that do not know it
};

/** The output of a controller that knows the jerk it wants in this tick [rad/s^3]. It is the torque of the present
acceleration, with the jerk as its derivative. (14) makes exactly that jerk of it. */
inline void askForJerk(const ControllerInput& input, const JointVector& jerk, ControllerOutput& output) {
    calcInverseDynamics(input.dynamics, input.nominal.qdd, output.torque);
    output.accelerationRate = jerk;
    output.hasAccelerationRate = true;
}

/** The commands that a controller can follow. The host asks once, after configure(). */
struct ControllerTraits {
    bool followsJoint = false, followsTool = false;

    bool follows(MotionCommand::Space space) const {
        return space == MotionCommand::Space::Joint ? followsJoint : followsTool;
    }
};

/** Any torque controller; it sees the nominal arm, not the real one. */
class NominalController : public Plugin {
public:
    using Traits = ControllerTraits;
    virtual ControllerTraits traits() const = 0;

    /** The torque that it would like, without regard to limits. The host substitutes the last good torque for
    kMaxSubstitutedTicks ticks where the status is not Ok or the output not usable, then brakes. */
    virtual TickStatus compute(const ControllerInput& input, ControllerOutput& output) = 0;
};

}  // namespace viable
