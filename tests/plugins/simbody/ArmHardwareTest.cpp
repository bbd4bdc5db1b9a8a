#include "SimbodyPlant.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"

// What every simulated arm has around its rigid bodies (ArmHardware, JointSensors), driven through the plant simbody, and
// what simbody has of its own: backlash.

namespace viable {
namespace {

const char* const kBare = "friction: none, encoder: exact";

struct Driven {
    Driven(TestArm& arm, const std::string& text) { arm.configure(plant, PluginKind::RealPlant, "simbody", text); }
    JointVector advance(const JointVector& torque) {
        JointVector applied;
        EXPECT_EQ(plant.advance(torque, applied), TickStatus::Ok);
        return applied;
    }
    const JointState& actual() const { return plant.actual(); }
    const JointState& measured() const { return plant.measured(); }
    SimbodyPlant plant;
};

JointVector one(double x) {
    return JointVector::Constant(1, x);
}

std::string complain(TestArm& arm, const std::string& text) {
    return findComplaint([&] { Driven(arm, text); });
}

void configure(ArmHardware& hardware, TestArm& arm, const std::string& text) {
    const Parameters parameters = arm.read(PluginKind::RealPlant, "simbody", text);
    hardware.configure(arm.setup(), parameters.get<ArmHardwareOptions>(), parameters);
}

TEST(ArmHardware, CommandsArriveAfterWholeTicksAndTheFirstOneAtOnce) {
    TestArm arm("single_joint");
    for (const int delay : {0, 1, 3, 20}) {
        Driven plant(arm, std::string(kBare) + ", delay_ticks: " + std::to_string(delay));
        for (int round = 0; round < 2; ++round) {
            for (int tick = 0; tick < 60; ++tick)
                ASSERT_EQ(plant.advance(one(1.0 + tick))[0], 1.0 + std::max(0, tick - delay))
                    << "delay " << delay << ", tick " << tick;
            plant.plant.reset(arm.start);  // nothing is left on its way
        }
    }
}

TEST(ArmHardware, RippleHasItsPeriodsPerTurnAndItsAmplitude) {
    TestArm arm("indy7");
    ArmHardware hardware;
    configure(hardware, arm, "torque_ripple_Nm: [1, 2, 0, 3, 0, 4], torque_ripple_per_turn: [0, 7, 0, 0, 0, 0]");
    const JointVector amplitude = (JointVector(6) << 1, 2, 0, 3, 0, 4).finished(), zero = JointVector::Zero(6);
    JointVector largest = zero;
    for (int k = 0; k < 20000; ++k) {
        const JointVector q = JointVector::Constant(6, 2.0 * kPi * k / 20000.0);
        const JointVector ripple = hardware.calcMotorTorque(zero, q);
        largest = largest.cwiseMax(ripple.cwiseAbs());
        EXPECT_NEAR(ripple[1], 2.0 * std::sin(7.0 * q[1]), 1e-9);
        EXPECT_NEAR(ripple[0], std::sin(2.0 * 121.0 * q[0]), 1e-9);  // twice per motor turn
    }
    EXPECT_LE((largest - amplitude).lpNorm<Eigen::Infinity>(), 1e-3);
}

TEST(ArmHardware, TiltedBaseTurnsGravity) {
    TestArm arm("indy7");
    RobotDescription tilted = arm.robot;
    // By hand: first about x, then about the new y; what was down leans by the angles.
    const double a = 0.2, b = -0.1;
    tilted.gravity = -9.81 * Eigen::Vector3d(-std::cos(a) * std::sin(b), std::sin(a), std::cos(a) * std::cos(b));
    RobotModel model(tilted);
    Dynamics d;
    model.calcDynamics(arm.start.q, arm.start.qd, d);
    ASSERT_GT((d.gravity - arm.calcDynamics(arm.start).gravity).lpNorm<Eigen::Infinity>(), 1.0);
    Driven plant(arm, std::string(kBare) + ", base_tilt_rad: [0.2, -0.1]");
    for (int tick = 0; tick < 200; ++tick) plant.advance(d.gravity);
    EXPECT_LE((plant.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(ArmHardware, Fault17LoadRaisesBreakaway) {
    TestArm arm("indy7");
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    const int k = 1;
    const double coulomb = arm.robot.actuation.friction.coulomb[k];
    // The gear carries the arm's weight g, whatever the motor gives: stuck up to Fc + mu |g|.
    const double most = coulomb + 0.2 * std::abs(gravity[k]);
    ASSERT_GT(most, 1.2 * coulomb);
    for (const double share : {0.98, -0.98, 1.05}) {
        JointVector torque = gravity;
        torque[k] += share * most;
        Driven plant(arm, "encoder: exact, load_friction: 0.2");
        for (int tick = 0; tick < 500; ++tick) plant.advance(torque);
        const double way = std::abs(plant.actual().q[k] - arm.start.q[k]);
        if (std::abs(share) < 1.0) {
            EXPECT_LE(way, 1e-6) << share;
        } else {
            EXPECT_GT(way, 1e-3) << share;
        }
    }
}

TEST(ArmHardware, PushActsInItsWindowAndIsReported) {
    TestArm arm("single_joint");  // unit inertia
    Driven plant(arm, std::string(kBare) + ", push_Nm: 2, push_from_s: 0.1, push_until_s: 0.3");
    for (int tick = 0; tick < 500; ++tick) {
        ASSERT_EQ((*plant.plant.externalTorque())[0], tick >= 100 && tick < 300 ? 2.0 : 0.0) << tick;
        plant.advance(one(0.0));
    }
    EXPECT_NEAR(plant.actual().qd[0], 0.4, 1e-9);
    EXPECT_CONTAINS(complain(arm, "push_from_s: 1, push_until_s: 1"), "is not after the beginning");
}

TEST(ArmHardware, Fault18BlockedJointStopsInAnImpulseAndTheOthersMoveAsIfItWereWelded) {
    TestArm arm("indy7");
    std::mt19937 random(3);
    arm.start.qd = makeRandomVector(6, 1.0, random);
    const int k = 2;
    const Dynamics d = arm.calcDynamics(arm.start);
    const JointVector unit = JointVector::Unit(6, k);
    Driven plant(arm, std::string(kBare) + ", blocked_joint: 2, blocked_until_s: 0.2");
    const JointVector torque = d.gravity;
    const double before = arm.model().calcEnergy(arm.start.q, arm.start.qd);
    double work = 0.0, energyAfterStop = 0.0;
    for (int tick = 0; tick < 200; ++tick) {
        const JointVector from = plant.actual().q;
        plant.advance(torque);
        ASSERT_EQ(plant.actual().q[k], arm.start.q[k]);
        ASSERT_EQ(plant.actual().qd[k], 0.0);
        const double energy = arm.model().calcEnergy(plant.actual().q, plant.actual().qd);
        const double done = torque.dot(plant.actual().q - from);
        if (tick == 0) energyAfterStop = energy - done;
        work += done;
        ASSERT_NEAR(energy - energyAfterStop, work, 1e-6) << tick;  // a weld does no work
    }
    // The impulse takes the least energy that stops the joint: v_k^2 / (2 (M^-1)_kk).
    const double taken = arm.start.qd[k] * arm.start.qd[k] / (2.0 * d.M.llt().solve(unit)[k]);
    EXPECT_NEAR(before - energyAfterStop, taken, 1e-4 * taken);
    plant.advance(torque);
    EXPECT_NE(plant.actual().q[k], arm.start.q[k]);  // released
    EXPECT_CONTAINS(complain(arm, "blocked_joint: 6"), "there is no joint 6");
}

// --- Sensors -----------------------------------------------------------------------------------------------------

/** Readings of joint 1 and 2 of a moving Indy7 with and without a fault from 0.1 to 0.2 s. */
struct Readings {
    std::vector<JointState> faulty, healthy;
};

Readings readWith(TestArm& arm, const std::string& fault, const std::string& encoder) {
    Driven faulty(arm, "friction: none, encoder: " + encoder +
                           ", sensor_fault_joint: 1, sensor_fault_from_s: 0.1, sensor_fault_until_s: 0.2, "
                           "sensor_fault_rad: 0.017, sensor_fault: " +
                           fault);
    Driven healthy(arm, "friction: none, encoder: " + encoder);
    Readings readings;
    for (int tick = 0; tick <= 300; ++tick) {
        readings.faulty.push_back(faulty.measured());
        readings.healthy.push_back(healthy.measured());
        faulty.advance(JointVector::Zero(6));
        healthy.advance(JointVector::Zero(6));
        EXPECT_EQ(faulty.actual().q, healthy.actual().q);
    }
    return readings;
}

TEST(ArmHardware, Fault22AFaultyChannelReadsWhatItShouldInItsWindowOnly) {
    TestArm arm("indy7");
    arm.start.qd.setConstant(0.5);
    struct Case {
        const char* name;
        double (*expected)(const Readings&, int tick);
    };
    const Case cases[] = {
        {"stuck", [](const Readings& r, int) { return r.healthy[99].q[1]; }},
        {"bias", [](const Readings& r, int k) { return r.healthy[k].q[1] + 0.017; }},
        {"sign", [](const Readings& r, int k) { return -r.healthy[k].q[1]; }},
        {"spike", [](const Readings& r, int k) { return r.healthy[k].q[1] + (k == 100 ? 0.017 : 0.0); }},
        {"swap", [](const Readings& r, int k) { return r.healthy[k].q[2]; }},
        {"wrap", [](const Readings& r, int k) { return r.healthy[k].q[1] + 2.0 * kPi; }},
    };
    for (const std::string encoder : {"exact", "robot"})
        for (const Case& c : cases) {
            const Readings r = readWith(arm, c.name, encoder);
            for (int k = 0; k <= 300; ++k) {
                const bool isFaulty = k >= 100 && k < 200;
                const double expected = isFaulty ? c.expected(r, k) : r.healthy[k].q[1];
                ASSERT_EQ(r.faulty[k].q[1], expected) << c.name << ", tick " << k;
                ASSERT_EQ(r.faulty[k].q[5], r.healthy[k].q[5]);
                if (encoder == "robot" && k > 0) {  // the drive takes differences of what it reads
                    ASSERT_EQ(r.faulty[k].qd[1], (r.faulty[k].q[1] - r.faulty[k - 1].q[1]) / arm.tick_s);
                }
            }
        }
    const Readings r = readWith(arm, "nan", "robot");
    EXPECT_TRUE(r.faulty[99].q.allFinite());
    EXPECT_TRUE(std::isnan(r.faulty[100].q[1]) && std::isnan(r.faulty[100].qd[1]));
    EXPECT_TRUE(std::isfinite(r.faulty[100].q[0]));
    EXPECT_TRUE(std::isfinite(r.faulty[200].q[1]));
    EXPECT_CONTAINS(complain(arm, "sensor_fault: swap, sensor_fault_joint: 5"), "swapped with the next one");
    EXPECT_CONTAINS(complain(arm, "sensor_fault: stuck, sensor_fault_joint: 6"), "joints are 0 to 5");
}

TEST(ArmHardware, Fault23WrapIsAJumpOfOneTurnThereAndBack) {
    TestArm arm("indy7");
    const Readings r = readWith(arm, "wrap", "robot");
    const auto jump = [&](int k) { return r.faulty[k].q[1] - r.faulty[k - 1].q[1]; };
    EXPECT_NEAR(jump(100), 2.0 * kPi, 0.01);
    EXPECT_NEAR(jump(200), -2.0 * kPi, 0.01);
}

TEST(ArmHardware, Fault22NoiseIsCutAtFourStandardDeviations) {
    TestArm arm("single_joint");
    const double noise = 1e-4;
    ArmHardware hardware;
    configure(hardware, arm, "encoder: exact, encoder_noise_rad: 1.0e-4, seed: 3");
    const JointState still{one(0.0), one(0.0)};
    hardware.reset(still);
    double largest = 0.0;
    int atTheCut = 0;
    for (int tick = 0; tick < 500000; ++tick) {
        hardware.endTick(one(0.0), still);
        const double reading = std::abs(hardware.measured().q[0]);
        largest = std::max(largest, reading);
        atTheCut += reading == 4.0 * noise;
    }
    EXPECT_EQ(largest, 4.0 * noise);
    EXPECT_GT(atTheCut, 5);  // 6.3e-5 of all: 32 expected
    EXPECT_LT(atTheCut, 80);
}

TEST(ArmHardware, AdvanceAllocatesNothingWithEverythingOn) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    for (const std::string gears : {"", ", backlash_rad: 1.0e-3, substeps: 20"}) {
        Driven plant(arm,
                     "load_friction: 0.1, delay_ticks: 3, torque_ripple_Nm: 1, push_Nm: 2, blocked_joint: 1, "
                     "blocked_from_s: 0.1, sensor_fault: swap, encoder_noise_rad: 1.0e-5" +
                         gears);
        std::int64_t allocations = 0;
        JointVector applied;
        for (int tick = 0; tick < 200; ++tick) {
            const JointVector torque = JointVector::Constant(6, 30.0 * std::sin(0.1 * tick));
            testing::AllocationCounter counter;
            plant.plant.advance(torque, applied);
            if (tick == 100) plant.plant.reset(arm.start);
            allocations += counter.count();
        }
        EXPECT_EQ(allocations, 0) << gears;
    }
}

// --- Backlash ----------------------------------------------------------------------------------------------------

/** A joint of 1 kg m^2 with a rotor of 0.5 and no gravity. */
void giveRotor(TestArm& arm) {
    arm.robot.actuation.rotorInertia.setConstant(1, 0.5);
    arm.rebuildModel();
}

TEST(Backlash, Fault17ReversalCrossesTheGapBeforeTheLinkFollows) {
    TestArm arm("single_joint");
    giveRotor(arm);
    const double gap = 0.01;
    Driven plant(arm, std::string(kBare) + ", backlash_rad: 0.01, substeps: 10");
    double widest = 0.0, narrowest = 0.0;
    const double start = plant.measured().q[0] - plant.actual().q[0];
    EXPECT_EQ(start, 0.0);  // the encoder is set by the link at the start
    for (int tick = 0; tick < 400; ++tick) {
        const double link = plant.actual().qd[0], lost = plant.measured().q[0] - plant.actual().q[0];
        plant.advance(one(tick < 200 ? 1.0 : -1.0));
        widest = std::max(widest, lost);
        narrowest = std::min(narrowest, lost);
        // In the gap nothing moves the link.
        if (lost < -0.1 * gap && lost > -0.9 * gap) EXPECT_NEAR(plant.actual().qd[0], link, 1e-9) << tick;
    }
    // Lost motion: the whole gap, and what the spring gives: 1 Nm / K before; then the impact, in which the rotor comes
    // with v = sqrt(2 gap 1 Nm / J_r) and J_r I / (J_r + I) swings on K.
    const double stiffness = 1e4, v = std::sqrt(2.0 * gap / 0.5), impact = v * std::sqrt(0.5 / 1.5 / stiffness);
    EXPECT_GE(widest - narrowest, gap + 0.7 * impact);  // damped
    EXPECT_LE(widest - narrowest, gap + impact + 1.0 / stiffness);
}

TEST(Backlash, MomentumIsKeptAndEnergyIsLostInImpacts) {
    TestArm arm("single_joint");
    giveRotor(arm);
    arm.start.qd[0] = 0.5;
    Driven plant(arm, std::string(kBare) + ", backlash_rad: 0.02, substeps: 20");
    plant.advance(one(100.0));
    double momentum = 0.0, energy = 1e9;
    for (int tick = 0; tick < 3000; ++tick) {
        plant.advance(one(0.0));
        const double link = plant.actual().qd[0];
        const double rotor = (plant.measured().qd[0]);  // exact encoders show the rotor's velocity
        const double now = 0.5 * rotor + 1.0 * link;
        if (tick == 0) momentum = now;
        ASSERT_NEAR(now, momentum, 1e-9) << tick;
        const double kinetic = 0.25 * rotor * rotor + 0.5 * link * link;
        if (tick % 1000 == 0) {
            EXPECT_LT(kinetic, energy);
            energy = kinetic;
        }
    }
}

TEST(Backlash, GearsCarryTheArmFromTheStartAndStickingStaysStuck) {
    TestArm arm("indy7");
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    Driven plant(arm, "encoder: exact, backlash_rad: 1.0e-3, substeps: 20");
    for (int tick = 0; tick < 300; ++tick) plant.advance(gravity);
    EXPECT_LE((plant.measured().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-6);  // rotors
    // Vertical axes feel no weight: their links lie free in the gap.
    EXPECT_LE((plant.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1.1e-3);
}

TEST(Backlash, RefusesTooFewStepsAndArmsWithoutRotors) {
    TestArm arm("indy7");
    const std::string complaint = complain(arm, "backlash_rad: 1.0e-3");
    expectContains(complaint, {"1 is too few for backlash", "Write substeps: "});
    const std::string needed = complaint.substr(complaint.find("Write substeps: ") + 16);
    const int enough = std::stoi(needed);
    EXPECT_EQ(complain(arm, "backlash_rad: 1.0e-3, substeps: " + std::to_string(enough)), "");
    EXPECT_NE(complain(arm, "backlash_rad: 1.0e-3, substeps: " + std::to_string(enough - 1)), "");
    TestArm bare("single_joint");
    bare.robot.actuation.rotorInertia.setZero();
    EXPECT_CONTAINS(complain(bare, "backlash_rad: 0.01, substeps: 100"), "has no rotor inertia");
}

}  // namespace
}  // namespace viable
