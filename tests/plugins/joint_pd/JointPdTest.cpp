#include "JointPd.h"

#include "TestArm.h"

namespace viable {
namespace {

class JointPdTest : public ::testing::TestWithParam<const char*> {
protected:
    JointPdTest() : arm_(GetParam()) {}

    int n() const { return arm_.size(); }

    void configure(const std::string& text) {
        controller_ = JointPd();
        arm_.configure(controller_, PluginKind::NominalController, "joint_pd", text);
    }

    void drawInputs() {
        state_ = {arm_.robot.home + makeRandomVector(n(), 0.8, random_), makeRandomVector(n(), 2.0, random_),
                  makeRandomVector(n(), 10.0, random_)};
        command_.space = MotionCommand::Space::Joint;
        command_.q = arm_.robot.home + makeRandomVector(n(), 0.8, random_);
        command_.qd = makeRandomVector(n(), 2.0, random_);
    }

    /** The controller's torque causes the acceleration that `expected` gives for a joint. Without rotors Simbody's own
    forward dynamics says it, which shares nothing with the M and b that the controller used. */
    template <class Expected>
    void expectResult(const std::string& parameters, const Expected& expected) {
        arm_.robot.actuation.rotorInertia.setZero();
        arm_.rebuildModel();
        configure(parameters);
        for (int k = 0; k < 100; ++k) {
            drawInputs();
            ControllerOutput output;
            EXPECT_EQ(controller_.compute({command_, state_, arm_.calcDynamics(state_)}, output), TickStatus::Ok);
            const JointVector qdd = arm_.model().calcLinkForwardDynamics(state_.q, state_.qd, output.torque);
            for (int i = 0; i < n(); ++i) EXPECT_NEAR(qdd[i], expected(i), 1e-8);
        }
    }

    TestArm arm_;
    JointPd controller_;
    MotionState state_;
    MotionCommand command_;
    std::mt19937 random_{4};
};

TEST_P(JointPdTest, ResultingAccelerationIsEquation24) {
    expectResult("stiffness: 5, damping: 1",
                 [&](int i) { return 5.0 * (command_.q[i] - state_.q[i]) - 1.0 * state_.qd[i]; });
}

TEST_P(JointPdTest, FeedforwardDampsTheDifferenceOfVelocities) {
    expectResult("stiffness: 40, damping: 12, velocity_feedforward: true",
                 [&](int i) { return 40.0 * (command_.q[i] - state_.q[i]) + 12.0 * (command_.qd[i] - state_.qd[i]); });
}

TEST_P(JointPdTest, RotorInertiaIsPartOfTheInverseDynamics) {
    configure("");
    drawInputs();
    const Dynamics dynamics = arm_.calcDynamics(state_);
    ControllerOutput output;
    ASSERT_EQ(controller_.compute({command_, state_, dynamics}, output), TickStatus::Ok);
    for (int i = 0; i < n(); ++i) {
        double expected = dynamics.b[i];
        for (int k = 0; k < n(); ++k)
            expected += dynamics.M(i, k) * (5.0 * (command_.q[k] - state_.q[k]) - state_.qd[k]);
        EXPECT_NEAR(output.torque[i], expected, 1e-10 * (1.0 + std::abs(expected)));
    }
}

TEST_P(JointPdTest, EachJointMayHaveItsOwnGains) {
    std::string stiffness, damping;
    for (int i = 0; i < n(); ++i) {
        stiffness += (i ? ", " : "") + std::to_string(10 + i);
        damping += (i ? ", " : "") + std::to_string(3 + i);
    }
    configure("stiffness: [" + stiffness + "], damping: [" + damping + "]");
    drawInputs();
    ControllerOutput output;
    ASSERT_EQ(controller_.compute({command_, state_, makeUnitDynamics(n())}, output), TickStatus::Ok);
    for (int i = 0; i < n(); ++i)
        EXPECT_NEAR(output.torque[i], (10 + i) * (command_.q[i] - state_.q[i]) - (3 + i) * state_.qd[i], 1e-12);
}

TEST_P(JointPdTest, RefusesToolSpaceAndWhatIsNotFinite) {
    configure("");
    EXPECT_TRUE(controller_.traits().follows(MotionCommand::Space::Joint));
    EXPECT_FALSE(controller_.traits().follows(MotionCommand::Space::Tool));
    drawInputs();
    const Dynamics dynamics = arm_.calcDynamics(state_);
    ControllerOutput output{JointVector::Constant(n(), 7.0), {}, false};
    const auto expectRefused = [&](const MotionCommand& command, const MotionState& state) {
        EXPECT_EQ(controller_.compute({command, state, dynamics}, output), TickStatus::InvalidInput);
        EXPECT_EQ(output.torque, JointVector::Constant(n(), 7.0));
    };
    MotionCommand bad = command_;
    bad.space = MotionCommand::Space::Tool;
    expectRefused(bad, state_);
    bad = command_;
    bad.q[0] = kNan;
    expectRefused(bad, state_);
    bad = command_;
    bad.qd.resize(n() + 1);
    expectRefused(bad, state_);
    MotionState badState = state_;
    badState.qd[0] = kInfinity;
    expectRefused(command_, badState);
}

TEST_P(JointPdTest, RefusesNegativeGains) {
    expectError({"stiffness"}, [&] { configure("stiffness: -5"); });
    expectError({"-0.1"}, [&] { configure("damping: -0.1"); });
    expectError({"stiffness"}, [&] { configure("stifness: 5"); });
}

TEST_P(JointPdTest, LoadsAsALibrary) {
    configure("");
    const auto plugin = arm_.load<NominalController>(PluginKind::NominalController, "joint_pd");
    drawInputs();
    const Dynamics dynamics = arm_.calcDynamics(state_);
    ControllerOutput loaded, own;
    ASSERT_EQ(plugin->compute({command_, state_, dynamics}, loaded), TickStatus::Ok);
    ASSERT_EQ(controller_.compute({command_, state_, dynamics}, own), TickStatus::Ok);
    EXPECT_EQ(loaded.torque, own.torque);
    EXPECT_FALSE(loaded.hasAccelerationRate);
}

INSTANTIATE_TEST_SUITE_P(Robots, JointPdTest, ::testing::Values("single_joint", "indy7"));

}  // namespace
}  // namespace viable
