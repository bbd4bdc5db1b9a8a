#pragma once

#include "viable/plugin/NominalController.h"

namespace viable {

/** Pulls the tool towards the commanded pose like a spring and damper in task space.

Method: by natural frequency w and damping ratio z, with the tool's inertia L = (J M^-1 J^T)^-1 (Khatib, IEEE J. Robotics
and Automation 3, 1987), bounded near singular poses; what the tool does not show of the motion is damped:
    tau_d = J^T L (w^2 e + 2 z w de) + b - 2 z w M (qd - M^-1 J^T L J qd)
or with constant matrices, as the paper:
    tau_d = J^T K e + J^T D de + s g(q) - c (1 - w / w0)^2 diag(M) qd           (paper, eqs. 27, 28)
e: position error [m] and orientation error [rad] (rotation vector from the tool to the command, base
frame), de = commanded twist - J qd. s = 1 with gravity compensation: the paper's (27) has none.
The last term acts near singular poses only, where manipulability w = sqrt(det J J^T) < w0 (Nakamura
and Hanafusa 1986 use the same factor to damp an inverse) and J^T D J no longer damps every motion.

The orientation error follows the command through half a turn without a jump: it leaves the short way
round only when the error has passed 3/2 pi, not at pi, where noise would flip it back and forth.
Real time: no allocation, lock or throw after configure(). */
class TaskSpacePd : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    ControllerTraits traits() const override { return {false, true}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    bool shape(const Dynamics& dynamics, const JointVector& qd, const Vector6& error, const Vector6& errorRate,
               const Vector6& twist, JointVector& torque) const;
    Eigen::Vector3d calcOrientationError(const Eigen::Quaterniond& desired, const Eigen::Quaterniond& present);

    int n_ = 0;
    bool isShaped_ = false;
    double frequency_ = 0.0, dampingRate_ = 0.0;  // [rad/s, 1/s], where shaped
    Vector6 stiffness_, damping_;
    double gravityShare_ = 1.0;
    double singularThreshold_ = 0.0;
    double singularDamping_ = 0.0;
    Eigen::Quaterniond lastError_ = Eigen::Quaterniond::Identity();
};

}  // namespace viable
