#include <Eigen/Cholesky>
#include <cmath>
#include <tuple>

#include "SampleArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

using Sample = std::tuple<const char*, DynamicsEngine>;

/** M, b, pose and Jacobian of every kind of arm by both engines against routes that share no formula with them. */
struct RobotModelTest : SampleArmTest, public ::testing::WithParamInterface<Sample> {
    RobotModelTest() : SampleArmTest(loadSampleArm(std::get<0>(GetParam())), 20240607, std::get<1>(GetParam())) {}

    RobotModel makeModel(const RobotDescription& robot) const { return {robot, std::get<1>(GetParam())}; }

    JointVector shift(const JointVector& q, int joint, double step) {
        JointVector shifted = q;
        shifted[joint] += step;
        return shifted;
    }
};

TEST_P(RobotModelTest, SimbodysForwardDynamicsInvertsTheTorque) {
    for (int sample = 0; sample < 1000; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0), qdd = draw(10.0);
        const Dynamics d = calc(q, qd);
        JointMatrix links = d.M;
        links.diagonal() -= robot_.actuation.rotorInertia;
        const JointVector tau = links * qdd + d.b, found = model_.calcLinkForwardDynamics(q, qd, tau);
        // Relative to the sizes that the solution is made of: light joints amplify the rounding of
        // the torques of heavy ones.
        ASSERT_LE((found - qdd).norm(), 1e-9 * qdd.norm()) << sample;
    }
}

TEST_P(RobotModelTest, InertiaIsSymmetricAndPositiveDefinite) {
    for (int sample = 0; sample < 200; ++sample) {
        const Dynamics d = calc(draw(3.0), draw(3.0));
        ASSERT_TRUE(isFinite(d, n_));
        ASSERT_EQ(d.M, JointMatrix(d.M.transpose()));
        ASSERT_EQ(Eigen::LLT<JointMatrix>(d.M).info(), Eigen::Success);
    }
}

TEST_P(RobotModelTest, RotorInertiaIsOnTheDiagonal) {
    RobotDescription bare = robot_;
    bare.actuation.rotorInertia.setZero();
    RobotModel links = makeModel(bare);
    const JointVector q = draw(2.0), qd = draw(2.0);
    Dynamics d;
    links.calcDynamics(q, qd, d);
    JointMatrix expected = d.M;
    expected.diagonal() += robot_.actuation.rotorInertia;
    EXPECT_EQ(calc(q, qd).M, expected);
    EXPECT_EQ(calc(q, qd).b, d.b);
}

TEST_P(RobotModelTest, VelocityTorqueIsMadeOfTheDerivativesOfM) {
    const double h = 1e-5;
    for (int sample = 0; sample < 20; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0);
        std::vector<JointMatrix> slope(n_);
        for (int k = 0; k < n_; ++k) slope[k] = (calc(shift(q, k, h), qd).M - calc(shift(q, k, -h), qd).M) / (2.0 * h);
        const Dynamics d = calc(q, qd);
        for (int i = 0; i < n_; ++i) {
            double christoffel = 0.0;
            for (int j = 0; j < n_; ++j)
                for (int k = 0; k < n_; ++k) christoffel += (slope[k](i, j) - 0.5 * slope[i](j, k)) * qd[j] * qd[k];
            ASSERT_NEAR(d.b[i] - d.gravity[i], christoffel, 1e-7) << i;
        }
    }
}

TEST_P(RobotModelTest, GravityIsTheSlopeOfThePotential) {
    const double h = 1e-5;
    const JointVector rest = JointVector::Zero(n_);
    for (int sample = 0; sample < 20; ++sample) {
        const JointVector q = draw(3.0);
        const Dynamics d = calc(q, draw(3.0));
        for (int i = 0; i < n_; ++i) {
            const double slope =
                (model_.calcEnergy(shift(q, i, h), rest) - model_.calcEnergy(shift(q, i, -h), rest)) / (2.0 * h);
            ASSERT_NEAR(d.gravity[i], slope, 1e-7) << i;
        }
    }
}

TEST_P(RobotModelTest, KineticEnergyIsHalfOfVelocityTimesMomentum) {
    const JointVector rest = JointVector::Zero(n_);
    for (int sample = 0; sample < 50; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0);
        const double kinetic = model_.calcEnergy(q, qd) - model_.calcEnergy(q, rest);
        const double expected = 0.5 * qd.dot(calc(q, qd).M * qd);
        ASSERT_NEAR(kinetic, expected, 1e-12 * (100.0 + expected));
    }
}

TEST_P(RobotModelTest, JacobianIsTheSlopeOfTheToolPose) {
    const double h = 1e-5;
    const JointVector rest = JointVector::Zero(n_);
    for (int sample = 0; sample < 20; ++sample) {
        const JointVector q = draw(3.0);
        const ToolJacobian J = calc(q, rest).J;
        ASSERT_EQ(J.cols(), n_);
        for (int i = 0; i < n_; ++i) {
            const Pose after = calc(shift(q, i, h), rest).tool;
            const Pose before = calc(shift(q, i, -h), rest).tool;
            const Eigen::Vector3d linear = (after.position - before.position) / (2.0 * h);
            const Eigen::AngleAxisd turn(after.orientation * before.orientation.conjugate());
            const Eigen::Vector3d angular = turn.angle() * turn.axis() / (2.0 * h);
            ASSERT_LT((J.col(i).head<3>() - linear).norm(), 1e-8) << i;
            ASSERT_LT((J.col(i).tail<3>() - angular).norm(), 1e-8) << i;
        }
    }
}

TEST_P(RobotModelTest, PayloadPullsAtTheTool) {
    const double mass = 1.7;
    const Eigen::Vector3d offset(0.03, -0.02, 0.11);
    RobotModel loaded = makeModel(withPayload(robot_, mass, offset));
    for (int sample = 0; sample < 50; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0);
        const Dynamics d = calc(q, qd);
        Dynamics with;
        loaded.calcDynamics(q, qd, with);
        const Eigen::Vector3d arm = d.tool.orientation * offset;
        ToolJacobian J = d.J;  // of the point where the mass is
        for (int i = 0; i < n_; ++i) {
            const Eigen::Vector3d axis = J.col(i).tail<3>();
            J.col(i).head<3>() += axis.cross(arm);
        }
        const Eigen::Vector3d weight = mass * robot_.gravity;
        JointVector expected = JointVector::Zero(n_);
        expected -= J.topRows<3>().transpose() * weight;
        ASSERT_LT((with.gravity - d.gravity - expected).norm(), 1e-11);
        const JointMatrix added = mass * J.topRows<3>().transpose() * J.topRows<3>();
        ASSERT_LT((with.M - d.M - added).norm(), 1e-11);
        ASSERT_TRUE(with.tool.position.isApprox(d.tool.position, 1e-14));
    }
}

TEST_P(RobotModelTest, ScalingAllMassesScalesTheLinks) {
    RobotModel heavy = makeModel(withScaledMasses(robot_, JointVector::Constant(n_, 1.25)));
    const JointVector q = draw(3.0), qd = draw(3.0);
    const Dynamics d = calc(q, qd);
    Dynamics scaled;
    heavy.calcDynamics(q, qd, scaled);
    EXPECT_LT((scaled.b - 1.25 * d.b).norm(), 1e-12 * (1.0 + d.b.norm()));
    JointMatrix expected = 1.25 * d.M;
    expected.diagonal() -= 0.25 * robot_.actuation.rotorInertia;
    EXPECT_LT((scaled.M - expected).norm(), 1e-12 * expected.norm());
}

TEST_P(RobotModelTest, EnergyIsKeptWhenNothingDrives) {
    const double h = 1e-4;
    JointVector q = draw(1.0), v = draw(1.0);
    const double start = model_.calcEnergy(q, v);
    const auto accelerate = [&](const JointVector& atQ, const JointVector& atV) {
        JointVector qdd;
        EXPECT_TRUE(calcForwardDynamics(calc(atQ, atV), JointVector::Zero(n_), qdd));
        return qdd;
    };
    double largestKinetic = 0.0, largestDrift = 0.0;
    for (int step = 0; step < 10000; ++step) {
        const JointVector k1 = accelerate(q, v), k2 = accelerate(q + h / 2 * v, v + h / 2 * k1);
        const JointVector k3 = accelerate(q + h / 2 * v + h * h / 4 * k1, v + h / 2 * k2);
        const JointVector k4 = accelerate(q + h * v + h * h / 2 * k2, v + h * k3);
        q += h * v + h * h / 6 * (k1 + k2 + k3);
        v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
        largestDrift = std::max(largestDrift, std::abs(model_.calcEnergy(q, v) - start));
        largestKinetic = std::max(largestKinetic, 0.5 * v.dot(calc(q, v).M * v));
    }
    EXPECT_GT(largestKinetic, 0.01);
    EXPECT_LT(largestDrift, 1e-8 * largestKinetic);
}

TEST_P(RobotModelTest, TheSameInputGivesTheSameBitsWhateverCameBefore) {
    const JointVector q = draw(3.0), qd = draw(3.0);
    const Dynamics first = calc(q, qd);
    calc(draw(3.0), draw(3.0));
    model_.calcEnergy(draw(3.0), draw(3.0));
    model_.calcLinkForwardDynamics(draw(3.0), draw(3.0), draw(3.0));
    const Dynamics again = calc(q, qd);
    EXPECT_EQ(first.M, again.M);
    EXPECT_EQ(first.b, again.b);
    EXPECT_EQ(first.gravity, again.gravity);
    EXPECT_EQ(first.J, again.J);
    EXPECT_EQ(first.tool.position, again.tool.position);
    RobotModel moved = std::move(model_);
    Dynamics afterMove;
    moved.calcDynamics(q, qd, afterMove);
    EXPECT_EQ(first.M, afterMove.M);
    EXPECT_EQ(moved.size(), n_);
}

TEST_P(RobotModelTest, Fault49_ATickAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    JointVector q = draw(3.0), qd = draw(3.0), qdd(n_), tau(n_);
    Dynamics d;
    testing::AllocationCounter counter;  // from the very first call on
    for (int i = 0; i < 1000; ++i) {
        q[0] += 1e-3;
        model_.calcDynamics(q, qd, d);
        calcForwardDynamics(d, tau.setZero(), qdd);
        calcInverseDynamics(d, qdd, tau);
    }
    EXPECT_EQ(counter.count(), 0);
}

TEST_P(RobotModelTest, NumbersThatAreNotFiniteComeBackAsSuchWithoutAnException) {
    for (const double bad : {kNan, kInfinity})
        for (int joint = 0; joint < n_; ++joint) {
            const JointVector zero = JointVector::Zero(n_);
            JointVector wrong = zero;
            wrong[joint] = bad;
            Dynamics d = calc(zero, zero);
            ASSERT_NO_THROW(model_.calcDynamics(wrong, zero, d));
            EXPECT_TRUE(d.M.hasNaN() && d.b.hasNaN() && d.gravity.hasNaN() && d.J.hasNaN());
            EXPECT_TRUE(d.tool.position.hasNaN() && d.tool.orientation.coeffs().hasNaN());
            d = calc(zero, zero);
            ASSERT_NO_THROW(model_.calcDynamics(zero, wrong, d));
            EXPECT_TRUE(d.b.hasNaN());
            EXPECT_TRUE(isFinite(calc(zero, zero), n_)) << "the next call is unharmed";
        }
    Dynamics d;
    EXPECT_NO_THROW(model_.calcDynamics(JointVector::Constant(n_, 1e300), JointVector::Constant(n_, -1e300), d));
}

INSTANTIATE_TEST_SUITE_P(Arms, RobotModelTest,
                         ::testing::Combine(::testing::Values("indy7", "single_joint", "simple", "slanted", "branched"),
                                            ::testing::Values(DynamicsEngine::Recursion, DynamicsEngine::Simbody)),
                         [](const auto& sample) {
                             const bool isSimbody = std::get<1>(sample.param) == DynamicsEngine::Simbody;
                             return std::string(std::get<0>(sample.param)) + (isSimbody ? "_simbody" : "_recursion");
                         });

TEST(RobotModel, CartWithPendulumAsInTheTextbook) {
    const double cart = 2.0, bob = 0.5, length = 0.4, centre = 0.01;  // centre: inertia of the bob
    RobotFolder folder;
    folder.urdf =
        "<robot name='arm'><link name='base'/>" +
        makeJoint("rail", "prismatic", "base", "cart", "xyz='0 0 0' rpy='0 0 0'", "1 0 0") +
        makeLink("cart", cart, "0 0 0", "0 0 0", kSomeInertia) +
        makeJoint("pivot", "revolute", "cart", "bob", "xyz='0 0 0' rpy='0 0 0'", "0 1 0") +
        makeLink("bob", bob, "0 0 -0.4", "0 0 0", "ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'") +
        "</robot>";
    folder.limits = kSomeLimits;
    RobotModel model(folder.load());
    const double angle = 0.7, rate = 1.3;
    JointVector q(2), qd(2);
    q << 0.2, angle;
    qd << -0.4, rate;
    Dynamics d;
    model.calcDynamics(q, qd, d);
    // The bob hangs at x = s - l sin(angle), z = -l cos(angle).
    const double coupling = -bob * length * std::cos(angle);
    EXPECT_NEAR(d.M(0, 0), cart + bob, 1e-14);
    EXPECT_NEAR(d.M(0, 1), coupling, 1e-14);
    EXPECT_NEAR(d.M(1, 1), centre + bob * length * length, 1e-14);
    EXPECT_NEAR(d.b[0], bob * length * std::sin(angle) * rate * rate, 1e-14);
    EXPECT_NEAR(d.b[1], bob * 9.81 * length * std::sin(angle), 1e-14);
    EXPECT_NEAR(d.tool.position.x(), 0.2, 1e-15);
}

TEST(RobotModel, BranchesDoNotFeelEachOther) {
    RobotFolder folder;
    makeBranchedArm(folder);
    const RobotDescription robot = folder.load();
    ASSERT_EQ(robot.jointNames(), (std::vector<std::string>{"lift", "right1", "left1", "left2"}));
    RobotModel model(robot);
    JointVector q(4), qd(4);
    q << 0.3, 0.5, -0.4, 0.8;
    qd << 0.1, 0.2, 0.3, 0.4;
    Dynamics d;
    model.calcDynamics(q, qd, d);
    EXPECT_EQ(d.M(1, 2), 0.0);
    EXPECT_EQ(d.M(1, 3), 0.0);
    EXPECT_NE(d.M(0, 1), 0.0);
    EXPECT_EQ(d.J.col(1).norm(), 0.0) << "the tool is on the other branch";
    EXPECT_NE(d.J.col(2).norm(), 0.0);
}

}  // namespace
}  // namespace viable
