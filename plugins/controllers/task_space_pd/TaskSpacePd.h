#pragma once

#include "viable/plugin/NominalController.h"

namespace viable {

struct TaskSpacePdOptions {
    double frequency = 10.0, dampingRatio = 2.0;
    std::optional<Vector6> stiffness, damping;
    bool carriesGravity = true;
    double singularThreshold = 0.01, singularDamping = 20.0;

    template <class V>
    void describe(V& v) {
        v(frequency, "natural_frequency_radps", "rad/s",
          "How fast the tool answers in every direction, shaped with its inertia; where stiffness is auto.")
            .above(0)
            .upTo(1e4);
        v(dampingRatio, "damping_ratio", "",
          "1: critical; more stands a jerk limit better, which is a lag; where stiffness is auto.")
            .atLeast(0)
            .upTo(100);
        v(stiffness, "stiffness", "N/m, Nm/rad",
          "K: three linear, three angular entries, base frame axes; auto: from the two above.")
            .atLeast(0)
            .orAuto();
        v(damping, "damping", "Ns/m, Nms/rad",
          "D: three linear, three angular entries, base frame axes; auto: likewise.")
            .atLeast(0)
            .orAuto();
        v(carriesGravity, "gravity_compensation", "Add the arm's gravity torque.");
        v(singularThreshold, "singular_threshold", "",
          "w0: manipulability sqrt(det J J^T) below which joint damping is added; 0 never.")
            .atLeast(0);
        v(singularDamping, "singular_damping", "1/s", "c: rate of that damping at the singular pose itself.")
            .atLeast(0);
    }
};

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
    void reset(const MotionState&) override { lastError_ = Eigen::Quaterniond::Identity(); }
    ControllerTraits traits() const override { return {false, true}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    bool shape(const Dynamics& dynamics, const JointVector& qd, const Vector6& error, const Vector6& errorRate,
               const Vector6& twist, JointVector& torque) const;
    Eigen::Vector3d calcOrientationError(const Eigen::Quaterniond& desired, const Eigen::Quaterniond& present);

    int n_ = 0;
    bool isShaped_ = false;
    TaskSpacePdOptions options_;
    double dampingRate_ = 0.0;  // [1/s], where shaped
    double gravityShare_ = 1.0;
    Eigen::Quaterniond lastError_ = Eigen::Quaterniond::Identity();
};

}  // namespace viable
