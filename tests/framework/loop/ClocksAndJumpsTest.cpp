// Clocks that jitter, stand or jump, and targets that jump.

#include "CaseSupport.h"
#include "viable/loop/ReferenceGuard.h"
#include "viable/loop/TorqueGuard.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;

/** The ticks missed before each one by a clock that jitters by less than a tick, and jumps back by 10 s and on again: below 0
where it ran back; on, its user takes the jump for one. */
std::int64_t countTicksRunBack(std::mt19937& random, double& clock_s, int tick) {
    std::uniform_real_distribution<double> jitter(-0.5, 0.5);
    const double now = kTick_s * (tick + jitter(random)) - (tick % 500 < 100 ? 10.0 : 0.0);
    const auto passed = static_cast<std::int64_t>(std::floor((now - clock_s) / kTick_s));
    clock_s = now;
    return std::min<std::int64_t>(passed, 0);
}

TEST(Fault24, AClockThatRunsBackMissesNoTicksOfEitherGuard) {
    const RobotDescription robot = testing::makeTwoLinkArm();
    TorqueGuard quiet(robot, kTick_s), jittering(robot, kTick_s);
    ReferenceGuard quietReference(robot, kTick_s), jitteringReference(robot, kTick_s);
    for (TorqueGuard* guard : {&quiet, &jittering}) guard->start({robot.home, JointVector::Zero(2)});
    for (ReferenceGuard* guard : {&quietReference, &jitteringReference})
        guard->start({robot.home, JointVector::Zero(2), JointVector::Zero(2)});
    std::mt19937 random(24);
    double clock_s = 0.0;
    std::int64_t back = 0;
    for (int k = 0; k < 3000; ++k) {
        JointVector target = robot.home;
        target[k / 700 % 2] += k / 300 % 2 ? 2.0 : -2.0;
        const auto law = [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
            torque = dynamics.M * (100.0 * (target - nominal.q) - 20.0 * nominal.qd) + dynamics.b;
        };
        const auto follow = [](const TorqueGuard& guard) { return JointState{guard.nominal().q, guard.nominal().qd}; };
        const std::int64_t missed = countTicksRunBack(random, clock_s, k);
        back += missed < 0;
        jittering.missTicks(missed);
        jitteringReference.missTicks(missed);
        ASSERT_EQ(jittering.step(follow(jittering), law).torque, quiet.step(follow(quiet), law).torque) << k;
        ASSERT_EQ(jittering.nominal().q, quiet.nominal().q) << k;
        ASSERT_EQ(jittering.nominal().qdd, quiet.nominal().qdd) << k;
        ASSERT_EQ(jitteringReference.step(target).state.q, quietReference.step(target).state.q) << k;
    }
    EXPECT_GT(back, 4);
    EXPECT_GT((quiet.nominal().q - robot.home).norm(), 0.1);
}

// Ten seconds in which the computer slept: the arm followed its stop, and stays stopped.
TEST(Fault24, ASuspendedComputerFindsBothGuardsStoppedWithinTheirLimits) {
    const RobotDescription robot = testing::makeTwoLinkArm();
    TorqueGuard guard(robot, kTick_s);
    ReferenceGuard reference(robot, kTick_s);
    guard.start({robot.home, JointVector::Zero(2)});
    reference.start({robot.home, JointVector::Zero(2), JointVector::Zero(2)});
    const JointVector target = robot.home + JointVector::Constant(2, 5.0);
    const auto law = [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
        torque = dynamics.M * (100.0 * (target - nominal.q) - 20.0 * nominal.qd) + dynamics.b;
    };
    for (int k = 0; k < 300; ++k) {
        guard.step({guard.nominal().q, guard.nominal().qd}, law);
        reference.step(target);
    }
    EXPECT_GT(guard.nominal().qd.norm(), 0.5);
    guard.missTicks(10000);
    reference.missTicks(10000);
    EXPECT_EQ(guard.stopReason(), GuardStop::TicksMissed);
    EXPECT_EQ(reference.stopReason(), GuardStop::TicksMissed);
    EXPECT_EQ(guard.step({guard.nominal().q, guard.nominal().qd}, law).status, GuardStatus::Stopped);
    EXPECT_EQ(reference.step(target).status, GuardStatus::Stopped);
    EXPECT_LT(guard.nominal().qd.norm(), 1e-9);
    for (int i = 0; i < 2; ++i) EXPECT_LE(guard.nominal().q[i], robot.limits.position.upper[i] + 1e-9);
}

// Where the target jumps by D, the desired acceleration k (q_d - q) - c qd of a spring and damper changes in a tick by k D, and
// beyond that by what the arm moves: |d qdd_d| <= k D + k V dt + c A dt. So the difference quotient of Remark 1 is at most
// k D / dt + k V + c A, and k V + c A in every other tick.
TEST(Fault30, TheDifferenceQuotientIsBoundedAtJumpsAndTurns) {
    constexpr double kStiffness = 100.0, kDamping = 20.0;
    for (const double jump : {0.5, 2.0 * kPi, 1e3}) {
        std::string points;
        for (int k = 0; k < 10; ++k)
            points += std::string(k ? ", " : "") + "[" + std::to_string(0.4 * k) + ", " +
                      std::to_string(k % 2 ? jump : 0.0) + "]";
        test::TestLoop t(test::kOneJoint,
                         {"filter={plugin: certified_braking}", "duration_s=4",
                          "controller={plugin: joint_pd, stiffness: 100, damping: 20}",
                          "command={plugin: waypoints, interpolation: hold, points: [" + points + "]}"});
        const CasePlan& plan = t.experiment.cases[0];
        const AxisLimits axis = plan.limits.axis(0);
        RobotModel model(plan.robot);
        Dynamics d;
        Summary summary(plan.robot.jointNames(), plan.limits, false);
        double last = 0.0, lastTarget = 0.0, worst[2] = {0.0, 0.0};
        const double usual = kStiffness * axis.velocityUpper + kDamping * axis.accelerationUpper;
        int jumps = 0;
        for (int k = 0; k < 4000; ++k) {
            t.tick();
            summary.add(t.record);
            model.calcDynamics(t.record.nominal.q, t.record.nominal.qd, d);
            JointVector qdd;
            ASSERT_TRUE(calcForwardDynamics(d, t.record.desiredTorque, qdd));
            const double quotient = std::abs(qdd[0] - last) / kTick_s,
                         move = std::abs(t.record.command.q[0] - lastTarget);
            if (k > 0) {
                ASSERT_LE(quotient, (kStiffness * move / kTick_s + usual) * (1.0 + 1e-6)) << k;
                worst[move > 0.0] = std::max(worst[move > 0.0], quotient);
                jumps += move > 0.0;
            }
            last = qdd[0];
            lastTarget = t.record.command.q[0];
        }
        std::printf("  jump %.4g rad: quotient up to %.3g rad/s^3 at it (bound %.3g), %.3g elsewhere (bound %.3g)\n",
                    jump, worst[1], kStiffness * jump / kTick_s + usual, worst[0], usual);
        EXPECT_GE(jumps, 9);
        EXPECT_GT(worst[1], 0.9 * kStiffness * jump / kTick_s) << "the bound is not near what is seen";
        EXPECT_FALSE(summary.anyLimitBroken());
    }
}

}  // namespace
}  // namespace viable
