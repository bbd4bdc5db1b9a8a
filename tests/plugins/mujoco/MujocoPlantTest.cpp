#include "MujocoPlant.h"

#include "CaseSupport.h"
#include "Effort.h"
#include "Joints.h"
#include "RobotFolder.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

using PlantPtr = PluginPtr<RealPlant>;

PlantPtr makePlant(TestArm& arm, const std::string& name, const std::string& text,
                   const Environment* environment = nullptr, const ArmGeometry* geometry = nullptr) {
    PlantPtr plant = PluginLoader::create<RealPlant>(findPlugin(PluginKind::RealPlant, name));
    RunSetup setup = arm.setup();
    setup.environment = environment;
    setup.geometry = geometry;
    plant->configure(setup, arm.read(PluginKind::RealPlant, name, text));
    plant->reset(arm.start);
    return plant;
}

double calcDistance(const JointState& a, const JointState& b) {
    return (a.q - b.q).lpNorm<Eigen::Infinity>();
}

JointVector advance(RealPlant& plant, const JointVector& torque) {
    JointVector applied;
    EXPECT_EQ(plant.advance(torque, applied), TickStatus::Ok);
    return applied;
}

/** Indy7 as it hangs: an arm that stands upright would double any rounding error several times a second. */
void hang(TestArm& arm) {
    RobotModel& model = arm.model();
    JointVector best = arm.robot.home;
    double least = model.calcEnergy(best, JointVector::Zero(6));
    std::mt19937 random(1);
    for (int k = 0; k < 20000; ++k) {
        const JointVector q = best + makeRandomVector(6, k < 2000 ? 1.5 : 0.05, random);
        const double energy = model.calcEnergy(q, JointVector::Zero(6));
        if (energy < least) least = energy, best = q;
    }
    arm.start.q = best;
}

/** The torques with which a simbody plant follows sines of 0.3 rad about the start for 10 s, and where it is then. */
struct Recording {
    std::vector<JointVector> torques;
    std::vector<JointState> states;
};

Recording recordSines(TestArm& arm, const std::string& text) {
    Recording recording;
    const PlantPtr plant = makePlant(arm, "simbody", text);
    for (int tick = 0; tick < 10000; ++tick) {
        const JointState& now = plant->actual();
        const double t = tick * arm.tick_s;
        const Dynamics d = arm.calcDynamics(now.q, now.qd);
        JointVector qdd(6);
        for (int i = 0; i < 6; ++i) {
            const double w = 1.0 + 0.3 * i, wanted = arm.start.q[i] + 0.3 * (1.0 - std::cos(w * t));
            qdd[i] = 25.0 * (wanted - now.q[i]) + 10.0 * (0.3 * w * std::sin(w * t) - now.qd[i]);
        }
        JointVector torque;
        calcInverseDynamics(d, qdd, torque);
        recording.torques.push_back(torque);
        advance(*plant, torque);
        recording.states.push_back(plant->actual());
    }
    return recording;
}

double playBack(TestArm& arm, const Recording& recording, const std::string& text) {
    const PlantPtr plant = makePlant(arm, "mujoco", text);
    double worst = 0.0;
    for (std::size_t k = 0; k < recording.torques.size(); ++k) {
        advance(*plant, recording.torques[k]);
        worst = std::max(worst, calcDistance(plant->actual(), recording.states[k]));
    }
    return worst;
}

TEST(MujocoPlant, MovesAsSimbodyDoesUnderTheSameTorques) {
    TestArm arm("indy7");
    hang(arm);
    const std::string text = "friction: none, encoder: exact, substeps: 2, torque_limit_factor: .inf";
    const std::string loaded = text +
                               ", payload_kg: 2, payload_offset_m: [0.02, 0.03, 0.1], mass_factor: "
                               "[1, 1.1, 0.9, 1.2, 1, 1.3], base_tilt_rad: [0.1, -0.2]";
    for (const std::string& set : {text, loaded}) {
        const Recording recording = recordSines(arm, set);
        double way = 0.0;
        for (const JointState& s : recording.states) way = std::max(way, (s.q - arm.start.q).lpNorm<Eigen::Infinity>());
        ASSERT_GT(way, 0.4);
        const double worst = playBack(arm, recording, set);
        std::printf("  largest difference over 10 s of open loop: %.1e rad\n", worst);
        EXPECT_LE(worst, 1e-6);
    }
    // The comparison sees a payload of a gram.
    EXPECT_GT(playBack(arm, recordSines(arm, text), text + ", payload_kg: 0.001"), 1e-6);
}

TEST(MujocoPlant, FrictionBrakesAsInSimbody) {
    TestArm arm("indy7");
    arm.start.qd.setConstant(0.8);
    const std::string text = "encoder: exact, breakaway_ratio: 1.3, load_friction: 0.1";
    const PlantPtr mujoco = makePlant(arm, "mujoco", text), simbody = makePlant(arm, "simbody", text);
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    double worst = 0.0;
    for (int tick = 0; tick < 300; ++tick) {
        advance(*mujoco, gravity);
        advance(*simbody, gravity);
        worst = std::max(worst, calcDistance(mujoco->actual(), simbody->actual()));
    }
    const double way = (simbody->actual().q - arm.start.q).lpNorm<Eigen::Infinity>();
    std::printf("  stopping by friction on %.3f rad, largest difference %.1e rad\n", way, worst);
    EXPECT_GT(way, 0.01);
    EXPECT_LE(worst, 0.02 * way);
}

TEST(MujocoPlant, Fault17JointAtRestUnderLoadCreepsWhereSimbodysStays) {
    TestArm arm("indy7");
    const JointVector torque = arm.calcDynamics(arm.start).gravity + 0.9 * arm.robot.actuation.friction.coulomb;
    const PlantPtr plant = makePlant(arm, "mujoco", "encoder: exact");
    for (int tick = 0; tick < 5000; ++tick) advance(*plant, torque);
    const double creep = calcDistance(plant->actual(), {arm.start.q, arm.start.qd}) / 5.0;
    std::printf("  MuJoCo creeps with %.1e rad/s at 90 %% of Coulomb friction\n", creep);
    EXPECT_LE(creep, 1e-5);
    EXPECT_GT(creep, 0.0);
    const PlantPtr loose = makePlant(arm, "mujoco", "encoder: exact");
    const JointVector more = arm.calcDynamics(arm.start).gravity + 1.1 * arm.robot.actuation.friction.coulomb;
    for (int tick = 0; tick < 500; ++tick) advance(*loose, more);
    for (int i = 0; i < 6; ++i) EXPECT_GT(std::abs(loose->actual().q[i] - arm.start.q[i]), 1e-3);
}

TEST(MujocoPlant, Fault17TenfoldFrictionNeedsAndGetsEnoughSteps) {
    TestArm arm("indy7");
    expectError({"too few for the viscous friction", "Write substeps:"},
                [&] { makePlant(arm, "mujoco", "friction_scale: 40"); });
    const PlantPtr plant = makePlant(arm, "mujoco", "friction_scale: 10, encoder: exact");
    std::mt19937 random(5);
    for (int tick = 0; tick < 1000; ++tick) {
        advance(*plant, makeRandomVector(6, 1.0, random).cwiseProduct(arm.robot.actuation.torqueLimit));
        ASSERT_TRUE(isFinite(plant->actual(), 6));
    }
    EXPECT_LE(plant->actual().qd.lpNorm<Eigen::Infinity>(), 0.5);
}

TEST(MujocoPlant, Fault18BlockedJointStopsAndTheOthersMoveAsInSimbody) {
    TestArm arm("indy7");
    arm.start.qd.setConstant(0.5);
    const std::string text =
        "friction: none, encoder: exact, blocked_joint: 2, blocked_from_s: 0.1, blocked_until_s: 0.3";
    const PlantPtr mujoco = makePlant(arm, "mujoco", text), simbody = makePlant(arm, "simbody", text);
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    double where = 0.0;
    for (int tick = 0; tick < 400; ++tick) {
        advance(*mujoco, gravity);
        advance(*simbody, gravity);
        if (tick == 150) where = mujoco->actual().q[2];
        if (tick > 150 && tick < 300) ASSERT_NEAR(mujoco->actual().q[2], where, 1e-5);
    }
    EXPECT_GT(std::abs(mujoco->actual().q[2] - where), 1e-3);  // released
    EXPECT_LE(calcDistance(mujoco->actual(), simbody->actual()), 1e-2);
}

/** Largest and root mean square |q_real - q_nominal| of the hand motion with NRIC, all joints [rad]. */
struct Tracking {
    double largest = 0.0, mean = 0.0;
};

Tracking follow(const std::string& plant) {
    test::TestLoop loop(test::kTeleoperation,
                        {"filter={plugin: certified_braking}", "real_plant={plugin: " + plant + ", payload_kg: 3}"});
    TickRecord record;
    Tracking tracking;
    constexpr int kTicks = 8000;
    for (int tick = 0; tick < kTicks; ++tick) {
        loop.loop.tick(record);
        const JointVector e = record.actual.q - record.nominal.q;
        tracking.largest = std::max(tracking.largest, e.lpNorm<Eigen::Infinity>());
        tracking.mean += e.squaredNorm() / kTicks;
    }
    EXPECT_FALSE(loop.loop.isStopping()) << loop.loop.stopMessage();
    tracking.mean = std::sqrt(tracking.mean);
    return tracking;
}

TEST(MujocoPlant, NricTracksAsWithSimbody) {
    const Tracking simbody = follow("simbody"), mujoco = follow("mujoco");
    std::printf("  |e| with 3 kg: largest %.3e (simbody), %.3e (mujoco) rad; rms %.3e, %.3e rad\n", simbody.largest,
                mujoco.largest, simbody.mean, mujoco.mean);
    EXPECT_NEAR(mujoco.largest / simbody.largest, 1.0, 0.02);
    EXPECT_NEAR(mujoco.mean / simbody.mean, 1.0, 0.02);
}

// A tree with a slider and a joint order of its own, without a folder: the description itself is written out as URDF.
TEST(MujocoPlant, TakesBranchesSlidersAndDescriptionsWithoutAFolder) {
    TestArm arm("planar_two_link");
    RobotDescription& robot = arm.robot;
    robot = testing::makeTwoLinkArm();
    JointDescription slider = robot.joints[1];
    slider.name = "slider";
    slider.childLink = "carriage";
    slider.type = JointType::Prismatic;
    slider.parent = 0;
    slider.placement.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
    slider.body.inertia(0, 1) = slider.body.inertia(1, 0) = 0.003;
    robot.joints.push_back(slider);
    std::swap(robot.joints[1], robot.joints[2]);
    robot.joints[2].parent = 0;
    robot.toolParent = 2;
    const JointVector ones = JointVector::Ones(3);
    Actuation& actuation = robot.actuation;
    actuation.gearRatio = actuation.encoderCounts = 100.0 * ones;
    actuation.rotorInertia = 0.3 * ones;
    actuation.torqueLimit = 1e3 * ones;
    actuation.friction = {ones, ones, ones};
    robot.limits.position = {-ones, ones};
    robot.home = 0.2 * ones;
    arm.start = {robot.home, 0.3 * ones, 0.0 * ones};
    arm.rebuildModel();
    const std::string text = "friction: none, encoder: exact, substeps: 4, payload_kg: 1, mass_factor: [1, 1.5, 0.7]";
    const PlantPtr mujoco = makePlant(arm, "mujoco", text), simbody = makePlant(arm, "simbody", text);
    for (int tick = 0; tick < 500; ++tick) {
        const JointVector torque = 3.0 * ones;
        advance(*mujoco, torque);
        advance(*simbody, torque);
    }
    EXPECT_GT(calcDistance(simbody->actual(), {arm.start.q, arm.start.qd}), 0.1);
    EXPECT_LE(calcDistance(mujoco->actual(), simbody->actual()), 1e-9);
}

TEST(MujocoPlant, MujocosErrorsDoNotEndTheProcessAndItsWarningsLeaveNoFile) {
    TestArm arm("indy7");
    makePlant(arm, "mujoco", "");
    MujocoPlant own;  // the handlers are the process's: of the class linked in here
    own.configure(arm.setup(), arm.read(PluginKind::RealPlant, "mujoco", ""));
    EXPECT_THROW(mju_error("test"), std::runtime_error);
    mju_warning("test");
    EXPECT_FALSE(std::filesystem::exists("MUJOCO_LOG.TXT"));
    EXPECT_THROW(MujocoModel("<robot name=\"a\"><link"), std::runtime_error);
    arm.robot.folder = "/nowhere";
    expectError({"cannot be read"}, [&] { makePlant(arm, "mujoco", ""); });
}

/** Link `fore` on a joint, and on `base` a part that nothing moves. */
std::string makeUrdf(const std::string& foreInertia, const std::string& standInertia) {
    const std::string rest = " ixy='0' ixz='0' iyz='0'/></inertial></link>";
    return "<robot name='arm'><link name='base'/><joint name='bolts' type='fixed'><parent link='base'/><child "
           "link='stand'/></joint><link name='stand'><inertial><mass value='1'/><inertia " +
           standInertia + rest +
           "<joint name='j' type='continuous'><parent link='stand'/><child link='fore'/><axis xyz='0 1 0'/></joint>"
           "<link name='fore'><inertial><origin xyz='0.1 0 0' rpy='0.3 -0.4 1'/><mass value='2'/><inertia " +
           foreInertia + rest + "</robot>";
}

TEST(MujocoModel, ATensorOfNoBodyIsNamedByItsLink) {
    const std::string good = "ixx='0.01' iyy='0.02' izz='0.02'", bad = "ixx='0.01' iyy='0.02' izz='0.05'";
    const auto findFault = [](const std::string& urdf) -> std::string {
        try {
            MujocoModel(urdf).sharpenInertia();
        } catch (const std::runtime_error& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(findFault(makeUrdf(good, good)), "");
    EXPECT_EQ(findFault(makeUrdf(good, bad)), "");                                                // nothing moves it
    EXPECT_EQ(findFault(makeUrdf("ixx='0.0123457' iyy='0.0234567' izz='0.0358025'", good)), "");  // a plate, rounded
    const std::string fault = findFault(makeUrdf(bad, good));
    for (const char* part :
         {"link `fore`: the inertia tensor belongs to no body", "0.01, 0.02 and 0.05 kg m^2", "Correct its <inertia>"})
        EXPECT_CONTAINS(fault, part);
    // MuJoCo's own errors name the link, too.
    EXPECT_CONTAINS(findFault(makeUrdf("ixx='-0.01' iyy='0.02' izz='0.02'", good)), "link `fore`: MuJoCo: ");
    // What is accepted has the tensor of the URDF.
    MujocoModel model(makeUrdf(good, good));
    model.sharpenInertia();
    const Dynamics still = model.calc(JointVector::Zero(1), JointVector::Zero(1), "fore");
    const Eigen::Vector3d axis =
        (Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.4, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()))
            .inverse() *
        Eigen::Vector3d::UnitY();
    EXPECT_NEAR(still.M(0, 0), axis.dot(Eigen::Vector3d(0.01, 0.02, 0.02).cwiseProduct(axis)) + 2.0 * 0.01, 1e-12);
}

constexpr double kToolRadius = 0.02;

/** A solid whose surface is at `distance` from the tool of the start, on its way `along`. */
Solid makeSolid(TestArm& arm, Solid::Kind kind, const Eigen::Vector3d& along, double distance) {
    Solid solid;
    solid.name = "thing";
    solid.kind = kind;
    solid.size = {0.3, 0.4, 0.2};
    solid.radius = 0.1;
    solid.length = 0.2;
    const double centre = kind == Solid::Kind::HalfSpace ? 0.0 : 0.1;
    solid.pose.linear() = Eigen::Quaterniond::FromTwoVectors(-Eigen::Vector3d::UnitZ(), along).toRotationMatrix();
    solid.pose.translation() = arm.calcDynamics(arm.start).tool.position + (distance + centre) * along;
    return solid;
}

/** Four joints in a row with random axes, places and masses. */
void makeRandomArm(RobotFolder& folder) {
    std::mt19937 random(11);
    const auto draw = [&](double size) {
        const JointVector v = makeRandomVector(3, size, random);
        return std::to_string(v[0]) + " " + std::to_string(v[1]) + " " + std::to_string(v[2]);
    };
    folder.urdf = "<robot name='arm'><link name='l0'/>";
    for (int i = 1; i <= 4; ++i) {
        const std::string link = "l" + std::to_string(i), before = "l" + std::to_string(i - 1);
        folder.urdf += makeJoint("j" + std::to_string(i), "revolute", before, link,
                                 "xyz='0.1 0.05 0.25' rpy='" + draw(1.5) + "'", draw(1.0)) +
                       makeLink(link, 4.0 - 0.7 * i, draw(0.1), draw(1.0), kSomeInertia);
    }
    folder.urdf += makeJoint("flange", "fixed", "l4", "tcp", "xyz='0.1 0 0.1' rpy='0 0 0'", "0 0 1") +
                   "<link name='tcp'/></robot>";
    folder.limits = kSomeLimits;
}

struct Blow {
    double force = 0.0, depth = 0.0;
};

Blow strike(TestArm& arm, const std::string& plant, const std::string& text, const Environment& environment) {
    const PlantPtr real = makePlant(arm, plant, "friction: none, encoder: exact, contact: tool, " + text, &environment);
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    Blow blow;
    bool hasTouched = false;
    for (int tick = 0; tick < 3000 && (!hasTouched || real->contact()->contacts > 0); ++tick) {
        advance(*real, gravity);
        const ContactReport& report = *real->contact();
        hasTouched |= report.contacts > 0;
        EXPECT_EQ(report.obstacle, report.contacts > 0 ? 0 : -1);
        EXPECT_EQ(report.carrier, report.contacts > 0 ? arm.robot.toolParent : -1);
        EXPECT_LE(report.force.norm(), std::hypot(1.0, 0.3001) * report.pressing + 1e-6);  // mu is at most 0.3
        blow.force = std::max(blow.force, report.pressing);
        blow.depth = std::max(blow.depth, report.depth);
    }
    return blow;
}

TEST(MujocoPlant, ABlowIsThatOfSimbodys) {
    RobotFolder folder;
    makeRandomArm(folder);
    using Kind = Solid::Kind;
    const char* const names[] = {"box", "sphere", "cylinder", "half-space", "moving sphere"};
    const char* const arms[] = {"indy7", "panda", "ur5e", "random"};
    for (int k = 0; k < std::min(4, test::countOf(4)); ++k) {
        const char* const name = arms[k];
        const bool isRandom = name == std::string("random");
        TestArm arm(isRandom ? "planar_two_link" : name, 1e-4);
        if (isRandom) arm.robot = folder.load();
        const int n = arm.size();
        arm.limits = arm.robot.limits;
        arm.robot.actuation.torqueLimit.setConstant(n, kInfinity);
        if (isRandom) arm.start = {JointVector::Constant(n, 0.4), JointVector::Zero(n), JointVector::Zero(n)};
        arm.rebuildModel();
        const Eigen::Vector3d along = Eigen::Vector3d(0.3, -0.2, -1.0).normalized();
        for (const double friction : {0.0, 0.3})
            for (int kind = 0; kind < 5; ++kind) {
                double worst = 0.0, hardest = 0.0;
                for (const double stiffness : {2.5e3, 1e5, 1e6})
                    for (const double speed : {0.05, 0.5}) {
                        arm.start.qd.setZero(n);
                        const Eigen::MatrixXd J = arm.calcDynamics(arm.start).J.topRows(3);
                        const bool moves = kind == 4;
                        Environment environment;
                        if (moves) {
                            const Eigen::Vector3d from =
                                arm.calcDynamics(arm.start).tool.position + (0.1 + kToolRadius + 1e-5) * along;
                            environment.spheres.push_back(
                                {"ball", 0.1, {{0.0, from}, {0.1 / speed, from - 0.1 * along}}, false});
                        } else {
                            arm.start.qd = J.completeOrthogonalDecomposition().solve(speed * along);
                            environment.solids.push_back(
                                makeSolid(arm, static_cast<Kind>(kind), along, kToolRadius + 1e-5));
                        }
                        const bool isSoft = stiffness < 1e4;
                        arm.tick_s = isSoft ? 1e-3 : 1e-4;
                        const std::string text = (isSoft ? "substeps: 4" : "substeps: 2") +
                                                 std::string(", contact_stiffness_Npm: ") + std::to_string(stiffness) +
                                                 ", contact_friction: " + std::to_string(friction);
                        const Blow ours = strike(arm, "simbody", text, environment),
                                   theirs = strike(arm, "mujoco", text, environment);
                        hardest = std::max(hardest, ours.force);
                        worst = std::max({worst, std::abs(theirs.force / ours.force - 1.0),
                                          std::abs(theirs.depth / ours.depth - 1.0)});
                    }
                std::printf(
                    "  %s against a %s, friction %.1f: up to %.0f N, peak and depth within %.2g %% of simbody's\n",
                    name, names[kind], friction, hardest, 100.0 * worst);
                EXPECT_GT(hardest, 100.0);
                EXPECT_LE(worst, friction > 0.0 ? 0.15 : 1e-3);
            }
    }
}

TEST(MujocoPlant, AnArmThatLeansOnATablePressesAsItsMotorsSay) {
    const char* const arms[] = {"indy7", "panda", "ur5e"};
    for (int k = 0; k < std::min(3, test::countOf(3)); ++k)
        for (const double stiffness : {2e3, 2e4, 1e6}) {
            const char* const name = arms[k];
            TestArm arm(name);
            Environment environment;
            environment.solids.push_back(
                makeSolid(arm, Solid::Kind::Box, -Eigen::Vector3d::UnitZ(), kToolRadius - 1e-3));
            const PlantPtr plant = makePlant(
                arm, "mujoco",
                "friction: none, encoder: exact, contact: tool, substeps: " + std::to_string(stiffness > 1e5 ? 20 : 4) +
                    ", contact_stiffness_Npm: " + std::to_string(stiffness),
                &environment);
            Vector6 force = Vector6::Zero();
            force[2] = -20.0;
            for (int tick = 0; tick < 2000; ++tick) {
                const JointState& now = plant->actual();
                const Dynamics d = arm.calcDynamics(now.q, now.qd);
                advance(*plant, d.gravity + d.J.transpose() * force - 10.0 * (d.M * now.qd));
            }
            const ContactReport& report = *plant->contact();
            std::printf("  %s at %.0e N/m: %.4f N, %.4f mm deep, %.1e rad/s\n", name, stiffness, report.pressing,
                        1e3 * report.depth, plant->actual().qd.cwiseAbs().maxCoeff());
            EXPECT_LT(plant->actual().qd.cwiseAbs().maxCoeff(), 1e-5);
            EXPECT_NEAR(report.pressing, 20.0, 0.2);
            EXPECT_NEAR(report.force.z(), 20.0, 0.2);
            EXPECT_NEAR(report.depth, 20.0 / stiffness, 0.01 * 20.0 / stiffness);
            const Dynamics d = arm.calcDynamics(plant->actual().q, plant->actual().qd);
            EXPECT_LT((*plant->externalTorque() + d.J.transpose() * force).cwiseAbs().maxCoeff(), 0.2);
        }
}

TEST(MujocoPlant, ContactHoldsWhatItsFrictionCanAndThenSlides) {
    RobotFolder folder;
    folder.urdf = "<robot name='arm'><link name='base'/>" +
                  makeJoint("along", "prismatic", "base", "cart", "xyz='0 0 0' rpy='0 0 0'", "1 0 0") +
                  makeLink("cart", 1e-3, "0 0 0", "0 0 0", kSomeInertia) +
                  makeJoint("up", "prismatic", "cart", "ball", "xyz='0 0 0' rpy='0 0 0'", "0 0 1") +
                  makeLink("ball", 2.0, "0 0 0", "0 0 0", kSomeInertia) + "</robot>";
    folder.limits = kSomeLimits;
    TestArm arm("planar_two_link");
    arm.robot = folder.load();
    arm.limits = arm.robot.limits;
    const double weight = 9.81 * 2.001, most = 0.4 * weight;
    arm.start = {test::joints(0.0, kToolRadius - weight / 1e5), test::joints(0.0, 0.0), test::joints(0.0, 0.0)};
    arm.rebuildModel();
    Environment environment;
    environment.solids.emplace_back();
    environment.solids[0].kind = Solid::Kind::HalfSpace;
    for (const double share : {0.5, 0.95, 1.5}) {
        const PlantPtr plant = makePlant(
            arm, "mujoco", "friction: none, encoder: exact, contact: tool, substeps: 10, contact_friction: 0.4",
            &environment);
        for (int tick = 0; tick < 1000; ++tick) advance(*plant, test::joints(share * most, 0.0));
        const double moved = plant->actual().q[0], free = 0.5 * (share - 1.0) * most / 2.001;
        std::printf("  at %.2f of mu N: %.3e m in 1 s\n", share, moved);
        EXPECT_NEAR(plant->contact()->pressing, weight, 2e-3 * weight);
        EXPECT_NEAR(-plant->contact()->force.x(), std::min(share, 1.0) * most, 0.01 * most);
        if (share < 1.0)
            EXPECT_LT(std::abs(moved), 1e-6);
        else
            EXPECT_NEAR(moved, free, 0.01 * free);
    }
}

TEST(MujocoPlant, CapsulesTouchToo) {
    TestArm arm("indy7");
    const ArmGeometry geometry = loadArmGeometry(arm.robot);
    const auto capsule = std::find_if(geometry.capsules.begin(), geometry.capsules.end(),
                                      [](const LinkCapsule& c) { return c.carrier == 2; });
    ASSERT_NE(capsule, geometry.capsules.end());
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    for (int i = 0; i <= 2; ++i) {
        const JointDescription& joint = arm.robot.joints[static_cast<std::size_t>(i)];
        ASSERT_EQ(joint.parent, i - 1);
        pose = pose * joint.placement;
        pose.rotate(Eigen::AngleAxisd(arm.start.q[i], joint.axis));
    }
    Environment environment;
    environment.solids.emplace_back();
    Solid& ball = environment.solids[0];
    ball.kind = Solid::Kind::Sphere;
    ball.radius = 0.05;
    const Eigen::Vector3d middle = pose * (0.5 * (capsule->a + capsule->b)),
                          aside = (pose.linear() * (capsule->b - capsule->a)).unitOrthogonal();
    ball.pose.translation() = middle + (capsule->radius + 0.05 - 1e-3) * aside;
    const std::string text = "friction: none, contact_stiffness_Npm: 1e4, contact_friction: 0, substeps: 20, contact: ";
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    const PlantPtr tool = makePlant(arm, "mujoco", text + "tool", &environment, &geometry),
                   whole = makePlant(arm, "mujoco", text + "arm", &environment, &geometry);
    advance(*tool, gravity);
    advance(*whole, gravity);
    EXPECT_EQ(tool->contact()->contacts, 0);
    const ContactReport& report = *whole->contact();
    EXPECT_GE(report.contacts, 1);
    EXPECT_EQ(report.carrier, 2);
    EXPECT_NEAR(report.depth, 1e-3, 1e-4);
    EXPECT_LT((report.force + report.pressing * aside).norm(), 0.05 * report.pressing);
    EXPECT_LT((report.point - ball.pose.translation() + (0.05 - 0.5e-3) * aside).norm(), 1e-3);
}

TEST(MujocoPlant, RefusesContactsThatItCannotHave) {
    TestArm arm("indy7");
    Environment environment;
    environment.solids.push_back(makeSolid(arm, Solid::Kind::Cylinder, Eigen::Vector3d::UnitX(), 0.0));
    const auto complain = [&](const std::string& text) {
        return findComplaint([&] { makePlant(arm, "mujoco", text, &environment); });
    };
    EXPECT_EQ(complain("contact: tool, substeps: 10"), "");
    expectContains(complain("contact: tool, contact_stiffness_Npm: 1e8"),
                   {"1 is too few for so stiff a contact", "Write substeps: "});
    EXPECT_CONTAINS(complain("contact: tool, contact_law: hertz"),
                    "Write contact_law: spring, or use the plant simbody");
    EXPECT_CONTAINS(complain("contact: arm"), "how deep a capsule is in the cylinder `thing`");
    environment.map.emplace();
    environment.map->name = "hall";
    EXPECT_CONTAINS(complain("contact: tool"), "each cell of the map `hall`");
    environment = {};
    EXPECT_CONTAINS(complain("contact: tool"), "there is nothing to touch");

    // More that touches at one time than there is room for.
    environment.solids.assign(101, makeSolid(arm, Solid::Kind::Sphere, Eigen::Vector3d::UnitX(), kToolRadius - 1e-5));
    const PlantPtr plant = makePlant(arm, "mujoco", "contact: tool, substeps: 10", &environment);
    JointVector applied;
    EXPECT_EQ(plant->advance(JointVector::Zero(6), applied), TickStatus::Faulted);
    EXPECT_EQ(plant->actual().q, arm.start.q);
}

TEST(MujocoPlant, AdvanceAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    const ArmGeometry geometry = loadArmGeometry(arm.robot);
    Environment environment;
    environment.solids.push_back(makeSolid(arm, Solid::Kind::Box, Eigen::Vector3d::UnitX(), 0.0));
    environment.spheres.push_back({"ball", 0.1, {{0.0, arm.calcDynamics(arm.start).tool.position}}, false});
    const PlantPtr plant = makePlant(arm, "mujoco",
                                     "friction_scale: 2, breakaway_ratio: 1.5, load_friction: 0.1, "
                                     "delay_ticks: 3, torque_ripple_Nm: 1, blocked_joint: 1, contact: arm, "
                                     "substeps: 20",
                                     &environment, &geometry);
    std::mt19937 random(7);
    JointVector applied;
    std::int64_t allocations = 0, contacts = 0;
    for (int tick = 0; tick < 500; ++tick) {
        const JointVector torque = makeRandomVector(6, 100.0, random);
        testing::AllocationCounter counter;
        plant->advance(torque, applied);
        contacts += plant->contact()->contacts;
        if (tick == 250) plant->reset(arm.start);
        allocations += counter.count();
    }
    EXPECT_GT(contacts, 10);
    EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace viable
