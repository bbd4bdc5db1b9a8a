#include <cmath>
#include <cstdio>

#include "SampleArm.h"
#include "robot/DynamicsCheck.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

constexpr int kSamples = 1000;
/** Both routes round in some 1e-15 of the largest term; what is asked for leaves room for light joints behind heavy
ones. */
constexpr double kRelative = 1e-10;

/** The same arm by Simbody. */
struct ArmRecursionTest : SampleArmTest, public ::testing::WithParamInterface<std::string> {
    ArmRecursionTest()
        : SampleArmTest(loadSampleArm(GetParam(), {1.0, -2.0, -9.0}), 20260607, DynamicsEngine::Simbody),
          arm_(robot_) {}

    ArmRecursion arm_;
    ArmRecursion::Frames frames_;
};

TEST_P(ArmRecursionTest, TorqueIsThatOfSimbody) {
    JointVector tau;
    for (int sample = 0; sample < kSamples; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0), qdd = draw(10.0);
        const Dynamics d = calc(q, qd);
        const JointVector inertial = d.M * qdd;
        arm_.calcTorque(q, qd, qdd, tau);
        ASSERT_EQ(tau.size(), n_);
        // Joint by joint: a wrist's torque is not hidden behind a shoulder's.
        for (int i = 0; i < n_; ++i)
            ASSERT_NEAR(
                tau[i], inertial[i] + d.b[i],
                kRelative * (d.M.row(i).cwiseAbs().dot(qdd.cwiseAbs()) + std::abs(d.b[i]) + std::abs(d.gravity[i])))
                << sample << ", joint " << i;
    }
}

TEST_P(ArmRecursionTest, InertiaIsThatOfSimbody) {
    JointMatrix M;
    for (int sample = 0; sample < kSamples; ++sample) {
        const JointVector q = draw(3.0);
        const Dynamics d = calc(q, JointVector::Zero(n_));
        arm_.calcInertia(q, M);
        ASSERT_EQ(M.rows(), n_);
        ASSERT_EQ(M.cols(), n_);
        for (int i = 0; i < n_; ++i)
            for (int j = 0; j < n_; ++j)
                ASSERT_NEAR(M(i, j), d.M(i, j), kRelative * std::sqrt(d.M(i, i) * d.M(j, j)))
                    << sample << ": " << i << ", " << j;
    }
}

TEST_P(ArmRecursionTest, DynamicsAreThoseOfSimbody) {
    Dynamics d;
    double largest = 0.0;
    for (int sample = 0; sample < kSamples; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0);
        arm_.calcDynamics(q, qd, d);
        ASSERT_TRUE(isFinite(d, n_));
        ASSERT_EQ(d.M, JointMatrix(d.M.transpose()));
        const detail::DynamicsDifference worst = detail::compareDynamics(robot_, q, qd, calc(q, qd), d);
        ASSERT_LE(worst.size, detail::kDynamicsTolerance) << sample << ", " << worst.what << ", joint " << worst.joint;
        largest = std::max(largest, worst.size);
    }
    std::printf("  largest difference %.1e of the scale\n", largest);
}

TEST_P(ArmRecursionTest, DynamicsAreThoseOfItsOwnPasses) {
    Dynamics d;
    JointMatrix M;
    JointVector tau;
    for (int sample = 0; sample < kSamples; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0), rest = JointVector::Zero(n_);
        arm_.calcDynamics(q, qd, d);
        arm_.calcInertia(q, M);
        ASSERT_EQ(d.M, M);
        arm_.calcTorque(q, qd, rest, tau);
        ASSERT_LT((d.b - tau).norm(), 1e-12 * (d.b.norm() + d.gravity.norm() + d.M.norm()));
        arm_.calcDynamics(q, rest, d);
        ASSERT_EQ(d.b, d.gravity) << "at rest";
    }
}

TEST_P(ArmRecursionTest, AnArmThatDiffersFromSimbodysIsRefusedWithItsJoint) {
    EXPECT_NO_THROW(detail::checkRecursion(robot_, arm_, "arm.urdf"));
    for (int i = 0; i < n_; ++i) {
        RobotDescription other = robot_;
        JointDescription& joint = other.joints[static_cast<std::size_t>(i)];
        other.actuation.rotorInertia[i] += 1e-5 * calc(JointVector::Zero(n_), JointVector::Zero(n_)).M(i, i);
        test::expectError(
            {"arm.urdf: the recursive dynamics differ from Simbody's: the inertia M of joint `" + joint.name + "` by ",
             "please report it with the robot's folder"},
            [&] { detail::checkRecursion(robot_, ArmRecursion(other), "arm.urdf"); });
        other = robot_;
        other.joints[static_cast<std::size_t>(i)].placement.rotate(
            Eigen::AngleAxisd(1e-6, Eigen::Vector3d(1.0, -2.0, 3.0).normalized()));
        EXPECT_THROW(detail::checkRecursion(robot_, ArmRecursion(other), "arm.urdf"), Error) << joint.name;
    }
    RobotDescription other = robot_;
    other.toolPlacement.translation().z() += 1e-6;
    EXPECT_THROW(detail::checkRecursion(robot_, ArmRecursion(other), "arm.urdf"), Error) << "tool";
}

TEST_P(ArmRecursionTest, InertiaIsTheSlopeOfTheTorque) {
    JointMatrix M;
    JointVector at, rest;
    for (int sample = 0; sample < 50; ++sample) {
        const JointVector q = draw(3.0), qd = draw(3.0);
        arm_.calcInertia(q, M);
        arm_.calcTorque(q, qd, JointVector::Zero(n_), rest);
        for (int j = 0; j < n_; ++j) {
            arm_.calcTorque(q, qd, JointVector::Unit(n_, j), at);
            const double scale = rest.norm() + M.col(j).norm();
            ASSERT_LT((at - rest - M.col(j)).norm(), 1e-12 * scale) << j;
        }
    }
}

TEST_P(ArmRecursionTest, FramesCarryTheToolAndItsJacobian) {
    for (int sample = 0; sample < kSamples; ++sample) {
        const JointVector q = draw(3.0);
        const Dynamics d = calc(q, JointVector::Zero(n_));
        arm_.calcFrames(q, frames_);
        const auto carrier = static_cast<std::size_t>(robot_.toolParent);
        const Eigen::Vector3d tool =
            frames_.rotation[carrier] * robot_.toolPlacement.translation() + frames_.origin[carrier];
        ASSERT_LT((tool - d.tool.position).norm(), 1e-12);
        const Eigen::Matrix3d turned = frames_.rotation[carrier] * robot_.toolPlacement.linear();
        ASSERT_LT((turned - d.tool.orientation.toRotationMatrix()).norm(), 1e-12);
        for (int i = 0; i < n_; ++i) {
            const auto k = static_cast<std::size_t>(i);
            const bool isMoved = arm_.moves(i, robot_.toolParent);
            Eigen::Vector3d linear = frames_.axis[k], angular = Eigen::Vector3d::Zero();
            if (!arm_.isPrismatic(i)) {
                angular = frames_.axis[k];
                linear = angular.cross(tool - frames_.origin[k]);
            }
            ASSERT_LT((d.J.col(i).head<3>() - isMoved * linear).norm(), 1e-12) << i;
            ASSERT_LT((d.J.col(i).tail<3>() - isMoved * angular).norm(), 1e-12) << i;
        }
    }
}

TEST_P(ArmRecursionTest, TheTreeIsThatOfTheDescription) {
    ASSERT_EQ(arm_.size(), n_);
    for (int i = 0; i < n_; ++i) {
        const JointDescription& joint = robot_.joints[static_cast<std::size_t>(i)];
        EXPECT_EQ(arm_.parent(i), joint.parent);
        EXPECT_EQ(arm_.isPrismatic(i), joint.type == JointType::Prismatic);
        EXPECT_FALSE(arm_.moves(i, -1));
        for (int carrier = 0; carrier < n_; ++carrier) {
            bool isBefore = false;
            for (int k = carrier; k >= 0; k = robot_.joints[static_cast<std::size_t>(k)].parent)
                isBefore = isBefore || k == i;
            EXPECT_EQ(arm_.moves(i, carrier), isBefore) << i << ", " << carrier;
        }
    }
}

TEST_P(ArmRecursionTest, Fault49_ATickAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    JointVector q = draw(3.0), qd = draw(3.0), qdd = draw(3.0), tau;
    JointMatrix M;
    Dynamics dynamics;
    testing::AllocationCounter counter;  // from the very first call on
    for (int i = 0; i < 100; ++i) {
        q[0] += 1e-3;
        arm_.calcFrames(q, frames_);
        arm_.calcTorque(q, qd, qdd, tau);
        arm_.calcInertia(q, M);
        arm_.calcDynamics(q, qd, dynamics);
    }
    EXPECT_EQ(counter.count(), 0);
}

TEST_P(ArmRecursionTest, WhatIsNoNumberGivesNone) {
    JointVector q = draw(3.0), tau;
    JointMatrix M;
    const JointVector qd = draw(3.0), qdd = draw(3.0);
    for (const double bad : {kNan, kInfinity}) {
        JointVector spoilt = qdd;
        spoilt[n_ - 1] = bad;
        arm_.calcTorque(q, qd, spoilt, tau);
        EXPECT_FALSE(std::isfinite(tau[n_ - 1]));
        spoilt = q;
        spoilt[0] = bad;
        arm_.calcFrames(spoilt, frames_);
        EXPECT_FALSE(frames_.rotation[0].allFinite() && frames_.origin[0].allFinite());
    }
}

INSTANTIATE_TEST_SUITE_P(Arms, ArmRecursionTest,
                         ::testing::Values("indy7", "panda", "ur5e", "planar_two_link", "single_joint", "simple",
                                           "slanted", "branched", "largest"),
                         [](const auto& arm) { return arm.param; });

}  // namespace
}  // namespace viable
