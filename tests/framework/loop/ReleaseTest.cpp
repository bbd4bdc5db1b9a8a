// A robust loop that is given up: its torque goes to zero without a step.

#include "CaseSupport.h"
#include "Joints.h"
#include "viable/loop/TorqueGuard.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable::test {
namespace {

constexpr double kTick_s = 1e-3;
/** Ticks of a release. */
constexpr int kReleaseTicks = 25;
static_assert(kRelease_s == kReleaseTicks * kTick_s);

enum class Failure { Throws, Nan, Status, Huge };

/** Nric, until it fails. */
class FailingLoop : public RobustLoop {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override { nric_.configure(setup, parameters); }
    void reset(const MotionState& start) override {
        nric_.reset(start);
        calls = 0;
    }
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override {
        const TickStatus status = nric_.compute(real, nominal, filterTorque, torque);
        if (calls++ != failsAt) return status;
        if (failure == Failure::Throws) throw std::runtime_error("test");
        torque.setConstant(failure == Failure::Nan ? kNan : failure == Failure::Huge ? 1e12 : 0.0);
        return failure == Failure::Status ? TickStatus::Faulted : status;
    }
    void holdIntegral() override { nric_.holdIntegral(); }
    RobustTraits traits() const override { return nric_.traits(); }

    Failure failure = Failure::Throws;
    int failsAt = -1, calls = 0;

private:
    Nric nric_;
};

/** A loop with a real arm, its robust loop listened to. */
struct HeardCase {
    using WrapPlant = PluginPtr<RealPlant> (*)(PluginPtr<RealPlant>);
    explicit HeardCase(const char* text, const std::vector<std::string>& overrides, RealArmOptions options = {},
                       WrapPlant wrapPlant = nullptr)
        : experiment(readTestExperiment(text, overrides)), configured(configureCase(experiment.cases.front())) {
        heard.configure(configured->setup, configured->plan.robustLoop->parameters);
        configured->plugins.robustLoop = PluginPtr<RobustLoop>(&heard, [](void*) {});
        options.motorRate = configured->motorRate;
        options.robustRate = heard.traits().errorLoop->torqueRate;
        if (wrapPlant) configured->plugins.realPlant = wrapPlant(std::move(configured->plugins.realPlant));
        loop = std::make_unique<ControlLoop>(configured->setup, std::move(configured->plugins), options);
    }

    FailingLoop heard;  // destroyed last
    Experiment experiment;
    std::unique_ptr<ConfiguredCase> configured;
    std::unique_ptr<ControlLoop> loop;
};

double calcLargest(const JointVector& v) {
    return v.lpNorm<Eigen::Infinity>();
}

TEST(Release, ALoopThatFailsGivesItsTorqueBackEvenly) {
    for (const Failure failure : {Failure::Throws, Failure::Nan, Failure::Status, Failure::Huge}) {
        SCOPED_TRACE(static_cast<int>(failure));
        HeardCase c(kTeleoperation, {"filter={plugin: certified_braking}", "real_plant.payload_kg=5"});
        c.heard.failure = failure;
        c.heard.failsAt = 800;
        TickRecord record, last;
        for (int k = 0; k < 800; ++k) c.loop->tick(last);
        const JointVector given = last.robustTorque;
        ASSERT_GT(calcLargest(given), 10.0);
        double largestStep = 0.0;
        for (int k = 1; k <= 2 * kReleaseTicks; ++k) {
            c.loop->tick(record);
            const JointVector expected = given * std::max(0.0, 1.0 - static_cast<double>(k) / kReleaseTicks);
            ASSERT_LE(calcLargest(record.robustTorque - expected), 1e-9) << k;
            largestStep = std::max(largestStep, calcLargest(record.robustTorque - last.robustTorque));
            last = record;
        }
        std::printf("  %.3g Nm, largest step %.3g Nm\n", calcLargest(given), largestStep);
        EXPECT_LE(largestStep, calcLargest(given) / kReleaseTicks * (1.0 + 1e-9));
        EXPECT_EQ(calcLargest(record.robustTorque), 0.0);
        EXPECT_EQ(c.heard.calls, 801) << "it is not asked again";
        EXPECT_EQ(c.loop->stopReason(), StopReason::RobustLoopFailed);
    }
}

TEST(Release, IsNoFasterThanTheStatedRates) {
    struct {
        const char* rate;
        double torqueRate, motorRate;
    } const cases[] = {{"robust_loop.torque_rate_Nmps=150", 150.0, kInfinity},
                       {"robust_loop.motor_rate_Nmps=200", kInfinity, 200.0},
                       {"real_plant.motor_rate_Nmps=200", kInfinity, 200.0}};
    for (const auto& given : cases) {
        SCOPED_TRACE(given.rate);
        HeardCase c(kTeleoperation, {"filter={plugin: certified_braking}", "real_plant.payload_kg=5", given.rate});
        c.heard.failsAt = 1200;
        TickRecord record, last;
        for (int k = 0; k < 1200; ++k) c.loop->tick(last);
        ASSERT_GT(calcLargest(last.robustTorque), 10.0);
        double robustStep = 0.0, motorStep = 0.0;
        int ticks = 0;
        while (calcLargest(last.robustTorque) > 0.0 && ticks < 2000) {
            c.loop->tick(record);
            const JointVector asked = record.filterTorque + record.robustTorque;
            robustStep = std::max(robustStep, calcLargest(record.robustTorque - last.robustTorque));
            motorStep = std::max(motorStep, calcLargest(asked - last.filterTorque - last.robustTorque));
            last = record;
            ++ticks;
        }
        std::printf("  steps of %.3g Nm (robust) and %.3g Nm (motor), over %d ticks\n", robustStep, motorStep, ticks);
        EXPECT_LE(robustStep, given.torqueRate * kTick_s * (1.0 + 1e-9));
        EXPECT_LE(motorStep, given.motorRate * kTick_s * (1.0 + 1e-9));
        EXPECT_GT(ticks, kReleaseTicks);
        EXPECT_LT(ticks, 1000);
    }
}

TEST(Release, ALoopThatFailsInItsFirstTickHasNothingToGiveBack) {
    HeardCase c(kTeleoperation, {"robust_loop.motor_rate_Nmps=200"});
    c.heard.failsAt = 0;
    TickRecord record;
    c.loop->tick(record);
    EXPECT_EQ(calcLargest(record.robustTorque), 0.0);
}

/** A plant whose clock begins with ticks that were missed. */
class LatePlant : public RealPlant {
public:
    static constexpr std::int64_t kFirst = 5;
    explicit LatePlant(PluginPtr<RealPlant> plant) : plant_(std::move(plant)) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override {
        plant_->reset(start);
        isFirst_ = true;
    }
    const JointState& measured() const override { return plant_->measured(); }
    const JointState& actual() const override { return plant_->actual(); }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        return plant_->advance(torque, applied);
    }
    PlantTraits traits() const override { return {Encoder::Counts, 0, {}, true}; }
    TickStatus read(std::int64_t& ticksPassed) override {
        ticksPassed = isFirst_ ? kFirst : 1;
        isFirst_ = false;
        return TickStatus::Ok;
    }

private:
    PluginPtr<RealPlant> plant_;
    bool isFirst_ = true;
};

TEST(Release, TicksMissedBeforeTheFirstTorqueSayNothingOfTheMotors) {
    HeardCase c(kTeleoperation, {"robust_loop.motor_rate_Nmps=200"}, {}, [](PluginPtr<RealPlant> plant) {
        return PluginPtr<RealPlant>(new LatePlant(std::move(plant)),
                                    [](void* p) { delete static_cast<LatePlant*>(p); });
    });
    c.heard.failsAt = 0;
    TickRecord record;
    for (int k = 1; k < LatePlant::kFirst; ++k) {
        c.loop->tick(record);
        ASSERT_TRUE(record.missed);
        ASSERT_EQ(c.heard.calls, 0);
    }
    c.loop->tick(record);
    ASSERT_EQ(c.heard.calls, 1);
    ASSERT_GT(calcLargest(record.filterTorque), 1.0);
    EXPECT_EQ(calcLargest(record.robustTorque), 0.0);
}

/** A Panda of a fiftieth of the masses that its loop is made for. */
const std::vector<std::string> kLightPanda = {"robot=panda", "real_plant.mass_factor=0.02"};

// A loop that swings goes on to damp while its share falls: no step is larger than those that it took itself.
TEST(Release, ALoopThatOscillatesFades) {
    RealArmOptions options;
    options.watchesFollowing = true;
    HeardCase c(kHandLed, kLightPanda, options);
    TickRecord record, last;
    double before = 0.0;
    int k = 0;
    for (; !c.loop->isStopping() && k < 200; ++k) {
        last = record;
        c.loop->tick(record);
        if (k > 0 && !c.loop->isStopping())
            before = std::max(before, calcLargest(record.robustTorque - last.robustTorque));
    }
    ASSERT_EQ(c.loop->stopReason(), StopReason::NotFollowing) << c.loop->stopMessage();
    const double speedAtStop = calcLargest(record.actual.qd - record.nominal.qd);
    double after = calcLargest(record.robustTorque - last.robustTorque), lastStep = 0.0, fastest = 0.0;
    for (int i = 1; i < 2 * kReleaseTicks; ++i) {
        last = record;
        c.loop->tick(record);
        const double step = calcLargest(record.robustTorque - last.robustTorque);
        after = std::max(after, step);
        if (step > 0.0) lastStep = step;
        fastest = std::max(fastest, calcLargest(record.actual.qd - record.nominal.qd));
    }
    std::printf(
        "  steps: %.3g Nm before, %.3g Nm at most after, %.3g Nm the last; %.3g rad/s at the stop, then at most %.3g\n",
        before, after, lastStep, speedAtStop, fastest);
    EXPECT_LE(after, before);
    // The loop's torque may be the motor's limit and what the nominal arm takes.
    const double limit = c.configured->plan.robot.actuation.torqueLimit.maxCoeff() + calcLargest(record.filterTorque);
    EXPECT_LE(lastStep, limit / kReleaseTicks * (1.0 + 1e-3));
    EXPECT_EQ(calcLargest(record.robustTorque), 0.0);
    EXPECT_EQ(c.heard.calls, k + kReleaseTicks - 1);
}

// Its readings are those of another joint: what it does drives the arm away, so the last torque goes, unasked.
TEST(Release, ALoopThatDrivesTheArmAwayIsNotAskedAgain) {
    RealArmOptions options;
    options.watchesFollowing = true;
    HeardCase c(kTeleoperation,
                {"robust_loop={plugin: nric}", "real_plant.sensor_fault=swap", "real_plant.sensor_fault_joint=0",
                 "real_plant.sensor_fault_from_s=1"},
                options);
    TickRecord record, last;
    int calls = -1;
    JointVector given;
    double largestStep = 0.0;
    for (int k = 0; k < 5000; ++k) {
        last = record;
        c.loop->tick(record);
        if (c.heard.calls != calls) {
            calls = c.heard.calls;
            ASSERT_TRUE(given.size() == 0) << "asked again";
            continue;
        }
        if (given.size() == 0) given = last.robustTorque;
        largestStep = std::max(largestStep, calcLargest(record.robustTorque - last.robustTorque));
    }
    ASSERT_GT(given.size(), 0) << "the loop was never given up: " << c.loop->stopMessage();
    std::printf("  %.3g Nm, largest step %.3g Nm\n", calcLargest(given), largestStep);
    ASSERT_GT(calcLargest(given), 1.0);
    EXPECT_LE(largestStep, calcLargest(given) / kReleaseTicks * (1.0 + 1e-9));
    EXPECT_EQ(calcLargest(record.robustTorque), 0.0);
}

// --- The same in a loop of one's own --------------------------------------------------------------

/** Without limits on readings and motors nothing holds the robust loop back. */
TEST(Release, ATorqueGuardWhoseRobustLoopFailsGivesItsShareBackEvenly) {
    RobotDescription robot = testing::makeTwoLinkArm();
    robot.actuation.torqueLimit = joints(kInfinity, kInfinity);
    TorqueGuardOptions options;
    options.largestSpeed = kInfinity;
    TorqueGuard guard(robot, kTick_s, options);
    guard.start({robot.home, JointVector::Zero(2)});
    const auto law = [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
        torque = dynamics.M * (100.0 * (robot.home - nominal.q) - 20.0 * nominal.qd) + dynamics.b;
    };
    const auto read = [&](double qd) { return JointState{guard.nominal().q + joints(0.01, 0.01), joints(qd, 0.0)}; };
    for (int k = 0; k < 500; ++k) guard.step(read(0.0), law);
    const JointVector given = guard.record().robustTorque;
    JointVector last = given;
    ASSERT_GT(calcLargest(given), 1.0);
    double largestStep = 0.0;
    for (int k = 0; k < 2 * kReleaseTicks; ++k) {
        guard.step(read(k == 0 ? 1e15 : 0.0), law);
        largestStep = std::max(largestStep, calcLargest(guard.record().robustTorque - last));
        last = guard.record().robustTorque;
    }
    EXPECT_EQ(guard.stopReason(), GuardStop::RobustLoopFailed);
    EXPECT_EQ(calcLargest(last), 0.0);
    std::printf("  %.3g Nm, largest step %.3g Nm\n", calcLargest(given), largestStep);
    EXPECT_LE(largestStep, calcLargest(given) / kReleaseTicks * (1.0 + 1e-9));
}

TEST(Release, ATorqueGuardWithoutNumbersTakesItsTorqueToZeroEvenly) {
    RobotDescription robot = testing::makeTwoLinkArm();
    robot.limits = JointLimits::unlimited(2);
    robot.limits.velocity = {joints(-1e7, -1e7), joints(1e7, 1e7)};
    robot.limits.acceleration = robot.limits.jerk = robot.limits.velocity;
    const std::optional<NricOptions> gains = TorqueGuard(robot, kTick_s).robustGains();
    ASSERT_TRUE(gains);
    const auto state = [&](const char* where, double rate) {
        TorqueGuardOptions options;
        options.convention.torqueRate = 1000.0;
        options.robustGains = gains;
        (where == std::string("robust") ? options.robustGains->torqueRate : options.robustGains->motorRate) = rate;
        return options;
    };
    TorqueGuardOptions slowRobot;
    slowRobot.convention.torqueRate = 400.0;
    struct {
        const char* name;
        TorqueGuardOptions options;
        double rate;
    } const cases[] = {{"no rate", {}, kInfinity},
                       {"the robot's", slowRobot, 400.0},
                       {"the robust loop's share, not what is sent", state("robust", 300.0), 1000.0},
                       {"the motors', in the robust loop", state("motors", 300.0), 300.0}};
    for (const auto& [name, options, rate] : cases) {
        SCOPED_TRACE(name);
        TorqueGuard guard(robot, kTick_s, options);
        guard.start({robot.home, JointVector::Zero(2)});
        JointVector last = JointVector::Zero(2), given;
        double largestStep = 0.0;
        int failed = 0;
        for (int k = 0; k < 5000 && failed < 1000; ++k) {
            const GuardedTorque& out = guard.step({guard.nominal().q, guard.nominal().qd},
                                                  [](const MotionState&, const Dynamics& d, JointVector& torque) {
                                                      torque = d.M * JointVector::Constant(2, 1e7) + d.b;
                                                  });
            if (out.status == GuardStatus::Failed) {
                if (failed++ == 0) given = last;
                largestStep = std::max(largestStep, calcLargest(out.torque - last));
            }
            last = out.torque;
        }
        ASSERT_EQ(failed, 1000);
        ASSERT_GT(calcLargest(given), 1.0);
        std::printf("  %s: %.3g Nm, largest step %.3g Nm\n", name, calcLargest(given), largestStep);
        EXPECT_LE(largestStep, std::min(calcLargest(given) / kReleaseTicks, rate * kTick_s) * (1.0 + 1e-9));
        EXPECT_EQ(calcLargest(last), 0.0);
    }
}

}  // namespace
}  // namespace viable::test
