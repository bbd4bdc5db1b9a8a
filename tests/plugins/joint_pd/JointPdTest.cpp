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
        controller_.configure(arm_.setup(), arm_.read(PluginKind::NominalController, "joint_pd", text));
        controller_.reset(arm_.start);
    }

    void drawInputs() {
        state_ = {arm_.robot.home + makeRandomVector(n(), 0.8, random_), makeRandomVector(n(), 2.0, random_),
                  makeRandomVector(n(), 10.0, random_)};
        command_.space = MotionCommand::Space::Joint;
        command_.q = arm_.robot.home + makeRandomVector(n(), 0.8, random_);
        command_.qd = makeRandomVector(n(), 2.0, random_);
    }

    /** The acceleration that the controller's torque causes. Without rotors Simbody's own forward
    dynamics says it, which shares nothing with the M and b that the controller used. */
    JointVector calcResult(const Dynamics& dynamics) {
        ControllerOutput output;
        EXPECT_EQ(controller_.compute({command_, state_, dynamics}, output), TickStatus::Ok);
        return arm_.model().calcLinkForwardDynamics(state_.q, state_.qd, output.torque);
    }

    TestArm arm_;
    JointPd controller_;
    MotionState state_;
    MotionCommand command_;
    std::mt19937 random_{4};
};

TEST_P(JointPdTest, ResultingAccelerationIsEquation24) {
    arm_.robot.actuation.rotorInertia.setZero();
    arm_.rebuildModel();
    configure("stiffness: 5, damping: 1");
    for (int k = 0; k < 100; ++k) {
        drawInputs();
        const JointVector qdd = calcResult(arm_.calcDynamics(state_));
        for (int i = 0; i < n(); ++i)
            EXPECT_NEAR(qdd[i], 5.0 * (command_.q[i] - state_.q[i]) - 1.0 * state_.qd[i], 1e-8);
    }
}

TEST_P(JointPdTest, FeedforwardDampsTheDifferenceOfVelocities) {
    arm_.robot.actuation.rotorInertia.setZero();
    arm_.rebuildModel();
    configure("stiffness: 40, damping: 12, velocity_feedforward: true");
    for (int k = 0; k < 100; ++k) {
        drawInputs();
        const JointVector qdd = calcResult(arm_.calcDynamics(state_));
        for (int i = 0; i < n(); ++i)
            EXPECT_NEAR(qdd[i], 40.0 * (command_.q[i] - state_.q[i]) + 12.0 * (command_.qd[i] - state_.qd[i]), 1e-8);
    }
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
    const Dynamics unit = makeUnitDynamics(n());
    ASSERT_EQ(controller_.compute({command_, state_, unit}, output), TickStatus::Ok);
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
    badState.qd[0] = std::numeric_limits<double>::infinity();
    expectRefused(command_, badState);
}

TEST_P(JointPdTest, RefusesNegativeGains) {
    EXPECT_CONTAINS(findComplaint([&] { configure("stiffness: -5"); }), "stiffness");
    EXPECT_CONTAINS(findComplaint([&] { configure("damping: -0.1"); }), "-0.1");
    EXPECT_CONTAINS(findComplaint([&] { configure("stifness: 5"); }), "stiffness");
}

TEST_P(JointPdTest, LoadsAsALibrary) {
    configure("");
    const auto plugin = PluginLoader::create<NominalController>(findPlugin(PluginKind::NominalController, "joint_pd"));
    plugin->configure(arm_.setup(), arm_.read(PluginKind::NominalController, "joint_pd", ""));
    plugin->reset(arm_.start);
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
