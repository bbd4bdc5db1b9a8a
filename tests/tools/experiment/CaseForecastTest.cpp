// What is told of a case before its run: motors, gains, clearances at the start, the command's first pose.

#include "experiment/CaseForecast.h"

#include "CaseSupport.h"
#include "config/Draws.h"

namespace viable::test {
namespace {

Experiment readArm(std::vector<std::string> overrides = {}) {
    overrides.insert(overrides.begin(), {"limits={velocity_radps: 1, acceleration_radps2: 4, jerk_radps3: 40}",
                                         "command={plugin: generated_hand_motion, seed: 1}"});
    return readTestExperiment(kHandLed, overrides);
}

CaseForecast forecast(const std::vector<std::string>& overrides = {}) {
    return forecastCase(*configureCase(readArm(overrides).cases.front()));
}

std::string joinWarnings(const CaseForecast& told) {
    std::string all;
    for (const std::string& warning : told.warnings) all += warning + "\n";
    return all;
}

TEST(CaseLimits, AKindOfALibraryIsOfExperimentsThatUseIt) {
    std::string text = kOneJoint;
    const std::string cases = "cases: {A: {}}";
    text.replace(text.find(cases), cases.size(),
                 "cases: {A: {}, B: {filter: {plugin: " VIABLE_BROKEN_PLUGIN_DIR
                 "/viable_filter_upright.so, judge: cannot_say}}, "
                 "C: {filter: {plugin: " VIABLE_BROKEN_PLUGIN_DIR "/viable_filter_upright.so}}}");
    const Experiment with = readTestExperiment(text), without = readTestExperiment(kOneJoint);
    const LimitSet upright{addLimitKind("upright", "deg")};
    for (const CasePlan& plan : with.cases) EXPECT_EQ(findLimits(plan), upright) << plan.name;
    configureCase(with.cases[1]);  // from here on it cannot say whether a case has it
    EXPECT_THROW(findLimits(with.cases[0]), Error);
    EXPECT_TRUE(findLimits(without.cases.front()).isEmpty());
    configureCase(with.cases[2]);  // and here again it can
    EXPECT_EQ(findLimits(with.cases[0]), upright);
}

TEST(Forecast, OfAnArmThatIsWellTellsGainsAndMotorsAndWarnsOfNothing) {
    const CaseForecast told = forecast();
    EXPECT_EQ(joinWarnings(told), "");
    expectContains(told.gains,
                   {"nric: k_r, k_p, k_i from the arm's inertia; margins 11.0 dB and 55 degrees", "least at joint"});
    expectContains(told.motors,
                   {"10 % (joint2) to hold the start", "any pose within the limits", "acceleration limit"});
    expectContains(forecast({"robust_loop={plugin: nric, k_p: 5}"}).gains,
                   {"k_r, k_i from the arm's inertia, k_p given"});
}

TEST(Forecast, NumbersThatCanOnlyBeDegreesAreWarnedOfInCheckAndRun) {
    const auto warn = [](const std::vector<std::string>& overrides, std::initializer_list<std::string> words) {
        const Experiment experiment = readArm(overrides);
        const CaseForecast told = forecastCase(*configureCase(experiment.cases.front()));
        expectContains(joinWarnings(told), words);
        const std::vector<std::string> run = makeResult(*configureCase(experiment.cases.front())).warnings;
        ASSERT_EQ(run.size(), 1u);
        expectContains(run[0], words);
        EXPECT_EQ(told.warnings[0], run[0]);
    };
    warn({"limits.velocity_radps=120"}, {"the velocity limit of joint0 is 120 rad/s, 45.8 times the robot's own 2.62: "
                                         "perhaps degrees; write `120*pi/180`"});
    warn({"limits.velocity_radps=1200"}, {"458 times the robot's own 2.62: check its unit and exponent"});
    warn({"limits.position_rad=12"}, {"the position limit of joint", "perhaps degrees; write `12*pi/180`"});
    warn({"command={plugin: waypoints, points: [[0, 0, 0, 90, 0, 0, 0]]}", "controller={plugin: joint_servo}"},
         {"command.points row 1: the position of joint2 is 90 rad", "perhaps degrees; write `90*pi/180`"});
    // A jerk limit is free: 200, 2000 and 200000 may be meant, one that would be the robot's own in degrees hardly.
    const auto jerk = [](const char* factor) { return std::string("limits.jerk_radps3=") + factor; };
    warn({jerk("2160")}, {"the jerk limit of joint0 is ", "perhaps degrees; write `"});
    for (const char* free : {"226", "1131", "3770"})
        EXPECT_TRUE(makeResult(*configureCase(readArm({jerk(free)}).cases.front())).warnings.empty()) << free;
    warn({"command.reach_m=[5, 0, 0]"}, {"command.reach_m is 5 m, 3.48 times the robot's own 1.44"});
    EXPECT_TRUE(makeResult(*configureCase(readArm().cases.front())).warnings.empty());
    const Experiment start = readArm({"start={position_rad: [90, 0, 0, 0, 0, 0]}"});
    expectError({"the start position of joint0 is 90 rad", "perhaps degrees; write `90*pi/180`"},
                [&] { configureCase(start.cases.front()); });
}

TEST(Forecast, TellsWhatIsKnownOfPeople) {
    using Lines = std::vector<std::string>;
    EXPECT_EQ(forecast().people, Lines());
    EXPECT_TRUE(forecast().keepsApart);
    const std::string ann =
        "environment={people: {ann: {capsules: [{from_m: [3, 0, 0], radius_m: 0.2}], "
        "walk: [{time_s: 0, xyz: [0, 0, 0]}], ";
    const CaseForecast blind = forecast({ann + "max_speed_mps: 1.2, latency_s: 0.05, error_m: 0.02}}}"});
    EXPECT_EQ(
        blind.people,
        Lines{"ann: at most 1.2 m/s, seen at most 0.05 s late and 0.02 m off, what can touch it must rest first"});
    EXPECT_FALSE(blind.keepsApart);
    const CaseForecast seeing = forecast({ann + "contact_speed_mps: 0.25}}}", "filter.plugin=whole_arm_braking"});
    EXPECT_EQ(seeing.people,
              Lines{"ann: at most 1.6 m/s, seen at most 0 s late and 0 m off, contact at 0.25 m/s at most"});
    EXPECT_TRUE(seeing.keepsApart);
    expectContains(forecast({ann + "body_part: hand}}}", "filter.plugin=whole_arm_braking"}).people.at(0),
                   {"contact (hand) at ", " m/s at most"});
}

// Of one folder, and not a figure of the file that differs: only what was read.
TEST(Forecast, RobotsThatDifferShareNoMargins) {
    const Experiment experiment = readArm({"robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8}"});
    CasePlan plan = experiment.cases.front();
    const auto first = configureTracking(plan);
    EXPECT_EQ(configureTracking(plan)->margins->gain, first->margins->gain);
    plan.robot.actuation.rotorInertia *= 1.5;
    const auto other = configureTracking(plan);
    EXPECT_EQ(
        other->margins->gain,
        calcMargins(plan.robot, plan.limits, plan.tick_s, 0, *other->plugins.robustLoop->traits().errorLoop).gain);
    EXPECT_NE(other->margins->gain, first->margins->gain);
}

TEST(Forecast, OfEveryExperimentOfTheProjectWarnsOfNothing) {
    int cases = 0;
    const PluginLoader loader({VIABLE_PLUGIN_DIR});
    for (const auto& entry : std::filesystem::directory_iterator(VIABLE_SOURCE_DIR "/experiments")) {
        if (entry.path().extension() != ".yaml") continue;
        SCOPED_TRACE(entry.path().string());
        ConfigNode root = readExperimentTree(entry.path().string(), {});
        resolveDraws(root, {1, 0}, {});
        const Experiment experiment =
            readExperiment(root, entry.path().string(), {}, loader, {VIABLE_SOURCE_DIR "/robots"});
        for (const CasePlan& plan : experiment.cases) {
            EXPECT_EQ(joinWarnings(forecastCase(*configureCase(plan))), "") << plan.name;
            ++cases;
        }
    }
    EXPECT_GT(cases, 40);
}

TEST(Fault81, MotorsThatCannotHoldTheStartAreNamedWithJointPoseAndShare) {
    const std::vector<std::string> heavy = {"payload_kg=60"};
    const CaseForecast told = forecast(heavy);
    ASSERT_EQ(told.warnings.size(), 2u) << joinWarnings(told);
    // By another route: the torque that holds the arm, from the energy of the pose.
    const CasePlan plan = readArm(heavy).cases.front();
    RobotModel model(plan.robot);
    const JointVector still = JointVector::Zero(6);
    double worst = 0.0;
    int joint = 0;
    for (int i = 0; i < 6; ++i) {
        constexpr double h = 1e-6;
        JointVector more = plan.start.q, less = plan.start.q;
        more[i] += h;
        less[i] -= h;
        const double torque = (model.calcEnergy(more, still) - model.calcEnergy(less, still)) / (2.0 * h);
        const double share = std::abs(torque) / plan.robot.actuation.torqueLimit[i];
        if (share > worst) joint = i;
        worst = std::max(worst, share);
    }
    ASSERT_GT(worst, 1.0);
    expectContains(told.warnings[0],
                   {"the motors cannot hold the start: " + plan.robot.joints[static_cast<std::size_t>(joint)].name +
                        " takes " + std::to_string(std::lround(100.0 * worst)) + " % of its motor's torque limit",
                    " of 79.8 Nm) in the pose [0, -0.262, -1.57, 0, -1.31, 0]", "`start.position_rad`"});
    expectContains(told.warnings[1], {"cannot hold every pose within the limits: joint", "`torque_share`"});
}

TEST(Fault81, MotorsThatCannotCarryTheLimitsAreNamedWithWhatTheyCarry) {
    const std::vector<std::string> fast = {"limits.acceleration_radps2=60", "limits.jerk_radps3=200"};
    const CaseForecast told = forecast(fast);
    ASSERT_EQ(told.warnings.size(), 1u) << joinWarnings(told);
    expectContains(told.warnings[0], {"the motors cannot carry the limits: joint", "acceleration limit of 60 rad/s^2",
                                      "in the pose [", "Lower its acceleration_radps2 to"});
    // With what it names the joint is carried; and a filter that knows the motors needs no advice.
    const std::size_t at = told.warnings[0].find("Lower its acceleration_radps2 to ") + 33;
    const double carried = std::stod(told.warnings[0].substr(at));
    EXPECT_LT(carried, 60.0);
    const CaseForecast slower =
        forecast({"limits.acceleration_radps2=" + std::to_string(0.98 * carried), "limits.jerk_radps3=200"});
    EXPECT_EQ(joinWarnings(slower), "");
    EXPECT_EQ(joinWarnings(forecast({fast[0], fast[1], "filter={plugin: whole_arm_braking, torque_share: 0.9}"})), "");
}

TEST(Fault81, AStartThatTheFilterCannotCarryIsRefusedWithJointAndPose) {
    expectError({"needs 153 % of the torque that joint3 may use", "Nm in the pose [0, -0.262, -1.57, 0, -1.31, 0], 0 s",
                 "torque_share"},
                [] {
                    forecast({"payload_kg=60", "filter={plugin: whole_arm_braking, torque_share: 0.9}"});
                });
}

// The elbow folded so far that links meet: all of it at once, deepest first.
TEST(Forecast, AnArmThatStartsInItselfIsToldInOneList) {
    const std::vector<std::string> folded = {"start.position_rad=[0, 0, 2.9, 0, 0.5, 0]", "environment={}",
                                             "limits.position_rad=3.1"};
    const CaseForecast told = forecast(folded);
    ASSERT_EQ(told.warnings.size(), 1u) << joinWarnings(told);
    const std::string& list = told.warnings[0];
    expectContains(list, {"starts nearer than safety_distance_m, 0.02 m: link", "m deep, link", "`may_touch`"});
    // The filter that would keep clearances refuses it with the same pairs.
    const std::string refused = catchError([&] {
        forecast({folded[0], folded[1], folded[2], "filter={plugin: whole_arm_braking}"});
    });
    expectContains(refused, {"brings link", " m from link", ", link", "at least 0.02 m is to be kept"});
    const auto count = [](const std::string& text, const std::string& what) {
        int n = 0;
        for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
        return n;
    };
    const int pairs = count(list, " to link");
    EXPECT_GT(pairs, 1);
    EXPECT_EQ(count(refused, " m from link"), pairs) << list << "\n" << refused;
}

/** A joint whose command rests 5.1 mrad from where it starts: what the forecast says, and what a run does. */
struct Rest {
    std::string told;
    double jerk;  ///< RMS over its last quarter, as a share of the limit
};
Rest tryRest(const std::string& controller, const std::string& filter, const std::string& jerk) {
    const Experiment e = readTestExperiment(
        kOneJoint, {"controller=" + controller, "filter=" + filter, "duration_s=20",
                    "command={plugin: waypoints, points: [[0, 0.0051]]}",
                    "limits={velocity_radps: 3, acceleration_radps2: 8, jerk_radps3: " + jerk + "}"});
    std::string told = joinWarnings(forecastCase(*configureCase(e.cases.front())));
    if (told.find("goes on swinging") == std::string::npos)
        told.clear();  // another: the jerk is far beyond the robot's
    const auto configured = configureCase(e.cases.front());
    ControlLoop loop(configured->setup, std::move(configured->plugins));
    TickRecord record;
    double squared = 0.0;
    for (int k = 0; k < 20000; ++k) {
        loop.tick(record);
        if (k >= 15000) squared += record.nominal.jerk[0] * record.nominal.jerk[0] / 5000.0;
    }
    return {told, std::sqrt(squared) / std::stod(jerk)};
}

TEST(Fault80, ANominalLoopThatDoesNotComeToRestIsToldBeforeTheRun) {
    const auto spring = [](double stiffness, double damping) {
        return "{plugin: joint_pd, stiffness: " + std::to_string(stiffness) + ", damping: " + std::to_string(damping) +
               "}";
    };
    const char* const kCertified = "{plugin: certified_braking}";
    // Damped twice as much as critical springs are; too stiff for a low jerk limit, and not for a high one.
    for (const double stiffness : {5.0, 50.0, 300.0, 6000.0, 20000.0}) {
        SCOPED_TRACE(stiffness);
        const std::string pd = spring(stiffness, 2.0 * std::sqrt(stiffness));
        const Rest low = tryRest(pd, kCertified, "20"), high = tryRest(pd, kCertified, "2000");
        const bool swings = stiffness > 1000.0;
        EXPECT_EQ(low.told != "", swings) << low.told;
        EXPECT_EQ(low.jerk > 0.1, swings) << low.jerk;
        EXPECT_EQ(high.told, "");
        EXPECT_LT(high.jerk, 1e-3);
        if (swings)
            expectContains(low.told, {"controller joint_pd and the filter certified_braking", "joint0 goes on swinging",
                                      "its jerk limit of 20 rad/s^3 is too small", "joint_servo, which know it"});
    }
    // Faster than the tick: no jerk limit is to blame.
    const Rest fast = tryRest(spring(100.0, 2500.0), kCertified, "2000");
    expectContains(
        fast.told,
        {"joint0 goes on swinging (feedback there: 100 1/s^2 and 2.5e+03 1/s at a tick of 0.001 s)", "shorter tick"});
    EXPECT_GT(fast.jerk, 0.1);
    // Without damping, and without a filter in between.
    for (const char* filter : {kCertified, "{plugin: pass_through}"}) {
        EXPECT_NE(tryRest(spring(100.0, 0.0), filter, "2000").told, "") << filter;
        EXPECT_EQ(tryRest(spring(100.0, 20.0), filter, "2000").told, "") << filter;
    }
}

TEST(Fault80, ASpringAtTheToolIsToldWithTheJointThatItShakes) {
    const auto tell = [](const std::string& spring, const std::string& damper) {
        return joinWarnings(
            forecast({"controller={plugin: task_space_pd, stiffness: " + spring + ", damping: " + damper + "}"}));
    };
    EXPECT_EQ(tell("[600, 600, 600, 160, 160, 160]", "[60, 60, 60, 16, 16, 16]"), "");
    expectContains(tell("[1e5, 1e5, 1e5, 1e4, 1e4, 1e4]", "[10, 10, 10, 1, 1, 1]"),
                   {"controller task_space_pd", "do not bring the nominal arm to rest at the start", "joint",
                    "Damping of about 2 sqrt(stiffness)", "less stiffness"});
    EXPECT_EQ(joinWarnings(forecast({"controller={plugin: task_space_pd}"})), "");
}

TEST(Fault80, NoControllerOfTheProjectIsWarnedOfOnAnyOfItsRobotsAsItComes) {
    int cases = 0;
    for (const auto& robot : std::filesystem::directory_iterator(VIABLE_SOURCE_DIR "/robots")) {
        if (!robot.is_directory()) continue;
        for (const char* filter : {"certified_braking", "tosbp", "tovzbp", "exponential_cbf"})
            for (const char* controller : {"joint_pd", "joint_servo", "task_space_pd", "tool_servo"}) {
                const bool isJoint = std::string(controller).find("joint") == 0;
                const Experiment e = readTestExperiment(
                    std::string("schema: 1\ntitle: defaults\nduration_s: 1\ncases: {A: {}}\nrobot: ") +
                    robot.path().filename().string() + "\nfilter: {plugin: " + filter +
                    "}\ncontroller: {plugin: " + controller + "}\ncommand: {plugin: " +
                    (isJoint ? "random_steps, seed: 1" : "generated_hand_motion, seed: 1") + "}\n");
                EXPECT_EQ(joinWarnings(forecastCase(*configureCase(e.cases.front()))), "")
                    << robot.path() << " " << controller << " " << filter;
                ++cases;
            }
    }
    EXPECT_GE(cases, 80);
}

/** A tool that is to be at a place from the beginning. */
class Place : public CommandSource {
public:
    explicit Place(const Pose& pose) : pose_(pose) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double, MotionCommand& out) override {
        out.space = MotionCommand::Space::Tool;
        out.tool = pose_;
        return TickStatus::Ok;
    }

private:
    Pose pose_;
};

TEST(Fault20, ACommandThatStartsOutOfReachOrFarAwayIsTold) {
    const auto at = [&](const Eigen::Vector3d& place, const std::vector<std::string>& overrides = {}) {
        const Experiment experiment = readArm(overrides);
        const auto configured = configureCase(experiment.cases.front());
        Pose pose = configured->setup.startTool;
        pose.position = place;
        configured->plugins.command = {new Place(pose),
                                       [](void* object) { delete static_cast<CommandSource*>(object); }};
        return joinWarnings(forecastCase(*configured));
    };
    const std::string far = at({3, 0, 0.5});
    expectContains(far, {"the command starts", "out of its reach: the nearest place found", "relative: true"});
    EXPECT_EQ(at({3, 0, 0.5}, {"controller.relative=true"}), "");
    const std::string reachable = at({0.3, 0.4, 0.4});
    expectContains(reachable, {"the command starts", "the arm goes there first"});
    EXPECT_EQ(reachable.find("out of its reach"), std::string::npos) << reachable;
    // Of an arm whose reach is known: what is missing is what is farther away than it is long.
    const std::size_t begin = far.find("limits is ") + 10;
    const double missing = std::stod(far.substr(begin));
    EXPECT_GT(missing, 1.5);
    EXPECT_LT(missing, 3.0);
}

}  // namespace
}  // namespace viable::test
