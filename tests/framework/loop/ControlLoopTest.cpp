
#include "CaseSupport.h"
#include "viable/plugin/HostServices.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

TEST(ControlLoop, TheNominalArmAdvancesByExactlyTheConfiguredTick) {
    TestLoop t(kOneJoint);
    TickRecord last, now;
    t.loop.tick(last);
    for (int k = 1; k < 2000; ++k) {
        t.loop.tick(now);
        ASSERT_EQ(now.time_s, k * 0.001);
        const double dt = 0.001, j = last.nominal.jerk[0];
        ASSERT_DOUBLE_EQ(now.nominal.qdd[0], last.nominal.qdd[0] + j * dt);
        ASSERT_NEAR(now.nominal.qd[0], last.nominal.qd[0] + last.nominal.qdd[0] * dt + j * dt * dt / 2, 1e-15);
        last = now;
    }
}

TEST(ControlLoop, ResetGivesTheSameRunAgainBitForBit) {
    TestLoop t(kTeleoperation);
    std::vector<TickRecord> first(500);
    for (TickRecord& record : first) t.loop.tick(record);
    t.loop.reset();
    for (const TickRecord& before : first) {
        t.tick();
        ASSERT_EQ(t.record.nominal.q, before.nominal.q);
        ASSERT_EQ(t.record.motorTorque, before.motorTorque);
        ASSERT_EQ(t.record.real.q, before.real.q);
        ASSERT_EQ(t.record.time_s, before.time_s);
    }
}

TEST(ControlLoop, TenThousandTicksAllocateNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    for (const char* filter : {"tosbp", "acceleration_viability", "pass_through"}) {
        TestLoop t(kTeleoperation, {"duration_s=12", std::string("filter.plugin=") + filter});
        t.tick(100);
        const testing::AllocationCounter counter;
        t.tick(10000);
        EXPECT_EQ(counter.count(), 0) << filter;
    }
}

TEST(ControlLoop, TheTorqueOfADecisionGivesItsAccelerationInSimbodysForwardDynamics) {
    TestLoop t(kTeleoperation);
    const RobotDescription& robot = t.experiment.cases[0].robot;
    RobotModel model(robot);
    for (int k = 0; k < 2000; ++k) {
        t.tick();
        if (k % 50) continue;
        // x_c, the mean acceleration over the tick; the rotors' share of tau_c does not reach the
        // links.
        const JointVector x = t.record.nominal.qdd + t.record.nominal.jerk * 0.0005;
        const JointVector link = t.record.filterTorque - robot.actuation.rotorInertia.cwiseProduct(x);
        const JointVector qdd = model.calcLinkForwardDynamics(t.record.nominal.q, t.record.nominal.qd, link);
        ASSERT_LT((qdd - x).cwiseAbs().maxCoeff(), 1e-9 * (1.0 + x.cwiseAbs().maxCoeff())) << "tick " << k;
    }
}

TEST(ControlLoop, StopOnRequestEndsAtRestWithinJerkAndAcceleration) {
    TestLoop t(kTeleoperation, {"duration_s=10"});
    t.tick(1500);
    ASSERT_GT(t.record.nominal.qd.cwiseAbs().maxCoeff(), 0.01);
    t.loop.requestStop(StopReason::Requested, "test");
    t.loop.requestStop(StopReason::Requested, "later");  // the first request stays
    int ticks = 0;
    while (!t.loop.hasStopped()) {
        t.tick();
        ASSERT_EQ(t.record.status, FilterStatus::StoppedByPlan);
        ASSERT_TRUE(t.record.braking);
        ASSERT_LE(t.record.nominal.jerk.cwiseAbs().maxCoeff(), 12 * EIGEN_PI * (1 + 1e-9));
        ASSERT_LE(t.record.nominal.qdd.cwiseAbs().maxCoeff(), 4 * EIGEN_PI * (1 + 1e-9));
        ASSERT_LT(++ticks, 2000);
    }
    EXPECT_EQ(t.loop.stopReason(), StopReason::Requested);
    EXPECT_STREQ(t.loop.stopMessage(), "test");
    t.tick();
    EXPECT_LT(t.record.nominal.qd.cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT(t.record.nominal.qdd.cwiseAbs().maxCoeff(), 1e-9);
}

TEST(ControlLoop, AFailureDuringARequestedStopIsNotHidden) {
    TestLoop t(kTeleoperation, {"robust_loop={plugin: throwing_robust, after_ticks: 510}"});
    t.tick(500);
    t.loop.requestStop(StopReason::Requested, "test");
    while (!t.loop.hasStopped()) t.tick();
    EXPECT_EQ(t.loop.stopReason(), StopReason::RobustLoopFailed);
}

TEST(ControlLoop, StopUnderAFilterThatHoldsAccelerationsKeepsItsPositionLimits) {
    TestLoop t(kTeleoperation, {"filter.plugin=acceleration_viability", "duration_s=10"});
    const JointBounds& bounds = t.experiment.cases[0].limits.position;
    for (int begin = 200; begin < 5000; begin += 97) {
        t.loop.reset();
        t.tick(begin);
        t.loop.requestStop(StopReason::Requested, "test");
        int ticks = 0;
        while (!t.loop.hasStopped()) {
            t.tick();
            ASSERT_LT(++ticks, 2000);
        }
        const JointVector& q = t.loop.nominal().q;
        for (int i = 0; i < q.size(); ++i) {
            ASSERT_GE(q[i], bounds.lower[i] - 2e-5) << "begun in tick " << begin;
            ASSERT_LE(q[i], bounds.upper[i] + 2e-5) << "begun in tick " << begin;
        }
        ASSERT_LT(t.loop.nominal().qd.cwiseAbs().maxCoeff(), 1e-9);
    }
}

/** Asks for the acceleration A cos(w t), whose derivative it knows. */
struct KnowingController : NominalController {
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    ControllerTraits traits() const override { return {true, true}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        tick = input.tick;
        const double phase = 3.0 * input.tick.time_s;
        desired = std::cos(phase + 1.0);
        calcInverseDynamics(input.dynamics, JointVector::Constant(1, desired), output.torque);
        output.accelerationRate.setConstant(1, -3.0 * std::sin(phase + 1.0));
        if (failsAt >= 0 && --failsAt < 0) output.accelerationRate.setConstant(1, std::nan(""));
        output.hasAccelerationRate = knows;
        return TickStatus::Ok;
    }

    bool knows = true;
    int failsAt = -1;  ///< call in which the rate is none
    Tick tick;
    double desired = 0.0;
};

/** A plant whose clock passes `script[k]` ticks before the k-th read(), later one each; it moves by 2 rad in each. */
class ClockedPlant : public RealPlant {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override {
        if (isAbsent) throw badInput("here.yaml:1", "the robot does not answer", "Switch it on.");
        state_ = {start.q.array() + standsOff, start.qd};
    }
    const JointState& measured() const override { return state_; }
    const JointState& actual() const override { return state_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        ++advances;
        applied = torque;
        return TickStatus::Ok;
    }
    PlantTraits traits() const override { return {Encoder::Counts, 0, {}, ticks}; }
    TickStatus read(std::int64_t& ticksPassed) override {
        ticksPassed = reads < script.size() ? script[reads] : 1;
        ++reads;
        state_.q.array() += 2.0 * static_cast<double>(ticksPassed);
        if (explanation) explainFault(explanation);
        return status;
    }

    bool ticks = true, isAbsent = false;
    double standsOff = 0.0;  ///< from the start [rad]
    const char* explanation = nullptr;
    std::vector<std::int64_t> script;
    TickStatus status = TickStatus::Ok;
    std::size_t reads = 0;
    int advances = 0;

private:
    JointState state_;
};

/** Adds nothing. */
struct SilentLoop : RobustLoop {
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    TickStatus compute(const JointState&, const MotionState&, const JointVector&, JointVector& torque) override {
        torque.setZero(1);
        return TickStatus::Ok;
    }
};

/** A loop of one joint around the plugins above. */
struct ScriptedLoop {
    explicit ScriptedLoop(bool hasPlant)
        : experiment(readTestExperiment(kOneJoint, {})), configured(configureCase(experiment.cases.front())) {
        configured->plugins.controller = lend<NominalController>(controller);
        if (hasPlant) {
            configured->plugins.robustLoop = lend<RobustLoop>(robustLoop);
            configured->plugins.realPlant = lend<RealPlant>(plant);
        }
    }
    template <class Interface>
    static PluginPtr<Interface> lend(Interface& plugin) {
        return {&plugin, [](void*) {}};
    }
    ControlLoop& start() {
        loop = std::make_unique<ControlLoop>(configured->setup, std::move(configured->plugins));
        return *loop;
    }
    void tick(int count = 1) {
        for (int k = 0; k < count; ++k) loop->tick(record);
    }

    KnowingController controller;  // destroyed last
    SilentLoop robustLoop;
    ClockedPlant plant;
    Experiment experiment;
    std::unique_ptr<ConfiguredCase> configured;
    std::unique_ptr<ControlLoop> loop;
    TickRecord record;  ///< of the last tick
};

TEST(ControlLoop, TheRateThatAControllerKnowsTakesThePlaceOfTheQuotient) {
    for (const bool knows : {true, false}) {
        ScriptedLoop t(false);
        t.controller.knows = knows;
        t.start();
        double last = 0.0;
        for (int k = 0; k < 200; ++k) {
            t.tick();
            const double rate = -3.0 * std::sin(3.0 * t.record.time_s + 1.0);
            const double quotient = k == 0 ? 0.0 : (t.controller.desired - last) / 1e-3;
            const double u = (knows ? rate : quotient) - 100.0 * (t.record.nominal.qdd[0] - t.controller.desired);
            if (t.record.status == FilterStatus::Passed) ASSERT_NEAR(t.record.nominal.jerk[0], u, 1e-9) << k;
            last = t.controller.desired;
        }
        EXPECT_EQ(t.record.status, FilterStatus::Passed);
    }
}

TEST(ControlLoop, ARateThatIsNoNumberMakesTheWholeOutputUnusable) {
    ScriptedLoop t(false);
    t.controller.failsAt = 5;
    t.start();
    t.tick(10);
    EXPECT_EQ(t.record.substituted, 1);
    EXPECT_EQ(t.loop->stopReason(), StopReason::None);
}

TEST(ControlLoop, AControllerIsToldTheTimeAndTheMissedTicks) {
    ScriptedLoop t(false);
    t.start();
    t.tick(10);
    EXPECT_EQ(t.controller.tick.time_s, 9 * 0.001);
    EXPECT_EQ(t.controller.tick.missed, 0);
    for (int k = 0; k < 3; ++k) t.loop->missTick(t.record);
    t.tick();
    EXPECT_EQ(t.controller.tick.time_s, 13 * 0.001);
    EXPECT_EQ(t.controller.tick.missed, 3);
    t.tick();
    EXPECT_EQ(t.controller.tick.missed, 0);
}

TEST(ControlLoop, TicksThatAPlantsClockHasPassedAreMissedOnes) {
    ScriptedLoop t(true);
    t.plant.script = {1, 1, 3, 1};
    t.start();
    std::vector<bool> missed;
    JointVector held;
    for (int k = 0; k < 6; ++k) {
        t.tick();
        missed.push_back(t.record.missed);
        EXPECT_EQ(t.record.time_s, k * 0.001);
        if (t.record.missed) {
            EXPECT_EQ(t.record.motorTorque, held);  // nothing was sent
        }
        held = t.record.motorTorque;
        if (k == 4) EXPECT_EQ(t.controller.tick.missed, 2);
    }
    EXPECT_EQ(missed, (std::vector<bool>{false, false, true, true, false, false}));
    EXPECT_EQ(t.plant.reads, 4u);
    EXPECT_EQ(t.plant.advances, 4);
    // 6 rad over three ticks are no jump; 2 rad in one are none either.
    EXPECT_EQ(t.loop->stopReason(), StopReason::None);
}

TEST(ControlLoop, ANominalArmStartsWhereTheRobotStandsWithinItsLimits) {
    for (const double off : {0.01, -0.3}) {
        ScriptedLoop t(true);
        t.plant.standsOff = off;
        ControlLoop& loop = t.start();
        const double expected = t.configured->setup.start.q[0] + off;
        EXPECT_EQ(loop.nominal().q[0], expected);
        EXPECT_EQ(loop.nominal().qd[0], 0.0);
        TickRecord record;
        loop.tick(record);
        EXPECT_EQ(record.nominal.q[0], expected);
        loop.reset();
        EXPECT_EQ(loop.nominal().q[0], expected);
    }
    ScriptedLoop outside(true);
    const double limit = outside.configured->setup.limits.position.upper[0];
    outside.plant.standsOff = limit + 0.1 - outside.configured->setup.start.q[0];
    expectError({"beyond the nominal arm's position limit"}, [&] { outside.start(); });
    ScriptedLoop atLimit(true);  // measured a count beyond it
    atLimit.plant.standsOff =
        limit - atLimit.configured->setup.start.q[0] + atLimit.configured->plan.robot.encoderStep(0);
    EXPECT_EQ(atLimit.start().nominal().q[0], limit);
    ScriptedLoop simulated(true);
    simulated.plant.ticks = false;
    simulated.plant.standsOff = 0.01;
    EXPECT_EQ(simulated.start().nominal().q[0], simulated.configured->setup.start.q[0]);
}

TEST(ControlLoop, APlantWithoutAClockIsNotWaitedFor) {
    ScriptedLoop t(true);
    t.plant.ticks = false;
    t.start();
    t.tick(5);
    EXPECT_EQ(t.plant.reads, 0u);
    EXPECT_EQ(t.plant.advances, 5);
}

TEST(ControlLoop, AClockThatFailsOrStandsStillEndsTheLoop) {
    for (const bool faults : {true, false}) {
        ScriptedLoop t(true);
        if (faults)
            t.plant.status = TickStatus::Faulted;
        else
            t.plant.script = {0};
        t.start();
        t.tick();
        EXPECT_TRUE(t.loop->hasFailed());
        EXPECT_EQ(t.loop->stopReason(), StopReason::PlantFailed);
        EXPECT_CONTAINS(t.loop->stopMessage(), "its clock gave no tick");
        EXPECT_EQ(t.plant.advances, 0);
    }
}

TEST(ControlLoop, APlantThatFaultsSaysWhy) {
    ScriptedLoop t(true);
    t.plant.explanation = "it says this of the last tick only where that one failed";
    t.start();
    t.tick();
    EXPECT_FALSE(t.loop->hasFailed());
    t.plant.explanation = nullptr;
    t.tick();
    t.plant.explanation = "it has lost the robot";
    t.plant.status = TickStatus::Faulted;
    t.tick();
    EXPECT_TRUE(t.loop->hasFailed());
    EXPECT_EQ(t.loop->stopReason(), StopReason::PlantFailed);
    EXPECT_STREQ(t.loop->stopMessage(), "it has lost the robot");
}

TEST(ControlLoop, ARobotThatCannotBeHadIsRefusedInItsOwnWords) {
    ScriptedLoop t(true);
    t.plant.isAbsent = true;
    const std::string text = catchError([&] { t.start(); });
    EXPECT_CONTAINS(text, "here.yaml:1: the robot does not answer. Switch it on.");
    EXPECT_EQ(text.find("must not throw"), std::string::npos) << text;
}

TEST(ControlLoop, ManyTicksMissedByThePlantsClockBrakeTheArmForGood) {
    ScriptedLoop t(true);
    t.plant.script = {1, 5000};
    ControlLoop& loop = t.start();
    expectStop(loop, StopReason::TicksMissed);
}

TEST(Fault28, AFewTicksOfNanAreSubstitutedAndCounted) {
    TestLoop t(kOneJoint, {"controller.plugin=nan_torque", "controller.after_ticks=200", "controller.ticks=10"});
    JointVector before;
    for (int k = 0; k < 1000; ++k) {
        t.tick();
        ASSERT_TRUE(allFinite(t.record)) << "tick " << k;
        if (k == 199) before = t.record.desiredTorque;
        if (k >= 200 && k < 210) ASSERT_EQ(t.record.desiredTorque, before);
    }
    EXPECT_EQ(t.record.substituted, kMaxSubstitutedTicks);
    EXPECT_EQ(t.loop.stopReason(), StopReason::None);
}

TEST(Fault28, MoreTicksOfNanBrakeTheArm) {
    TestLoop t(kOneJoint, {"controller.plugin=nan_torque", "controller.after_ticks=200", "controller.ticks=100000"});
    ASSERT_NO_FATAL_FAILURE(runUntilStopped(t.loop, t.record, 5000, [](const TickRecord&) {}));
    EXPECT_EQ(t.loop.stopReason(), StopReason::ControllerFailed);
    EXPECT_NEAR(t.loop.stopTime(), 0.210, 1e-9);
    EXPECT_CONTAINS(t.loop.stopMessage(), "no usable torque");
    EXPECT_LT(t.record.nominal.qd.cwiseAbs().maxCoeff(), 0.05);
}

TEST(Fault29, HugeAndTinyTorquesStayFiniteAndInsideTheJerkLimit) {
    for (const char* filter : {"tosbp", "acceleration_viability"}) {
        TestLoop t(kOneJoint, {"controller.plugin=extreme_torque", std::string("filter.plugin=") + filter});
        Summary summary({"joint0"}, t.experiment.cases[0].limits, false);
        for (int k = 0; k < 5000; ++k) {
            t.tick();
            ASSERT_TRUE(allFinite(t.record)) << filter << " tick " << k;
            summary.add(t.record);
        }
        EXPECT_EQ(t.loop.stopReason(), StopReason::None) << filter;
        EXPECT_EQ(summary.ticksOutside(LimitKind::Acceleration), 0) << filter;
        if (std::string(filter) == "tosbp") EXPECT_EQ(summary.ticksOutside(LimitKind::Jerk), 0);
        EXPECT_LT(summary.limit(LimitKind::Position)[0].worstUse, 1.001) << filter;
        EXPECT_LT(summary.limit(LimitKind::Velocity)[0].worstUse, 1.001) << filter;
    }
}

TEST(Fault29, HugeTorquesThroughAFilterThatLetsThemPassBrakeTheArm) {
    TestLoop t(kTeleoperation, {"controller.plugin=extreme_torque", "filter.plugin=pass_through"});
    expectStop(t.loop, StopReason::ControllerFailed);
    EXPECT_CONTAINS(t.loop.stopMessage(), "beyond 1e9");
}

TEST(Fault30, JumpingSetPointsKeepTheLimits) {
    TestLoop t(kOneJoint, {"command.plugin=jumping_setpoint"});
    Summary summary({"joint0"}, t.experiment.cases[0].limits, false);
    for (int k = 0; k < 10000; ++k) {
        t.tick();
        ASSERT_TRUE(allFinite(t.record));
        summary.add(t.record);
    }
    EXPECT_EQ(summary.ticksOutside(LimitKind::Jerk), 0);
    EXPECT_EQ(summary.ticksOutside(LimitKind::Acceleration), 0);
    EXPECT_LT(summary.limit(LimitKind::Position)[0].worstUse, 1.001);
    EXPECT_LT(summary.limit(LimitKind::Velocity)[0].worstUse, 1.001);
}

TEST(Fault32, AWrongSizedTorqueIsSubstitutedThenBraked) {
    TestLoop few(kOneJoint, {"controller.plugin=wrong_size_torque", "controller.after_ticks=0", "controller.ticks=5"});
    TickRecord record;
    for (int k = 0; k < 100; ++k) few.loop.tick(record);
    EXPECT_EQ(few.loop.stopReason(), StopReason::None);
    EXPECT_EQ(record.substituted, 5);

    TestLoop many(kOneJoint,
                  {"controller.plugin=wrong_size_torque", "controller.after_ticks=0", "controller.ticks=1000"});
    for (int k = 0; k < 100 && !many.loop.hasStopped(); ++k) many.loop.tick(record);
    EXPECT_EQ(many.loop.stopReason(), StopReason::ControllerFailed);
}

TEST(Fault32, AWrongSizedDecisionStopsTheArmAtOnce) {
    TestLoop t(kOneJoint, {"filter.plugin=wrong_size", "filter.after_ticks=100"});
    ASSERT_NO_FATAL_FAILURE(
        runUntilStopped(t.loop, t.record, 5000, [](const TickRecord& r) { ASSERT_EQ(r.filterTorque.size(), 1); }));
    EXPECT_EQ(t.loop.stopReason(), StopReason::FilterFailed);
    EXPECT_NEAR(t.loop.stopTime(), 0.1, 1e-9);
}

TEST(Fault44, AFilterThatThrowsInATickIsContained) {
    TestLoop t(kOneJoint, {"filter.plugin=throwing_tick", "filter.after_ticks=300"});
    expectStop(t.loop, StopReason::FilterFailed);
    EXPECT_EQ(std::string(t.loop.stopMessage()).rfind("it threw: ", 0), 0u) << t.loop.stopMessage();
}

TEST(Fault44, ARobustLoopThatThrowsIsContainedAndTheArmComesToRest) {
    TestLoop t(kTeleoperation, {"robust_loop={plugin: throwing_robust, after_ticks: 900}"});
    expectStop(t.loop, StopReason::RobustLoopFailed);
    EXPECT_LT(t.loop.nominal().qd.cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT(t.loop.nominal().qdd.cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Fault44, APlantThatFailsEndsTheLoopAtOnce) {
    for (const char* mode : {"faulted", "nan_state", "wrong_size", "throw_measured", "throw_advance"}) {
        TestLoop t(kTeleoperation,
                   {std::string("real_plant={plugin: failing_plant, after_ticks: 100, mode: ") + mode + "}"});
        SCOPED_TRACE(mode);
        ASSERT_NO_FATAL_FAILURE(runUntilStopped(t.loop, t.record, 103, [](const TickRecord& r) {
            ASSERT_TRUE(r.real.q.allFinite() && r.actual.q.allFinite());
        }));
        EXPECT_EQ(t.loop.stopReason(), StopReason::PlantFailed) << mode;
    }
}

TEST(Fault44, ACommandThatFallsSilentBrakesTheArm) {
    TestLoop t(kOneJoint, {"command={plugin: silent_command, after_ticks: 100}"});
    expectStop(t.loop, StopReason::CommandFailed);
    EXPECT_NEAR(t.loop.stopTime(), 0.110, 1e-9);
}

TEST(Fault51, NanFromAFilterNeverReachesPlantOrLog) {
    TestLoop t(kOneJoint, {"filter.plugin=nan_output", "filter.after_ticks=50"});
    expectStop(t.loop, StopReason::FilterFailed);
    EXPECT_CONTAINS(t.loop.stopMessage(), "not finite");
}

}  // namespace
}  // namespace viable::test
