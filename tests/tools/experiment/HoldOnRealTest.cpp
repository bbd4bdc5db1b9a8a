#include "CaseSupport.h"

// limits: {hold_on: real} and disturbance_set in experiment files.

namespace viable::test {
namespace {

const std::vector<std::string> kReal = {
    "filter={plugin: certified_braking}",
    "limits.velocity_radps=0.8",
    "limits.acceleration_radps2=2",
    "limits.jerk_radps3=10",
    "robust_loop={plugin: nric, k_r: [1950, 2600, 1000, 400, 450, 390], k_p: 78, k_i: 8}",
    "disturbance_set={friction_scale: 1, payload_kg: 1}",
    "real_plant={plugin: simbody}"};

std::vector<std::string> with(std::vector<std::string> overrides) {
    overrides.insert(overrides.begin(), kReal.begin(), kReal.end());
    return overrides;
}

void configureTest(const std::vector<std::string>& overrides) {
    configureCase(readTestExperiment(kTeleoperation, overrides).cases.front());
}

TEST(HoldOnReal, TightensPositionAndVelocityByTheBoundAndNothingElse) {
    const Experiment nominalFile = readTestExperiment(kTeleoperation, kReal);
    const Experiment realFile = readTestExperiment(kTeleoperation, with({"limits.hold_on=real"}));
    EXPECT_FALSE(nominalFile.cases.front().holdsOnReal);
    EXPECT_TRUE(realFile.cases.front().holdsOnReal);
    const auto nominalCase = configureCase(nominalFile.cases.front()), realCase = configureCase(realFile.cases.front());
    ASSERT_TRUE(nominalCase->bound && realCase->bound);
    const RunSetup &onNominal = nominalCase->setup, &onReal = realCase->setup;
    EXPECT_EQ(onNominal.limits.position.upper, nominalFile.cases.front().limits.position.upper);
    const TrackingBound& bound = *realCase->bound;
    EXPECT_GT(bound.position.minCoeff(), 0.0);
    EXPECT_EQ(realFile.cases.front().limits.position.upper, onNominal.limits.position.upper);
    EXPECT_EQ(onReal.limits.position.upper, onNominal.limits.position.upper - bound.position);
    EXPECT_EQ(onReal.limits.position.lower, onNominal.limits.position.lower + bound.position);
    EXPECT_EQ(onReal.limits.velocity.upper, onNominal.limits.velocity.upper - bound.velocity);
    EXPECT_EQ(onReal.limits.velocity.lower, onNominal.limits.velocity.lower + bound.velocity);
    EXPECT_EQ(onReal.limits.acceleration.upper, onNominal.limits.acceleration.upper);
    EXPECT_EQ(onReal.limits.jerk.upper, onNominal.limits.jerk.upper);
}

// The log's copy of the experiment says what the file said, and gives the same case again.
TEST(HoldOnReal, TheResolvedFileKeepsTheLimitsOfTheRealArm) {
    const CasePlan plan = readTestExperiment(kTeleoperation, with({"limits.hold_on=real"})).cases.front();
    const TemporaryFolder folder;
    const std::filesystem::path file = folder.path() / "again.yaml";
    std::ofstream(file) << writeConfig(plan.resolved);
    const CasePlan again = readExperiment(file, {}, PluginLoader({VIABLE_PLUGIN_DIR}), {}).cases.front();
    EXPECT_TRUE(again.holdsOnReal);
    EXPECT_EQ(again.limits.position.lower, plan.limits.position.lower);
    EXPECT_EQ(again.limits.velocity.upper, plan.limits.velocity.upper);
}

TEST(HoldOnReal, WithoutABoundItIsRefused) {
    expectError({"hold_on: real needs a tracking bound, and this case has none"}, [] {
        readTestExperiment(kTeleoperation,
                           {"limits.hold_on=real", "real_plant={plugin: simbody}", "robust_loop={plugin: nric}"});
    });
    expectError({"State a disturbance_set and use the robust loop nric."}, [] {
        configureTest(with({"limits.hold_on=real", "robust_loop={plugin: none}"}));
    });
    expectError({"leaves the nominal joint"}, [] {
        configureTest(with({"limits.hold_on=real", "limits.velocity_radps=0.02"}));
    });
}

TEST(DisturbanceSet, ALimitedChangeOfTheMotorsWholeTorqueHasNoBound) {
    const auto configure = [](const std::string& rate) {
        const Experiment e = readTestExperiment(
            kOneJoint, {"robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8, motor_rate_Nmps: " + rate + "}",
                        "real_plant={plugin: simbody}", "disturbance_set={}"});
        configureCase(e.cases.front());
    };
    EXPECT_NO_THROW(configure(".inf"));
    expectError({"motor_rate_Nmps", "no tracking bound covers", "`torque_rate_Nmps`"}, [&] { configure("1e6"); });
}

TEST(DisturbanceSet, WhatIsWrongInItIsToldWithItsPlace) {
    const auto tell = [](const std::string& override) { return catchError([&] { configureTest(with({override})); }); };
    EXPECT_CONTAINS(tell("disturbance_set.payload_kg=-1"), "disturbance_set.payload_kg");
    EXPECT_CONTAINS(tell("disturbance_set.payload=1"), "payload_kg");
    EXPECT_CONTAINS(tell("disturbance_set={plugin: nric}"), "disturbance_set is no plugin");
    EXPECT_CONTAINS(tell("start.velocity_radps=[0.1, 0, 0, 0, 0, 0]"), "start at rest, and joint0");
    // What it assumes of loop and plant, which they say themselves.
    EXPECT_CONTAINS(tell("robust_loop.torque_rate_Nmps=10"), "robust_loop: with 10 Nm/s at joint");
    expectContains(tell("robust_loop.integral_limit_Nm=0.001"),
                   {"as the limit of the robust loop's integral the tracking bound does not hold"});
    expectContains(tell("real_plant.encoder=exact"),
                   {"real_plant: the tracking bound is for encoders that tell positions in counts"});
    EXPECT_CONTAINS(tell("robust_loop.k_r=6000"), "the robust loop is unstable on this arm");
    EXPECT_CONTAINS(tell("robust_loop={plugin: nric}"), "is known for constant gains only");
}

// Another loop than one that is linear in the error: nothing is known, so nothing trips.
TEST(DisturbanceSet, OfALoopThatNoBoundFollowsFromIsNoMistake) {
    const Experiment e = readTestExperiment(kTeleoperation, with({"robust_loop={plugin: none}"}));
    EXPECT_FALSE(configureCase(e.cases.front())->bound);
}

// Not before the run: `viable bound` still shows what asks for so much.
TEST(DisturbanceSet, MotorsThatAreTooWeakForItAreRefused) {
    const Experiment e = readTestExperiment(kTeleoperation, with({"disturbance_set.torque_limit_factor=0.3"}));
    ASSERT_TRUE(configureTracking(e.cases.front())->bound);
    expectError({"disturbance_set: the motor of joint1 gives 129"}, [&] { configureCase(e.cases.front()); });
}

}  // namespace
}  // namespace viable::test
