#include "viable/robot/RobotDraft.h"

#include <cmath>
#include <limits>

#include "RobotFolder.h"

namespace viable {
namespace {

/** One link on one joint; each test spoils one figure. */
class RobotDraftTest : public ::testing::Test {
protected:
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
                            << "><parent link='base'/><child link='l'/><axis xyz='0 0 1'/><limit "
                            << limit_ << "/></joint>\n<link name='l'><inertial><origin xyz='"
                            << com_ << "'/><mass value='" << mass_ << "'/><inertia " << inertia_
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
        EXPECT_NE(text.find("arm.urdf:" + place), std::string::npos) << text;
        for (const std::string& part : parts)
            EXPECT_NE(text.find(part), std::string::npos) << "no: " << part << "\nin: " << text;
    }
    void expectLink(const std::vector<std::string>& parts) const {
        expectWarning("4:1: link `l`: ", parts);
    }

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
        const RobotDraft draft = readRobotDraft(file / (std::string(name) + ".urdf"));
        EXPECT_EQ(draft.warnings, std::vector<std::string>{}) << name;
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
    EXPECT_EQ(draft.joints[0].positionLower, -std::numeric_limits<double>::infinity());
    EXPECT_EQ(draft.joints[0].positionUpper, std::numeric_limits<double>::infinity());
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
}

TEST_F(RobotDraftTest, InertiasOfAnotherUnitAreTold) {
    inertia_ = "ixx='3000' iyy='20000' izz='20000' ixy='0' ixz='0' iyz='0'";  // kg mm^2
    expectLink({"its inertia is too large for its mass of 2 kg", "radius of gyration is 100 m",
                "is it in kg mm^2"});
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
    EXPECT_NE(
        draft.warnings[0].find("link `l`: its centre of mass is 200 m from the link's origin"),
        std::string::npos)
        << draft.warnings[0];
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

}  // namespace
}  // namespace viable
