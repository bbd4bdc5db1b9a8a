
#include "CaseSupport.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

constexpr char kCertified[] = "filter={plugin: certified_braking}";

/** What the nominal arm's torque changed by from one tick to the next beyond what its own motion explains, over the most that
the jerk limits allow, M j_max dt; the worst joint. */
class TorqueStep {
public:
    TorqueStep(const RobotDescription& robot, const JointLimits& limits, double tick_s)
        : model_(robot), jerk_(limits.jerk.upper.cwiseMax(-limits.jerk.lower)), tick_s_(tick_s) {}

    double take(const TickRecord& r) {
        model_.calcDynamics(r.nominal.q, r.nominal.qd, now_);
        // The mean acceleration over the tick, which the torque is for.
        const JointVector x = r.nominal.qdd + 0.5 * tick_s_ * r.nominal.jerk;
        double share = 0.0;
        if (hasLast_) {
            const JointVector explained = now_.M * x_ + now_.b - (last_.M * x_ + last_.b);
            const JointVector step = r.filterTorque - torque_ - explained;
            const JointVector most = now_.M.cwiseAbs() * jerk_ * tick_s_;
            share = (step.cwiseAbs().array() / most.array()).maxCoeff();
        }
        last_ = now_;
        x_ = x;
        torque_ = r.filterTorque;
        hasLast_ = true;
        return share;
    }

private:
    RobotModel model_;
    const JointVector jerk_;
    const double tick_s_;
    Dynamics now_, last_;
    JointVector x_, torque_;
    bool hasLast_ = false;
};

TEST(Pause, BrakesToRestHoldsThereAndGoesOnWithTheCommandWhereItWas) {
    TestLoop t(kOneJoint, {kCertified, "duration_s=20"});
    t.tick(700);
    ASSERT_GT(std::abs(t.record.nominal.qd[0]), 0.1);
    const double commandTime = t.loop.commandTime();
    t.loop.pause();
    for (int k = 0; k < 2000; ++k) {
        t.tick();
        ASSERT_TRUE(t.record.paused);
        ASSERT_FALSE(t.record.braking);
        ASSERT_FALSE(t.record.missed);
        ASSERT_EQ(t.loop.commandTime(), commandTime);
    }
    EXPECT_TRUE(t.loop.isHolding());
    EXPECT_FALSE(t.loop.hasStopped());
    EXPECT_EQ(t.record.nominal.qd[0], 0.0);
    EXPECT_EQ(t.record.nominal.qdd[0], 0.0);
    const double rest = t.record.nominal.q[0];
    t.tick(1000);
    EXPECT_EQ(t.record.nominal.q[0], rest);
    t.loop.resume();
    double reached = 0.0;
    for (int k = 0; k < 1500; ++k) {
        t.tick();
        ASSERT_FALSE(t.record.paused);
        reached = std::max(reached, std::abs(t.record.nominal.q[0] - rest));
    }
    EXPECT_NEAR(t.loop.commandTime(), commandTime + 1.5, 1e-9);
    EXPECT_GT(reached, 0.1);
    EXPECT_EQ(t.loop.stopReason(), StopReason::None);
}

TEST(Pause, FromTheFirstTickHoldsTheStart) {
    TestLoop t(kTeleoperation, {kCertified});
    const JointVector start = t.loop.nominal().q;
    t.loop.pause();
    t.tick(3000);
    EXPECT_EQ(t.loop.nominal().q, start);
    EXPECT_EQ(t.loop.commandTime(), 0.0);
}

TEST(Pause, ARunWithAPauseAtItsBeginningIsTheRunWithoutLater) {
    TestLoop straight(kOneJoint, {kCertified}), later(kOneJoint, {kCertified});
    later.loop.pause();
    TickRecord a, b;
    for (int k = 0; k < 100; ++k) later.loop.tick(b);
    later.loop.resume();
    for (int k = 0; k < 1500; ++k) {
        straight.loop.tick(a);
        later.loop.tick(b);
        ASSERT_NEAR(a.nominal.q[0], b.nominal.q[0], 1e-12) << "tick " << k;
        ASSERT_EQ(a.command.q, b.command.q);
    }
}

TEST(Pause, OfMinutesIsTakenUpInOneTickAsAShortOne) {
    TestLoop shortly(kOneJoint, {kCertified, "duration_s=20"}), long_(kOneJoint, {kCertified, "duration_s=20"});
    TickRecord a, b;
    const auto hold = [](ControlLoop& loop, TickRecord& r, int ticks) {
        for (int k = 0; k < 700; ++k) loop.tick(r);
        loop.pause();
        for (int k = 0; k < ticks; ++k) loop.tick(r);
        loop.resume();
    };
    hold(shortly.loop, a, 2000);
    hold(long_.loop, b, 300000);
    for (int k = 0; k < 500; ++k) {
        shortly.loop.tick(a);
        long_.loop.tick(b);
        ASSERT_EQ(a.nominal.q, b.nominal.q) << "tick " << k;
        ASSERT_EQ(a.filterTorque, b.filterTorque) << "tick " << k;
    }
}

TEST(Pause, OrStopWhileMissedTicksComeInBetweenKeepsAllLimitsAndEveryStepOfTheTorqueSmall) {
    std::mt19937_64 random(71);
    RecordProperty("seed", 71);
    for (int run = 0; run < 20; ++run) {
        TestLoop t(kTeleoperation, {kCertified, "duration_s=100", "command.seed=" + std::to_string(run)});
        const JointLimits& limits = t.configured->setup.limits;
        TorqueStep step(t.experiment.cases[0].robot, limits, 0.001);
        int paused = 0, moved = 0;
        for (int k = 0; k < 3000; ++k) {
            if (random() % 60 == 0) t.loop.isPaused() ? t.loop.resume() : t.loop.pause();
            if (k == 2500) t.loop.requestStop(StopReason::Requested, "test");
            if (random() % 40 == 0)
                t.loop.missTick(t.record);
            else
                t.tick();
            paused += t.record.paused;
            moved += !t.record.paused && t.record.nominal.qd.cwiseAbs().maxCoeff() > 0.01;
            ASSERT_LE(step.take(t.record), 1.0 + 1e-6) << "run " << run << ", tick " << k;
            for (int i = 0; i < limits.size(); ++i) {
                ASSERT_LE(t.record.nominal.q[i], limits.position.upper[i] + 1e-10);
                ASSERT_GE(t.record.nominal.q[i], limits.position.lower[i] - 1e-10);
                ASSERT_LE(std::abs(t.record.nominal.qd[i]), limits.velocity.upper[i] * (1 + 1e-10));
                ASSERT_LE(std::abs(t.record.nominal.qdd[i]), limits.acceleration.upper[i] * (1 + 1e-10));
                ASSERT_LE(std::abs(t.record.nominal.jerk[i]), limits.jerk.upper[i] * (1 + 1e-10));
            }
        }
        EXPECT_GT(paused, 300);
        EXPECT_GT(moved, 300);
    }
}

/** Works as another one, and from a call on no more. */
class FailingController : public NominalController {
public:
    FailingController(PluginPtr<NominalController> works, int calls) : works_(std::move(works)), calls_(calls) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override { works_->reset(start); }
    ControllerTraits traits() const override { return works_->traits(); }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        return --calls_ < 0 ? TickStatus::Faulted : works_->compute(input, output);
    }

private:
    const PluginPtr<NominalController> works_;
    int calls_;
};

TEST(Bumpless, AControllerThatFailsInMotionIsNoStepOfTheTorque) {
    for (const int calls : {300, 450, 700, 1000}) {
        const Experiment e = readTestExperiment(kTeleoperation, {kCertified, "duration_s=100"});
        auto configured = configureCase(e.cases[0]);
        FailingController failing(std::move(configured->plugins.controller), calls);
        configured->plugins.controller = PluginPtr<NominalController>(&failing, [](void*) {});
        ControlLoop loop(configured->setup, std::move(configured->plugins));
        TorqueStep step(e.cases[0].robot, configured->setup.limits, 0.001);
        TickRecord r;
        double fastest = 0.0;
        for (int k = 0; k < 2000; ++k) {
            loop.tick(r);
            if (k == calls) fastest = r.nominal.qd.cwiseAbs().maxCoeff();
            ASSERT_LE(step.take(r), 1.0 + 1e-6) << "tick " << k;
        }
        EXPECT_GT(fastest, 0.01);
        EXPECT_EQ(loop.stopReason(), StopReason::ControllerFailed);
        EXPECT_TRUE(loop.hasStopped());
    }
}

TEST(Bumpless, AFaultOfTheCommandAndLimitsThatChangeAreNoStepOfTheTorque) {
    const std::string servo = "controller={plugin: joint_servo}";
    struct Event {
        std::vector<std::string> overrides;
        StopReason reason;
        double rateShare = 1.0;  // of acceleration and jerk limits, the larger of before and after
    };
    for (const Event& event : std::vector<Event>{
             {{"command={plugin: silent_command, after_ticks: 700}", servo}, StopReason::CommandFailed},
             {{"command={plugin: changing_limits, fault: throw, at_s: 0.7}", servo}, StopReason::CommandFailed},
             {{"command={plugin: changing_limits, at_s: 0.3, rate_share: 0.5}", servo}, StopReason::None},
             {{"command={plugin: changing_limits, at_s: 0.3, rate_share: 2}", servo}, StopReason::None, 2.0}}) {
        std::vector<std::string> overrides{kCertified, "duration_s=100"};
        overrides.insert(overrides.end(), event.overrides.begin(), event.overrides.end());
        TestLoop t(kTeleoperation, overrides);
        JointLimits limits = t.configured->setup.limits;
        limits.jerk.lower *= event.rateShare;
        limits.jerk.upper *= event.rateShare;
        TorqueStep step(t.experiment.cases[0].robot, limits, 0.001);
        double largest = 0.0;
        for (int k = 0; k < 2000; ++k) {
            t.tick();
            largest = std::max(largest, step.take(t.record));
            ASSERT_LE(largest, 1.0 + 1e-6) << event.overrides.front() << ", tick " << k;
        }
        EXPECT_EQ(t.loop.stopReason(), event.reason) << event.overrides.front();
        EXPECT_GT(largest, 0.1) << event.overrides.front();  // or nothing has moved
    }
}

TEST(Pause, IsNoRefugeFromTooManyMissedTicksOrFromAFailure) {
    TestLoop t(kTeleoperation, {kCertified, "robust_loop={plugin: throwing_robust, after_ticks: 500}"});
    t.loop.pause();
    TickRecord r;
    for (int k = 0; k < 600; ++k) t.loop.tick(r);
    EXPECT_EQ(t.loop.stopReason(), StopReason::RobustLoopFailed);
    TestLoop u(kOneJoint, {kCertified});
    u.loop.pause();
    for (int k = 0; k < 1100; ++k) u.loop.missTick(r);
    EXPECT_EQ(u.loop.stopReason(), StopReason::TicksMissed);
}

TEST(Pause, AllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestLoop t(kTeleoperation, {kCertified, "duration_s=20"});
    t.tick(100);
    const testing::AllocationCounter counter;
    for (int k = 0; k < 5000; ++k) {
        if (k % 500 == 0) t.loop.pause();
        if (k % 500 == 300) t.loop.resume();
        t.tick();
    }
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable::test
