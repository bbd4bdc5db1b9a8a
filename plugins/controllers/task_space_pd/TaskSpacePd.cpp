#include "TaskSpacePd.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "viable/core/Error.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number("natural_frequency_radps", "rad/s", "10",
                      "How fast the tool answers in every direction, shaped with its inertia; where stiffness is auto.")
        .above(0)
        .upTo(1e4),
    parameter::number("damping_ratio", "", "2.0",
                      "1: critical; more stands a jerk limit better, which is a lag; where stiffness is auto.")
        .atLeast(0)
        .upTo(100),
    parameter::numbers("stiffness", "N/m, Nm/rad", 6, 6, "auto",
                       "K: three linear, three angular entries, base frame axes; auto: from the two above.")
        .atLeast(0)
        .orAuto(),
    parameter::numbers("damping", "Ns/m, Nms/rad", 6, 6, "auto",
                       "D: three linear, three angular entries, base frame axes; auto: likewise.")
        .atLeast(0)
        .orAuto(),
    parameter::flag("gravity_compensation", "true", "Add the arm's gravity torque."),
    parameter::number("singular_threshold", "", "0.01",
                      "w0: manipulability sqrt(det J J^T) below which joint damping is added; 0 never.")
        .atLeast(0),
    parameter::number("singular_damping", "1/s", "20.0", "c: rate of that damping at the singular pose itself.")
        .atLeast(0),
};

using Matrix6 = Eigen::Matrix<double, 6, 6>;

/** Of the (geometric) mean mobility of translations, and of rotations: in directions in which the tool can hardly be moved it is taken
as this much, so that no force grows without bound near singular poses. */
constexpr double kLeastMobility = 0.01;
/** Where there is none at all [1/kg, 1/(kg m^2)]. */
constexpr double kNoMobility = 1e-9;

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
    const std::vector<double>&stiffness = parameters.numbers("stiffness"), &damping = parameters.numbers("damping");
    if (stiffness.empty() != damping.empty())
        throw badInput(parameters.place(stiffness.empty() ? "damping" : "stiffness"),
                       "stiffness and damping belong together, and one of them is auto",
                       "Give both, or neither and natural_frequency_radps and damping_ratio.");
    isShaped_ = stiffness.empty();
    if (isShaped_) {
        frequency_ = parameters.number("natural_frequency_radps");
        dampingRate_ = 2.0 * parameters.number("damping_ratio") * frequency_;
    } else {
        stiffness_ = Eigen::Map<const Vector6>(stiffness.data());
        damping_ = Eigen::Map<const Vector6>(damping.data());
    }
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

/** tau = J^T F + b - c M qd_0, F = L (w^2 e + 2 z w de), with L of a bounded inverse, and qd_0 what of the motion the tool
does not show. False where M is not positive definite. */
bool TaskSpacePd::shape(const Dynamics& dynamics, const JointVector& qd, const Vector6& error, const Vector6& errorRate,
                        const Vector6& twist, JointVector& torque) const {
    const Eigen::LLT<JointMatrix> inertia(dynamics.M);
    if (inertia.info() != Eigen::Success) return false;
    Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxJoints, 6> mobile = dynamics.J.transpose();
    inertia.solveInPlace(mobile);  // M^-1 J^T
    Matrix6 mobility;
    mobility.noalias() = dynamics.J.lazyProduct(mobile);
    for (const int block : {0, 3}) {
        const auto diagonal = mobility.diagonal().segment<3>(block).array();
        const double mean = std::cbrt(diagonal.max(kNoMobility).prod());
        mobility.diagonal().segment<3>(block).array() += kLeastMobility * mean + kNoMobility;
    }
    const Eigen::LLT<Matrix6> tool(mobility);
    Vector6 force = frequency_ * frequency_ * error + dampingRate_ * errorRate;
    tool.solveInPlace(force);
    Vector6 momentum = twist;
    tool.solveInPlace(momentum);
    JointVector rest = qd;
    rest.noalias() -= mobile.lazyProduct(momentum);
    torque = dynamics.b - (1.0 - gravityShare_) * dynamics.gravity;
    torque.noalias() += dynamics.J.transpose().lazyProduct(force);
    torque.noalias() -= dampingRate_ * dynamics.M.lazyProduct(rest);
    return true;
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
    JointVector& torque = output.torque;
    if (isShaped_) {
        if (!shape(dynamics, nominal.qd, error, command.toolTwist - twist, twist, torque)) return TickStatus::Faulted;
        return TickStatus::Ok;
    }
    const Vector6 wrench = stiffness_.cwiseProduct(error) + damping_.cwiseProduct(command.toolTwist - twist);
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
