#include "MujocoPlant.h"

#include "CaseSupport.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

using PlantPtr = PluginPtr<RealPlant>;

PlantPtr makePlant(TestArm& arm, const std::string& name, const std::string& text) {
    PlantPtr plant = PluginLoader::create<RealPlant>(findPlugin(PluginKind::RealPlant, name));
    plant->configure(arm.setup(), arm.read(PluginKind::RealPlant, name, text));
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
            const double w = 1.0 + 0.3 * i;
            const double wanted = arm.start.q[i] + 0.3 * (1.0 - std::cos(w * t));
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
    const std::string complaint = findComplaint([&] { makePlant(arm, "mujoco", "friction_scale: 40"); });
    EXPECT_CONTAINS(complaint, "too few for the viscous friction");
    EXPECT_CONTAINS(complaint, "Write substeps:");
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
        "friction: none, encoder: exact, blocked_joint: 2, blocked_from_s: 0.1, blocked_until_s: "
        "0.3";
    const PlantPtr mujoco = makePlant(arm, "mujoco", text), simbody = makePlant(arm, "simbody", text);
    const JointVector gravity = arm.calcDynamics(arm.start).gravity;
    double where = 0.0;
    for (int tick = 0; tick < 400; ++tick) {
        advance(*mujoco, gravity);
        advance(*simbody, gravity);
        if (tick == 150) where = mujoco->actual().q[2];
        if (tick > 150 && tick < 300) {
            ASSERT_NEAR(mujoco->actual().q[2], where, 1e-5);
        }
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
    EXPECT_CONTAINS(findComplaint([&] { makePlant(arm, "mujoco", ""); }), "cannot be read");
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

TEST(MujocoPlant, AdvanceAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    const PlantPtr plant = makePlant(arm, "mujoco",
                                     "friction_scale: 2, breakaway_ratio: 1.5, load_friction: 0.1, "
                                     "delay_ticks: 3, torque_ripple_Nm: 1, blocked_joint: 1");
    std::mt19937 random(7);
    JointVector applied;
    std::int64_t allocations = 0;
    for (int tick = 0; tick < 500; ++tick) {
        const JointVector torque = makeRandomVector(6, 100.0, random);
        testing::AllocationCounter counter;
        plant->advance(torque, applied);
        if (tick == 250) plant->reset(arm.start);
        allocations += counter.count();
    }
    EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace viable
