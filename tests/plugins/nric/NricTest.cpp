#include "viable/tracking/LoopStability.h"
#include "viable/tracking/Nric.h"

#include "TestArm.h"

namespace viable {
namespace {

struct NricTest : ::testing::Test {
    NricTest() { arm_.robot.actuation.torqueLimit.setConstant(n(), kInfinity); }

    int n() const { return arm_.size(); }

    void configure(const std::string& text) { arm_.configure(loop_, PluginKind::RobustLoop, "nric", text); }

    /** The answer to the position error e and the velocity error de. */
    JointVector compute(const JointVector& e, const JointVector& de, const JointVector& filterTorque) {
        const JointState real{arm_.start.q + e, arm_.start.qd + de};
        JointVector torque;
        EXPECT_EQ(loop_.compute(real, arm_.start, filterTorque, torque), TickStatus::Ok);
        return torque;
    }
    JointVector constant(double x) const { return JointVector::Constant(n(), x); }

    TestArm arm_{"indy7"};
    Nric loop_;
};

// What the host withheld is no news of the arm: neither sum nor rate counts from it.
TEST_F(NricTest, NeitherIntegralNorRateCountWhatTheHostWithheld) {
    for (const bool hasRate : {true, false}) {
        configure(std::string("k_r: 600, k_p: 20, k_i: 8") + (hasRate ? ", torque_rate_Nmps: 1000" : ""));
        constexpr double kMost = 5.0;
        JointState real{arm_.start.q - constant(0.01), arm_.start.qd};
        JointVector torque = constant(0.0);
        for (int k = 0; k < 3000; ++k) {
            const JointVector given = torque;
            ASSERT_EQ(loop_.compute(real, arm_.start, constant(0.0), torque), TickStatus::Ok);
            ASSERT_LE((torque - given).cwiseAbs().maxCoeff(), hasRate ? 1.0 + 1e-9 : kInfinity);
            torque = torque.cwiseMin(kMost);
        }
        real.q = arm_.start.q;
        for (int k = 0; k < 200; ++k) loop_.compute(real, arm_.start, constant(0.0), torque);
        // Without that the sum would be 3 s x 0.01 rad, and 144 Nm.
        EXPECT_LE(torque.cwiseAbs().maxCoeff(), 600 * 8 * 0.01 * 10e-3) << hasRate;
    }
}

// Formula (7), joint by joint, with the integral as a plain sum in higher precision.
TEST_F(NricTest, FollowsFormula7WithAGainOfItsOwnForEachJoint) {
    const double kr[] = {600, 500, 400, 30, 20, 10}, kp[] = {20, 19, 18, 0, 16, 15}, ki[] = {8, 7, 6, 5, 0, 3};
    configure("k_r: [600, 500, 400, 30, 20, 10], k_p: [20, 19, 18, 0, 16, 15], k_i: [8, 7, 6, 5, 0, 3]");
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

TEST_F(NricTest, DefaultsFollowFromTheArmInEveryPose) {
    const LinearErrorLoop loop = scaleGains(arm_.robot, arm_.limits, arm_.tick_s);
    configure("");
    std::mt19937 random(4);
    for (int k = 0; k < 20; ++k) {
        arm_.start.q = arm_.robot.home + makeRandomVector(n(), 1.0, random);
        loop_.reset(arm_.start);
        const JointVector e = makeRandomVector(n(), 0.001, random), de = makeRandomVector(n(), 0.01, random);
        // K_r^-1 = diag(k_r)^-1 + (c M)^-1
        const JointMatrix M = arm_.calcDynamics(arm_.start).M;
        JointMatrix inverse = (loop.inertiaRate * M).inverse();
        inverse.diagonal() += loop.kr.cwiseInverse();
        const JointVector error = de + loop.kp.cwiseProduct(e) + 0.001 * loop.ki.cwiseProduct(e);
        const JointVector expected = -(inverse.inverse() * error);
        EXPECT_LE((compute(e, de, constant(0.0)) - expected).norm(), 1e-9 * expected.norm());
    }
}

// 20,000 ticks at a limit of the integral's torque, joint by joint, with gains that couple the joints.
TEST_F(NricTest, CoupledGainsKeepTheBoundsToo) {
    configure("integral_limit_Nm: 5, torque_rate_Nmps: 2000");
    arm_.robot.actuation.torqueLimit.setConstant(n(), 50.0);
    configure("integral_limit_Nm: 5, torque_rate_Nmps: 2000");
    std::mt19937 random(8);
    JointVector last = constant(0.0);
    const JointVector held = makeRandomVector(n(), 0.02, random);
    for (int k = 0; k < 20000; ++k) {
        const JointVector filterTorque = constant(49.0);
        const JointVector torque = compute(k < 10000 ? held : constant(0.0), constant(0.0), filterTorque);
        ASSERT_LE((torque + filterTorque).cwiseAbs().maxCoeff(), 50.0 * (1.0 + 1e-14));
        ASSERT_LE((torque - last).cwiseAbs().maxCoeff(), 2.0 * (1.0 + 1e-9));
        last = torque;
    }
    // What is left is the integral's torque, which a coupled gain spreads over the joints.
    EXPECT_LE(last.cwiseAbs().maxCoeff(), 5.0 * n());
}

TEST_F(NricTest, ThePluginHasTheBoundsOfTheOptions) {
    const Parameters parameters = arm_.read(PluginKind::RobustLoop, "nric", "");
    const NricOptions options;
    const auto settings = parameters.get<NricSettings>();
    EXPECT_FALSE(settings.kr || settings.kp || settings.ki) << "not auto";
    EXPECT_EQ(settings.integralLimit.expand(n()), options.integralLimit.expand(n()));
    EXPECT_EQ(settings.torqueRate.expand(n()), options.torqueRate.expand(n()));
    EXPECT_EQ(settings.motorRate.expand(n()), options.motorRate.expand(n()));
}

TEST_F(NricTest, OptionsInCodeAreChecked) {
    const auto complain = [&](const NricOptions& options) {
        return test::findComplaint([&] { Nric().configure(arm_.setup(), options); });
    };
    EXPECT_EQ(complain({}), "");
    EXPECT_EQ(complain({constant(100.0), 0.0, constant(3.0)}), "");
    for (const double bad : {-1.0, kNan, kInfinity}) {
        EXPECT_CONTAINS(complain({bad}), "NricOptions::kr: the gain of joint 0 is");
        EXPECT_CONTAINS(complain({600.0, bad}), "NricOptions::kp");
        EXPECT_CONTAINS(complain({600.0, 20.0, bad}), "NricOptions::ki");
    }
    EXPECT_CONTAINS(complain({JointVector(JointVector::Constant(5, 600.0))}),
                    "NricOptions::kr: 5 gains; the robot has 6 joints");
    for (const double bad : {-1.0, 0.0, kNan}) {
        NricOptions options;
        options.integralLimit = bad;
        EXPECT_CONTAINS(complain(options), "NricOptions::integralLimit: the bound of joint 0 is");
        options = {};
        options.torqueRate = bad;
        EXPECT_CONTAINS(complain(options), "NricOptions::torqueRate: the bound of joint 0 is");
        options = {};
        options.motorRate = bad;
        EXPECT_CONTAINS(complain(options), "NricOptions::motorRate: the bound of joint 0 is");
    }
}

TEST_F(NricTest, SumStaysWithinTheMotorLimits) {
    arm_.robot.actuation.torqueLimit.setLinSpaced(n(), 10.0, 60.0);
    configure("");
    const JointVector& limit = arm_.robot.actuation.torqueLimit;
    std::mt19937 random(3);
    int saturated = 0;
    for (int k = 0; k < 5000; ++k) {
        const JointVector filterTorque = makeRandomVector(n(), 1.0, random).cwiseProduct(limit);
        const JointVector torque =
            compute(makeRandomVector(n(), 0.05, random), makeRandomVector(n(), 0.1, random), filterTorque);
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
        for (int k = 0; k < 20000; ++k)
            ASSERT_EQ(compute(constant(0.1 * side), constant(0.0), constant(0.0)), constant(-50.0 * side));
        // Let go: the very next answer is that of an integral that never grew.
        EXPECT_LE(compute(constant(0.0), constant(0.0), constant(0.0)).lpNorm<Eigen::Infinity>(), 1e-12);
        const double e = -0.001 * side;
        const JointVector back = compute(constant(e), constant(0.0), constant(0.0));
        for (int i = 0; i < n(); ++i) EXPECT_NEAR(back[i], -600.0 * (20.0 * e + 8.0 * e * 0.001), 1e-9);
    }
}

// From what holds the arm at the start, the filter's torque and the loop's together.
TEST_F(NricTest, TheMotorsTorqueChangesNoFasterThanItsRateAndTheIntegralIsHeldMeanwhile) {
    const JointVector& limit = arm_.robot.actuation.torqueLimit;
    RobotModel model(arm_.robot);
    Dynamics dynamics;
    model.calcDynamics(arm_.start.q, constant(0.0), dynamics);
    configure("k_r: 600, k_p: 20, k_i: 8, motor_rate_Nmps: 1000");
    JointVector last = dynamics.gravity;
    std::mt19937 random(5);
    int cut = 0;
    for (int k = 0; k < 5000; ++k) {
        const JointVector filterTorque = dynamics.gravity + makeRandomVector(n(), 2.0, random);
        const JointVector torque =
            compute(makeRandomVector(n(), 1e-4, random), makeRandomVector(n(), 1e-3, random), filterTorque);
        const JointVector total = filterTorque + torque;
        ASSERT_LE((total - last).lpNorm<Eigen::Infinity>(), 1.0 + 1e-9) << k;
        ASSERT_TRUE((total.cwiseAbs().array() <= limit.array()).all());
        cut += (total - last).lpNorm<Eigen::Infinity>() > 1.0 - 1e-9;
        last = total;
    }
    EXPECT_GT(cut, 1000);
    // An error that asks for 1200 Nm more, which 1000 Nm/s take 1.2 s to give: none of that time winds up the integral.
    configure("k_r: 600, k_p: 20, k_i: 8, motor_rate_Nmps: 1000");
    for (int k = 1; k <= 1000; ++k) {
        const JointVector torque = compute(constant(-0.1), constant(0.0), dynamics.gravity);
        for (int i = 0; i < n(); ++i) ASSERT_NEAR(torque[i], 1.0 * k, 1e-6);
    }
    for (int k = 999; k >= 1; --k) {
        const JointVector torque = compute(constant(0.0), constant(0.0), dynamics.gravity);
        for (int i = 0; i < n(); ++i) ASSERT_NEAR(torque[i], 1.0 * k, 1e-6);
    }
    EXPECT_LE(compute(constant(0.0), constant(0.0), dynamics.gravity).lpNorm<Eigen::Infinity>(), 1e-6);
}

TEST_F(NricTest, IntegralMayShrinkWhileSaturated) {
    arm_.robot.actuation.torqueLimit.setConstant(n(), 50.0);
    configure("k_r: 600, k_p: 0, k_i: 8");
    // Wind up within the limit to 5 e-3 rad s (24 Nm), then saturate by a velocity error on the
    // same side while the position error already pulls the other way.
    for (int k = 0; k < 500; ++k) compute(constant(0.01), constant(0.0), constant(0.0));
    for (int k = 0; k < 500; ++k) ASSERT_EQ(compute(constant(-0.01), constant(1.0), constant(0.0)), constant(-50.0));
    EXPECT_LE(compute(constant(0.0), constant(0.0), constant(0.0)).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST_F(NricTest, ResetForgetsTheIntegral) {
    configure("");
    const JointVector e = constant(0.01), zero = constant(0.0), first = compute(e, zero, zero);
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
    for (int k = 0; k < 10; ++k) EXPECT_NEAR(compute(e, none, none)[0], -100.0 * 10.0 * 0.005, 1e-12);
    loop_.reset(arm_.start);
    for (int k = 1; k < 10; ++k) EXPECT_NEAR(compute(e, none, none)[0], -100.0 * 10.0 * 0.0005 * k, 1e-12);
}

TEST_F(NricTest, BoundsThatDoNotActChangeNoBit) {
    arm_.robot.actuation.torqueLimit.setConstant(n(), 400.0);
    configure("");
    Nric bounded;
    // In 2000 ticks of |e| <= 6e-3 the integral's torque stays below 600 x 8 x 0.012 = 58 Nm, and no step is
    // larger than twice 600 x (0.1 + 20 x 0.006) + 58 = 380 Nm.
    arm_.configure(bounded, PluginKind::RobustLoop, "nric", "integral_limit_Nm: 60, torque_rate_Nmps: 380e3");
    std::mt19937 random(5);
    for (int k = 0; k < 2000; ++k) {
        const JointState real{arm_.start.q + makeRandomVector(n(), 0.004, random) + constant(0.002),
                              arm_.start.qd + makeRandomVector(n(), 0.1, random)};
        const JointVector filterTorque = makeRandomVector(n(), 300.0, random);
        JointVector expected, torque;
        ASSERT_EQ(loop_.compute(real, arm_.start, filterTorque, expected), TickStatus::Ok);
        ASSERT_EQ(bounded.compute(real, arm_.start, filterTorque, torque), TickStatus::Ok);
        ASSERT_EQ(torque, expected) << "tick " << k;
    }
}

TEST_F(NricTest, TheIntegralEndsAtItsLimitAndAtTheMotorsAtTheLatest) {
    const JointVector e = constant(0.01), none = constant(0.0);
    for (const double side : {1.0, -1.0}) {
        configure("k_r: 600, k_p: 20, k_i: [8, 8, 8, 0, 8, 8], integral_limit_Nm: [10, 20, .inf, 5, 30, 40]");
        for (int k = 0; k < 1000; ++k) compute(side * e, none, none);
        const JointVector torque = compute(none, none, none);
        EXPECT_NEAR(torque[0], -side * 10.0, 1e-12);
        EXPECT_NEAR(torque[1], -side * 20.0, 1e-12);
        EXPECT_NEAR(torque[2], -side * 48.0, 1e-9);  // 600 x 8 x 0.01 rad s
        EXPECT_EQ(torque[3], 0.0);
        // It shrinks from there at once.
        compute(-side * e, none, none);
        EXPECT_NEAR(compute(none, none, none)[0], -side * (10.0 - 4800.0 * 0.01 * 0.001), 1e-9);
    }
    // A filter torque on the other side lets tau_a grow beyond the motor's limit, the integral not.
    arm_.robot.actuation.torqueLimit.setConstant(n(), 50.0);
    configure("k_r: 600, k_p: 0, k_i: 8");
    for (int k = 0; k < 2000; ++k) compute(e, none, constant(50.0));
    EXPECT_NEAR(compute(none, none, constant(50.0))[0], -50.0, 1e-9);
}

// The motor's limit goes before the rate: at it, tau_a follows tau_c.
TEST_F(NricTest, TheTorqueChangesNoFasterThanItsRateOrTheFilterTorqueAtTheMotorsLimit) {
    arm_.robot.actuation.torqueLimit.setConstant(n(), 100.0);
    configure("torque_rate_Nmps: [2000, 2000, 2000, 5000, 5000, .inf]");
    const double step[] = {2.0, 2.0, 2.0, 5.0, 5.0, kInfinity};
    std::mt19937 random(6);
    JointVector last = constant(0.0), lastFilterTorque = constant(0.0);
    int atRate = 0, beyond = 0;
    for (int k = 0; k < 5000; ++k) {
        const JointVector filterTorque = makeRandomVector(n(), 100.0, random);
        const JointVector torque =
            compute(makeRandomVector(n(), 0.05, random), makeRandomVector(n(), 0.1, random), filterTorque);
        for (int i = 0; i < n(); ++i) {
            ASSERT_LE(std::abs(filterTorque[i] + torque[i]), 100.0 * (1.0 + 1e-14));
            const double change = std::abs(torque[i] - last[i]);
            const double allowed = std::max(step[i], std::abs(filterTorque[i] - lastFilterTorque[i]));
            ASSERT_LE(change, allowed + 1e-12) << "tick " << k << ", joint " << i;
            atRate += std::abs(change - step[i]) < 1e-12;
            beyond += i < 5 && change > step[i] + 1e-9;
        }
        last = torque;
        lastFilterTorque = filterTorque;
    }
    EXPECT_GT(atRate, 1000);
    EXPECT_GT(beyond, 100);
}

TEST_F(NricTest, IsZeroWhereTheRealArmIsTheNominalOne) {
    for (const char* bounds : {"", "integral_limit_Nm: 1, torque_rate_Nmps: 10"}) {
        configure(bounds);
        std::mt19937 random(7);
        for (int k = 0; k < 1000; ++k) {
            const MotionState nominal{makeRandomVector(n(), 3.0, random), makeRandomVector(n(), 3.0, random),
                                      constant(0.0)};
            JointVector torque;
            ASSERT_EQ(loop_.compute({nominal.q, nominal.qd}, nominal, makeRandomVector(n(), 100.0, random), torque),
                      TickStatus::Ok);
            ASSERT_LE(torque.lpNorm<Eigen::Infinity>(), 1e-9);
        }
    }
}

/** Joint 0 as a body of 3 kg m^2 that is held 5 mrad from its nominal place for 2 s, then let go for 3 s. */
struct ReleasedJoint {
    static constexpr double kInertia = 3.0, kOffset = 0.005;

    double pressing = 0.0;     ///< largest torque while it was held [Nm]
    double largestStep = 0.0;  ///< of the torque in a tick [Nm]
    double overshoot = 0.0;    ///< [rad]
    double lastSpeed = 0.0;    ///< [rad/s]

    template <class Compute>
    explicit ReleasedJoint(const Compute& compute) {
        const double dt = 0.001;
        double e = kOffset, speed = 0.0, last = 0.0;
        for (int k = 0; k < 5000; ++k) {
            const double torque = compute(e, speed);
            largestStep = std::max(largestStep, std::abs(torque - last));
            last = torque;
            if (k < 2000) {
                pressing = std::max(pressing, std::abs(torque));
                continue;
            }
            e += dt * speed + 0.5 * dt * dt * torque / kInertia;
            speed += dt * torque / kInertia;
            overshoot = std::max(overshoot, -e);
        }
        lastSpeed = std::abs(speed);
    }
};

// After the release  m e'' + K_r e' + K_r K_p e = d + delta,  d the integral's torque, |d| <= L, and delta what the rate
// R takes away from the loop's answer. K_r > 4 m K_p: the impulse response is positive, its integral is
// 1 / (K_r K_p) and its peak below 1 / K_r, so d moves e across zero by L / (K_r K_p) at most. With
// T = K_r K_p e(0) + L, the torque that was pressed with, and R = K_r T / (2 m), delta lasts for
// 2 (T / R - m / K_r) = 2 m / K_r, and its integral over time is (2/3) (K_r T / m - R)^3 m^2 / (K_r R)^2
// = m T / (3 K_r) if e stands still; it moves by less than a quarter meanwhile, which a factor of 2 covers.
TEST_F(NricTest, Fault18AJointThatWasHeldAndIsReleasedGetsNoJumpAndHardlyOvershoots) {
    const auto release = [&](const std::string& bounds) {
        configure("k_r: 600, k_p: 20, k_i: 8" + bounds);
        return ReleasedJoint([&](double e, double speed) {
            JointVector position = constant(0.0), velocity = constant(0.0);
            position[0] = e;
            velocity[0] = speed;
            return compute(position, velocity, constant(0.0))[0];
        });
    };
    const double m = ReleasedJoint::kInertia, limit = 20.0;
    const double pressing = 600.0 * 20.0 * ReleasedJoint::kOffset + limit;  // 80 Nm
    const double rate = 600.0 * pressing / (2.0 * m);                       // 8000 Nm/s
    const double bound = limit / (600.0 * 20.0) + 2.0 * m * pressing / (3.0 * 600.0 * 600.0);
    ASSERT_GT(600.0, 4.0 * m * 20.0);

    const ReleasedJoint both = release(", integral_limit_Nm: 20, torque_rate_Nmps: 8000");
    EXPECT_NEAR(both.pressing, pressing, 1e-9);
    EXPECT_LE(both.largestStep, rate * 0.001 * (1.0 + 1e-12));
    EXPECT_GT(both.largestStep, rate * 0.001 * (1.0 - 1e-12));  // it acted
    EXPECT_LE(both.overshoot, bound);
    EXPECT_GT(both.overshoot, 0.0);
    EXPECT_LT(both.lastSpeed, 2e-3);

    // Without: 2 s at 5 mrad are 48 Nm of integral, and it shows.
    const ReleasedJoint free = release("");
    EXPECT_NEAR(free.pressing, 60.0 + 600.0 * 8.0 * 0.01, 1e-6);
    EXPECT_GT(free.largestStep, 2.0 * rate * 0.001);
    EXPECT_GT(free.overshoot, 1.5 * bound);
    std::printf("released: overshoot %.3g mrad (bound %.3g), free %.3g mrad\n", 1e3 * both.overshoot, 1e3 * bound,
                1e3 * free.overshoot);
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
    // Ten times the tick carries a tenth, or less of it where the margin asks for it: half of that at least.
    const NricOptions slow = scaleNric(robot, robot.limits, 0.01);
    for (int i = 0; i < n(); ++i) {
        EXPECT_LT(slow.kr[i], 300.0);
        if (i < 3) continue;
        EXPECT_LE(slow.kr[i], 0.1 * gains.kr[i] + 1e-9);
        EXPECT_GE(slow.kr[i], 0.05 * gains.kr[i]);
        EXPECT_LE(slow.kp[i] * 0.01, 0.1 + 1e-12);
    }
}

TEST_F(NricTest, RefusesWhatIsNotFiniteOrOfTheWrongSizeAndStaysAsItWas) {
    configure("");
    const JointVector zero = constant(0.0), e = constant(0.01);
    compute(e, zero, zero);
    const JointState real{arm_.start.q + e, arm_.start.qd};
    JointVector torque = constant(7.0);
    for (const double bad : {kNan, kInfinity}) {
        JointState badReal = real;
        badReal.qd[2] = bad;
        EXPECT_EQ(loop_.compute(badReal, arm_.start, zero, torque), TickStatus::InvalidInput);
        MotionState badNominal = arm_.start;
        badNominal.q[0] = bad;
        EXPECT_EQ(loop_.compute(real, badNominal, zero, torque), TickStatus::InvalidInput);
        EXPECT_EQ(loop_.compute(real, arm_.start, constant(bad), torque), TickStatus::InvalidInput);
    }
    EXPECT_EQ(loop_.compute(real, arm_.start, JointVector::Zero(n() - 1), torque), TickStatus::InvalidInput);
    EXPECT_EQ(torque, constant(7.0));

    const JointVector second = compute(e, zero, zero);
    Nric other;
    arm_.configure(other, PluginKind::RobustLoop, "nric");
    JointVector expected;
    for (int k = 0; k < 2; ++k) other.compute(real, arm_.start, zero, expected);
    EXPECT_EQ(second, expected);  // the refused ticks left no trace in the integral
}

TEST_F(NricTest, RefusesNegativeGainsAndListsOfTheWrongLength) {
    expectError({"k_r"}, [&] { configure("k_r: -1"); });
    expectError({"k_i"}, [&] { configure("k_i: [1, 2]"); });
}

TEST_F(NricTest, TellsTheLinearLawThatATrackingBoundFollowsFrom) {
    configure("k_r: 30, k_p: 4, k_i: 2, integral_limit_Nm: 7");
    const std::optional<LinearErrorLoop> loop = loop_.traits().errorLoop;
    ASSERT_TRUE(loop);
    EXPECT_EQ(loop->kr, constant(30.0));
    EXPECT_EQ(loop->kp, constant(4.0));
    EXPECT_EQ(loop->ki, constant(2.0));
    EXPECT_EQ(loop->integralLimit, constant(7.0));
    EXPECT_EQ(loop->torqueRate, constant(kInfinity));
}

TEST_F(NricTest, LoadsAsALibrary) {
    configure("");
    const auto plugin = arm_.load<RobustLoop>(PluginKind::RobustLoop, "nric");
    const JointState real{arm_.start.q + constant(0.01), arm_.start.qd};
    JointVector torque;
    ASSERT_EQ(plugin->compute(real, arm_.start, constant(0.0), torque), TickStatus::Ok);
    EXPECT_EQ(torque, compute(constant(0.01), constant(0.0), constant(0.0)));
}

// --- friction that is fed forward

TEST_F(NricTest, FeedsKnownFrictionForwardAtTheNominalVelocity) {
    configure("k_r: 600, k_p: 20, k_i: 8, friction_scale: [1, 0.5, 2, 0, 1, 1]");
    const JointFriction& f = arm_.robot.actuation.friction;
    const double scale[] = {1, 0.5, 2, 0, 1, 1};
    std::mt19937 random(3);
    for (int k = 0; k < 200; ++k) {
        arm_.start.qd = makeRandomVector(n(), k % 2 == 0 ? 1.0 : 0.02, random);
        const JointVector torque = compute(constant(0.0), constant(0.0), constant(0.0));
        for (int i = 0; i < n(); ++i) {
            const double v = arm_.start.qd[i], speed = 5.0 * 0.001 * arm_.robot.limits.acceleration.upper[i];
            const double dry = f.coulomb[i] * std::max(-1.0, std::min(1.0, v / speed));
            const double viscous = f.viscous[i] * (1.0 - std::exp(-std::abs(v) / f.viscousVelocity[i]));
            EXPECT_NEAR(torque[i], scale[i] * (dry + std::copysign(viscous, v)), 1e-9) << i;
        }
    }
    // Of an arm that stands still nothing is known.
    arm_.start.qd.setZero();
    EXPECT_EQ(compute(constant(0.0), constant(0.0), constant(0.0)), constant(0.0));
}

TEST_F(NricTest, AFactorOfZeroChangesNoBit) {
    std::mt19937 random(4);
    Nric with;
    configure("k_r: 600, k_p: 20, k_i: 8");
    with.configure(arm_.setup(),
                   arm_.read(PluginKind::RobustLoop, "nric", "k_r: 600, k_p: 20, k_i: 8, friction_scale: 0"));
    arm_.start.qd = makeRandomVector(n(), 1.0, random);
    for (int k = 0; k < 100; ++k) {
        const JointState real{arm_.start.q + makeRandomVector(n(), 0.01, random), arm_.start.qd};
        JointVector one, other;
        loop_.compute(real, arm_.start, constant(3.0), one);
        with.compute(real, arm_.start, constant(3.0), other);
        ASSERT_EQ(one, other);
    }
}

TEST_F(NricTest, FrictionThatDoesNotFitIsRefused) {
    const auto tell = [&](const FrictionFeed& feed) {
        NricOptions options;
        options.friction = feed;
        return test::findComplaint([&] { loop_.configure(arm_.setup(), options); });
    };
    const FrictionFeed good = scaleFriction(arm_.robot.actuation.friction, 1.0, arm_.robot.limits, 1e-3);
    EXPECT_EQ(tell(good), "");
    FrictionFeed wrong = good;
    wrong.figures.coulomb.resize(2);
    EXPECT_CONTAINS(tell(wrong), "NricOptions::friction: it has not one number for each of 6 joints");
    wrong = good;
    wrong.speed[3] = 0.0;
    EXPECT_CONTAINS(tell(wrong), "NricOptions::friction");
    EXPECT_THROW(scaleFriction(arm_.robot.actuation.friction, -1.0, arm_.robot.limits, 1e-3), Error);
}

}  // namespace
}  // namespace viable
