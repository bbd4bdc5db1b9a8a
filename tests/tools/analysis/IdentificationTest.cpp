#include "Paths.h"
#include "analysis/identification/Identification.h"
#include "records/WorkShare.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "RobotFolder.h"
#include "robot/ArmRecursion.h"

namespace viable {
namespace {

using Law = std::function<double(int joint, double velocity, double load)>;

/** A motion of sines that are not in tune, and the torques that it takes: by inverse dynamics, so that nothing of it comes
from the identification. */
struct Experiment {
    explicit Experiment(RobotDescription arm) : robot(std::move(arm)), really(robot) {
        amplitude = JointVector::Constant(robot.size(), 0.6);
        speed = JointVector::Constant(robot.size(), 2.2);
    }

    RobotDescription robot;   ///< what is assumed
    RobotDescription really;  ///< the arm that moves
    JointVector amplitude;    ///< [rad]
    JointVector speed;        ///< slowest of the three sines [rad/s]
    double duration_s = 12.0, interval_s = 0.004;
    double quantum = 1e-6;     ///< of the positions [rad]
    double torqueNoise = 0.0;  ///< white [Nm]
    double delay_s = 0.0;      ///< of the torques' effect
    unsigned seed = 1;
    Law extra;  ///< friction beyond the law [Nm], its sign included

    double calcFriction(int i, double v, double load) const {
        const JointFriction& f = really.actuation.friction;
        const double size = f.coulomb[i] + f.viscous[i] * -std::expm1(-std::abs(v) / f.viscousVelocity[i]);
        return (v > 0.0 ? size : v < 0.0 ? -size : 0.0) + (extra ? extra(i, v, load) : 0.0);
    }

    MotionRecord record() const {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> phase(0.0, 2.0 * EIGEN_PI);
        std::normal_distribution<double> normal;
        const int n = robot.size();
        MotionRecord record;
        record.source = "made-up seed " + std::to_string(seed);
        record.robot = robot.name;
        record.joints.resize(static_cast<std::size_t>(n));
        constexpr int kSines = 3;
        const double ratio[kSines] = {1.0, 1.618, 2.414}, share[kSines] = {0.5, 0.3, 0.2};
        std::vector<std::array<double, kSines>> phases(static_cast<std::size_t>(n));
        for (auto& own : phases)
            for (double& p : own) p = phase(random);
        const ArmRecursion arm(really);
        const auto calcMotion = [&](double t, JointVector& q, JointVector& qd, JointVector& qdd) {
            q = robot.home;
            qd = qdd = JointVector::Zero(n);
            for (int i = 0; i < n; ++i)
                for (int s = 0; s < kSines; ++s) {
                    const double w = ratio[s] * speed[i] * (1.0 + 0.13 * i), a = amplitude[i] * share[s];
                    const double angle = w * t + phases[static_cast<std::size_t>(i)][static_cast<std::size_t>(s)];
                    q[i] += a * std::sin(angle);
                    qd[i] += a * w * std::cos(angle);
                    qdd[i] -= a * w * w * std::sin(angle);
                }
        };
        JointVector q, qd, qdd, torque(n);
        for (int k = 0; k * interval_s <= duration_s; ++k) {
            const double t = k * interval_s;
            record.times_s.push_back(t);
            calcMotion(t + delay_s, q, qd, qdd);
            arm.calcTorque(q, qd, qdd, torque);
            JointVector at;
            calcMotion(t, at, q, qdd);
            for (int i = 0; i < n; ++i) {
                MotionRecord::Joint& joint = record.joints[static_cast<std::size_t>(i)];
                joint.name = robot.joints[static_cast<std::size_t>(i)].name;
                joint.positions.push_back(std::round(at[i] / quantum) * quantum);
                joint.torques.push_back(torque[i] + calcFriction(i, qd[i], torque[i]) + torqueNoise * normal(random));
            }
        }
        return record;
    }

    Identification identify(IdentificationOptions options = {}) const {
        options.isTorqueHeld = false;
        return viable::identify(robot, {record()}, options);
    }
};

std::filesystem::path robotFolder(const char* name) {
    return std::filesystem::path(VIABLE_SOURCE_DIR) / "robots" / name;
}
RobotDescription planar() {
    return loadRobot(robotFolder("planar_two_link"));
}

bool holds(const IdentifiedFigure& figure, double truth) {
    return truth >= figure.lower && truth <= figure.upper;
}

ResidualCheck findCheck(const JointIdentification& joint, const std::string& name) {
    for (const ResidualCheck& check : joint.checks)
        if (check.name == name) return check;
    ADD_FAILURE() << "no check " << name << ": " << joint.reason;
    return {};
}

TEST(Identification, FindsFrictionAndPayloadWithinItsIntervals) {
    constexpr unsigned kFirstSeed = 100, kSeeds = 20;
    Experiment experiment(planar());
    experiment.really = withPayload(experiment.robot, 0.3, {0.05, 0.0, 0.0});
    experiment.robot.actuation.friction.coulomb *= 0.5;  // what is assumed is no help
    experiment.robot.actuation.friction.viscous *= 3.0;
    experiment.torqueNoise = 0.1;
    const JointFriction& truth = experiment.really.actuation.friction;
    int inside[4] = {}, asked[4] = {}, wrongAlarms = 0;
    for (unsigned s = 0; s < kSeeds; ++s) {
        experiment.seed = kFirstSeed + s;
        const Identification found = experiment.identify();
        const auto count = [&](int kind, const IdentifiedFigure& figure, double value) {
            if (!figure.isKnown) return;
            ++asked[kind];
            inside[kind] += holds(figure, value);
        };
        for (int i = 0; i < 2; ++i) {
            const JointIdentification& joint = found.joints[static_cast<std::size_t>(i)];
            EXPECT_TRUE(joint.coulomb.isKnown) << joint.reason << " seed " << experiment.seed;
            EXPECT_NEAR(joint.coulomb.value, truth.coulomb[i], 0.1 * truth.coulomb[i]) << experiment.seed;
            wrongAlarms += joint.verdict != ModelVerdict::Adequate;
            EXPECT_NE(joint.verdict, ModelVerdict::Doubtful) << writeText(found) << experiment.seed;
            count(0, joint.coulomb, truth.coulomb[i]);
            if (joint.form != FrictionForm::Saturating) continue;
            count(1, joint.viscous, truth.viscous[i]);
            count(2, joint.viscousVelocity, truth.viscousVelocity[i]);
        }
        count(3, found.payload.mass, 0.3);
    }
    EXPECT_LE(wrongAlarms, 2);  // of 40 joints
    const char* const names[] = {"coulomb", "viscous", "viscous velocity", "payload"};
    for (int kind = 0; kind < 4; ++kind) {
        RecordProperty(names[kind], std::to_string(inside[kind]) + " of " + std::to_string(asked[kind]));
        EXPECT_GE(asked[kind], static_cast<int>(kSeeds) / 2) << names[kind];
        // 95 % intervals: fewer than 85 % of 20 to 40 come by chance once in fifty times.
        EXPECT_GE(inside[kind], 0.85 * asked[kind])
            << names[kind] << ", seeds " << kFirstSeed << " to " << kFirstSeed + kSeeds - 1;
    }
}

TEST(Identification, IsExactWithoutNoise) {
    Experiment experiment(planar());
    experiment.really = withPayload(experiment.robot, 0.3, {0.05, 0.0, -0.02});
    experiment.interval_s = 0.002;
    experiment.quantum = 1e-9;
    static std::map<std::string, double> told;  // how far it was
    WorkShare::show = [](const char* what, double share) { told[what] = share; };
    const Identification found = experiment.identify();
    WorkShare::show = nullptr;
    EXPECT_EQ(told["smoothing"], 1.0);
    EXPECT_EQ(told["fitting"], 1.0);
    const JointFriction& truth = experiment.really.actuation.friction;
    for (int i = 0; i < 2; ++i) {
        const JointIdentification& joint = found.joints[static_cast<std::size_t>(i)];
        ASSERT_EQ(joint.form, FrictionForm::Saturating) << joint.reason;
        EXPECT_NEAR(joint.coulomb.value, truth.coulomb[i], 1e-4 * truth.coulomb[i]);
        EXPECT_NEAR(joint.viscous.value, truth.viscous[i], 1e-3 * truth.viscous[i]);
        EXPECT_NEAR(joint.viscousVelocity.value, truth.viscousVelocity[i], 1e-3 * truth.viscousVelocity[i]);
        EXPECT_GT(joint.explained, 0.9999);
    }
    EXPECT_NEAR(found.payload.mass.value, 0.3, 1e-4);
    EXPECT_NEAR(found.payload.centre[0].value, 0.05, 1e-3);
}

TEST(Identification, FindsAPayloadWhereverItIs) {
    RobotFolder folder;
    makeSlantedArm(folder);  // prismatic joints too
    Experiment experiment(folder.load());
    const int n = experiment.robot.size();
    experiment.robot.actuation.friction = {JointVector::Constant(n, 0.2), JointVector::Constant(n, 0.4),
                                           JointVector::Constant(n, 0.5)};
    experiment.amplitude.setConstant(n, 0.4);
    const Eigen::Vector3d place(0.06, -0.03, 0.11);
    experiment.really = withPayload(experiment.robot, 0.8, place);
    experiment.torqueNoise = 0.02;
    const Identification found = experiment.identify();
    ASSERT_TRUE(found.payload.isFound());
    EXPECT_EQ(found.payload.model, PayloadModel::MassAndCentre);
    EXPECT_NEAR(found.payload.mass.value, 0.8, 0.01);
    for (int k = 0; k < 3; ++k) {
        EXPECT_TRUE(found.payload.centre[static_cast<std::size_t>(k)].isKnown);
        EXPECT_NEAR(found.payload.centre[static_cast<std::size_t>(k)].value, place[k], 0.01) << k;
    }
    EXPECT_CONTAINS(writeText(found), "payload_kg: 0.");

    experiment.really = experiment.robot;
    const Identification nothing = experiment.identify();
    EXPECT_TRUE(nothing.payload.mass.isKnown);
    EXPECT_TRUE(holds(nothing.payload.mass, 0.0)) << nothing.payload.mass.value;
    EXPECT_FALSE(nothing.payload.centre[0].isKnown);
}

TEST(Identification, FindsMassesRotorsOffsetsAndDelaysWhenAsked) {
    Experiment experiment(planar());
    JointVector factor(2), rotor(2), offset(2);
    factor << 1.0, 1.2;
    rotor << 0.05, 0.01;
    offset << 0.3, -0.1;
    experiment.really = withScaledMasses(experiment.robot, factor);
    experiment.really.actuation.rotorInertia += rotor;
    experiment.delay_s = 0.003;
    experiment.torqueNoise = 0.02;
    experiment.extra = [&](int i, double, double) { return offset[i]; };
    IdentificationOptions options;
    options.payload = PayloadModel::None;
    options.bodyMasses = options.rotorInertias = options.torqueOffsets = true;
    const Identification found = experiment.identify(options);
    ASSERT_EQ(found.bodyMasses.size(), 2u);
    EXPECT_NEAR(found.bodyMasses[1].value, 1.2, 0.01);
    for (int i = 0; i < 2; ++i)
        EXPECT_NEAR(found.joints[static_cast<std::size_t>(i)].torqueOffset.value, offset[i], 0.02) << i;
    // Sooner in the record than in the motion: the record's torque acts later.
    EXPECT_NEAR(found.torqueDelay.value, 0.003, 2e-4);
}

TEST(Identification, KeepsTheFiguresOfAJointThatDoesNotMove) {
    Experiment experiment(planar());
    experiment.amplitude[1] = 0.0;
    const Identification found = experiment.identify();
    EXPECT_EQ(found.joints[0].form, FrictionForm::Saturating) << found.joints[0].reason;
    const JointIdentification& still = found.joints[1];
    EXPECT_EQ(still.form, FrictionForm::None);
    EXPECT_EQ(still.reason, "it never moved");
    EXPECT_EQ(still.verdict, ModelVerdict::NotIdentified);
    EXPECT_FALSE(still.coulomb.isKnown);
    EXPECT_EQ(still.written, still.old);
    EXPECT_EQ(still.coulomb.reason, still.reason);
    EXPECT_TRUE(nlohmann::json::parse(writeJson(found))["joints"][still.name]["coulomb_Nm"]["value"].is_null());

    // Nor one that moves a few times, nor one without torques.
    experiment.amplitude[1] = 0.5;
    MotionRecord record = experiment.record();
    for (std::size_t k = record.times_s.size() / 8; k < record.times_s.size(); ++k)
        record.joints[1].positions[k] = record.joints[1].positions[record.times_s.size() / 8];
    IdentificationOptions options;
    options.isTorqueHeld = false;
    Identification few = identify(experiment.robot, {record}, options);
    EXPECT_EQ(few.joints[1].form, FrictionForm::None);
    EXPECT_CONTAINS(few.joints[1].reason, "it moved too little: ");
    record = experiment.record();
    record.joints[1].torques.clear();
    few = identify(experiment.robot, {record}, options);
    EXPECT_EQ(few.joints[1].reason, "the records have no torques of it");
    EXPECT_EQ(few.joints[0].form, FrictionForm::Saturating);
}

TEST(Identification, DoesNotInventTheBendOfSlowMotions) {
    Experiment experiment(planar());
    experiment.amplitude.setConstant(0.15);
    experiment.speed.setConstant(0.9);
    experiment.duration_s = 20.0;
    experiment.torqueNoise = 0.05;
    experiment.quantum = 1e-5;
    const Identification found = experiment.identify();
    for (const JointIdentification& joint : found.joints) {
        EXPECT_EQ(joint.form, FrictionForm::KnownVelocity) << joint.fastest;
        EXPECT_FALSE(joint.viscousVelocity.isKnown);
        EXPECT_CONTAINS(joint.reason, "do not show that the friction saturates");
        EXPECT_EQ(joint.written[2], joint.old[2]);
    }

    // Where the robot's velocity says more than the motion allows, a straight line is written.
    experiment.speed.setConstant(2.2);
    experiment.amplitude.setConstant(0.5);
    experiment.torqueNoise = 0.05;
    experiment.really.actuation.friction.viscousVelocity.setConstant(1000.0);
    experiment.really.actuation.friction.viscous.setConstant(1000.0);
    experiment.robot.actuation.friction.viscousVelocity.setConstant(0.05);
    const Identification straight = experiment.identify();
    for (const JointIdentification& joint : straight.joints) {
        EXPECT_EQ(joint.form, FrictionForm::Line) << joint.reason;
        EXPECT_NEAR(joint.slope.value, 1.0, 0.1);
        EXPECT_NEAR(joint.written[1] / joint.written[2], 1.0, 0.1);
        EXPECT_GT(joint.written[2], 50.0 * joint.fastest);
    }
}

TEST(Identification, ChecksNameWhatTheLawLacks) {
    Experiment experiment(planar());
    experiment.torqueNoise = 0.02;
    experiment.extra = [](int, double v, double load) { return std::copysign(0.1 * std::abs(load), v); };
    const Identification loaded = experiment.identify();
    for (const JointIdentification& joint : loaded.joints) {
        EXPECT_TRUE(findCheck(joint, "load friction").isFound) << writeText(loaded);
        EXPECT_NE(joint.verdict, ModelVerdict::Adequate);
    }
    EXPECT_CONTAINS(writeText(loaded), "the residuals also show");

    experiment.extra = [](int i, double v, double) {
        return (i == 0 ? 1.0 : 0.4) * std::copysign(std::exp(-v * v / 0.01), v);
    };
    for (const JointIdentification& joint : experiment.identify().joints)
        EXPECT_NE(joint.verdict, ModelVerdict::Adequate) << joint.name;

    experiment.extra = [](int i, double, double) { return i == 0 ? 0.5 : 0.0; };
    const Identification offset = experiment.identify();
    EXPECT_TRUE(findCheck(offset.joints[0], "torque offset").isFound) << writeText(offset);

    experiment.extra = nullptr;
    experiment.really.gravity = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY()) * experiment.robot.gravity;
    const Identification tilted = experiment.identify();
    EXPECT_TRUE(findCheck(tilted.joints[0], "tilt of the base about y").isFound) << writeText(tilted);
}

TEST(Identification, AFrictionlessArmHasNone) {
    Experiment experiment(planar());
    experiment.really.actuation.friction.coulomb.setZero();
    experiment.really.actuation.friction.viscous.setZero();
    experiment.torqueNoise = 0.01;
    for (const JointIdentification& joint : experiment.identify().joints) {
        EXPECT_TRUE(joint.coulomb.isKnown) << joint.reason;
        EXPECT_TRUE(holds(joint.coulomb, 0.0)) << joint.coulomb.value << " +- " << joint.coulomb.deviation;
        EXPECT_LT(joint.written[0], 0.02);
        EXPECT_GE(joint.written[0], 0.0);
        EXPECT_GE(joint.written[1], 0.0);
        EXPECT_LT(joint.written[1], 0.05);
    }
}

TEST(Identification, SeveralRecordsCountTogether) {
    Experiment experiment(planar());
    experiment.torqueNoise = 0.1;
    IdentificationOptions options;
    options.isTorqueHeld = false;
    std::vector<MotionRecord> records;
    for (experiment.seed = 1; experiment.seed <= 3; ++experiment.seed) records.push_back(experiment.record());
    const Identification all = identify(experiment.robot, records, options);
    const Identification one = identify(experiment.robot, {records[0]}, options);
    EXPECT_NEAR(all.duration_s, 36.0, 0.1);
    EXPECT_EQ(all.sources.size(), 3u);
    EXPECT_LT(all.joints[0].coulomb.deviation, one.joints[0].coulomb.deviation);
    // The order of a record's joints does not matter.
    std::swap(records[0].joints[0], records[0].joints[1]);
    EXPECT_EQ(identify(experiment.robot, {records[0]}, options).joints[0].coulomb.value, one.joints[0].coulomb.value);
}

TEST(Identification, RefusesWhatItCannotUse) {
    const Experiment experiment(planar());
    const MotionRecord good = experiment.record();
    const auto refuseRecord = [&](const std::function<void(MotionRecord&)>& spoil) {
        MotionRecord record = good;
        spoil(record);
        return test::catchError([&] { identify(experiment.robot, {record}); });
    };
    EXPECT_EQ(test::catchError([&] { identify(experiment.robot, {}); }),
              "there is no record to identify from. Name one log or more.");
    EXPECT_EQ(refuseRecord([](MotionRecord& r) {
                  for (auto& joint : r.joints) joint.torques.clear();
              }),
              "made-up seed 1: the record has no torques. Friction and masses are found from the "
              "torques of the motors at the joints.");
    const std::string name = good.joints[0].name;
    test::expectContains(
        refuseRecord([&](MotionRecord& r) { r.joints[0].name = name + "x"; }),
        {"made-up seed 1: the robot `planar_two_link` has no joint `" + name + "x`. Did you mean `" + name});
    EXPECT_CONTAINS(refuseRecord([](MotionRecord& r) { r.joints.pop_back(); }),
                    "the record has no joint `" + good.joints[1].name + "`");
    const std::string brief = refuseRecord([](MotionRecord& r) {
        r.times_s.resize(300);
        for (auto& joint : r.joints) joint.positions.resize(300), joint.torques.resize(300);
    });
    EXPECT_CONTAINS(brief, "which is too short to tell how sure the figures are");
}

TEST(Identification, ReadingsThatAreMissingDoNoHarm) {
    Experiment experiment(planar());
    MotionRecord record = experiment.record();
    std::mt19937 random(3);
    for (int k = 0; k < 60; ++k) {
        record.joints[random() % 2].torques[random() % record.times_s.size()] = kNan;
        record.joints[random() % 2].positions[random() % record.times_s.size()] = kNan;
    }
    IdentificationOptions options;
    options.isTorqueHeld = false;
    const Identification found = identify(experiment.robot, {record}, options);
    const JointFriction& truth = experiment.really.actuation.friction;
    for (int i = 0; i < 2; ++i)
        EXPECT_NEAR(found.joints[static_cast<std::size_t>(i)].coulomb.value, truth.coulomb[i], 0.02 * truth.coulomb[i]);
}

// -------------------------------------------------------------------------------- actuation.yaml

struct ActuationFileTest : ::testing::Test {
    ActuationFileTest() {
        makeSimpleArm(folder_);
        folder_.actuation =
            "schema: 1\n# the vendor's\ngear_ratio: [50, 80]   # turns\nrotor_inertia_kgm2: "
            "1e-5\ntorque_limit_Nm: .inf\n"
            "friction:\n  coulomb_Nm: [0.61, 0.25]  # old\n  viscous_Nm: [1.5, 0.75]\n  "
            "viscous_velocity_radps: [0.7, 0.9]\n"
            "  source: \"a guess: mine\"\n";
    }
    /** Identifies joint 0 only, writes, loads again. */
    RobotDescription rewrite() {
        Experiment experiment(folder_.load());
        experiment.really.actuation.friction.coulomb *= 1.7;
        experiment.amplitude[1] = 0.0;
        found_ = experiment.identify();
        text_ = writeActuation(experiment.robot, found_);
        folder_.put("actuation.yaml", text_);
        return loadRobot(folder_.path());
    }
    void expectFigures(const RobotDescription& robot) const {
        const JointFriction& friction = robot.actuation.friction;
        EXPECT_NEAR(friction.coulomb[0], 1.7 * 0.61, 0.01);
        EXPECT_NEAR(friction.viscous[0], 1.5, 0.03);
        EXPECT_NEAR(friction.viscousVelocity[0], 0.7, 0.02);
        EXPECT_EQ(friction.coulomb[1], 0.25);
        EXPECT_EQ(friction.viscous[1], 0.75);
        EXPECT_EQ(friction.viscousVelocity[1], 0.9);
        EXPECT_EQ(robot.actuation.gearRatio[1], 80.0);
        EXPECT_DOUBLE_EQ(robot.actuation.rotorInertia[0], 1e-5 * 2500.0);
    }
    RobotFolder folder_;
    Identification found_;
    std::string text_;
};

TEST_F(ActuationFileTest, KeepsTheRestOfTheFile) {
    expectFigures(rewrite());
    EXPECT_EQ(text_.find("schema: 1\n# the vendor's\ngear_ratio: [50, 80]   # turns\n"), 0u) << text_;
    test::expectContains(text_, {"source: \"identified by viable ", "made-up seed 1", "# standard errors: ",
                                 "# elbow: none; it never moved\n", "# what is kept comes from: a guess: mine\n"});
    // Once more: the same figures, and no text that grows.
    const std::string first = text_;
    RobotDescription again = loadRobot(folder_.path());
    EXPECT_EQ(writeActuation(again, found_).size() - text_.size(),
              std::string("identified by viable 0.1.0 from 12 s of motion in made-up seed 1").size() -
                  std::string("a guess: mine").size());
}

TEST_F(ActuationFileTest, TakesAnyLayout) {
    const std::string rest = "gear_ratio: [50, 80]\nrotor_inertia_kgm2: 1e-5\ntorque_limit_Nm: .inf\n";
    const std::string flow = "{coulomb_Nm: [0.61, 0.25], viscous_Nm: [1.5, 0.75], viscous_velocity_radps: [0.7, 0.9]}";
    const std::string block =
        "friction:\n  coulomb_Nm: [0.61, 0.25]\n\n  # here\n  viscous_Nm:\n  - 1.5\n  - 0.75\n"
        "  viscous_velocity_radps: [0.7, 0.9]\n";
    std::string windows = "schema: 1\n" + block + rest;
    for (std::size_t at = 0; (at = windows.find('\n', at)) != std::string::npos; at += 2)
        windows.replace(at, 1, "\r\n");
    const std::string layouts[] = {
        "schema: 1\nfriction: " + flow + "\n" + rest,
        "schema: 1\n" + rest + "friction: " + flow,
        "schema: 1\n" + block + "\n# about gears\n" + rest,
        "friction:   # first\n  " + flow + "\nschema: 1\n" + rest,
        "  schema: 1\n  friction: " + flow +
            "\n  gear_ratio: [50, 80]\n  rotor_inertia_kgm2: 1e-5\n  torque_limit_Nm: .inf\n",
        "{schema: 1, gear_ratio: [50, 80], rotor_inertia_kgm2: 1e-5, torque_limit_Nm: .inf, friction: " + flow + "}\n",
        "schema: 1\n\"friction\": " + flow + "\n" + rest,
        "\xEF\xBB\xBF"
        "friction: " +
            flow + "\nschema: 1\n" + rest,
        windows,
    };
    for (const std::string& layout : layouts) {
        SCOPED_TRACE(layout);
        folder_.actuation = layout;
        expectFigures(rewrite());
        EXPECT_EQ(layout.find("# about gears") == std::string::npos,
                  text_.find("\n\n# about gears\n") == std::string::npos)
            << text_;
        if (layout == windows)
            for (std::size_t at = 0; (at = text_.find('\n', at)) != std::string::npos; ++at)
                EXPECT_EQ(text_[at - 1], '\r');
    }
}

TEST_F(ActuationFileTest, NamesOfLogsAreOnlyText) {
    Experiment experiment(folder_.load());
    Identification found = experiment.identify();
    found.sources = {"a: \"b\" #c\n- {d}\x1b[2J.mcap", "*x"};
    for (int i = 0; i < 20; ++i) found.sources.push_back("run" + std::to_string(i));
    text_ = writeActuation(experiment.robot, found);
    EXPECT_EQ(text_.find('\x1b'), std::string::npos);
    EXPECT_CONTAINS(text_, " and 14 more");
    folder_.put("actuation.yaml", text_);
    EXPECT_NO_THROW(loadRobot(folder_.path())) << text_;
    EXPECT_TRUE(nlohmann::json::accept(writeJson(found)));
    EXPECT_EQ(writeText(found).find('\x1b'), std::string::npos);
}

TEST_F(ActuationFileTest, WorksForTheRobotsThatAreThere) {
    for (const char* const name : {"single_joint", "planar_two_link", "indy7", "panda", "ur5e"}) {
        SCOPED_TRACE(name);
        const TemporaryFolder copy;
        std::filesystem::copy(robotFolder(name), copy.path() / name, std::filesystem::copy_options::recursive);
        const RobotDescription robot = loadRobot(copy.path() / name);
        Identification found;
        found.robot = name;
        for (int i = 0; i < robot.size(); ++i) {
            JointIdentification joint;
            joint.name = robot.joints[static_cast<std::size_t>(i)].name;
            joint.form = FrictionForm::Saturating;
            joint.covariance.setZero();
            joint.written = {1.2345678 + i, 0.012345678, 98.7654321};
            joint.coulomb.deviation = 0.012;
            joint.viscous.deviation = 0.00012;
            joint.viscousVelocity.deviation = 1.2;
            found.joints.push_back(joint);
        }
        const std::string text = writeActuation(robot, found);
        std::ofstream(copy.path() / name / "actuation.yaml") << text;
        const RobotDescription again = loadRobot(copy.path() / name);
        for (int i = 0; i < robot.size(); ++i) {
            EXPECT_NEAR(again.actuation.friction.coulomb[i], 1.2345678 + i, 0.0005 + 1e-12);
            EXPECT_NEAR(again.actuation.friction.viscous[i], 0.012345678, 0.000005 + 1e-12);
            EXPECT_NEAR(again.actuation.friction.viscousVelocity[i], 98.7654321, 0.05 + 1e-12);
        }
        EXPECT_EQ(again.actuation.torqueLimit, robot.actuation.torqueLimit);
        EXPECT_EQ(again.actuation.gearRatio, robot.actuation.gearRatio);
    }
}

}  // namespace
}  // namespace viable
