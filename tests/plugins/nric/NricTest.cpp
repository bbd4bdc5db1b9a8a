#include "viable/plugin/Nric.h"

#include <gtest/gtest.h>

#include <limits>

#include "TestArm.h"

namespace viable {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

class NricTest : public ::testing::Test {
protected:
    NricTest() { arm_.robot.actuation.torqueLimit.setConstant(n(), kInf); }

    int n() const { return arm_.size(); }

    void configure(const std::string& text) {
        loop_.configure(arm_.setup(), arm_.read(PluginKind::RobustLoop, "nric", text));
        loop_.reset(arm_.start);
    }

    /** The answer to the position error e and the velocity error de. */
    JointVector compute(const JointVector& e, const JointVector& de,
                        const JointVector& filterTorque) {
        const JointState real{arm_.start.q + e, arm_.start.qd + de};
        JointVector torque;
        EXPECT_EQ(loop_.compute(real, arm_.start, filterTorque, torque), TickStatus::Ok);
        return torque;
    }
    JointVector constant(double x) const { return JointVector::Constant(n(), x); }

    TestArm arm_{"indy7"};
    Nric loop_;
};

// Formula (7), joint by joint, with the integral as a plain sum in higher precision.
TEST_F(NricTest, FollowsFormula7WithAGainOfItsOwnForEachJoint) {
    const double kr[] = {600, 500, 400, 30, 20, 10}, kp[] = {20, 19, 18, 0, 16, 15},
                 ki[] = {8, 7, 6, 5, 0, 3};
    configure(
        "k_r: [600, 500, 400, 30, 20, 10], k_p: [20, 19, 18, 0, 16, 15], "
        "k_i: [8, 7, 6, 5, 0, 3]");
    std::mt19937 random(2);
    std::vector<long double> sum(n(), 0.0L);
    for (int k = 0; k < 5000; ++k) {
        const JointVector e = makeRandomVector(n(), 0.01, random) + constant(0.002);
        const JointVector de = makeRandomVector(n(), 0.5, random);
        const JointVector torque = compute(e, de, makeRandomVector(n(), 100.0, random));
        for (int i = 0; i < n(); ++i) {
            const double exactE = (arm_.start.q[i] + e[i]) - arm_.start.q[i];
            sum[i] += static_cast<long double>(exactE) * 0.001L;
            const long double expected = -kr[i] * (de[i] + kp[i] * exactE + ki[i] * sum[i]);
            ASSERT_NEAR(torque[i], static_cast<double>(expected), 1e-10) << "tick " << k;
        }
    }
    EXPECT_GT(sum[0], 0.009L);  // the integral played a part
}

TEST_F(NricTest, DefaultsAreThoseOfThePaper) {
    configure("");
    const JointVector e = constant(0.001), de = constant(0.01);
    const JointVector torque = compute(e, de, constant(0.0));
    for (int i = 0; i < n(); ++i)
        EXPECT_NEAR(torque[i], -600.0 * (0.01 + 20.0 * 0.001 + 8.0 * 1e-6), 1e-9);
}

TEST_F(NricTest, ThePluginHasTheDefaultsOfTheOptions) {
    const Parameters parameters = arm_.read(PluginKind::RobustLoop, "nric", "");
    const NricOptions options;
    EXPECT_EQ(parameters.jointNumbers("k_r"), options.kr.expand(n()));
    EXPECT_EQ(parameters.jointNumbers("k_p"), options.kp.expand(n()));
    EXPECT_EQ(parameters.jointNumbers("k_i"), options.ki.expand(n()));
}

TEST_F(NricTest, OptionsInCodeAreChecked) {
    const auto complain = [&](const NricOptions& options) {
        return findComplaint([&] { Nric().configure(arm_.setup(), options); });
    };
    EXPECT_EQ(complain({}), "");
    EXPECT_EQ(complain({constant(100.0), 0.0, constant(3.0)}), "");
    for (const double bad : {-1.0, kNan, kInf}) {
        EXPECT_CONTAINS(complain({bad}), "NricOptions::kr: the gain of joint 0 is");
        EXPECT_CONTAINS(complain({600.0, bad}), "NricOptions::kp");
        EXPECT_CONTAINS(complain({600.0, 20.0, bad}), "NricOptions::ki");
    }
    EXPECT_CONTAINS(complain({JointVector(JointVector::Constant(5, 600.0))}),
                    "NricOptions::kr: 5 gains; the robot has 6 joints");
}

TEST_F(NricTest, SumStaysWithinTheMotorLimits) {
    arm_.robot.actuation.torqueLimit.setLinSpaced(n(), 10.0, 60.0);
    configure("");
    const JointVector& limit = arm_.robot.actuation.torqueLimit;
    std::mt19937 random(3);
    int saturated = 0;
    for (int k = 0; k < 5000; ++k) {
        const JointVector filterTorque = makeRandomVector(n(), 1.0, random).cwiseProduct(limit);
        const JointVector torque = compute(makeRandomVector(n(), 0.05, random),
                                           makeRandomVector(n(), 0.1, random), filterTorque);
        for (int i = 0; i < n(); ++i) {
            const double total = std::abs(filterTorque[i] + torque[i]);
            ASSERT_LE(total, limit[i] * (1.0 + 1e-14));
            saturated += total >= limit[i] * (1.0 - 1e-14);
        }
    }
    EXPECT_GT(saturated, 1000);
}

TEST_F(NricTest, Fault17IntegralIsHeldWhileSaturatedAndReleasedAtOnce) {
    arm_.robot.actuation.torqueLimit.setConstant(n(), 50.0);
    for (const double side : {1.0, -1.0}) {
        configure("k_r: 600, k_p: 20, k_i: 8");
        // An arm that is held 0.1 rad off: the loop asks for 1200 Nm, twenty seconds long. A free
        // integral would reach 2 rad s and keep the motor at its limit long after the release.
        for (int k = 0; k < 20000; ++k) {
            const JointVector torque = compute(constant(0.1 * side), constant(0.0), constant(0.0));
            ASSERT_EQ(torque, constant(-50.0 * side));
        }
        // Let go: the very next answer is that of an integral that never grew.
        const JointVector released = compute(constant(0.0), constant(0.0), constant(0.0));
        EXPECT_LE(released.lpNorm<Eigen::Infinity>(), 1e-12);
        const double e = -0.001 * side;
        const JointVector back = compute(constant(e), constant(0.0), constant(0.0));
        for (int i = 0; i < n(); ++i)
            EXPECT_NEAR(back[i], -600.0 * (20.0 * e + 8.0 * e * 0.001), 1e-9);
    }
}

TEST_F(NricTest, IntegralMayShrinkWhileSaturated) {
    arm_.robot.actuation.torqueLimit.setConstant(n(), 50.0);
    configure("k_r: 600, k_p: 0, k_i: 8");
    // Wind up within the limit to 5 e-3 rad s (24 Nm), then saturate by a velocity error on the
    // same side while the position error already pulls the other way.
    for (int k = 0; k < 500; ++k) compute(constant(0.01), constant(0.0), constant(0.0));
    for (int k = 0; k < 500; ++k) {
        const JointVector torque = compute(constant(-0.01), constant(1.0), constant(0.0));
        ASSERT_EQ(torque, constant(-50.0));
    }
    const JointVector torque = compute(constant(0.0), constant(0.0), constant(0.0));
    EXPECT_LE(torque.lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST_F(NricTest, ResetForgetsTheIntegral) {
    configure("");
    const JointVector e = constant(0.01), zero = constant(0.0);
    const JointVector first = compute(e, zero, zero);
    for (int k = 0; k < 100; ++k) compute(e, zero, zero);
    EXPECT_NE(compute(e, zero, zero), first);
    loop_.reset(arm_.start);
    EXPECT_EQ(compute(e, zero, zero), first);
}

TEST_F(NricTest, AHeldIntegralStandsStillUntilReset) {
    configure("k_r: 100, k_p: 0, k_i: 10");
    const JointVector e = constant(0.5), none = constant(0.0);
    for (int k = 0; k < 10; ++k) compute(e, none, none);
    loop_.holdIntegral();
    for (int k = 0; k < 10; ++k)
        EXPECT_NEAR(compute(e, none, none)[0], -100.0 * 10.0 * 0.005, 1e-12);
    loop_.reset(arm_.start);
    for (int k = 1; k < 10; ++k)
        EXPECT_NEAR(compute(e, none, none)[0], -100.0 * 10.0 * 0.0005 * k, 1e-12);
}

TEST_F(NricTest, ScaledGainsAreThePapersOnTheHeavyJointsOfTheIndy7AndCarriedByTheOthers) {
    const RobotDescription& robot = arm_.robot;
    const NricOptions gains = scaleNric(robot, robot.limits, 0.001);
    for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(gains.kr[i], 600.0);
        EXPECT_EQ(gains.kp[i], 20.0);
        EXPECT_EQ(gains.ki[i], 8.0);
    }
    for (int i = 3; i < n(); ++i) {
        EXPECT_GT(gains.kr[i], 300.0);
        EXPECT_LT(gains.kr[i], 600.0);
        EXPECT_NEAR(gains.kr[i] * gains.kp[i], 12000.0, 1e-6);
    }
    // Ten times the tick carries a tenth.
    const NricOptions slow = scaleNric(robot, robot.limits, 0.01);
    for (int i = 0; i < n(); ++i) {
        EXPECT_LT(slow.kr[i], 300.0);
        if (i < 3) continue;
        EXPECT_NEAR(slow.kr[i], 0.1 * gains.kr[i], 1e-9);
        EXPECT_LE(slow.kp[i] * 0.01, 0.1 + 1e-12);
    }
}

TEST_F(NricTest, RefusesWhatIsNotFiniteOrOfTheWrongSizeAndStaysAsItWas) {
    configure("");
    const JointVector zero = constant(0.0);
    const JointVector e = constant(0.01);
    compute(e, zero, zero);
    const JointState real{arm_.start.q + e, arm_.start.qd};
    JointVector torque = constant(7.0);
    for (const double bad : {kNan, kInf}) {
        JointState badReal = real;
        badReal.qd[2] = bad;
        EXPECT_EQ(loop_.compute(badReal, arm_.start, zero, torque), TickStatus::InvalidInput);
        MotionState badNominal = arm_.start;
        badNominal.q[0] = bad;
        EXPECT_EQ(loop_.compute(real, badNominal, zero, torque), TickStatus::InvalidInput);
        EXPECT_EQ(loop_.compute(real, arm_.start, constant(bad), torque), TickStatus::InvalidInput);
    }
    EXPECT_EQ(loop_.compute(real, arm_.start, JointVector::Zero(n() - 1), torque),
              TickStatus::InvalidInput);
    EXPECT_EQ(torque, constant(7.0));

    const JointVector second = compute(e, zero, zero);
    Nric other;
    other.configure(arm_.setup(), arm_.read(PluginKind::RobustLoop, "nric", ""));
    other.reset(arm_.start);
    JointVector expected;
    for (int k = 0; k < 2; ++k) other.compute(real, arm_.start, zero, expected);
    EXPECT_EQ(second, expected);  // the refused ticks left no trace in the integral
}

TEST_F(NricTest, RefusesNegativeGainsAndListsOfTheWrongLength) {
    EXPECT_CONTAINS(findComplaint([&] { configure("k_r: -1"); }), "k_r");
    EXPECT_CONTAINS(findComplaint([&] { configure("k_i: [1, 2]"); }), "k_i");
}

TEST_F(NricTest, LoadsAsALibrary) {
    configure("");
    const auto plugin =
        PluginLoader::create<RobustLoop>(findPlugin(PluginKind::RobustLoop, "nric"));
    plugin->configure(arm_.setup(), arm_.read(PluginKind::RobustLoop, "nric", ""));
    plugin->reset(arm_.start);
    const JointState real{arm_.start.q + constant(0.01), arm_.start.qd};
    JointVector torque;
    ASSERT_EQ(plugin->compute(real, arm_.start, constant(0.0), torque), TickStatus::Ok);
    EXPECT_EQ(torque, compute(constant(0.01), constant(0.0), constant(0.0)));
}

}  // namespace
}  // namespace viable
