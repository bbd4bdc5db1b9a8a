
#include "Properties.h"
#include "Random.h"
#include "robot/DynamicsCheck.h"
#include "robot/SimbodyModel.h"

namespace viable {

namespace {

/** Counted as steps. */
constexpr int kStatesPerArm = 20;

Eigen::Vector3d drawVector(Random& random, double size) {
    return {random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size)};
}

/** Often a base axis, either way. */
Eigen::Vector3d drawAxis(Random& random) {
    if (random.chance(0.4)) return (random.chance(0.5) ? 1.0 : -1.0) * Eigen::Vector3d::Unit(random.integer(0, 2));
    return random.direction();
}

/** Three rods across each other, turned. */
BodyInertia drawBody(Random& random) {
    BodyInertia body;
    body.mass = random.logUniform(0.05, 50.0);
    body.com = drawVector(random, 0.3);
    const Eigen::Vector3d rods(random.logUniform(1e-5, 0.1), random.logUniform(1e-5, 0.1),
                               random.logUniform(1e-5, 0.1));
    const Eigen::Matrix3d R = Eigen::AngleAxisd(random.uniform(0.0, EIGEN_PI), drawAxis(random)).toRotationMatrix();
    const Eigen::Vector3d moments = Eigen::Vector3d::Constant(rods.sum()) - rods;
    body.inertia = body.mass * R * moments.asDiagonal() * R.transpose();
    return body;
}

/** Any tree of any joints. */
RobotDescription drawTree(Random& random) {
    RobotDescription robot;
    const int n = random.integer(1, kMaxJoints);
    const bool isChain = random.chance(0.4);
    const double sliding = random.chance(0.5) ? random.uniform(0.0, 1.0) : 0.0;
    robot.actuation.rotorInertia.setZero(n);
    for (int i = 0; i < n; ++i) {
        JointDescription joint;
        joint.name = "j" + std::to_string(i);
        joint.type = random.chance(sliding) ? JointType::Prismatic : JointType::Revolute;
        joint.parent = isChain ? i - 1 : random.integer(-1, i - 1);
        joint.placement = Eigen::Translation3d(drawVector(random, 0.5)) *
                          Eigen::AngleAxisd(random.uniform(-EIGEN_PI, EIGEN_PI), drawAxis(random));
        joint.axis = drawAxis(random);
        joint.body = drawBody(random);
        robot.joints.push_back(joint);
        if (random.chance(0.7)) robot.actuation.rotorInertia[i] = random.logUniform(1e-4, 10.0);
    }
    robot.toolParent = random.integer(0, n - 1);
    robot.toolPlacement = Eigen::Translation3d(drawVector(random, 0.3)) *
                          Eigen::AngleAxisd(random.uniform(-EIGEN_PI, EIGEN_PI), drawAxis(random));
    robot.gravity = drawVector(random, 10.0);
    return robot;
}

}  // namespace

bool checkDynamics(const Options& options) {
    Run run("dynamics", options);
    Figures differences;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        const RobotDescription robot = drawTree(random);
        const int n = robot.size();
        const ArmRecursion recursion(robot);
        SimbodyModel simbody(robot);
        JointVector q(n), qd(n);
        Dynamics expected, found;
        detail::DynamicsDifference worst;
        for (int k = 0; k < kStatesPerArm; ++k) {
            for (int i = 0; i < n; ++i) {
                q[i] = random.uniform(-4.0, 4.0);
                qd[i] = random.uniform(-5.0, 5.0);
            }
            simbody.calcDynamics(q, qd, expected);
            recursion.calcDynamics(q, qd, found);
            const auto difference = detail::compareDynamics(robot, q, qd, expected, found);
            if (!std::isnan(worst.size) && !(difference.size <= worst.size)) worst = difference;
        }
        run.addSteps(kStatesPerArm);
        differences.add(worst.size);
        if (!(worst.size <= detail::kDynamicsTolerance)) run.fail(worst.what, worst.size);
    }
    run.print();
    differences.print("largest difference from Simbody per arm, as a share of the scale");
    return run.isGood();
}

}  // namespace viable
