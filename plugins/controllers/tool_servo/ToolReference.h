#pragma once

#include <memory>

#include "viable/core/JointLimits.h"
#include "viable/qp/BoxQp.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** How a tool pose becomes a motion of the joints. */
struct ToolReferenceOptions {
    double rotationLength_m = 0.2;  ///< so far counts a rotation of 1 rad as an error
    double restRate = 0.0;          ///< how fast spare joints go to their rest posture [1/s]
};

/** The joint positions whose tool is nearest to a commanded pose, within the joint position limits: integrated from
tick to tick, not solved anew, so that the arm stays in its branch and turns of more than half a turn are followed.

Method, per tick: minimise |W (J dq - error)|^2 + damping |dq|^2 + (spare joints) subject to the position limits and to
what the velocity limits allow in a tick, a box QP; the damping grows with the error that is left (Levenberg-Marquardt
with the residual as damping: Sugihara, IEEE Trans. Robotics 27, 2011), so that unreachable and singular poses are
approached without wild joint motion.
Real time: no allocation, lock or throw after configure(). */
class ToolReference {
public:
    void configure(const RobotDescription& robot, const JointLimits& limits, double tick_s, const JointVector& rest,
                   const ToolReferenceOptions& options);
    void reset(const JointVector& q);

    /** One tick towards `command`; its orientation is of unit length. */
    void advance(const Pose& command);
    const JointVector& q() const { return q_; }  ///< [rad]
    /** A joint went as fast as it may in the last tick: the command jumped, or is too fast. */
    bool isAtSpeedLimit() const { return isAtSpeedLimit_; }

private:
    int n_ = 0;
    bool isAtSpeedLimit_ = false;
    double tick_s_ = 0.0;
    JointLimits limits_;
    ToolReferenceOptions options_;
    std::unique_ptr<RobotModel> model_;
    Dynamics dynamics_;
    BoxQp qp_;
    JointVector q_, rest_, still_, target_, lower_, upper_, step_, gradient_;
    JointMatrix normal_, factor_;
};

}  // namespace viable
