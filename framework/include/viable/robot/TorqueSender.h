#pragma once

#include <memory>

#include "viable/robot/RobotDescription.h"

namespace viable {

/** The effect of a robot's own controller on the torques that it is sent. */
struct TorqueConvention {
    /** It adds the torque that holds the arm against gravity: what is sent is without (libfranka, for one). */
    bool addsGravity = false;
    /** It adds what friction takes: the arm moves as if it had none, and the figures in RobotDescription::actuation are
    what its motors need for that. */
    bool addsFriction = false;
    /** Fastest change of what is sent that it accepts [Nm/s, prismatic: N/s]; > 0 (Panda: 1000). */
    PerJoint torqueRate = std::numeric_limits<double>::infinity();
};

/** The arm as such a robot shows it. If the robot adds friction itself, the arm has no friction, and its motors are
weaker by the largest friction. Throws Error (BadInput) where nothing is left of a motor. */
RobotDescription withConvention(RobotDescription robot, const TorqueConvention& convention);

/** Makes of the torque that the motors shall give what a robot is to be sent: for plants and loops of one's own.
Guarantees: the sent torque changes by no more than torqueRate x tick per call, from the torque that holds the arm at
rest. This comes before the motors' limits where a pose that changes makes both impossible.
Real time: no allocation, lock or throw after construction. */
class TorqueSender {
public:
    /** Throws Error (BadInput) for a rate that is not above 0 or of the wrong number. @param robot  see withConvention() */
    TorqueSender(const RobotDescription& robot, const TorqueConvention& convention, double tick_s);
    ~TorqueSender();
    TorqueSender(TorqueSender&&) noexcept;
    TorqueSender& operator=(TorqueSender&&) noexcept;

    /** The robot holds the arm at rest at q. */
    void reset(const JointVector& q);
    /** The same, with the torque `held`, as the robot measures it in its own convention [Nm]. The first torque that
    is sent takes that over. The difference from the model's torque (payload, friction that holds, errors of the
    model) fades within blend_s, along half a cosine. The loop outside learns of it meanwhile. */
    void reset(const JointVector& q, const JointVector& held, double blend_s);

    /** @param q       joint positions, as read now [rad]
        @param torque  of the motors [Nm]: what is wanted; then what they give, within their limits
        @return        to be sent [Nm], valid until the next call */
    const JointVector& send(const JointVector& q, JointVector& torque);

    bool isRateLimited() const;  ///< the last torque changed as fast as it may

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
