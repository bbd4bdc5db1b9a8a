#include "TaskSpacePd.h"

#include <Eigen/LU>

#include "TestArm.h"

namespace viable {
namespace {

/** The paper's matrices, unless `text` has some. */
std::string withPapers(const std::string& text) {
    if (text.find("stiffness") != std::string::npos || text.find("damping: [") != std::string::npos ||
        text.find("natural_frequency") != std::string::npos)
        return text;
    return "stiffness: [600, 600, 600, 160, 160, 160], damping: [60, 60, 60, 16, 16, 16]" +
           (text.empty() ? "" : ", " + text);
}

struct TaskSpacePdTest : ::testing::Test {
    void configure(const std::string& text) { configure(controller_, text); }
    void configure(NominalController& controller, const std::string& text) {
        arm_.configure(controller, PluginKind::NominalController, "task_space_pd", withPapers(text));
    }

    /** A state whose pose is well away from singular ones. */
    MotionState drawState() {
        for (;;) {
            const MotionState state{arm_.robot.home + makeRandomVector(6, 0.4, random_),
                                    makeRandomVector(6, 1.0, random_), JointVector::Zero(6)};
            if (calcManipulability(state.q) > 0.03) return state;
        }
    }
    double calcManipulability(const JointVector& q) {
        const Dynamics d = arm_.calcDynamics(q, JointVector::Zero(6));
        return std::abs(Eigen::MatrixXd(d.J).determinant());
    }

    MotionCommand drawCommand(const Pose& near) {
        MotionCommand command;
        command.space = MotionCommand::Space::Tool;
        const Eigen::Vector3d turn = makeRandomVector(3, 0.8, random_);
        command.tool.position = near.position + Eigen::Vector3d(makeRandomVector(3, 0.3, random_));
        command.tool.orientation = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * near.orientation;
        command.toolTwist = makeRandomVector(6, 1.0, random_);
        return command;
    }
    static MotionCommand holdAt(const Pose& pose) {
        MotionCommand command;
        command.space = MotionCommand::Space::Tool;
        command.tool = pose;
        return command;
    }

    JointVector compute(const MotionCommand& command, const MotionState& state) {
        return compute(controller_, command, state);
    }
    JointVector compute(NominalController& controller, const MotionCommand& command, const MotionState& state) {
        ControllerOutput output;
        EXPECT_EQ(controller.compute({command, state, arm_.calcDynamics(state)}, output), TickStatus::Ok);
        return output.torque;
    }

    /** J by central differences of the tool pose, column by column. */
    Eigen::MatrixXd differentiatePose(const JointVector& q) {
        Eigen::MatrixXd J(6, 6);
        const double h = 1e-5;
        for (int i = 0; i < 6; ++i) {
            JointVector ahead = q, behind = q;
            ahead[i] += h;
            behind[i] -= h;
            const Pose a = arm_.calcDynamics(ahead, JointVector::Zero(6)).tool;
            const Pose b = arm_.calcDynamics(behind, JointVector::Zero(6)).tool;
            const Eigen::AngleAxisd turn(a.orientation * b.orientation.conjugate());
            J.col(i).head<3>() = (a.position - b.position) / (2 * h);
            J.col(i).tail<3>() = turn.angle() * turn.axis() / (2 * h);
        }
        return J;
    }

    /** Gravity torque as slope of the potential energy. */
    Eigen::VectorXd differentiateEnergy(const JointVector& q) {
        Eigen::VectorXd gravity(6);
        const double h = 1e-5;
        const JointVector rest = JointVector::Zero(6);
        for (int i = 0; i < 6; ++i) {
            JointVector ahead = q, behind = q;
            ahead[i] += h;
            behind[i] -= h;
            gravity[i] = (arm_.model().calcEnergy(ahead, rest) - arm_.model().calcEnergy(behind, rest)) / (2 * h);
        }
        return gravity;
    }

    /** K e + D de with rotation matrices instead of quaternions. */
    Vector6 calcWrench(const MotionCommand& command, const MotionState& state, const Eigen::MatrixXd& J) {
        const Pose tool = arm_.calcDynamics(state).tool;
        const Eigen::Matrix3d turn =
            command.tool.orientation.toRotationMatrix() * tool.orientation.toRotationMatrix().transpose();
        const Eigen::AngleAxisd axis(turn);
        Vector6 e, K, D;
        e << command.tool.position - tool.position, axis.angle() * axis.axis();
        K << 600, 600, 600, 160, 160, 160;
        D << 60, 60, 60, 16, 16, 16;
        const Eigen::VectorXd twist = J * state.qd;
        return K.cwiseProduct(e) + D.cwiseProduct(command.toolTwist - twist);
    }

    TestArm arm_{"indy7"};
    TaskSpacePd controller_;
    std::mt19937 random_{5};
};

TEST_F(TaskSpacePdTest, TorqueIsEquation27PlusGravity) {
    configure("");
    for (int k = 0; k < 50; ++k) {
        const MotionState state = drawState();
        const MotionCommand command = drawCommand(arm_.calcDynamics(state).tool);
        controller_.reset(state);
        const JointVector torque = compute(command, state);
        const Eigen::MatrixXd J = differentiatePose(state.q);
        const Eigen::VectorXd expected = J.transpose() * calcWrench(command, state, J) + differentiateEnergy(state.q);
        EXPECT_LE((torque - expected).lpNorm<Eigen::Infinity>(), 2e-6) << "state " << k;
    }
}

TEST_F(TaskSpacePdTest, WithoutGravityCompensationOnlyTheToolForceIsLeft) {
    configure("gravity_compensation: false");
    for (int k = 0; k < 50; ++k) {
        const MotionState state = drawState();
        const MotionCommand command = drawCommand(arm_.calcDynamics(state).tool);
        controller_.reset(state);
        const Eigen::MatrixXd J = differentiatePose(state.q);
        const Eigen::VectorXd expected = J.transpose() * calcWrench(command, state, J);
        EXPECT_LE((compute(command, state) - expected).lpNorm<Eigen::Infinity>(), 2e-6);
    }
    const MotionState atRest = arm_.start;
    controller_.reset(atRest);
    EXPECT_LE(compute(holdAt(arm_.calcDynamics(atRest).tool), atRest).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST_F(TaskSpacePdTest, EachAxisHasItsOwnStiffnessAndDamping) {
    configure("stiffness: [100, 200, 300, 40, 50, 60], damping: [0, 0, 0, 0, 0, 0], gravity_compensation: false");
    const MotionState state = arm_.start;
    const Dynamics d = arm_.calcDynamics(state);
    const double K[] = {100, 200, 300, 40, 50, 60};
    for (int axis = 0; axis < 6; ++axis) {
        MotionCommand command = holdAt(d.tool);
        if (axis < 3)
            command.tool.position[axis] += 0.05;
        else
            command.tool.orientation = Eigen::AngleAxisd(0.05, Eigen::Vector3d::Unit(axis - 3)) * d.tool.orientation;
        controller_.reset(state);
        const JointVector expected = K[axis] * 0.05 * d.J.row(axis).transpose();
        EXPECT_LE((compute(command, state) - expected).lpNorm<Eigen::Infinity>(), 1e-9);
    }
}

TEST_F(TaskSpacePdTest, SignOfTheCommandedQuaternionDoesNotMatter) {
    configure("");
    TaskSpacePd other;
    configure(other, "");
    const MotionState state = drawState();
    const Pose tool = arm_.calcDynamics(state).tool;
    for (int k = 0; k < 700; ++k) {  // up to 7/5 pi, so also beyond half a turn
        MotionCommand command = holdAt(tool);
        command.tool.orientation = Eigen::AngleAxisd(2 * kPi * k / 1000, Eigen::Vector3d::UnitX()) * tool.orientation;
        const JointVector expected = compute(controller_, command, state);
        if (k % 2) command.tool.orientation.coeffs() *= -1.0;
        ASSERT_EQ(compute(other, command, state), expected) << "step " << k;
    }
}

// Two turns of the command while the arm stands: the torque grows steadily through half a turn (the
// short way round changes there) and gives up only at three quarters, once per turn.
TEST_F(TaskSpacePdTest, TorqueIsContinuousThroughHalfATurn) {
    configure("");
    const MotionState state = arm_.start;
    const Pose tool = arm_.calcDynamics(state).tool;
    const Eigen::Vector3d axis = Eigen::Vector3d(1, 2, -1).normalized();
    JointVector last = compute(holdAt(tool), state);
    const double step = 1e-3;
    // |J^T K axis| step: what a step of the command can do to the torque, J within the norm here.
    const double bound = 1.01 * 160.0 * step * Eigen::MatrixXd(arm_.calcDynamics(state).J).operatorNorm();
    int jumps = 0;
    for (double angle = step; angle < 4 * kPi; angle += step) {
        MotionCommand command = holdAt(tool);
        command.tool.orientation = Eigen::AngleAxisd(angle, axis) * tool.orientation;
        const JointVector torque = compute(command, state);
        if ((torque - last).norm() > bound) {
            ++jumps;
            EXPECT_NEAR(std::fmod(angle, 2 * kPi), 1.5 * kPi, 2 * step);
        }
        last = torque;
    }
    EXPECT_EQ(jumps, 2);

    // Back and forth about half a turn, as noise would do it: no jump at all.
    controller_.reset(state);
    for (double angle = 0.0; angle < kPi; angle += step) {
        MotionCommand command = holdAt(tool);
        command.tool.orientation = Eigen::AngleAxisd(angle, axis) * tool.orientation;
        last = compute(command, state);
    }
    for (int k = 0; k < 1000; ++k) {
        MotionCommand command = holdAt(tool);
        command.tool.orientation = Eigen::AngleAxisd(kPi + (k % 2 ? 0.4 : -0.4) * step, axis) * tool.orientation;
        const JointVector torque = compute(command, state);
        ASSERT_LE((torque - last).norm(), bound);
        last = torque;
    }
}

// The arm follows: the last joint turns with the command, two turns, and nothing jumps.
TEST_F(TaskSpacePdTest, ArmFollowsTwoTurnsOfTheCommandWithoutAJump) {
    configure("");
    MotionState state = arm_.start;
    Dynamics d = arm_.calcDynamics(state);
    const Pose start = d.tool;
    const Eigen::Vector3d axis = d.J.col(5).tail<3>().normalized();  // of the last joint
    const double rate = 2.0;                                         // [rad/s]
    ControllerOutput output;
    const JointVector& torque = output.torque;
    JointVector last, qdd;
    double turned = 0.0;
    for (int k = 0; k * 1e-3 < 4 * kPi / rate; ++k) {
        const double angle = rate * k * 1e-3;
        MotionCommand command = holdAt(start);
        command.tool.orientation = Eigen::AngleAxisd(angle, axis) * start.orientation;
        command.toolTwist.tail<3>() = rate * axis;
        d = arm_.calcDynamics(state);
        ASSERT_EQ(controller_.compute({command, state, d}, output), TickStatus::Ok);
        if (k > 0) {
            ASSERT_LE((torque - last).norm(), 2.0) << "tick " << k;  // a flip would be 1000 Nm
        }
        last = torque;
        ASSERT_TRUE(calcForwardDynamics(d, torque, qdd));
        state.qd += 1e-3 * qdd;
        state.q += 1e-3 * state.qd;
        turned = angle;
        ASSERT_LE(Eigen::AngleAxisd(command.tool.orientation * d.tool.orientation.conjugate()).angle(), 0.3);
    }
    EXPECT_GT(turned, 12.5);
    EXPECT_NEAR(state.q[5] - arm_.start.q[5], 4 * kPi, 0.5);
}

TEST_F(TaskSpacePdTest, Fault20DampingIsAddedNearSingularPosesOnly) {
    TaskSpacePd bare;
    configure("singular_damping: 20, singular_threshold: 0.01");
    configure(bare, "singular_damping: 0");
    for (int k = 0; k < 50; ++k) {  // regular poses: the same to the last bit
        const MotionState state = drawState();
        const MotionCommand command = drawCommand(arm_.calcDynamics(state).tool);
        controller_.reset(state);
        bare.reset(state);
        EXPECT_EQ(compute(command, state), compute(bare, command, state));
    }
    // Stretched elbow (third joint at zero), where J loses a rank and all of the manipulability is rounding; and nearly so.
    for (const auto& [elbow, tolerance] : {std::pair(0.0, 1e-4), std::pair(1e-3, 1e-6)}) {
        MotionState state = arm_.start;
        state.q[2] = elbow;
        state.qd = makeRandomVector(6, 1.0, random_);
        EXPECT_LT(calcManipulability(state.q), 1e-3);
        const Dynamics d = arm_.calcDynamics(state);
        const MotionCommand command = drawCommand(d.tool);
        controller_.reset(state);
        bare.reset(state);
        const JointVector torque = compute(command, state);
        ASSERT_TRUE(torque.allFinite());
        const double share = std::pow(1.0 - calcManipulability(state.q) / 0.01, 2);
        const JointVector expected = -20.0 * share * d.M.diagonal().cwiseProduct(state.qd);
        EXPECT_LE((torque - compute(bare, command, state) - expected).lpNorm<Eigen::Infinity>(), tolerance);
        EXPECT_LT((torque - compute(bare, command, state)).dot(state.qd), -1e-3);  // it brakes
    }
}

// A set-point far beyond reach pulls the arm through and into the stretched pose.
TEST_F(TaskSpacePdTest, Fault20SetPointBeyondReachGivesBoundedAcceleration) {
    configure("");
    MotionState state = arm_.start;
    Dynamics d = arm_.calcDynamics(state);
    MotionCommand command = holdAt(d.tool);
    ControllerOutput output;
    const JointVector& torque = output.torque;
    JointVector qdd;
    double fastest = 0.0, strongest = 0.0, smallest = 1.0;
    for (int k = 0; k < 20000; ++k) {
        const double side = (k / 5000) % 2 ? -1.0 : 1.0;
        command.tool.position = Eigen::Vector3d(side * 1.5, 0.3, 0.8);
        d = arm_.calcDynamics(state);
        ASSERT_EQ(controller_.compute({command, state, d}, output), TickStatus::Ok);
        ASSERT_TRUE(torque.allFinite()) << "tick " << k;
        ASSERT_TRUE(calcForwardDynamics(d, torque, qdd));
        strongest = std::max(strongest, qdd.lpNorm<Eigen::Infinity>());
        smallest = std::min(smallest, calcManipulability(state.q));
        state.qd += 1e-3 * qdd;
        state.q += 1e-3 * state.qd;
        fastest = std::max(fastest, state.qd.lpNorm<Eigen::Infinity>());
    }
    EXPECT_LT(smallest, 1e-3);  // it did get there
    EXPECT_LT(fastest, 50.0);
    EXPECT_LT(strongest, 5000.0);
    EXPECT_LT(state.qd.lpNorm<Eigen::Infinity>(), 1.0);  // and comes to rest again
    std::printf("  manipulability down to %.2g, at most %.3g rad/s and %.3g rad/s^2\n", smallest, fastest, strongest);
}

TEST_F(TaskSpacePdTest, WorksForAnArmWithOneJoint) {
    TestArm arm("single_joint");
    TaskSpacePd controller;
    arm.configure(controller, PluginKind::NominalController, "task_space_pd", withPapers(""));
    const Dynamics d = arm.calcDynamics(arm.start);
    MotionCommand command = holdAt(d.tool);
    command.tool.position += Eigen::Vector3d(0, 0.1, 0);  // tangential: the tool is 1 m out
    ControllerOutput output;
    ASSERT_EQ(controller.compute({command, arm.start, d}, output), TickStatus::Ok);
    EXPECT_NEAR(output.torque[0], 60.0, 1e-9);
}

TEST_F(TaskSpacePdTest, RefusesJointSpaceAndWhatIsNotFinite) {
    configure("");
    EXPECT_TRUE(controller_.traits().follows(MotionCommand::Space::Tool));
    EXPECT_FALSE(controller_.traits().follows(MotionCommand::Space::Joint));
    const Dynamics d = arm_.calcDynamics(arm_.start);
    const MotionCommand good = holdAt(d.tool);
    ControllerOutput output{JointVector::Constant(6, 7.0), {}, false};
    const auto expectRefused = [&](const MotionCommand& command, const MotionState& state) {
        EXPECT_EQ(controller_.compute({command, state, d}, output), TickStatus::InvalidInput);
        EXPECT_EQ(output.torque, JointVector::Constant(6, 7.0));
    };
    MotionCommand bad = good;
    bad.space = MotionCommand::Space::Joint;
    expectRefused(bad, arm_.start);
    for (const double x : {kNan, kInfinity}) {
        bad = good;
        bad.tool.position[1] = x;
        expectRefused(bad, arm_.start);
        bad = good;
        bad.tool.orientation.w() = x;
        expectRefused(bad, arm_.start);
        bad = good;
        bad.toolTwist[5] = x;
        expectRefused(bad, arm_.start);
    }
    bad = good;
    bad.tool.orientation.coeffs().setZero();
    expectRefused(bad, arm_.start);
    MotionState badState = arm_.start;
    badState.q[0] = kNan;
    expectRefused(good, badState);
    // A quaternion that is only nearly of unit length is taken as the rotation it means.
    MotionCommand scaled = good;
    scaled.tool.orientation.coeffs() *= 1.5;
    const JointVector a = compute(scaled, arm_.start), b = compute(good, arm_.start);
    EXPECT_LE((a - b).norm(), 1e-10);
}

TEST_F(TaskSpacePdTest, RefusesGainsOutsideTheirRange) {
    expectError({"stiffness"}, [&] { configure("stiffness: [1, 2, 3], damping: [1, 1, 1, 1, 1, 1]"); });
    expectError({"-1"}, [&] { configure("damping: [1, 1, 1, 1, 1, -1]"); });
    expectError({"singular_threshold"}, [&] { configure("singular_threshold: -0.1"); });
}

// Away from singular poses the tool's acceleration is w^2 e + 2 z w de in every direction, whatever it weighs: as the bound
// of the inverse allows.
TEST_F(TaskSpacePdTest, ShapedItAnswersAlikeInEveryDirection) {
    configure("natural_frequency_radps: 8, damping_ratio: 0.7");
    double worst = 0.0;
    for (int k = 0; k < 200; ++k) {
        MotionState state = drawState();
        state.qd.setZero();
        const Dynamics d = arm_.calcDynamics(state);
        MotionCommand command = holdAt(d.tool);
        command.tool.position += Eigen::Vector3d(makeRandomVector(3, 0.1, random_));
        command.toolTwist = makeRandomVector(6, 0.3, random_);
        JointVector qdd;
        ASSERT_TRUE(calcForwardDynamics(d, compute(command, state), qdd));
        Vector6 expected = 2.0 * 0.7 * 8.0 * command.toolTwist;
        expected.head<3>() += 64.0 * (command.tool.position - d.tool.position);
        worst = std::max(worst, (d.J * qdd - expected).norm() / expected.norm());
    }
    std::printf("farthest from the acceleration asked for: %.3g of it\n", worst);
    EXPECT_LE(worst, 0.35);
}

TEST_F(TaskSpacePdTest, ShapedItDampsWhatTheToolDoesNotShow) {
    TestArm arm("panda");
    TaskSpacePd controller;
    arm.configure(controller, PluginKind::NominalController, "task_space_pd");
    MotionState state = arm.start;
    const Dynamics d = arm.calcDynamics(state);
    const Eigen::FullPivLU<Eigen::MatrixXd> rank(d.J);
    state.qd = rank.kernel().col(0).normalized();
    ASSERT_LE((d.J * state.qd).norm(), 1e-12);
    const Dynamics moving = arm.calcDynamics(state);
    ControllerOutput output;
    ASSERT_EQ(controller.compute({holdAt(d.tool), state, moving}, output), TickStatus::Ok);
    JointVector qdd;
    ASSERT_TRUE(calcForwardDynamics(moving, output.torque, qdd));
    // 2 z w = 40 1/s at the defaults, 10 rad/s and 2.
    EXPECT_LE((qdd + 40.0 * state.qd).norm(), 1e-6);
}

TEST_F(TaskSpacePdTest, ShapedItStaysFiniteInSingularPosesOfEveryArm) {
    for (const char* name : {"indy7", "panda", "ur5e", "planar_two_link", "single_joint"}) {
        TestArm arm(name);
        TaskSpacePd controller;
        arm.configure(controller, PluginKind::NominalController, "task_space_pd");
        for (int k = 0; k < 100; ++k) {
            MotionState state = arm.start;
            if (k > 0) state.q = makeRandomVector(arm.size(), 3.0, random_);
            if (k % 2 == 0) state.q.setZero();
            state.qd = makeRandomVector(arm.size(), 1.0, random_);
            const Dynamics d = arm.calcDynamics(state);
            MotionCommand command = holdAt(d.tool);
            command.tool.position += Eigen::Vector3d(makeRandomVector(3, 0.2, random_));
            ControllerOutput output;
            ASSERT_EQ(controller.compute({command, state, d}, output), TickStatus::Ok) << name;
            JointVector qdd;
            ASSERT_TRUE(calcForwardDynamics(d, output.torque, qdd));
            EXPECT_LE(qdd.cwiseAbs().maxCoeff(), 1e4) << name << " " << k;
        }
    }
}

TEST_F(TaskSpacePdTest, MatricesComeTogether) {
    expectError({"belong together"}, [&] { configure("stiffness: [1, 1, 1, 1, 1, 1]"); });
    expectError({"Give both, or neither"}, [&] { configure("damping: [1, 1, 1, 1, 1, 1]"); });
    expectError({"`soft` is neither a number nor `auto`. Write"},
                [&] { configure("stiffness: soft, natural_frequency_radps: 3"); });
    expectError({"Did you mean `auto`?"}, [&] { configure("stiffness: atuo"); });
}

TEST_F(TaskSpacePdTest, LoadsAsALibrary) {
    configure("");
    const auto plugin = arm_.load<NominalController>(PluginKind::NominalController, "task_space_pd", withPapers(""));
    const MotionState state = drawState();
    const MotionCommand command = drawCommand(arm_.calcDynamics(state).tool);
    EXPECT_EQ(compute(*plugin, command, state), compute(command, state));
}

}  // namespace
}  // namespace viable
