#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

/** Any torque controller; it sees the nominal arm, not the real one. */
class NominalController : public Plugin {
public:
    /** Can it follow commands in this space? Asked before the run. */
    virtual bool follows(MotionCommand::Space space) const = 0;

    /** The torque tau_d [Nm] that it would like, without regard to limits. On Ok, `torque` has one
    finite entry per joint. The host substitutes the last good torque for kMaxSubstitutedTicks ticks
    otherwise, then brakes. */
    virtual TickStatus compute(const MotionCommand& command, const MotionState& nominal, const Dynamics& dynamics,
                               JointVector& torque) = 0;
};

}  // namespace viable
