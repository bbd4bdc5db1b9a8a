#include "viable/robot/TorqueSender.h"

#include "TestArm.h"

namespace viable {
namespace {

constexpr double kTick = 0.001;

TEST(TorqueSender, TakesOverWhatTheRobotHeldItsArmWithAndLetsGoOfItSmoothly) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const int n = robot.size();
    RobotModel model(robot);
    Dynamics dynamics;
    const JointVector q = JointVector::LinSpaced(n, -0.4, 0.5), still = JointVector::Zero(n);
    model.calcDynamics(q, still, dynamics);
    for (const bool addsGravity : {false, true}) {
        TorqueConvention convention;
        convention.addsGravity = addsGravity;
        TorqueSender sender(robot, convention, kTick);
        const JointVector expected = addsGravity ? still : dynamics.gravity;
        const JointVector held = expected + JointVector::LinSpaced(n, 3.0, -2.0);
        constexpr double kBlend_s = 0.4;
        sender.reset(q, held, kBlend_s);
        JointVector last = held, given;
        double largestStep = 0.0;
        for (int k = 0; k < 500; ++k) {
            given = dynamics.gravity;  // an arm at rest asks for no more
            const JointVector sent = sender.send(q, given);
            if (k == 0) EXPECT_LT((sent - held).cwiseAbs().maxCoeff(), 1e-12);
            largestStep = std::max(largestStep, (sent - last).cwiseAbs().maxCoeff());
            EXPECT_LT((given - (sent + (dynamics.gravity - expected))).cwiseAbs().maxCoeff(), 1e-12);
            last = sent;
        }
        // Half a cosine over 400 ticks: pi / 2 / 400 of 3 Nm in its middle.
        EXPECT_LT(largestStep, 3.0 * EIGEN_PI / 2.0 / 400.0 * 1.001);
        EXPECT_LT((last - expected).cwiseAbs().maxCoeff(), 1e-12);
        EXPECT_EQ(given, dynamics.gravity);
        sender.reset(q);
        given = dynamics.gravity;
        EXPECT_LT((sender.send(q, given) - expected).cwiseAbs().maxCoeff(), 1e-12);
    }
}

TEST(TorqueSender, KeepsItsRateWhileItBlends) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const int n = robot.size();
    TorqueConvention convention;
    convention.torqueRate = 10.0;
    TorqueSender sender(robot, convention, kTick);
    const JointVector q = JointVector::Zero(n), held = JointVector::Constant(n, 5.0);
    sender.reset(q, held, 0.01);
    JointVector last = held;
    for (int k = 0; k < 3000; ++k) {
        JointVector torque = JointVector::Zero(n);
        const JointVector sent = sender.send(q, torque);
        ASSERT_LE((sent - last).cwiseAbs().maxCoeff(), 10.0 * kTick * (1.0 + 1e-9));
        last = sent;
    }
    EXPECT_LT(last.cwiseAbs().maxCoeff(), 1e-12);
}

}  // namespace
}  // namespace viable
