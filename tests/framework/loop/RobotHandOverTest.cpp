
#include "CaseSupport.h"

namespace viable::test {
namespace {

/** A simulated arm with the clock of a robot, whose driver turns the torque of a joint round, or does not pass it on. */
class WrongRobot : public RealPlant {
public:
    WrongRobot(PluginPtr<RealPlant> plant, int joint, double factor)
        : plant_(std::move(plant)), joint_(joint), factor_(factor) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override { plant_->reset(start); }
    const JointState& measured() const override { return plant_->measured(); }
    const JointState& actual() const override { return plant_->actual(); }
    PlantTraits traits() const override { return {Encoder::Counts, 0, {}, true}; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        ++advances;
        JointVector given = torque;
        given[joint_] *= factor_;
        const TickStatus status = plant_->advance(given, applied);
        applied[joint_] = torque[joint_];  // it knows no better
        return status;
    }

    int advances = 0;

private:
    const PluginPtr<RealPlant> plant_;
    const int joint_;
    const double factor_;
};

TEST(RobotHandOver, ARobotThatGoesOnThoughItIsToldToBrakeIsLeftToItsOwnStop) {
    for (const int joint : {0, 1, 2, 3}) {
        const Experiment e = readTestExperiment(
            kTeleoperation, {"filter={plugin: certified_braking}", "duration_s=20", "robust_loop={plugin: nric}"});
        auto configured = configureCase(e.cases[0]);
        WrongRobot robot(std::move(configured->plugins.realPlant), joint, -1.0);
        configured->plugins.realPlant = PluginPtr<RealPlant>(&robot, [](void*) {});
        ControlLoop loop(configured->setup, std::move(configured->plugins), {nullptr, false, true, false, true});
        TickRecord r;
        int ticks = 0, braking = 0;
        for (; !loop.hasFailed() && ticks < 5000; ++ticks) {
            const MotionState before = loop.nominal();
            loop.tick(r);
            braking += r.braking;
            // Its nominal arm brakes as any other, to the last row.
            ASSERT_LT(std::abs((loop.nominal().qd - before.qd).cwiseAbs().maxCoeff()), 4 * EIGEN_PI * 0.001 * 1.01);
        }
        EXPECT_EQ(loop.stopReason(), StopReason::NotFollowing) << "joint " << joint << ": " << loop.stopMessage();
        EXPECT_TRUE(loop.hasFailed()) << "joint " << joint;
        EXPECT_LT(braking, 400) << "joint " << joint;
        EXPECT_EQ(r.motorTorque.cwiseAbs().maxCoeff(), 0.0);  // nothing was sent in the last tick
        EXPECT_EQ(robot.advances, ticks - 1);
    }
}

TEST(RobotHandOver, ARobotThatFollowsIsBrakedToRestAndNotLeft) {
    const Experiment e = readTestExperiment(
        kTeleoperation, {"filter={plugin: certified_braking}", "duration_s=20", "robust_loop={plugin: nric}"});
    auto configured = configureCase(e.cases[0]);
    WrongRobot robot(std::move(configured->plugins.realPlant), 0, 1.0);
    configured->plugins.realPlant = PluginPtr<RealPlant>(&robot, [](void*) {});
    ControlLoop loop(configured->setup, std::move(configured->plugins), {nullptr, false, true, false, true});
    TickRecord r;
    for (int k = 0; k < 1500; ++k) loop.tick(r);
    loop.requestStop(StopReason::Requested, "test");
    for (int k = 0; k < 2000 && !loop.hasStopped(); ++k) loop.tick(r);
    EXPECT_TRUE(loop.hasStopped());
    EXPECT_FALSE(loop.hasFailed());
    EXPECT_EQ(robot.advances, static_cast<int>(std::lround(loop.time() / 0.001)));
}

}  // namespace
}  // namespace viable::test
