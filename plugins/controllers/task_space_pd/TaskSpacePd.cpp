#include "TaskSpacePd.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::numbers("stiffness", "N/m, Nm/rad", 6, 6, "[600, 600, 600, 160, 160, 160]",
                       "K: three linear, three angular entries, base frame axes.")
        .atLeast(0),
    parameter::numbers("damping", "Ns/m, Nms/rad", 6, 6, "[60, 60, 60, 16, 16, 16]",
                       "D: three linear, three angular entries, base frame axes.")
        .atLeast(0),
    parameter::flag("gravity_compensation", "true", "Add the arm's gravity torque."),
    parameter::number("singular_threshold", "", "0.01",
                      "w0: manipulability sqrt(det J J^T) below which joint damping is added; 0 never.")
        .atLeast(0),
    parameter::number("singular_damping", "1/s", "20.0", "c: rate of that damping at the singular pose itself.")
        .atLeast(0),
};

/** sqrt(det J J^T), or sqrt(det J^T J) for arms with fewer than six joints. */
double calcManipulability(const ToolJacobian& J) {
    if (J.cols() >= 6) {
        Eigen::Matrix<double, 6, 6> square;
        square.noalias() = J.lazyProduct(J.transpose());
        return std::sqrt(std::max(0.0, square.determinant()));
    }
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6> square(J.cols(), J.cols());
    square.noalias() = J.transpose().lazyProduct(J);
    return std::sqrt(std::max(0.0, square.determinant()));
}

}  // namespace

void TaskSpacePd::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    stiffness_ = Eigen::Map<const Vector6>(parameters.numbers("stiffness").data());
    damping_ = Eigen::Map<const Vector6>(parameters.numbers("damping").data());
    gravityShare_ = parameters.flag("gravity_compensation") ? 1.0 : 0.0;
    singularThreshold_ = parameters.number("singular_threshold");
    singularDamping_ = parameters.number("singular_damping");
}

void TaskSpacePd::reset(const MotionState&) {
    lastError_ = Eigen::Quaterniond::Identity();
}

Eigen::Vector3d TaskSpacePd::calcOrientationError(const Eigen::Quaterniond& desired,
                                                  const Eigen::Quaterniond& present) {
    Eigen::Quaterniond error = desired * present.conjugate();
    if (error.dot(lastError_) < 0.0) error.coeffs() = -error.coeffs();
    constexpr double kCosOfThreeQuarterPi = -0.70710678118654752;  // w = cos(angle / 2)
    if (error.w() < kCosOfThreeQuarterPi) error.coeffs() = -error.coeffs();
    lastError_ = error;
    const double sine = error.vec().norm();
    const double angle = 2.0 * std::atan2(sine, error.w());
    const double factor = sine > 1e-9 ? angle / sine : 2.0;
    return factor * error.vec();
}

TickStatus TaskSpacePd::compute(const ControllerInput& input, ControllerOutput& output) {
    const auto& [command, nominal, dynamics, tick] = input;
    const double norm = command.tool.orientation.norm();
    if (command.space != MotionCommand::Space::Tool || !command.tool.position.allFinite() ||
        !(norm > 0.5 && norm < 2.0) || !command.toolTwist.allFinite() || !isFinite(nominal, n_) ||
        !isFinite(dynamics, n_))
        return TickStatus::InvalidInput;

    Vector6 error;
    error.head<3>() = command.tool.position - dynamics.tool.position;
    error.tail<3>() = calcOrientationError(command.tool.orientation.normalized(), dynamics.tool.orientation);
    Vector6 twist;
    twist.noalias() = dynamics.J.lazyProduct(nominal.qd);
    const Vector6 wrench = stiffness_.cwiseProduct(error) + damping_.cwiseProduct(command.toolTwist - twist);

    JointVector& torque = output.torque;
    torque = gravityShare_ * dynamics.gravity;
    torque.noalias() += dynamics.J.transpose().lazyProduct(wrench);
    if (singularThreshold_ > 0.0) {
        const double distance = 1.0 - calcManipulability(dynamics.J) / singularThreshold_;
        if (distance > 0.0)
            torque -= singularDamping_ * distance * distance * dynamics.M.diagonal().cwiseProduct(nominal.qd);
    }
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::TaskSpacePd, "task_space_pd",
              "Task-space spring and damper at the tool (the paper's teleoperation).", viable::kParameters)
