#include "robot/RigidBody.h"

#include <Eigen/Eigenvalues>

#include "core/Text.h"

namespace viable::detail {

namespace {

/** Rounding of the eigenvalues, relative to their sum; Simbody's own checks are just above it. */
constexpr double kMomentTolerance = 1e-14;

}  // namespace

Eigen::Matrix3d calcPointInertia(const Eigen::Vector3d& p) {
    return p.squaredNorm() * Eigen::Matrix3d::Identity() - p * p.transpose();
}

BodyInertia transformBody(const Eigen::Isometry3d& placement, const BodyInertia& body) {
    const Eigen::Matrix3d R = placement.linear();
    return {body.mass, placement * body.com, R * body.inertia * R.transpose()};
}

BodyInertia mergeBodies(const BodyInertia& a, const BodyInertia& b) {
    if (a.mass == 0.0) return b;
    if (b.mass == 0.0) return a;
    BodyInertia sum;
    sum.mass = a.mass + b.mass;
    sum.com = (a.mass * a.com + b.mass * b.com) / sum.mass;
    sum.inertia =
        a.inertia + a.mass * calcPointInertia(a.com - sum.com) + b.inertia + b.mass * calcPointInertia(b.com - sum.com);
    return sum;
}

Eigen::Matrix3d makeAxisFrame(const Eigen::Vector3d& axis) {
    if (axis == Eigen::Vector3d::UnitZ()) return Eigen::Matrix3d::Identity();
    // Near -z, where the shortest turn is known to few digits only: half a turn about x, then to the other end.
    if (axis.z() < -0.5) return makeAxisFrame(-axis) * Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), axis).toRotationMatrix();
}

std::string findInertiaFault(const Eigen::Matrix3d& inertia, bool mustTurn) {
    const Eigen::Vector3d moments =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(inertia, Eigen::EigenvaluesOnly).eigenvalues();
    const double tolerance = kMomentTolerance * moments.cwiseAbs().sum();
    const std::string shown = "its principal moments are " + formatNumber(moments[0]) + ", " +
                              formatNumber(moments[1]) + " and " + formatNumber(moments[2]) + " kg m^2";
    if (moments[0] < -tolerance || (mustTurn && moments[0] <= tolerance))
        return "the inertia tensor is not positive definite: " + shown;
    if (moments[2] > moments[0] + moments[1] + tolerance)
        return "the inertia tensor belongs to no body: " + shown +
               ", and the largest is above the sum of the other two";
    return {};
}

}  // namespace viable::detail
