// What a run says of an arm that does not follow, of gains that it cannot carry, and of a job that is not done.

#include <nlohmann/json.hpp>

#include "CaseSupport.h"

namespace viable::test {
namespace {

/** A hand leads a Panda; keys can be overridden. */
const std::vector<std::string> kPanda = {"robot=panda", "duration_s=4", "real_plant.payload_kg=0.2"};

Experiment readPanda(const std::vector<std::string>& overrides) {
    std::vector<std::string> all = kPanda;
    all.insert(all.end(), overrides.begin(), overrides.end());
    return readTestExperiment(kHandLed, all);
}
CaseResult runPanda(const std::vector<std::string>& overrides = {}) {
    return runCase(configureCase(readPanda(overrides).cases.front()), {});
}

TEST(AnyArm, DefaultGainsFollowAndTheVerdictIsClean) {
    const CaseResult r = runPanda();
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    EXPECT_EQ(r.exitCode(), 0);
    EXPECT_TRUE(findProblems(r).empty()) << formatVerdict(r);
    for (int i = 0; i < 7; ++i) EXPECT_LT(r.summary.trackingRms(i), 0.01) << i;
    EXPECT_LT(r.summary.toolErrorRms(), 0.005);
    // The real tool: by its own kinematics, not far from the nominal one.
    EXPECT_LT(std::abs(r.summary.realTool().errorRms() - r.summary.toolErrorRms()), 0.002);
    expectContains(formatDetails(r), {"command       nominal tool", "; real tool", "degrees RMS"});
}

TEST(Fault80, GainsThatTheArmCannotCarryAreRefusedWithTheLargestStableOnes) {
    const std::vector<std::string> indy7 = {"robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8}"};
    const std::string refused = catchError([&] { runPanda(indy7); });
    expectContains(refused, {"unstable on this arm at a tick of 0.001 s", "k_r of joint7 is 600", "about [", "`auto`",
                             "accept_unstable: true"});
    // Those that the remedy prints hold the arm.
    const std::size_t from = refused.find("k_r: ["), to = refused.find(". To run");
    const CaseResult constant = runPanda({"robust_loop={plugin: nric, " + refused.substr(from, to - from) + "}"});
    EXPECT_EQ(constant.stopReason, StopReason::None) << constant.stopMessage;
    // Those that are named, halved, are stable.
    const std::size_t begin = refused.find("about [") + 6;
    const std::string largest = refused.substr(begin, refused.find(']', begin) + 1 - begin);
    expectError({"unstable"}, [&] {
        runPanda({"robust_loop.k_r=" + largest, "robust_loop.k_p=1", "robust_loop.k_i=0.1"});
    });
    std::string half = "[";
    for (const char* number = largest.c_str() + 1; *number;) {
        char* end = nullptr;
        half += (half.size() > 1 ? ", " : "") + std::to_string(0.5 * std::strtod(number, &end));
        number = *end == ',' ? end + 1 : "";
    }
    EXPECT_NO_THROW(configureCase(
        readPanda({"robust_loop.k_r=" + half + "]", "robust_loop.k_p=1", "robust_loop.k_i=0.1"}).cases.front()));
    // k_p or k_i can be too large for a k_r that is not, and for gains that follow the inertia.
    expectError({"unstable", "k_p is too large for such a k_r"}, [&] {
        runPanda({"robust_loop.k_r=" + half + "]", "robust_loop.k_p=2000", "robust_loop.k_i=0.1"});
    });
    expectError({"unstable", "k_p is too large for such a k_r"}, [&] {
        runPanda({"robust_loop.k_p=2000", "robust_loop.k_i=0.1"});
    });
    expectError({"unstable", "k_i of joint1 is 50, and with its k_r and k_p it just becomes unstable at about"}, [&] {
        runPanda({"robust_loop.k_r=" + half + "]", "robust_loop.k_p=2", "robust_loop.k_i=[50, 0, 0, 0, 0, 0, 0]"});
    });
}

// `auto` stands on a bound of 600 for K_r: not to be taken for a constant 600.
TEST(Fault80, TheTwoKindsOfGainsAreJudgedApart) {
    const std::vector<std::string> numbers = {"robust_loop={plugin: nric, k_p: 20, k_i: 8}"};
    const std::vector<std::string> constant = {"robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8}"};
    EXPECT_NO_THROW(configureCase(readPanda(numbers).cases.front()));
    EXPECT_NE(catchError([&] { runPanda(constant); }), "");
    EXPECT_NO_THROW(configureCase(readPanda(numbers).cases.front()));
}

// Feedback of another joint's position would drive the arm away for good.
TEST(AnyArm, ALoopThatActsOnSwappedReadingsIsSwitchedOff) {
    const CaseResult r =
        runFirstCase(kTeleoperation, {"robust_loop={plugin: nric}", "duration_s=3", "real_plant.sensor_fault=swap",
                                      "real_plant.sensor_fault_joint=0", "real_plant.sensor_fault_from_s=1"});
    EXPECT_NE(r.stopReason, StopReason::None);
    EXPECT_EQ(r.exitCode() == 0, false);
    for (int i = 0; i < 6; ++i) EXPECT_LT(r.summary.trackingMax(i), 4.0) << i;
}

// The joint whose reading wrapped is stood in for; the others stay held.
TEST(AnyArm, AWrappedReadingTakesTheLoopFromNoOtherJoint) {
    const std::vector<std::string> wrap = {"robust_loop={plugin: nric}", "duration_s=2", "real_plant.sensor_fault=wrap",
                                           "real_plant.sensor_fault_joint=1", "real_plant.sensor_fault_from_s=1"};
    const CaseResult r = runPanda(wrap);
    EXPECT_EQ(r.stopReason, StopReason::SensorFailed) << r.stopMessage;
    for (int i = 0; i < 6; ++i)
        if (i != 1) EXPECT_LT(r.summary.trackingMax(i), 2e-3) << i;
}

TEST(AnyArm, NoisyEncodersAreNoOscillation) {
    const CaseResult r =
        runFirstCase(kTeleoperation,
                     {"robust_loop={plugin: nric}", "real_plant.encoder_noise_rad=5e-5", "limits.velocity_radps=0.5"});
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    const CaseResult fine = runPanda({"robust_loop={plugin: nric}", "tick_s=0.00025", "duration_s=1",
                                      "real_plant.encoder_noise_rad=5e-5", "limits.velocity_radps=0.25"});
    EXPECT_EQ(fine.stopReason, StopReason::None) << fine.stopMessage;
}

TEST(Fault80, ADelayCountsInTheCheckAndInTheGains) {
    const std::vector<std::string> delayed = {"real_plant.delay_ticks=5"};
    const CaseResult r = runFirstCase(kTeleoperation, {"robust_loop={plugin: nric}", delayed[0]});
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    expectError({"unstable", "a delay of 5 ticks", "k_r of joint"}, [&] { runFirstCase(kTeleoperation, delayed); });
}

TEST(Fault80, AcceptedItRunsToItsEndAndTheVerdictTells) {
    const CaseResult r = runPanda({"robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8, accept_unstable: true}"});
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    EXPECT_EQ(r.exitCode(), 0);
    expectContains(formatVerdict(r),
                   {"the robust loop is unstable on this arm", "the real arm does not follow the nominal one: joint"});
}

// A real arm of a twentieth of the masses that the check knows: unstable all the same.
TEST(Fault80, ALoopThatSwingsIsStoppedWithin50Milliseconds) {
    const CaseResult r = runPanda({"real_plant.mass_factor=0.02", "real_plant.payload_kg=0", "duration_s=2"});
    EXPECT_EQ(r.stopReason, StopReason::NotFollowing);
    EXPECT_LE(r.stopTime_s, 0.05);
    EXPECT_EQ(r.exitCode(), 6);
    expectContains(r.stopMessage, {"because the real arm oscillates: the velocity of joint", "rad/s about"});
    expectContains(formatVerdict(r), {"the real arm did not follow, and the nominal one was stopped"});
    EXPECT_FALSE(r.summary.anyLimitBroken());
}

TEST(Fault80, ALoopThatIsAlmostUnstableIsTold) {
    const CaseResult r =
        runPanda({"duration_s=0.2",
                  "robust_loop={plugin: nric, k_r: [5.74, 129, 3.23, 35.2, 2.25, 2.67, 0.0852], "
                  "k_p: [100, 93, 100, 100, 100, 100, 100], k_i: [55.2, 37.2, 84, 100, 100, 100, 100]}"});
    ASSERT_TRUE(r.margins && r.margins->isStable && r.margins->phase_rad < 0.3);
    expectContains(formatVerdict(r), {"the robust loop is almost unstable: its margin is", "35 degrees are enough"});
}

// The same where nobody stops it: not the limits of acceleration are the remedy.
TEST(Fault80, MotorsThatTheRobustLoopDrivesToTheirLimitsAreToldAsThat) {
    const CaseResult r = runPanda({"real_plant.mass_factor=0.02", "real_plant.payload_kg=0", "duration_s=1",
                                   "robust_loop={plugin: nric, accept_unstable: true}"});
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    expectContains(formatVerdict(r), {"the robust loop swings and drives motors to their torque limits: joint",
                                      "smaller gains, or the true masses"});
    EXPECT_EQ(formatVerdict(r).find("lower the limits of acceleration"), std::string::npos) << formatVerdict(r);
}

TEST(Fault81, MotorsThatCannotCarryTheMotionAreTheCauseOfAStop) {
    const CaseResult r = runFirstCase(kTeleoperation, {"real_plant.torque_limit_factor=0.15"});
    EXPECT_EQ(r.stopReason, StopReason::NotFollowing);
    expectContains(r.stopMessage, {"the real arm does not follow: joint", "gives less torque than is asked of it"});
    expectContains(r.stopRemedy, {"less than actuation.yaml says"});
}

TEST(AnyArm, ALoopThatIsTooWeakIsToldAsThat) {
    const CaseResult r = runFirstCase(kTeleoperation, {"robust_loop={plugin: none}"});
    EXPECT_EQ(r.stopReason, StopReason::NotFollowing);
    expectContains(r.stopMessage, {"does not follow", "no motor is at its torque limit"});
}

TEST(AnyArm, ASwingingToolIsNamedWithItsRemedy) {
    const std::vector<std::string> hand = {"duration_s=20", "filter={plugin: certified_braking}"};
    const CaseResult spring = runFirstCase(kTeleoperation, hand);
    expectContains(formatVerdict(spring), {"the tool swings about its command", "tool_servo, which knows it"});
    const CaseResult servo = runFirstCase(kTeleoperation, {hand[0], hand[1], "controller={plugin: tool_servo}"});
    EXPECT_TRUE(findProblems(servo).empty()) << formatVerdict(servo);
    const auto json = nlohmann::json::parse(writeSummaryJson("", "", {spring, servo}));
    EXPECT_EQ(json["cases"][0]["shortcomings"].size(), 1u);
    EXPECT_EQ(json["cases"][1]["shortcomings"].size(), 0u);
    EXPECT_EQ(json["cases"][1]["real_tool_error_rms_m"].get<double>(), servo.summary.realTool().errorRms());
}

// Nominal arm and controller diverge: the run ends, in bounded time, and the filter that passed it on is not blamed.
TEST(Fault82, ACaseThatDivergesEndsAndNamesTheController) {
    const CaseResult r = runFirstCase(
        kOneJoint, {"filter={plugin: pass_through}", "controller.stiffness=4.2e6", "controller.damping=0",
                    "limits={velocity_radps: .inf, acceleration_radps2: 10, jerk_radps3: 100}", "duration_s=5"});
    EXPECT_EQ(r.stopReason, StopReason::ControllerFailed) << r.stopMessage;
    expectContains(r.stopMessage, {"controller", "joint_pd", "the filter passed on, is beyond 1e9",
                                   "it was still braking after 10.0000 s"});
    EXPECT_LE(r.simulated_s, 16.0);
}

TEST(Fault82, AStopThatIsMerelyLongComesToItsEnd) {
    const CaseResult r =
        runFirstCase(kOneJoint, {"limits={velocity_radps: 3, acceleration_radps2: 0.2, jerk_radps3: 0.2}",
                                 "start.velocity_radps=2.9", "command.points=[[0, 300]]", "limits.position_rad=100",
                                 "limits.allow_large_angles=true", "filter={plugin: certified_braking}",
                                 "missed_ticks=[{at_s: 0.1, count: 1001}]"});
    EXPECT_EQ(r.stopReason, StopReason::TicksMissed) << r.stopMessage;
    EXPECT_GT(r.simulated_s, 14.0);
    EXPECT_EQ(r.stopMessage.find("still braking"), std::string::npos) << r.stopMessage;
}

}  // namespace
}  // namespace viable::test
