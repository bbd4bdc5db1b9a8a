#include "TaskSpacePd.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

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
    options_ = parameters.get<TaskSpacePdOptions>();
    isShaped_ = !options_.stiffness;
    if (isShaped_ == options_.damping.has_value())
        throw badInput(parameters.place(isShaped_ ? "damping" : "stiffness"),
                       "stiffness and damping belong together, and one of them is auto",
                       "Give both, or neither and natural_frequency_radps and damping_ratio.");
    dampingRate_ = 2.0 * options_.dampingRatio * options_.frequency;
    gravityShare_ = options_.carriesGravity ? 1.0 : 0.0;
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
    Vector6 force = options_.frequency * options_.frequency * error + dampingRate_ * errorRate;
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
    const Vector6 wrench =
        options_.stiffness->cwiseProduct(error) + options_.damping->cwiseProduct(command.toolTwist - twist);
    torque = gravityShare_ * dynamics.gravity;
    torque.noalias() += dynamics.J.transpose().lazyProduct(wrench);
    if (options_.singularThreshold > 0.0) {
        const double distance = 1.0 - calcManipulability(dynamics.J) / options_.singularThreshold;
        if (distance > 0.0)
            torque -= options_.singularDamping * distance * distance * dynamics.M.diagonal().cwiseProduct(nominal.qd);
    }
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::TaskSpacePd, "task_space_pd",
              "Task-space spring and damper at the tool (the paper's teleoperation).", viable::TaskSpacePdOptions)
