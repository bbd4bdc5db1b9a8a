#include "JointServo.h"

#include "CaseSupport.h"
#include "Effort.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** Set-points that jump, three in ten of them beyond a limit. */
Summary run(std::vector<std::string> overrides = {}) {
    overrides.insert(overrides.begin(),
                     {"duration_s=20", "command={plugin: random_steps, seed: 1, shortest_s: 1, longest_s: 6}",
                      "controller={plugin: joint_servo}", "filter={plugin: certified_braking}"});
    return runNominalArm(overrides);
}

TEST(JointServo, CertifiedFiltersPassItAndLimitsAreKept) {
    for (const char* filter : {"certified_braking", "whole_arm_braking"}) {
        const Summary s = run({std::string("filter.plugin=") + filter});
        EXPECT_GE(passedShare(s), 0.95) << filter;
        EXPECT_FALSE(s.anyLimitBroken()) << filter;
    }
}

TEST(JointServo, IsNearerToItsSetPointsThanASpringAndDamperWithoutAJerkLimit) {
    const double servo = run().commandErrorRms();
    const std::vector<std::string> pd = {"controller={plugin: joint_pd, stiffness: 100, damping: 20}"};
    EXPECT_LT(servo, run({pd[0], "filter.plugin=acceleration_viability"}).commandErrorRms());
    EXPECT_LT(servo, run(pd).commandErrorRms());
}

TEST(JointServo, RestsOnItsSetPointsAndAtTheLimitsInSilence) {
    EXPECT_LE(run().chatter(), 1e-6);
}

// Filters that hold accelerations have no jerk to pass; they take the acceleration at the end of the tick.
TEST(JointServo, FollowsBehindFiltersThatHoldAccelerations) {
    const double certified = run().commandErrorRms();
    for (const char* filter : {"pass_through", "jerk_limited_rate", "acceleration_viability"})
        EXPECT_LT(run({std::string("filter.plugin=") + filter}).commandErrorRms(), 1.25 * certified) << filter;
}

TEST(JointServo, FollowsAMovingSetPoint) {
    const std::vector<std::string> moving = {
        "command={plugin: waypoints, points: [[0, 0, -0.2, -1.4, 0.1, -1.2, 0], [2, 0.3, -0.4, -1.7, -0.1, -1.4, "
        "-0.5]]}",
        "start.position_rad=[0, -0.2, -1.4, 0.1, -1.2, 0]", "duration_s=4"};
    EXPECT_LT(run(moving).commandErrorRms(), 2e-4);
    std::vector<std::string> without = moving;
    without.push_back("controller.velocity_feedforward=false");
    EXPECT_GT(run(without).commandErrorRms(), run(moving).commandErrorRms());
}

TEST(JointServo, NeedsAJerkLimit) {
    expectError({"joint_servo", "jerk limit", "limits.jerk_radps3"}, [] {
        run({"limits.jerk_radps3=.inf", "filter.plugin=pass_through"});
    });
}

// 1e6 ticks: VIABLE_EFFORT=50
TEST(JointServo, TakesNoMemoryInItsTicks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    const RunSetup setup = arm.setup();
    JointServo servo;
    servo.configure(setup, arm.read(PluginKind::NominalController, "joint_servo", ""));
    MotionState state = arm.start;
    Dynamics dynamics = arm.calcDynamics(state);
    MotionCommand command;
    command.q = arm.start.q;
    command.qd.setZero(arm.size());
    ControllerOutput output;
    ASSERT_EQ(servo.compute({command, state, dynamics}, output), TickStatus::Ok);
    const testing::AllocationCounter counter;
    for (int tick = 0; tick < countOf(20000); ++tick) {
        if (tick % 700 == 0) command.q[tick / 700 % 6] = 3.0 * std::sin(tick);
        if (tick % 5000 == 4999) servo.reset(state);
        ASSERT_EQ(servo.compute({command, state, dynamics, {1e-3 * tick, tick % 900 == 0 ? 3 : 0}}, output),
                  TickStatus::Ok);
        advanceArm(state, output.accelerationRate, 1e-3);
    }
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable::test
