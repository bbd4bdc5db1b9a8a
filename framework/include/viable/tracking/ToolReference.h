#pragma once

#include <memory>
#include <optional>

#include "viable/core/JointLimits.h"
#include "viable/environment/ArmClearances.h"
#include "viable/qp/BoxQp.h"
#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

class ArmRecursion;

/** How a tool pose becomes a motion of the joints. */
struct ToolReferenceOptions {
    double rotationLength_m = 0.2;  ///< so far counts a rotation of 1 rad as an error; 0: the orientation is free
    double restRate = 0.0;          ///< how fast spare joints go to their rest posture [1/s]
    double apart_m = 0.0;           ///< nearer than this to obstacles or itself, spare joints lead the arm away
};

/** The joint positions whose tool is nearest to a commanded pose, within the joint position limits: integrated from
tick to tick, not solved anew, so that the arm stays in its branch and turns of more than half a turn are followed.

Method, per tick: minimise |W (J dq - error)|^2 + damping |dq|^2 + (spare joints) subject to the position limits and to
what the velocity limits allow in a tick, a box QP; the damping grows with the error that is left (Levenberg-Marquardt
with the residual as damping: Sugihara, IEEE Trans. Robotics 27, 2011), so that unreachable and singular poses are
approached without wild joint motion. Where the arm is nearer than apart_m to something, spare joints go away from it, in
the time in which they could stop if it is a whole apart_m too near.
Real time: no allocation, lock or throw after configure(). */
class ToolReference {
public:
    /** @param rest       where spare joints go
        @param geometry   null: apart_m has no effect; need not outlive this call
        @param recursion  of the robot, shared by many; null: one of its own */
    void configure(const RobotDescription& robot, const JointLimits& limits, double tick_s, const JointVector& rest,
                   const ToolReferenceOptions& options, const ArmGeometry* geometry = nullptr,
                   std::shared_ptr<const ArmRecursion> recursion = nullptr);
    void reset(const JointVector& q);
    /** From now on. */
    void changeLimits(const JointLimits& limits, const JointVector& rest);

    /** One tick towards `command`; its orientation is of unit length.
        @param surroundings  null: none are known
        @param time_s        of the run */
    void advance(const Pose& command, const Surroundings* surroundings = nullptr, double time_s = 0.0);
    const JointVector& q() const { return q_; }  ///< [rad]
    /** A joint went as fast as it may in the last tick: the command jumped, or is too fast. */
    bool isAtSpeedLimit() const { return isAtSpeedLimit_; }

private:
    void leadApart(const Surroundings* surroundings, double time_s);

    int n_ = 0;
    bool isAtSpeedLimit_ = false;
    double tick_s_ = 0.0;
    JointLimits limits_;
    ToolReferenceOptions options_;
    std::shared_ptr<const ArmRecursion> recursion_;
    Dynamics dynamics_;
    std::optional<ArmClearances> clearances_;
    double apartRate_ = 0.0;  ///< [1/s]
    BoxQp qp_;
    JointVector q_, rest_, still_, target_, lower_, upper_, step_, gradient_;
    JointMatrix normal_, factor_;
};

}  // namespace viable
