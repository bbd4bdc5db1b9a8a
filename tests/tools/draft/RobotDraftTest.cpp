#include "Paths.h"
#include "draft/RobotDraft.h"

#include <cmath>
#include <random>

#include "RobotFolder.h"

namespace viable {
namespace {

/** One link on one joint; each test spoils one figure. */
struct RobotDraftTest : ::testing::Test {
    std::string joint_ = "type='revolute'";
    std::string limit_ = "lower='-1' upper='2' velocity='3' effort='40'";
    std::string com_ = "0.2 0 0";
    std::string mass_ = "2";
    std::string inertia_ = "ixx='0.003' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'";
    std::string visual_ = "<cylinder radius='0.05' length='0.4'/>";
    std::string more_;

    RobotDraft read() const {
        const std::filesystem::path file = folder_.path() / "arm.urdf";
        std::ofstream(file) << "<robot name='arm'>\n<link name='base'/>\n<joint name='j' " << joint_
                            << "><parent link='base'/><child link='l'/><axis xyz='0 0 1'/><limit " << limit_
                            << "/></joint>\n<link name='l'><inertial><origin xyz='" << com_ << "'/><mass value='"
                            << mass_ << "'/><inertia " << inertia_
                            << "/></inertial><visual><origin xyz='0.2 0 0' rpy='0 1.57 0'/>"
                            << "<geometry>" << visual_ << "</geometry></visual></link>\n"
                            << more_ << "</robot>\n";
        return readRobotDraft(file);
    }
    /** The single warning there is. */
    std::string warning() const {
        const RobotDraft draft = read();
        EXPECT_EQ(draft.warnings.size(), 1u);
        return draft.warnings.empty() ? "" : draft.warnings.front();
    }
    void expectWarning(const std::string& place, const std::vector<std::string>& parts) const {
        const std::string text = warning();
        EXPECT_CONTAINS(text, "arm.urdf:" + place);
        for (const std::string& part : parts) EXPECT_CONTAINS(text, part);
    }
    void expectLink(const std::vector<std::string>& parts) const { expectWarning("4:1: link `l`: ", parts); }

    TemporaryFolder folder_;
};

TEST_F(RobotDraftTest, ASoundArmIsReadWithoutAWarning) {
    const RobotDraft draft = read();
    EXPECT_EQ(draft.warnings, std::vector<std::string>{});
    ASSERT_EQ(draft.joints.size(), 1u);
    const DraftJoint& joint = draft.joints[0];
    EXPECT_EQ(joint.name, "j");
    EXPECT_EQ(joint.positionLower, -1.0);
    EXPECT_EQ(joint.positionUpper, 2.0);
    EXPECT_EQ(joint.velocity, 3.0);
    EXPECT_EQ(joint.effort, 40.0);
    EXPECT_EQ(joint.home, 0.0);
    EXPECT_EQ(draft.toolLinks, std::vector<std::string>{"l"});
    EXPECT_TRUE(draft.meshes.empty());
}

TEST_F(RobotDraftTest, TheProjectsOwnRobotsAreSound) {
    for (const char* name : {"indy7", "panda", "ur5e", "planar_two_link"}) {
        const auto file = std::filesystem::path(VIABLE_SOURCE_DIR) / "robots" / name;
        EXPECT_EQ(readRobotDraft(file / (std::string(name) + ".urdf")).warnings, std::vector<std::string>{}) << name;
    }
}

TEST_F(RobotDraftTest, HomeIsZeroOrTheMiddleWhereZeroIsAtAnEndOrOutside) {
    limit_ = "lower='-0.1' upper='3' velocity='3' effort='40'";
    EXPECT_DOUBLE_EQ(read().joints[0].home, 1.45);
    limit_ = "lower='-3' upper='-1' velocity='3' effort='40'";
    EXPECT_DOUBLE_EQ(read().joints[0].home, -2.0);
}

TEST_F(RobotDraftTest, ContinuousJointsHaveNoEndAndMayLackALimitOfVelocity) {
    joint_ = "type='continuous'";
    limit_ = "effort='40' velocity='2'";
    const RobotDraft draft = read();
    EXPECT_TRUE(draft.warnings.empty());
    EXPECT_EQ(draft.joints[0].positionLower, -kInfinity);
    EXPECT_EQ(draft.joints[0].positionUpper, kInfinity);
    limit_ = "effort='40' velocity='0'";
    expectWarning("3:1: joint `j`: ", {"it has no velocity limit", "velocity_radps is left"});
    EXPECT_TRUE(std::isnan(read().joints[0].velocity));
}

TEST_F(RobotDraftTest, LimitsThatCannotBeMeantAreLeftBlank) {
    const std::string place = "3:1: joint `j`: ";
    limit_ = "lower='0' upper='0' velocity='3' effort='40'";
    expectWarning(place, {"position limits are 0 to 0, which leaves no range", "position_rad"});
    EXPECT_TRUE(std::isnan(read().joints[0].positionLower));
    limit_ = "lower='-170' upper='170' velocity='3' effort='40'";
    expectWarning(place, {"-170 to 170, more than two turns", "perhaps degrees"});
    EXPECT_TRUE(std::isnan(read().joints[0].positionUpper));
    limit_ = "lower='-1' upper='1' velocity='0' effort='40'";
    expectWarning(place, {"its velocity limit is 0, so it could not move"});
    limit_ = "lower='-1' upper='1' velocity='3' effort='0'";
    expectWarning(place, {"its effort limit is 0 or missing", "torque_limit_Nm is left"});
    EXPECT_TRUE(std::isnan(read().joints[0].effort));
    limit_ = "lower='-1' upper='1' velocity='3' effort='-4'";
    expectWarning(place, {"its effort limit is -4"});
    joint_ = "type='prismatic'";  // metres may be many
    limit_ = "lower='-1' upper='20' velocity='3' effort='40'";
    EXPECT_TRUE(read().warnings.empty());
    limit_ = "lower='0' upper='500' velocity='3' effort='40'";
    expectWarning(place, {"0 to 500 m, longer than any slide", "perhaps millimetres"});
}

TEST_F(RobotDraftTest, InertiasOfAnotherUnitAreTold) {
    inertia_ = "ixx='3000' iyy='20000' izz='20000' ixy='0' ixz='0' iyz='0'";  // kg mm^2
    expectLink({"its inertia is too large for its mass of 2 kg", "radius of gyration is 100 m", "is it in kg mm^2"});
    inertia_ = "ixx='3' iyy='20' izz='20' ixy='0' ixz='0' iyz='0'";  // g m^2
    expectLink({"its inertia is too large", "radius of gyration is 3.16 m"});
    inertia_ = "ixx='3e-6' iyy='2e-5' izz='2e-5' ixy='0' ixz='0' iyz='0'";  // t m^2
    expectLink({"its inertia is too small", "0.00316 m, but the link reaches 0.206 m"});
    inertia_ = "ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'";
    expectLink({"its inertia is too large", "a placeholder?"});
}

TEST_F(RobotDraftTest, MassesInGramsAndCentresInMillimetresAreTold) {
    mass_ = "2000";
    inertia_ = "ixx='3' iyy='20' izz='20' ixy='0' ixz='0' iyz='0'";
    expectLink({"its mass is 2e+03 kg", "are these grams?"});
    mass_ = "2";
    inertia_ = "ixx='0.003' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'";
    com_ = "200 0 0";
    const RobotDraft draft = read();
    ASSERT_FALSE(draft.warnings.empty());
    EXPECT_CONTAINS(draft.warnings[0], "link `l`: its centre of mass is 200 m from the link's origin");
}

TEST_F(RobotDraftTest, PartsWithoutMassOrThicknessAreTold) {
    inertia_ = "ixx='0' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'";
    more_ =
        "<joint name='f' type='fixed'><parent link='l'/><child link='m'/></joint><link "
        "name='m'><inertial><mass value='1'/><inertia ixx='0.003' iyy='0.003' izz='0.003' "
        "ixy='0' ixz='0' iyz='0'/></inertial></link>";
    expectLink({"its smallest principal moment of inertia is zero, as of a rod"});
    inertia_ = "ixx='0' iyy='0' izz='0' ixy='0' ixz='0' iyz='0'";
    expectLink({"it has a mass but no inertia, as a point has"});
    mass_ = "0";
    expectLink({"it is drawn but has no mass, so it weighs nothing"});
}

TEST_F(RobotDraftTest, MeshesAreNamedOnce) {
    visual_ = "<mesh filename='package://arm/link.stl'/>";
    more_ =
        "<joint name='f' type='fixed'><parent link='l'/><child link='m'/></joint><link "
        "name='m'><inertial><mass value='1'/><inertia ixx='0.003' iyy='0.003' izz='0.003' "
        "ixy='0' ixz='0' iyz='0'/></inertial><visual><geometry>" +
        visual_ + "</geometry></visual></link>";
    EXPECT_EQ(read().meshes, std::vector<std::string>{"package://arm/link.stl"});
}

// ------------------------------------------------------------------------------------ collision

double calcDistance(const Eigen::Vector3d& p, const DraftCapsule& c) {
    const Eigen::Vector3d along = c.to - c.from;
    const double length2 = along.squaredNorm();
    const double t = length2 == 0.0 ? 0.0 : std::clamp((p - c.from).dot(along) / length2, 0.0, 1.0);
    return (p - c.from - t * along).norm() - c.radius;
}

double calcVolume(const DraftCapsule& c) {
    return EIGEN_PI * c.radius * c.radius * ((c.to - c.from).norm() + 4.0 / 3.0 * c.radius);
}

/** The arm of RobotDraftTest with a collision element, at a slanted place, in front of its visual one. */
struct CapsuleTest : RobotDraftTest {
    std::string collision_ = "<box size='0.3 0.2 0.1'/>";

    DraftCapsule draft() {
        visual_ =
            "<sphere radius='9'/></geometry></visual><collision><origin xyz='0.1 -0.2 0.3' "
            "rpy='0.4 -0.5 0.6'/><geometry>" +
            collision_ + "</geometry></collision><visual><geometry><sphere radius='9'/>";
        for (const DraftLink& link : read().links)
            if (link.name == "l" && link.capsules.size() == 1) return link.capsules[0];
        throw std::runtime_error("not one capsule");
    }
    /** Where the collision element is. */
    Eigen::Isometry3d pose() const {
        return Eigen::Translation3d(0.1, -0.2, 0.3) * Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()) *
               Eigen::AngleAxisd(-0.5, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX());
    }
    /** `draw` gives points of the shape, in its own frame: all must be inside, and some at the surface. */
    template <class Draw>
    void expectContains(const DraftCapsule& capsule, const Draw& draw, double slack) {
        double farthest = -1.0;
        for (int i = 0; i < 20000; ++i) farthest = std::max(farthest, calcDistance(pose() * draw(), capsule));
        EXPECT_LE(farthest, 0.0);
        EXPECT_GT(farthest, -slack) << "larger than it need be";
    }
    double between(double lower, double upper) { return std::uniform_real_distribution<>(lower, upper)(random_); }
    std::mt19937_64 random_{1};
};

TEST_F(CapsuleTest, ABoxIsInside) {
    for (const Eigen::Vector3d& size : {Eigen::Vector3d(0.3, 0.2, 0.1), {0.05, 0.05, 1.0}, {1, 1, 1}}) {
        collision_ = "<box size='" + std::to_string(size.x()) + " " + std::to_string(size.y()) + " " +
                     std::to_string(size.z()) + "'/>";
        const DraftCapsule capsule = draft();
        expectContains(
            capsule,
            [&] {
                Eigen::Vector3d corner;
                for (int k = 0; k < 3; ++k) corner[k] = 0.5 * size[k] * (between(0, 1) < 0.5 ? -1 : 1);
                return corner;
            },
            1e-3);
        // No larger than the ball around the box.
        EXPECT_LE(calcVolume(capsule), EIGEN_PI / 6 * std::pow(size.norm() + 1e-3, 3));
    }
}

TEST_F(CapsuleTest, ACylinderIsInside) {
    for (const auto& [radius, length] : {std::pair(0.06, 0.4), std::pair(0.2, 0.02), std::pair(0.001, 0.5)}) {
        collision_ = "<cylinder radius='" + std::to_string(radius) + "' length='" + std::to_string(length) + "'/>";
        const DraftCapsule capsule = draft();
        expectContains(
            capsule,
            [&, r = radius, l = length] {
                const double angle = between(-4, 4);
                return Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle),
                                       between(0, 1) < 0.5 ? -0.5 * l : 0.5 * l);
            },
            0.01 * radius + 1e-3);
    }
    collision_ = "<cylinder radius='0.06' length='0.4'/>";  // a long one's capsule lies along it
    const DraftCapsule capsule = draft();
    const Eigen::Vector3d along = (capsule.to - capsule.from).normalized();
    EXPECT_GT(std::abs(along.dot(pose().linear().col(2))), 0.999);
    EXPECT_LT(capsule.radius, 0.07);
}

TEST_F(CapsuleTest, ASphereIsACapsuleWithoutLength) {
    collision_ = "<sphere radius='0.12'/>";
    const DraftCapsule capsule = draft();
    EXPECT_EQ(capsule.from, capsule.to);
    EXPECT_LE((capsule.from - pose().translation()).norm() + 0.12, capsule.radius);
    EXPECT_LT(capsule.radius, 0.1203);
}

TEST_F(CapsuleTest, AMeshIsInside) {
    for (int mesh = 0; mesh < 20; ++mesh) {
        // A cloud of triangles, long, flat or round, off its own frame.
        const Eigen::Vector3d size(between(0.01, 0.5), between(0.01, 0.5), between(0.01, 0.5));
        std::vector<Eigen::Vector3d> points;
        std::string text;
        for (int i = 0; i < 300; ++i) {
            points.emplace_back(size.x() * between(-1, 1) + 0.1, size.y() * between(-1, 1),
                                size.z() * between(-1, 1) * between(0, 1));
            text += "v";
            for (const double x : points.back()) text += " " + std::to_string(x);
            text += "\n";
        }
        for (int i = 0; i < 300; i += 3)
            text += "f " + std::to_string(i + 1) + " " + std::to_string(i + 2) + " " + std::to_string(i + 3) + "\n";
        std::ofstream(folder_.path() / "link.obj") << text;
        collision_ = "<mesh filename='package://arm_description/link.obj' scale='1 2 1'/>";
        std::size_t next = 0;
        expectContains(
            draft(),
            [&] {
                const Eigen::Vector3d& a = points[next++ % points.size()];
                // Six decimals were written.
                return Eigen::Vector3d(a.cwiseProduct(Eigen::Vector3d(1, 2, 1)) * (1.0 - 1e-5));
            },
            2e-3);
    }
}

// A rod of 1 m along z, in a file that calls z up: it stays along z, as ROS reads it.
TEST_F(CapsuleTest, AColladaFilesOwnAxesCount) {
    for (const char* up : {"X_UP", "Y_UP", "Z_UP"}) {
        std::ofstream(folder_.path() / "rod.dae")
            << "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
               "<asset><unit name='meter' meter='1'/><up_axis>"
            << up
            << "</up_axis></asset>"
               "<library_geometries><geometry id='g'><mesh><source id='p'><float_array id='a' count='12'>"
               "0 0 0 0.01 0 0 0 0.01 0 0 0 1</float_array><technique_common><accessor source='#a' count='4' "
               "stride='3'>"
               "<param name='X' type='float'/><param name='Y' type='float'/><param name='Z' type='float'/></accessor>"
               "</technique_common></source><vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
               "<triangles count='4'><input semantic='VERTEX' source='#v' offset='0'/>"
               "<p>0 1 2 0 1 3 0 2 3 1 2 3</p></triangles></mesh></geometry></library_geometries>"
               "<library_visual_scenes><visual_scene id='s'><node id='n'><instance_geometry url='#g'/></node>"
               "</visual_scene></library_visual_scenes><scene><instance_visual_scene url='#s'/></scene></COLLADA>\n";
        collision_ = "<mesh filename='package://arm_description/rod.dae'/>";
        const DraftCapsule capsule = draft();
        EXPECT_GT(std::abs((capsule.to - capsule.from).normalized().dot(pose().linear().col(2))), 0.999) << up;
    }
}

TEST_F(CapsuleTest, AMeshThatIsNotThereIsTold) {
    collision_ = "<mesh filename='package://arm_description/gone.stl'/>";
    EXPECT_THROW(draft(), std::runtime_error);
    const RobotDraft lost = read();
    ASSERT_EQ(lost.links.size(), 2u);
    EXPECT_EQ(lost.links[1].lostMeshes, std::vector<std::string>{"package://arm_description/gone.stl"});
    EXPECT_TRUE(lost.links[1].capsules.empty());
}

TEST_F(CapsuleTest, AMeshIsFoundInThePackageAroundTheUrdf) {
    const std::filesystem::path package = folder_.path() / "source/arm_description";
    std::filesystem::create_directories(package / "urdf");
    std::filesystem::create_directories(package / "meshes");
    std::ofstream(package / "meshes/link.obj") << "v 0 0 0\nv 1 0 0\nv 0 0.1 0\nf 1 2 3\n";
    for (const char* name : {"package://arm_description/meshes/link.obj", "../meshes/link.obj"}) {
        collision_ = std::string("<mesh filename='") + name + "'/>";
        EXPECT_THROW(draft(), std::runtime_error);  // seen from elsewhere
        std::filesystem::copy_file(folder_.path() / "arm.urdf", package / "urdf/arm.urdf",
                                   std::filesystem::copy_options::overwrite_existing);
        EXPECT_EQ(readRobotDraft(package / "urdf/arm.urdf").links.at(1).capsules.size(), 1u);
    }
}

TEST(DraftContacts, AreNeighboursAndWhatIsNearInNearlyAllPoses) {
    // A wrist so short that hand and fore arm overlap; the base is far from both.
    const auto shape = [](const std::string& geometry) {
        return "<collision><geometry>" + geometry + "</geometry></collision></link>";
    };
    const auto link = [&](const std::string& name, const std::string& geometry) {
        std::string text = makeLink(name, 1.0, "0 0 0", "0 0 0", kSomeInertia);
        RobotFolder::replace(text, "</link>", shape(geometry));
        return text;
    };
    TemporaryFolder folder;
    std::ofstream(folder.path() / "arm.urdf")
        << "<robot name='arm'><link name='base'>" + shape("<sphere radius='0.1'/>") +
               makeJoint("j1", "revolute", "base", "fore", "xyz='0 0 1'", "0 0 1") +
               link("fore", "<sphere radius='0.1'/>") +
               makeJoint("j2", "revolute", "fore", "wrist", "xyz='0 0 0.05'", "0 1 0") +
               link("wrist", "<sphere radius='0.02'/>") +
               makeJoint("j3", "revolute", "wrist", "hand", "xyz='0 0 0.05'", "1 0 0") +
               link("hand", "<sphere radius='0.1'/>") + makeJoint("f", "fixed", "hand", "tip", "xyz='0 0 1'", "0 0 1") +
               "<link name='tip'/></robot>";
    const RobotDraft draft = readRobotDraft(folder.path() / "arm.urdf");
    std::vector<std::string> found;
    for (const DraftContact& c : draft.contacts) found.push_back(c.first + " " + c.second + ": " + c.reason);
    EXPECT_EQ(found, (std::vector<std::string>{"base fore: next to each other", "fore wrist: next to each other",
                                               "wrist hand: next to each other",
                                               "fore hand: nearer than 2 cm in 100.0 % of 1000 random poses"}));
    ASSERT_EQ(draft.links.size(), 5u);
    EXPECT_TRUE(draft.links.back().capsules.empty());
    EXPECT_TRUE(draft.links.back().lostMeshes.empty());
}

}  // namespace
}  // namespace viable
