#include "robot/DynamicsCheck.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "robot/PoseSampling.h"
#include "robot/SimbodyModel.h"

namespace viable::detail {

namespace {

constexpr int kStates = 8;
constexpr std::uint64_t kSeed = 21;
/** Of the joints' velocities to either side [rad/s, m/s]. */
constexpr double kSpeed = 3.0;

/** Sizes of the terms that M, b and J are sums of. */
struct Scale {
    double length = 0.0;  // of the farthest part from the base [m]
    double mass;          // of all [kg]
    double weight = 0.0;  // with what the velocities add [N]

    Scale(const RobotDescription& robot, const JointVector& q, const JointVector& qd) : mass(robot.movingMass()) {
        double turning = 0.0, sliding = 0.0;
        std::array<double, kMaxJoints> reach{};
        for (int i = 0; i < robot.size(); ++i) {
            const JointDescription& joint = robot.joints[i];
            double& own = reach[i];
            own = joint.placement.translation().norm() + (robot.slides(i) ? std::abs(q[i]) : 0.0);
            if (joint.parent >= 0) own += reach[joint.parent];
            const double own_kg = joint.body.mass;
            const double gyration = own_kg > 0.0 ? std::sqrt(std::max(joint.body.inertia.trace(), 0.0) / own_kg) : 0.0;
            length = std::max(length, own + joint.body.com.norm() + gyration);
            if (i == robot.toolParent) length = std::max(length, own + robot.toolPlacement.translation().norm());
            (robot.slides(i) ? sliding : turning) += std::abs(qd[i]);
        }
        weight = mass * (robot.gravity.norm() + turning * (length * turning + 2.0 * sliding));
    }
};

void add(double difference, double scale, const char* what, int joint, DynamicsDifference& worst) {
    const double size = difference == 0.0 ? 0.0 : std::abs(difference) / scale;
    if (!(size <= worst.size) && !std::isnan(worst.size)) worst = {size, what, joint};
}

}  // namespace

DynamicsDifference compareDynamics(const RobotDescription& robot, const JointVector& q, const JointVector& qd,
                                   const Dynamics& expected, const Dynamics& found) {
    const Scale scale(robot, q, qd);
    const int n = robot.size();
    JointVector lever(n);
    for (int i = 0; i < n; ++i) lever[i] = robot.slides(i) ? 1.0 : scale.length;
    DynamicsDifference worst;
    for (int i = 0; i < n; ++i) {
        add(found.b[i] - expected.b[i], scale.weight * lever[i], "torque b", i, worst);
        add(found.gravity[i] - expected.gravity[i], scale.weight * lever[i], "gravity torque", i, worst);
        for (int j = 0; j < n; ++j) {
            const double rotor = i == j ? robot.actuation.rotorInertia[i] : 0.0;
            add(found.M(i, j) - expected.M(i, j), scale.mass * lever[i] * lever[j] + rotor, "inertia M", std::max(i, j),
                worst);
        }
        add((found.J.col(i) - expected.J.col(i)).head<3>().norm(), lever[i], "Jacobian", i, worst);
        add((found.J.col(i) - expected.J.col(i)).tail<3>().norm(), 1.0, "Jacobian", i, worst);
    }
    add((found.tool.position - expected.tool.position).norm(), scale.length, "pose", -1, worst);
    // By matrices: q and -q are one orientation.
    add((found.tool.orientation.toRotationMatrix() - expected.tool.orientation.toRotationMatrix()).norm(), 1.0, "pose",
        -1, worst);
    return worst;
}

void checkRecursion(const RobotDescription& robot, const ArmRecursion& recursion, const std::string& where) {
    SimbodyModel simbody(robot);
    std::mt19937_64 random(kSeed);
    const int n = robot.size();
    JointVector reach(n);
    for (int i = 0; i < n; ++i) reach[i] = getFreeReach(robot.joints[i].type);
    const JointBounds poses = makeFinite(robot.limits.position, reach);
    const JointBounds velocities{JointVector::Constant(n, -kSpeed), JointVector::Constant(n, kSpeed)};
    Dynamics expected, found;
    for (int k = 0; k < kStates; ++k) {
        const JointVector q = drawPose(poses, random), qd = drawPose(velocities, random);
        simbody.calcDynamics(q, qd, expected);
        recursion.calcDynamics(q, qd, found);
        const DynamicsDifference worst = compareDynamics(robot, q, qd, expected, found);
        if (worst.size <= kDynamicsTolerance) continue;
        const std::string part = worst.joint < 0 ? "the tool" : "joint `" + robot.joints[worst.joint].name + "`";
        throw badInput(where,
                       "the recursive dynamics differ from Simbody's: the " + std::string(worst.what) + " of " + part +
                           " by " + formatNumber(worst.size) + " of its size (rounding is below " +
                           formatNumber(kDynamicsTolerance) + ") at q = " + formatList(q),
                       "This is a fault of the program, not of the robot: please report it with the robot's folder.");
    }
}

}  // namespace viable::detail
