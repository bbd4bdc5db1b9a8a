// What goes wrong around a real arm, in whole runs: the nominal arm is as without it, and the run is good, or tripped with a
// cause that is true.

#include "CaseSupport.h"

namespace viable::test {
namespace {

/** An arm of six joints and one of seven. */
const std::vector<std::string> kBothArms = {"robot=indy7", "robot=panda"};

std::vector<std::string> joined(std::vector<std::string> overrides, const std::vector<std::string>& more) {
    overrides.insert(overrides.end(), more.begin(), more.end());
    return overrides;
}

/** A run with its records. */
struct RecordedRun {
    using MakeRobustLoop = std::function<PluginPtr<RobustLoop>(const ConfiguredCase&)>;
    /** @param robustLoop  configured, in place of the file's; null: that one */
    explicit RecordedRun(Experiment e, MakeRobustLoop robustLoop = nullptr) : experiment(std::move(e)) {
        const CasePlan& plan = experiment.cases.front();
        auto configured = configureCase(plan);
        if (robustLoop) configured->plugins.robustLoop = robustLoop(*configured);
        result.emplace(makeResult(*configured));
        ControlLoop loop(configured->setup, std::move(configured->plugins),
                         RealArmOptions{nullptr, plan.feedsExternalTorque, true, false, true, configured->motorRate});
        const auto ticks = static_cast<int>(std::lround(plan.duration_s / plan.tick_s));
        TickRecord record;
        for (int k = 0; k < ticks; ++k) {
            loop.tick(record);
            records.push_back(record);
            result->summary.add(record);
        }
        result->stopReason = loop.stopReason();
        result->stopMessage = loop.stopMessage();
        result->stopTime_s = loop.stopTime();
    }
    RecordedRun(const char* text, const std::vector<std::string>& overrides)
        : RecordedRun(readTestExperiment(text, overrides)) {}

    /** Not tripped, and nothing to complain of. */
    bool isGood() const { return result->stopReason == StopReason::None && findProblems(*result).empty(); }
    bool isTripped() const {
        return result->stopReason == StopReason::NotFollowing || result->stopReason == StopReason::SensorFailed;
    }

    Experiment experiment;
    std::optional<CaseResult> result;
    std::vector<TickRecord> records;
};

/** The nominal arm of `run` is that of `other` to the last bit, up to a trip. Returns the ticks that were compared. */
int expectSameNominal(const RecordedRun& run, const RecordedRun& other) {
    int compared = 0;
    for (std::size_t k = 0; k < run.records.size(); ++k) {
        const TickRecord &a = run.records[k], &b = other.records[k];
        if (a.braking) break;
        EXPECT_EQ(a.nominal.q, b.nominal.q) << k;
        EXPECT_EQ(a.nominal.jerk, b.nominal.jerk) << k;
        EXPECT_EQ(a.filterTorque, b.filterTorque) << k;
        ++compared;
        if (::testing::Test::HasFailure()) break;
    }
    EXPECT_FALSE(run.result->summary.anyLimitBroken());
    return compared;
}

// --- Rates of the motors ----------------------------------------------------------------------------

/** MuJoCo's is built where it is installed. */
bool hasPlant(const char* name) {
    try {
        makeTestLoader().find(PluginKind::RealPlant, name, "test", {});
        return true;
    } catch (const Error&) {
        return false;
    }
}

/** Largest change of the motors' torque in a tick [Nm], from tick `from` on. */
double calcLargestStep(const std::vector<TickRecord>& records, std::size_t from = 1) {
    double largest = 0.0;
    for (std::size_t k = std::max<std::size_t>(from, 1); k < records.size(); ++k)
        largest = std::max(largest, (records[k].motorTorque - records[k - 1].motorTorque).lpNorm<Eigen::Infinity>());
    return largest;
}

TEST(Fault19, ARateOfTheMotorsIsKnownToTheRobustLoopAndCounted) {
    for (const char* engine : {"simbody", "mujoco"}) {
        if (!hasPlant(engine)) continue;
        SCOPED_TRACE(engine);
        const std::vector<std::string> rate = {std::string("real_plant.plugin=") + engine, "real_plant.payload_kg=0.5",
                                               "real_plant.motor_rate_Nmps=300"};
        const RecordedRun run(kHandLed, rate);
        EXPECT_TRUE(run.result->stopReason == StopReason::None) << run.result->stopMessage;
        double cutOff = 0.0;
        for (const TickRecord& r : run.records)
            cutOff = std::max(cutOff, (r.filterTorque + r.robustTorque - r.motorTorque).lpNorm<Eigen::Infinity>());
        EXPECT_LE(calcLargestStep(run.records), 0.3 * (1.0 + 1e-9));
        EXPECT_LE(cutOff, 1e-9);
        std::int64_t ticks = 0;
        for (int i = 0; i < 6; ++i) ticks += run.result->summary.motor(i).ticksRateLimited;
        EXPECT_GT(ticks, 0);
        expectContains(formatDetails(*run.result), {", changing as fast as they may in " + std::to_string(ticks)});
        std::printf("  %s: largest step %.3g Nm, rate acted in %lld joint-ticks\n", engine,
                    calcLargestStep(run.records), static_cast<long long>(ticks));
    }
}

TEST(Fault19, ALoopThatIsNotToldTheRateAsksForWhatTheMotorsDoNotGive) {
    const Experiment e =
        readTestExperiment(kHandLed, {"real_plant.payload_kg=0.5", "real_plant.motor_rate_Nmps=300", "duration_s=1"});
    const auto makeNric = [](const ConfiguredCase& configured, bool isTold) {
        RunSetup setup = configured.setup;
        EXPECT_EQ(setup.motorRate, JointVector::Constant(6, 300.0));
        if (!isTold) setup.motorRate = {};
        auto nric = std::make_unique<Nric>();
        nric->configure(setup, configured.plan.robustLoop->parameters);
        return PluginPtr<RobustLoop>(nric.release(), [](void* p) { delete static_cast<Nric*>(p); });
    };
    const RecordedRun told(e, [&](const ConfiguredCase& c) { return makeNric(c, true); });
    const RecordedRun untold(e, [&](const ConfiguredCase& c) { return makeNric(c, false); });
    const auto calcCutOff = [](const RecordedRun& run) {
        double largest = 0.0;
        for (const TickRecord& r : run.records)
            largest = std::max(largest, (r.filterTorque + r.robustTorque - r.motorTorque).lpNorm<Eigen::Infinity>());
        return largest;
    };
    std::printf("  cut off: up to %.3g Nm, not told %.3g Nm\n", calcCutOff(told), calcCutOff(untold));
    EXPECT_LE(calcCutOff(told), 1e-9);
    EXPECT_GT(calcCutOff(untold), 1.0);
    EXPECT_LE(calcLargestStep(untold.records), 0.3 * (1.0 + 1e-9));
}

// Motors that cannot carry the arm at the start: what they give begins at their limit, not at what carries it.
TEST(MotorRate, OfWeakMotorsNeverGivesMoreThanTheirLimit) {
    for (const char* engine : {"simbody", "mujoco"}) {
        if (!hasPlant(engine)) continue;
        SCOPED_TRACE(engine);
        Experiment e =
            readTestExperiment(kHandLed, {"robot=panda", std::string("real_plant.plugin=") + engine, "duration_s=0.3",
                                          "real_plant.substeps=5", "real_plant.torque_limit_factor=0.2",
                                          "real_plant.motor_rate_Nmps=300"});
        JointVector& start = e.cases[0].start.q;
        start[1] = 1.2;  // stretched out
        start[3] = -0.5;
        const RecordedRun run(e);
        const RobotDescription& robot = run.experiment.cases[0].robot;
        const JointVector limit = 0.2 * robot.actuation.torqueLimit;
        Dynamics d;
        RobotModel(robot).calcDynamics(run.experiment.cases[0].start.q, JointVector::Zero(robot.size()), d);
        ASSERT_TRUE((d.b.cwiseAbs().array() > limit.array()).any()) << "the motors carry the arm";
        double most = 0.0;
        for (const TickRecord& r : run.records)
            most = std::max(most, r.motorTorque.cwiseAbs().cwiseQuotient(limit).maxCoeff());
        EXPECT_LE(most, 1.0 + 1e-12);
        EXPECT_GT(most, 0.99);
        EXPECT_LE(calcLargestStep(run.records), 0.3 * (1.0 + 1e-9));
    }
}

TEST(MotorRate, OneThatDoesNotActChangesNoBit) {
    const RecordedRun without(kHandLed, {"duration_s=0.5"}),
        rated(kHandLed, {"duration_s=0.5", "real_plant.motor_rate_Nmps=1e6"});
    for (std::size_t k = 0; k < without.records.size(); ++k) {
        ASSERT_EQ(rated.records[k].motorTorque, without.records[k].motorTorque) << k;
        ASSERT_EQ(rated.records[k].actual.q, without.records[k].actual.q) << k;
    }
}

TEST(MotorRate, TheSmallerOfPlantAndRobustLoopCounts) {
    const auto configure = [](const std::vector<std::string>& overrides) {
        return configureCase(readTestExperiment(kHandLed, overrides).cases.front())->motorRate;
    };
    EXPECT_EQ(configure({"real_plant.motor_rate_Nmps=300"}), JointVector::Constant(6, 300.0));
    EXPECT_EQ(configure({"robust_loop.motor_rate_Nmps=200"}), JointVector::Constant(6, 200.0));
    for (const char* own : {"200", "400"})
        EXPECT_EQ(configure({"real_plant.motor_rate_Nmps=300", std::string("robust_loop.motor_rate_Nmps=") + own}),
                  JointVector::Constant(6, std::min(300.0, std::stod(own))));
    EXPECT_EQ(configure({}).size(), 0);
    expectError({"real_plant.motor_rate_Nmps", "(0, inf)"}, [&] { configure({"real_plant.motor_rate_Nmps=0"}); });
}

TEST(MotorRate, OfThePlantHasNoTrackingBound) {
    expectError({"motor_rate_Nmps", "no tracking bound covers a limited change of the motor's whole torque"}, [] {
        configureCase(
            readTestExperiment(kTeleoperation, {"filter={plugin: certified_braking}", "real_plant.motor_rate_Nmps=300",
                                                "disturbance_set={payload_kg: 1}"})
                .cases.front());
    });
}

// --- 16: other masses -------------------------------------------------------------------------------

TEST(Fault16, LighterAndHeavierArmsWithShiftedCentresOfMassFollowOrTrip) {
    struct {
        const char* name;
        std::vector<std::string> overrides;
    } const arms[] = {
        {"half the masses", {"real_plant.mass_factor=0.5"}},
        {"twice", {"real_plant.mass_factor=2"}},
        {"centre of mass aside", {"real_plant.payload_kg=1", "real_plant.payload_offset_m=[0.15, -0.1, 0.1]"}},
        {"5 kg aside", {"real_plant.payload_kg=5", "real_plant.payload_offset_m=[-0.1, 0.15, 0.2]"}},
    };
    for (const std::string& robot : kBothArms) {
        const RecordedRun asModelled(kHandLed, {robot, "duration_s=1"});
        EXPECT_TRUE(asModelled.isGood()) << formatVerdict(*asModelled.result);
        for (const auto& arm : arms) {
            SCOPED_TRACE(robot + ", " + arm.name);
            const RecordedRun run(kHandLed, joined({robot, "duration_s=1"}, arm.overrides));
            const int compared = expectSameNominal(run, asModelled);
            const bool isTold = run.isTripped() || !findProblems(*run.result).empty();
            std::printf("  %-40s %s (%d ticks, %.3g mrad RMS)\n", (robot.substr(6) + ", " + arm.name).c_str(),
                        run.isTripped() ? run.result->stopMessage.c_str()
                        : isTold        ? "told"
                                        : "good",
                        compared, 1e3 * run.result->summary.trackingRms());
            EXPECT_GT(compared, 20);
            double worst = 0.0;
            for (int i = 0; i < run.experiment.cases[0].robot.size(); ++i)
                worst = std::max(worst, run.result->summary.trackingRms(i));
            EXPECT_TRUE(isTold || worst < 0.02) << worst;
            if (run.isTripped())
                EXPECT_TRUE(run.result->stopMessage.find("oscillates") != std::string::npos ||
                            run.result->stopMessage.find("does not follow") != std::string::npos)
                    << run.result->stopMessage;
        }
    }
}

// --- 18: a joint that is blocked, then released, with the limits and rates as they come -----------------

TEST(Fault18, AJointBlockedThenReleasedGetsNoJumpWithTheDefaults) {
    for (const std::string& robot : kBothArms)
        for (const char* rate : {".inf", "1000"}) {
            SCOPED_TRACE(robot + ", " + rate);
            // A joint that hardly moves: it is not so far away that the run trips, and the loop presses all the time, with
            // no more than it can take back at that rate (see TorqueGuardOptions::convention).
            const std::string zeros = robot == "robot=panda" ? ", 0, 0, 0, 0, 0" : ", 0, 0, 0, 0";
            const std::string points = std::string("[[0, 0, 0") + zeros + "], [4, 0, " +
                                       (std::string(rate) == "1000" ? "0.004" : "0.1") + zeros + "]]";
            const std::vector<std::string> slow = {
                robot, "duration_s=4", "controller={plugin: joint_servo}",
                "command={plugin: waypoints, interpolation: linear, relative_to_start: true, points: " + points + "}",
                std::string("real_plant.motor_rate_Nmps=") + rate};
            const RecordedRun free(kHandLed, slow);
            const RecordedRun run(kHandLed, joined(slow, {"real_plant.blocked_joint=1", "real_plant.blocked_from_s=0.5",
                                                          "real_plant.blocked_until_s=2.0"}));
            ASSERT_EQ(run.result->stopReason, StopReason::None) << run.result->stopMessage;
            expectSameNominal(run, free);
            const std::size_t release = 2000;
            const double limit = run.experiment.cases[0].robot.actuation.torqueLimit[1];
            const double pressing =
                std::abs(run.records[release - 1].robustTorque[1] - free.records[release - 1].robustTorque[1]);
            double largest = 0.0, far = 0.0;
            for (const TickRecord& r : run.records) largest = std::max(largest, std::abs(r.motorTorque[1]));
            // The loop answers a released joint of inertia m by K_r T dt / m a tick, and K_r is below c m.
            const double step = calcLargestStep(run.records, release), share = step / pressing;
            for (std::size_t k = 3000; k < 4000; ++k)
                far = std::max(far, std::abs(run.records[k].robustTorque[1] - free.records[k].robustTorque[1]));
            std::printf(
                "  %s, %s: pressed with %.3g Nm (motor up to %.3g of %.3g), largest step at the release %.3g Nm, "
                "%.3g Nm left a second later\n",
                robot.c_str(), rate, pressing, largest, limit, step, far);
            EXPECT_GT(pressing, 5.0);
            EXPECT_LE(largest, limit);
            EXPECT_LE(step, std::string(rate) == "1000" ? 1.0 * (1.0 + 1e-9) : pressing);
            EXPECT_LT(share, 0.5);
            EXPECT_LT(far, 0.3 * pressing);
        }
}

// --- 19: motors that give half of their torque -----------------------------------------------------------

TEST(Fault19, HalfTheTorqueIsFoundBeforeTheErrorIsLarge) {
    // Motors that the motion needs to two thirds.
    for (const std::string& robot : kBothArms) {
        SCOPED_TRACE(robot);
        Experiment e = readTestExperiment(
            kHandLed, {robot, "limits={velocity_radps: 2, acceleration_radps2: 15, jerk_radps3: 300}",
                       "command.reach_m=[0.3, 0.3, 0.3]", "command.top_speed_mps=3", "duration_s=3"});
        const RecordedRun strong(e);
        ASSERT_EQ(strong.result->stopReason, StopReason::None) << strong.result->stopMessage;
        JointVector needed = JointVector::Zero(e.cases[0].robot.size());
        for (const TickRecord& r : strong.records) needed = needed.cwiseMax(r.motorTorque.cwiseAbs());
        e.cases[0].robot.actuation.torqueLimit = 1.5 * needed;
        const RecordedRun enough(e);
        EXPECT_EQ(enough.result->stopReason, StopReason::None) << enough.result->stopMessage;
        Experiment weak = readTestExperiment(writeConfig(e.cases[0].resolved), {"real_plant.torque_limit_factor=0.5"});
        weak.cases[0].robot.actuation.torqueLimit = 1.5 * needed;
        const RecordedRun run(weak);
        expectSameNominal(run, enough);
        EXPECT_TRUE(run.isTripped() || !findProblems(*run.result).empty()) << formatVerdict(*run.result);
        // Up to the trip: 0.15 s at the velocity limit (FollowingWatch), 50 mrad at least.
        double before = 0.0;
        std::int64_t saturated = 0;
        for (const TickRecord& r : run.records)
            if (!r.braking || r.time_s <= run.result->stopTime_s)
                before = std::max(before, (r.real.q - r.nominal.q).lpNorm<Eigen::Infinity>());
        for (int i = 0; i < needed.size(); ++i) saturated += run.result->summary.motor(i).ticksSaturated;
        std::printf("  %s: %s; error up to %.3g rad before, %.3g rad in all; saturated in %lld joint-ticks\n",
                    robot.c_str(),
                    run.isTripped() ? run.result->stopMessage.c_str() : formatVerdict(*run.result).c_str(), before,
                    run.result->summary.trackingMax(), static_cast<long long>(saturated));
        EXPECT_LE(before, 0.15 * 2.0 + 0.01);
        EXPECT_GT(saturated, 0);
        if (run.isTripped()) expectContains(run.result->stopMessage, {"the real arm ", "the motor of "});
    }
}

// --- 20: singular poses -----------------------------------------------------------------------------------

/** The tool of an arm that moves on a line of poses, and back. */
class LineOfPoses : public CommandSource {
public:
    LineOfPoses(const RobotDescription& robot, JointVector from, JointVector to, double period_s)
        : model_(robot), from_(std::move(from)), to_(std::move(to)), period_s_(period_s) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double t, MotionCommand& out) override {
        const double phase = 2.0 * kPi * t / period_s_, s = 0.5 - 0.5 * std::cos(phase);
        const JointVector q = from_ + s * (to_ - from_);
        const JointVector qd = (kPi / period_s_ * std::sin(phase)) * (to_ - from_);
        model_.calcDynamics(q, qd, dynamics_);
        out.space = MotionCommand::Space::Tool;
        out.tool = dynamics_.tool;
        out.toolTwist = dynamics_.J * qd;
        return TickStatus::Ok;
    }

private:
    RobotModel model_;
    Dynamics dynamics_;
    JointVector from_, to_;
    double period_s_;
};

double calcLeastSingularValue(const Dynamics& d) {
    const Eigen::MatrixXd J = d.J;
    return Eigen::JacobiSVD<Eigen::MatrixXd>(J).singularValues().minCoeff();
}

TEST(Fault20, WristElbowAndShoulderSingularPosesArePassedWithBoundedAccelerations) {
    struct {
        const char *robot, *name;
        int moving, other;  ///< joints whose positions make the pose singular
    } const lines[] = {{"robot=indy7", "wrist", 4, 3},    {"robot=indy7", "elbow", 2, 1},
                       {"robot=indy7", "shoulder", 1, 2}, {"robot=panda", "wrist", 5, 4},
                       {"robot=panda", "elbow", 3, 1},    {"robot=panda", "shoulder", 1, 2}};
    for (const auto& line : lines)
        for (const char* controller : {"task_space_pd", "tool_servo"}) {
            SCOPED_TRACE(std::string(line.robot) + ", " + line.name + ", " + controller);
            Experiment e = readTestExperiment(
                kHandLed, {line.robot, std::string("controller={plugin: ") + controller + "}", "duration_s=3",
                           "limits={velocity_radps: 1.5, acceleration_radps2: 8, jerk_radps3: 200}"});
            CasePlan& plan = e.cases.front();
            RobotModel model(plan.robot);
            Dynamics d;
            const JointVector still = JointVector::Zero(plan.robot.size());
            const auto calc = [&](const JointVector& q) {
                model.calcDynamics(q, still, d);
                return calcLeastSingularValue(d);
            };
            // The pose nearest to singular, over the positions of two joints; then a way of 0.5 rad through it.
            JointVector singular = plan.robot.home;
            double least = kInfinity;
            const auto look = [&](const JointVector& centre, double width, int steps) {
                for (int a = -steps; a <= steps; ++a)
                    for (int b = -steps; b <= steps; ++b) {
                        JointVector q = centre;
                        const auto place = [&](int joint, int step, double margin) {
                            const JointBounds& range = plan.limits.position;
                            q[joint] = std::clamp(centre[joint] + width * step / steps, range.lower[joint] + margin,
                                                  range.upper[joint] - margin);
                        };
                        place(line.moving, a, 0.26);
                        place(line.other, b, 0.05);
                        const double value = calc(q);
                        if (!(value < least)) continue;
                        least = value;
                        singular = q;
                    }
            };
            look(plan.robot.home, 3.0, 20);
            for (const double width : {0.2, 0.02}) look(JointVector(singular), width, 6);
            EXPECT_LT(least, 0.01) << "no singular pose was found";
            JointVector from = singular, to = singular;
            from[line.moving] -= 0.25;
            to[line.moving] += 0.25;
            plan.start.q = from;
            auto configured = configureCase(plan);
            configured->plugins.command = PluginPtr<CommandSource>(
                new LineOfPoses(plan.robot, from, to, 3.0), [](void* p) { delete static_cast<LineOfPoses*>(p); });
            CaseResult result = makeResult(*configured);
            ControlLoop loop(configured->setup, std::move(configured->plugins));
            TickRecord record;
            double strongest = 0.0, nearest = kInfinity;
            for (int k = 0; k < 3000; ++k) {
                loop.tick(record);
                ASSERT_TRUE(allFinite(record)) << k;
                result.summary.add(record);
                model.calcDynamics(record.nominal.q, record.nominal.qd, d);
                JointVector qdd;
                ASSERT_TRUE(calcForwardDynamics(d, record.desiredTorque, qdd));
                strongest = std::max(strongest, qdd.lpNorm<Eigen::Infinity>());
                if (k % 10 == 0) nearest = std::min(nearest, calcLeastSingularValue(d));
            }
            EXPECT_EQ(loop.stopReason(), StopReason::None) << loop.stopMessage();
            EXPECT_FALSE(result.summary.anyLimitBroken());
            std::printf(
                "  %s, %-8s %-13s |qdd_d| up to %.4g rad/s^2, least singular value %.2g (line %.2g), tool %.3g mm "
                "RMS\n",
                line.robot, line.name, controller, strongest, nearest, least, 1e3 * result.summary.toolErrorRms());
            // tool_servo asks for what the limits allow; the spring's answer is that of its stiffness.
            EXPECT_LE(strongest, std::string(controller) == "tool_servo" ? 8.0 * (1.0 + 1e-6) : 2000.0);
            EXPECT_LT(nearest, 0.1) << "the arm did not come near";  // a spare joint takes another way
        }
}

// --- 22: encoders ------------------------------------------------------------------------------------------

TEST(Fault22, EncodersOf12To20BitLeaveTheNominalArmAlone) {
    for (const std::string& robot : kBothArms) {
        const RecordedRun fine(kHandLed, {robot});
        EXPECT_TRUE(fine.isGood()) << formatVerdict(*fine.result);
        for (const int bits : {12, 14, 16, 18, 20}) {
            SCOPED_TRACE(robot + ", " + std::to_string(bits) + " bit");
            Experiment e = readTestExperiment(kHandLed, {robot});
            e.cases[0].robot.actuation.encoderCounts.setConstant(std::pow(2.0, bits));
            const RecordedRun run(e);
            const int compared = expectSameNominal(run, fine);
            double worst = 0.0;
            for (int i = 0; i < e.cases[0].robot.size(); ++i)
                worst = std::max(worst, run.result->summary.trackingRms(i));
            std::printf("  %s, %d bit: %s, %.3g mrad RMS\n", robot.c_str(), bits,
                        run.isTripped() ? run.result->stopMessage.c_str() : formatVerdict(*run.result).c_str(),
                        1e3 * worst);
            EXPECT_TRUE(run.isTripped() || compared == 2000);
            EXPECT_TRUE(run.isTripped() || !findProblems(*run.result).empty() || worst < 0.02) << worst;
        }
    }
}

TEST(Fault22, SwappedChannelsStopTheArmAndLeaveTheNominalOneAlone) {
    for (const std::string& robot : kBothArms)
        for (const char* joint : {"0", "2", "4"})
            for (const char* from : {"0", "1"}) {
                SCOPED_TRACE(robot + ", " + joint + " from " + from);
                const std::vector<std::string> swap = {robot, "real_plant.sensor_fault=swap",
                                                       std::string("real_plant.sensor_fault_joint=") + joint,
                                                       std::string("real_plant.sensor_fault_from_s=") + from};
                const RecordedRun whole(kHandLed, {robot}), run(kHandLed, swap);
                const int compared = expectSameNominal(run, whole);
                const double at = std::stod(from);
                EXPECT_TRUE(run.isTripped()) << formatVerdict(*run.result);
                EXPECT_GE(run.result->stopTime_s, at - 1e-9);
                EXPECT_LE(run.result->stopTime_s, at + 0.1) << run.result->stopMessage;
                EXPECT_GE(compared, static_cast<int>(1000.0 * at));
            }
}

// --- 60: an obstacle that is quicker than the arm -----------------------------------------------------------

// The filter knows its whole path, and cannot get out of it: it brakes, and the summary says from when on it was touched. Behind a
// controller that knows nothing of it: tool_servo would wait by itself.
TEST(Fault60, ABallQuickerThanTheArmIsBrakedForAndTheSummarySaysWhenItTouched) {
    const CaseResult r = runFirstCase(
        kHandLed,
        {"controller={plugin: task_space_pd}", "filter={plugin: whole_arm_braking, recovery: true}", "duration_s=2",
         "environment={obstacles: {ball: {sphere: 0.1, path: [{time_s: 0, xyz: [0.35, 0, 5]}, {time_s: 1, xyz: "
         "[0.35, 0, 0.4]}, {time_s: 2, xyz: [0.35, 0, -4]}]}}}"});
    EXPECT_EQ(r.stopReason, StopReason::None) << r.stopMessage;
    EXPECT_EQ(r.summary.ticksWith(FilterStatus::Infeasible), 0);
    EXPECT_FALSE(r.summary.anyLimitBroken());
    EXPECT_GT(r.summary.ticksWith(FilterStatus::StoppedByPlan), 100) << "it was not braked";
    ASSERT_TRUE(r.summary.account(LimitKind::Clearance));
    const ArmLimitRecord& nominal = r.summary.account(LimitKind::Clearance)->nominal;
    ASSERT_TRUE(nominal.firstBroken_s) << "nothing touched";
    std::printf("  %s\n", formatVerdict(r).c_str());
    EXPECT_GT(*nominal.firstBroken_s, 0.8);
    EXPECT_LT(*nominal.firstBroken_s, 1.1);
    EXPECT_EQ(nominal.other, "ball");
    expectContains(formatVerdict(r), {"the nominal arm collided: ", " deep in ball",
                                      "the tool misses its command: ", "held off by the safety distance to obstacles"});
    EXPECT_EQ(formatVerdict(r).find("swings"), std::string::npos) << formatVerdict(r);
    expectContains(formatDetails(r), {"in collision in " + std::to_string(nominal.brokenTicks) + " ticks (first at "});
}

}  // namespace
}  // namespace viable::test
