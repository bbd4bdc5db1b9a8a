#include "SimbodyPlant.h"

#include "Effort.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

/** Nothing but the multibody model. */
const char* const kIdeal = "friction: none, encoder: exact";

class Plant {
public:
    Plant(TestArm& arm, const std::string& text, const Environment* environment = nullptr) : tick_s_(arm.tick_s) {
        RunSetup setup = arm.setup();
        setup.environment = environment;
        plant_.configure(setup, arm.read(PluginKind::RealPlant, "simbody", text));
        plant_.reset(arm.start);
    }

    SimbodyPlant& plant() { return plant_; }
    const JointState& actual() const { return plant_.actual(); }
    const JointState& measured() const { return plant_.measured(); }

    /** One tick; returns the applied torque. */
    JointVector advance(const JointVector& torque) {
        JointVector applied;
        EXPECT_EQ(plant_.advance(torque, applied), TickStatus::Ok);
        return applied;
    }
    void advance(const JointVector& torque, double duration_s) {
        const int ticks = static_cast<int>(std::lround(duration_s / tick_s_));
        for (int k = 0; k < ticks; ++k) advance(torque);
    }

private:
    double tick_s_;
    SimbodyPlant plant_;
};

/** tau = M qdd + b integrated with 20 steps of Runge-Kutta per ms, the acceleration by Simbody's
own forward dynamics (so only for arms without rotors). */
JointState integrateLinks(TestArm& arm, JointState s, const JointVector& torque, double duration_s) {
    const double h = 5e-5;
    const auto accelerate = [&](const JointVector& q, const JointVector& qd) {
        return arm.model().calcLinkForwardDynamics(q, qd, torque);
    };
    for (int k = 0; k < std::lround(duration_s / h); ++k) {
        const JointVector a1 = accelerate(s.q, s.qd), v2 = s.qd + h / 2 * a1;
        const JointVector a2 = accelerate(s.q + h / 2 * s.qd, v2), v3 = s.qd + h / 2 * a2;
        const JointVector a3 = accelerate(s.q + h / 2 * v2, v3), v4 = s.qd + h * a3;
        const JointVector a4 = accelerate(s.q + h * v3, v4);
        s.q += h / 6 * (s.qd + 2 * v2 + 2 * v3 + v4);
        s.qd += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    }
    return s;
}

/** A single joint, unit inertia, no gravity, with friction to calculate by hand. */
void giveFriction(TestArm& arm) {
    JointFriction& friction = arm.robot.actuation.friction;
    friction.coulomb.setConstant(arm.size(), 2.0);
    friction.viscous.setConstant(arm.size(), 5.0);
    friction.viscousVelocity.setConstant(arm.size(), 0.5);
}

TEST(SimbodyPlant, FollowsTheMultibodyModel) {
    TestArm arm("indy7");
    arm.robot.actuation.rotorInertia.setZero();
    arm.robot.actuation.torqueLimit.setConstant(6, kInfinity);
    arm.rebuildModel();
    std::mt19937 random(1);
    for (int k = 0; k < 3; ++k) {
        arm.start.q = arm.robot.home + makeRandomVector(6, 0.5, random);
        arm.start.qd = makeRandomVector(6, 1.0, random);
        const JointVector torque = arm.calcDynamics(arm.start).gravity + makeRandomVector(6, 0.05, random);
        Plant plant(arm, kIdeal);
        plant.advance(torque, 0.1);
        const JointState expected = integrateLinks(arm, {arm.start.q, arm.start.qd}, torque, 0.1);
        EXPECT_LE((plant.actual().q - expected.q).lpNorm<Eigen::Infinity>(), 1e-7);
        EXPECT_LE((plant.actual().qd - expected.qd).lpNorm<Eigen::Infinity>(), 1e-5);
        EXPECT_EQ(plant.measured().q, plant.actual().q);
        EXPECT_EQ(plant.measured().qd, plant.actual().qd);
    }
}

TEST(SimbodyPlant, EnergyIsConservedWithoutFrictionAndTorque) {
    TestArm arm("indy7");
    std::mt19937 random(2);
    for (int k = 0; k < 3; ++k) {
        arm.start.q = arm.robot.home + makeRandomVector(6, 0.5, random);
        arm.start.qd = makeRandomVector(6, 1.0, random);
        Plant plant(arm, kIdeal);
        const double before = arm.model().calcEnergy(arm.start.q, arm.start.qd);
        double worst = 0.0;
        for (int tick = 0; tick < 2000; ++tick) {
            plant.advance(JointVector::Zero(6));
            worst = std::max(worst, std::abs(arm.model().calcEnergy(plant.actual().q, plant.actual().qd) - before));
        }
        EXPECT_LE(worst, 1e-7 * std::abs(before));
        EXPECT_GT((plant.actual().q - arm.start.q).norm(), 0.5);  // it fell and swung
    }
}

TEST(SimbodyPlant, ConvergesWithOrderFour) {
    TestArm arm("indy7", 0.02);
    std::mt19937 random(3);
    arm.start.q = arm.robot.home + makeRandomVector(6, 0.3, random);
    arm.start.qd = makeRandomVector(6, 1.0, random);
    const auto calcEnd = [&](int substeps) {
        Plant plant(arm, std::string(kIdeal) + ", substeps: " + std::to_string(substeps));
        plant.advance(JointVector::Zero(6), 0.2);
        return plant.actual().q;
    };
    const JointVector exact = calcEnd(256);
    double last = (calcEnd(2) - exact).norm();
    for (const int substeps : {4, 8, 16}) {
        const double error = (calcEnd(substeps) - exact).norm();
        EXPECT_NEAR(std::log2(last / error), 4.0, 0.5) << substeps << " substeps";
        last = error;
    }
}

TEST(SimbodyPlant, Fault17JointAtRestUnderLoadBelowCoulombFrictionStays) {
    TestArm arm("indy7");
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    const JointVector& coulomb = arm.robot.actuation.friction.coulomb;
    for (const double share : {0.0, 0.5, -0.9, 0.99}) {
        Plant plant(arm, "encoder: exact");
        plant.advance(gravity + share * coulomb, 5.0);
        EXPECT_LE((plant.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-6)
            << "load " << share << " of Coulomb friction";
        EXPECT_LE(plant.actual().qd.lpNorm<Eigen::Infinity>(), 1e-9);
    }
    // Above it, each joint breaks loose by itself.
    for (int i = 0; i < 6; ++i) {
        JointVector torque = gravity;
        torque[i] += 1.1 * coulomb[i];
        Plant plant(arm, "encoder: exact");
        plant.advance(torque, 0.5);
        EXPECT_GT(plant.actual().q[i] - arm.start.q[i], 1e-3) << "joint " << i;
    }
}

TEST(SimbodyPlant, Fault17BreakawayNeedsMoreThanSlidingDoes) {
    TestArm arm("single_joint");
    giveFriction(arm);
    const std::string text = "encoder: exact, breakaway_ratio: 1.5, stribeck_velocity_radps: 0.02";
    Plant held(arm, text);
    held.advance(JointVector::Constant(1, 2.9), 5.0);  // above Coulomb 2, below breakaway 3
    EXPECT_LE(std::abs(held.actual().q[0]), 1e-6);
    Plant loose(arm, text);
    loose.advance(JointVector::Constant(1, 3.1), 0.2);
    EXPECT_GT(loose.actual().q[0], 1e-3);
    loose.advance(JointVector::Constant(1, 2.9), 5.0);         // moving, the same 2.9 keep it moving
    const double expected = -0.5 * std::log(1.0 - 0.9 / 5.0);  // 2 + 5 (1 - exp(-v / 0.5)) = 2.9
    EXPECT_NEAR(loose.actual().qd[0], expected, 1e-3 * expected);
}

TEST(SimbodyPlant, SlidingJointComesToRestAndStaysThere) {
    TestArm arm("single_joint");
    giveFriction(arm);
    arm.start.qd[0] = 1.0;
    Plant plant(arm, "encoder: exact");
    plant.advance(JointVector::Zero(1), 1.0);
    EXPECT_LE(std::abs(plant.actual().qd[0]), 1e-9);
    const double rest = plant.actual().q[0];
    // On the way: v' = -(2 + 5 (1 - exp(-2 v))), so q = integral of v / (...) dv from 0 to 1.
    double way = 0.0;
    const int n = 100000;
    for (int k = 0; k < n; ++k) {
        const double v = (k + 0.5) / n;
        way += v / (2.0 + 5.0 * (1.0 - std::exp(-2.0 * v))) / n;
    }
    EXPECT_NEAR(rest, way, 2e-3 * way);  // friction is taken with order 1
    plant.advance(JointVector::Constant(1, -1.9), 1.0);
    EXPECT_NEAR(plant.actual().q[0], rest, 1e-9);
}

TEST(SimbodyPlant, TerminalVelocityBalancesTheTorque) {
    TestArm arm("single_joint");
    giveFriction(arm);
    for (const double torque : {2.5, 4.0, 6.0, -3.0, -6.5}) {
        Plant plant(arm, "encoder: exact");
        plant.advance(JointVector::Constant(1, torque), 20.0);
        const double v = -0.5 * std::log(1.0 - (std::abs(torque) - 2.0) / 5.0);
        EXPECT_NEAR(plant.actual().qd[0], std::copysign(v, torque), 1e-6) << torque << " Nm";
    }
}

// tau is constant in a tick, so its work is tau (q+ - q) exactly; what is left is friction's. Only
// in the very sub-step in which a joint stops or turns round does the friction, taken with order 1,
// not belong to the sign of all of the way: there a first-order remainder F |v| h / 2 is allowed.
TEST(SimbodyPlant, FrictionNeverFeedsEnergy) {
    TestArm arm("indy7");
    const JointVector& coulomb = arm.robot.actuation.friction.coulomb;
    struct Case {
        const char* text;
        double scale;
    };
    for (const Case& c : {Case{"encoder: exact", 1.0}, Case{"encoder: exact, friction_scale: 10", 10.0},
                          Case{"encoder: exact, breakaway_ratio: 2", 2.0}}) {
        std::mt19937 random(4);
        arm.start.qd = makeRandomVector(6, 1.0, random);
        Plant plant(arm, c.text);
        double energy = arm.model().calcEnergy(arm.start.q, arm.start.qd), lost = 0.0, fed = 0.0;
        JointVector torque = JointVector::Zero(6);
        int sliding = 0;
        for (int tick = 0; tick < 5000; ++tick) {
            if (tick % 50 == 0)
                torque =
                    arm.calcDynamics(plant.actual().q, plant.actual().qd).gravity + makeRandomVector(6, 60.0, random);
            const JointState before = plant.actual();
            const JointVector applied = plant.advance(torque);
            const JointState& after = plant.actual();
            const double now = arm.model().calcEnergy(after.q, after.qd);
            const double friction = now - energy - applied.dot(after.q - before.q);
            double allowed = 1e-8;
            for (int i = 0; i < 6; ++i)
                if (before.qd[i] * after.qd[i] <= 0.0 || std::abs(after.qd[i]) < 1e-9)
                    allowed += c.scale * coulomb[i] * arm.tick_s *
                               std::max(std::abs(before.qd[i]), std::abs(after.qd[i])) / 2.0;
            ASSERT_LE(friction, allowed) << c.text << ", tick " << tick;
            sliding += allowed == 1e-8;
            lost -= std::min(friction, 0.0);
            fed += std::max(friction, 0.0);
            energy = now;
        }
        EXPECT_GT(lost, 1.0) << c.text;
        EXPECT_LE(fed, 1e-3 * lost) << c.text;
        if (c.scale < 10.0) EXPECT_GT(sliding, 500) << c.text;
    }
}

// The friction torque itself, from the change of momentum in one sub-step: it opposes the velocity
// that the sub-step ends with, by at least the Coulomb torque.
TEST(SimbodyPlant, FrictionOpposesTheMotionOfEachJoint) {
    TestArm arm("indy7");
    arm.robot.actuation.torqueLimit.setConstant(6, kInfinity);
    const JointVector& coulomb = arm.robot.actuation.friction.coulomb;
    std::mt19937 random(8);
    arm.start.qd = makeRandomVector(6, 1.0, random);
    Plant plant(arm, "encoder: exact, substeps: 1");
    int seen = 0;
    for (int tick = 0; tick < 2000; ++tick) {
        const JointState before = plant.actual();
        const Dynamics d = arm.calcDynamics(before.q, before.qd);
        const JointVector torque = d.gravity + makeRandomVector(6, 80.0, random);
        plant.advance(torque);
        const JointState& after = plant.actual();
        const JointVector change = (after.qd - before.qd) / arm.tick_s, inertial = d.M * change;
        for (int i = 0; i < 6; ++i) {
            if (std::abs(after.qd[i]) < 1e-3) continue;
            ++seen;
            const double friction = torque[i] - d.b[i] - inertial[i];
            ASSERT_GT(friction * std::copysign(1.0, after.qd[i]), 0.8 * coulomb[i])
                << "joint " << i << ", tick " << tick;
        }
    }
    EXPECT_GT(seen, 2000);
}

TEST(SimbodyPlant, Fault17TenfoldFrictionIsStableWithTheDefaultSteps) {
    TestArm arm("indy7");
    std::mt19937 random(5);
    for (int k = 0; k < 5; ++k) {
        arm.start.qd = makeRandomVector(6, 2.0, random);
        Plant plant(arm, "encoder: exact, friction_scale: 10");
        double fastest = 0.0;
        for (int tick = 0; tick < 3000; ++tick) {
            plant.advance(makeRandomVector(6, 1.0, random).cwiseProduct(arm.robot.actuation.torqueLimit));
            ASSERT_TRUE(isFinite(plant.actual(), 6)) << "tick " << tick;
            if (tick > 1000) fastest = std::max(fastest, plant.actual().qd.lpNorm<Eigen::Infinity>());
        }
        // A tick of full torque on the lightest joint (0.5 kg m^2 with its rotor) gives 0.2 rad/s.
        EXPECT_LE(fastest, 0.5);
        plant.advance(arm.calcDynamics(plant.actual().q, JointVector::Zero(6)).gravity, 1.0);
        EXPECT_LE(plant.actual().qd.lpNorm<Eigen::Infinity>(), 1e-9);  // no chatter when let alone
    }
}

TEST(SimbodyPlant, Fault16PayloadChangesTheTorqueThatHoldsTheArm) {
    TestArm arm("indy7");
    const JointVector nominal = arm.calcDynamics(arm.start).gravity;
    const std::string text = std::string(kIdeal) + ", payload_kg: 2.0, payload_offset_m: [0, 0.05, 0.1]";
    Plant falling(arm, text);
    falling.advance(nominal, 0.2);
    EXPECT_GT((falling.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-2);

    // The torque that does hold it: the tool point's weight through the Jacobian, by hand.
    const Dynamics d = arm.calcDynamics(arm.start);
    const Eigen::Vector3d lever = d.tool.orientation * Eigen::Vector3d(0, 0.05, 0.1);
    JointVector holding = nominal;
    for (int i = 0; i < 6; ++i) {
        const Eigen::Vector3d linear = d.J.col(i).head<3>(), angular = d.J.col(i).tail<3>();
        const Eigen::Vector3d velocity = linear + angular.cross(lever);
        holding[i] += 2.0 * 9.81 * velocity.z();
    }
    EXPECT_GT((holding - nominal).lpNorm<Eigen::Infinity>(), 5.0);
    Plant held(arm, text);
    held.advance(holding, 0.2);
    EXPECT_LE((held.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(SimbodyPlant, Fault16MassFactorScalesGravityAndInertia) {
    TestArm arm("single_joint");
    Plant plant(arm, std::string(kIdeal) + ", mass_factor: 1.6");
    plant.advance(JointVector::Constant(1, 3.2), 0.5);  // I = 1.6: 2 rad/s^2
    EXPECT_NEAR(plant.actual().qd[0], 1.0, 1e-9);
    EXPECT_NEAR(plant.actual().q[0], 0.25, 1e-9);

    TestArm indy("indy7");
    Plant heavy(indy, std::string(kIdeal) + ", mass_factor: 1.5");
    heavy.advance(1.5 * indy.calcDynamics(indy.start).gravity, 0.2);
    EXPECT_LE((heavy.actual().q - indy.start.q).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(SimbodyPlant, Fault19TorqueLimitClipsAndAppliedSaysSo) {
    TestArm arm("indy7");
    const JointVector& limit = arm.robot.actuation.torqueLimit;
    Plant half(arm, std::string(kIdeal) + ", torque_limit_factor: 0.5");
    JointVector torque = 0.4 * limit;
    EXPECT_EQ(half.advance(torque), torque);
    torque = 0.4 * limit;
    torque[1] = 10.0 * limit[1];
    torque[4] = -10.0 * limit[4];
    const JointVector applied = half.advance(torque);
    EXPECT_DOUBLE_EQ(applied[1], 0.5 * limit[1]);
    EXPECT_DOUBLE_EQ(applied[4], -0.5 * limit[4]);
    EXPECT_EQ(applied[0], torque[0]);

    // And the arm moves as with the clipped torque.
    Plant clipped(arm, std::string(kIdeal) + ", torque_limit_factor: 0.5");
    clipped.advance(JointVector(0.4 * limit));
    clipped.advance(applied);
    EXPECT_EQ(clipped.actual().q, half.actual().q);

    Plant free(arm, std::string(kIdeal) + ", torque_limit_factor: .inf");
    EXPECT_EQ(free.advance(torque), torque);
}

TEST(SimbodyPlant, Fault22EncoderReportsWholeCountsAndTheirDifference) {
    TestArm arm("indy7");
    arm.robot.actuation.encoderCounts << 4096, 8192, 20000, 65536, 1000000, 0;
    std::mt19937 random(6);
    arm.start.qd = makeRandomVector(6, 1.0, random);
    Plant plant(arm, "");
    JointVector last = plant.measured().q;
    for (int tick = 0; tick < 1000; ++tick) {
        plant.advance(JointVector::Zero(6));
        const JointState& measured = plant.measured();
        for (int i = 0; i < 6; ++i) {
            const double counts = arm.robot.actuation.encoderCounts[i];
            const double error = std::abs(measured.q[i] - plant.actual().q[i]);
            if (counts == 0.0) {
                ASSERT_EQ(error, 0.0);
            } else {
                ASSERT_LE(error, kPi / counts * (1.0 + 1e-9));
                const double whole = measured.q[i] * counts / (2.0 * kPi);
                ASSERT_NEAR(whole, std::round(whole), 1e-6);
            }
            ASSERT_EQ(measured.qd[i], (measured.q[i] - last[i]) / arm.tick_s);
        }
        last = measured.q;
    }
}

TEST(SimbodyPlant, Fault22NoiseIsSeededAndOfTheSizeAskedFor) {
    TestArm arm("single_joint");
    giveFriction(arm);
    const auto record = [&](const std::string& seed, SimbodyPlant* again = nullptr) {
        Plant plant(arm, "encoder: exact, encoder_noise_rad: 1.0e-4, seed: " + seed);
        SimbodyPlant& used = again ? *again : plant.plant();
        std::vector<double> readings{used.measured().q[0]};
        JointVector applied;
        for (int tick = 0; tick < 20000; ++tick) {
            used.advance(JointVector::Zero(1), applied);
            readings.push_back(used.measured().q[0] - used.actual().q[0]);
        }
        return readings;
    };
    const std::vector<double> first = record("7");
    EXPECT_EQ(record("7"), first);
    EXPECT_NE(record("8"), first);

    Plant plant(arm, "encoder: exact, encoder_noise_rad: 1.0e-4, seed: 7");
    record("7", &plant.plant());
    plant.plant().reset(arm.start);
    EXPECT_EQ(record("7", &plant.plant()), first);  // reset begins the sequence again

    double sum = 0.0, squares = 0.0, neighbours = 0.0;
    for (std::size_t k = 0; k < first.size(); ++k) {
        sum += first[k];
        squares += first[k] * first[k];
        if (k > 0) neighbours += first[k] * first[k - 1];
    }
    const double n = static_cast<double>(first.size());
    EXPECT_NEAR(std::sqrt(squares / n), 1e-4, 5e-6);
    EXPECT_LE(std::abs(sum / n), 3e-6);               // 4 standard errors
    EXPECT_LE(std::abs(neighbours / squares), 0.03);  // one reading tells nothing of the next
}

TEST(SimbodyPlant, NoiseReachesTheVelocityReading) {
    TestArm arm("single_joint");
    Plant plant(arm, "encoder: exact, encoder_noise_rad: 1.0e-5");
    double last = plant.measured().q[0];
    for (int tick = 0; tick < 100; ++tick) {
        plant.advance(JointVector::Zero(1));
        EXPECT_EQ(plant.measured().qd[0], (plant.measured().q[0] - last) / arm.tick_s);
        EXPECT_NE(plant.measured().qd[0], 0.0);
        last = plant.measured().q[0];
    }
}

TEST(SimbodyPlant, RefusesTorqueThatIsNotFiniteOrOfTheWrongSizeAndStaysAsItWas) {
    TestArm arm("indy7");
    Plant plant(arm, "encoder_noise_rad: 1.0e-4");
    Plant untouched(arm, "encoder_noise_rad: 1.0e-4");
    const JointVector torque = JointVector::Constant(6, 10.0);
    plant.advance(torque);
    untouched.advance(torque);
    JointVector applied = JointVector::Constant(6, 7.0);
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
        JointVector badTorque = torque;
        badTorque[2] = bad;
        EXPECT_EQ(plant.plant().advance(badTorque, applied), TickStatus::InvalidInput);
    }
    EXPECT_EQ(plant.plant().advance(JointVector::Zero(5), applied), TickStatus::InvalidInput);
    EXPECT_EQ(applied, JointVector::Constant(6, 7.0));
    EXPECT_EQ(plant.actual().q, untouched.actual().q);
    EXPECT_EQ(plant.measured().q, untouched.measured().q);
    plant.advance(torque);
    untouched.advance(torque);
    EXPECT_EQ(plant.measured().q, untouched.measured().q);  // noise went on where it was
    EXPECT_EQ(plant.actual().qd, untouched.actual().qd);
}

TEST(SimbodyPlant, MotionThatOverflowsIsFaultedAndTheStateStays) {
    TestArm arm("single_joint");
    Plant plant(arm, kIdeal);
    plant.advance(JointVector::Constant(1, 1.0), 0.1);
    const JointState before = plant.actual();
    JointVector applied;
    TickStatus status = TickStatus::Ok;
    JointState last = before;
    for (int k = 0; k < 10 && status == TickStatus::Ok; ++k) {
        last = plant.actual();
        status = plant.plant().advance(JointVector::Constant(1, std::numeric_limits<double>::max()), applied);
    }
    EXPECT_TRUE(isFinite(plant.actual(), 1));
    EXPECT_TRUE(isFinite(plant.measured(), 1));
    if (status == TickStatus::Faulted) EXPECT_EQ(plant.actual().q, last.q);
}

/** A table whose top is so far below the tool of the start. */
Environment makeTable(TestArm& arm, double below) {
    Environment environment;
    Solid table;
    table.name = "table";
    table.size = {2.0, 2.0, 0.2};
    table.pose.translation() =
        arm.calcDynamics(arm.start).tool.position - Eigen::Vector3d(0.0, 0.0, below + 0.5 * table.size.z());
    environment.solids.push_back(table);
    return environment;
}

// Motors that hold the arm and press the tool down with 20 N: so much the table gives back.
TEST(SimbodyPlant, AnArmThatLeansOnATablePressesAsItsMotorsSay) {
    const char* const arms[] = {"indy7", "panda", "ur5e"};
    for (int k = 0; k < std::min(3, test::countOf(3)); ++k)
        for (const char* gears : {"", ", backlash_rad: 1e-3, gear_stiffness_Nmprad: 2000, substeps: 40"}) {
            const char* const name = arms[k];
            TestArm arm(name);
            if (*gears && !(arm.robot.actuation.rotorInertia.minCoeff() > 0.0)) continue;
            const Environment table = makeTable(arm, 0.019);
            Plant plant(arm,
                        std::string("friction_scale: 0.3, encoder: exact, contact: tool, contact_stiffness_Npm: 2e4") +
                            (*gears ? gears : ", substeps: 10"),
                        &table);
            Vector6 force = Vector6::Zero();
            force[2] = -20.0;
            JointVector applied;
            for (int tick = 0; tick < 6000; ++tick) {
                const JointState& now = plant.actual();
                const Dynamics dynamics = arm.calcDynamics(now.q, now.qd);
                // A little damping, which at rest is nothing.
                plant.advance(dynamics.gravity + dynamics.J.transpose() * force - 10.0 * (dynamics.M * now.qd));
            }
            const ContactReport* report = plant.plant().contact();
            ASSERT_NE(report, nullptr);
            const Dynamics dynamics = arm.calcDynamics(plant.actual().q, plant.actual().qd);
            const JointVector pressed = *plant.plant().externalTorque();
            std::printf("  %s: %.2f N, %.3f mm deep, %.2g rad/s\n", name, report->pressing, 1e3 * report->depth,
                        plant.actual().qd.cwiseAbs().maxCoeff());
            EXPECT_EQ(report->obstacle, 0);
            EXPECT_LT(plant.actual().qd.cwiseAbs().maxCoeff(), 1e-3);
            EXPECT_NEAR(report->pressing, 2e4 * report->depth, 0.02 * report->pressing);
            // Friction in the joints takes what it can of either.
            Vector6 felt = Vector6::Zero();
            felt.head<3>() = report->force;
            EXPECT_LT((pressed - dynamics.J.transpose() * felt).cwiseAbs().maxCoeff(), 0.03 * report->force.norm());
            EXPECT_GT(report->pressing, 5.0);
            EXPECT_LT(report->pressing, 60.0);
        }
}

TEST(SimbodyPlant, AdvanceAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    const Environment table = makeTable(arm, 0.0);
    Plant plant(arm,
                "friction_scale: 2, breakaway_ratio: 1.5, payload_kg: 1, "
                "encoder_noise_rad: 1.0e-5, contact: tool, substeps: 10",
                &table);
    std::mt19937 random(7);
    JointVector applied;
    std::int64_t allocations = 0;
    for (int tick = 0; tick < 500; ++tick) {
        const JointVector torque = makeRandomVector(6, 100.0, random);
        testing::AllocationCounter counter;
        plant.plant().advance(torque, applied);
        allocations += counter.count();
        if (tick == 250) {
            testing::AllocationCounter duringReset;
            plant.plant().reset(arm.start);
            allocations += duringReset.count();
        }
    }
    EXPECT_EQ(allocations, 0);
}

TEST(SimbodyPlant, RefusesParametersOutsideTheirRange) {
    TestArm arm("indy7");
    const auto complain = [&](const std::string& text) {
        return findComplaint([&] { arm.read(PluginKind::RealPlant, "simbody", text); });
    };
    EXPECT_CONTAINS(complain("substeps: 0"), "substeps");
    EXPECT_CONTAINS(complain("friction: sticky"), "robot");
    EXPECT_CONTAINS(complain("payload_kg: -1"), "payload_kg");
    EXPECT_CONTAINS(complain("mass_factor: 0"), "mass_factor");
    EXPECT_CONTAINS(complain("breakaway_ratio: 0.5"), "breakaway_ratio");
    EXPECT_CONTAINS(complain("torque_limit_factor: 0"), "torque_limit_factor");
    EXPECT_CONTAINS(complain("payload_offset_m: [0, 0]"), "payload_offset_m");
    EXPECT_EQ(complain("torque_limit_factor: .inf"), "");
}

TEST(SimbodyPlant, LoadsAsALibrary) {
    TestArm arm("indy7");
    const auto plugin = arm.load<RealPlant>(PluginKind::RealPlant, "simbody", "seed: 3");
    Plant own(arm, "seed: 3");
    JointVector applied;
    for (int k = 0; k < 100; ++k) {
        ASSERT_EQ(plugin->advance(JointVector::Constant(6, 20.0), applied), TickStatus::Ok);
        own.advance(JointVector::Constant(6, 20.0));
    }
    EXPECT_EQ(plugin->actual().q, own.actual().q);
    EXPECT_EQ(plugin->measured().q, own.measured().q);
}

}  // namespace
}  // namespace viable
