#include <sys/stat.h>

#include <cmath>

#include "RobotFolder.h"

namespace viable {
namespace {

using test::expectContains;
using ::testing::internal::CaptureStderr;
using ::testing::internal::GetCapturedStderr;

struct LoadRobotTest : ::testing::Test {
    LoadRobotTest() { makeSimpleArm(folder_); }
    void change(const std::string& from, const std::string& to) { RobotFolder::replace(folder_.urdf, from, to); }
    std::string findFault() { return folder_.writeAndFindFault(); }
    std::string findLimitsFault(const std::string& limits) {
        folder_.limits = limits;
        return findFault();
    }
    std::string findActuationFault(const std::string& from, const std::string& to) {
        const std::string before = folder_.actuation;
        RobotFolder::replace(folder_.actuation, from, to);
        const std::string fault = findFault();
        folder_.actuation = before;
        return fault;
    }

    RobotFolder folder_;
};

TEST_F(LoadRobotTest, TellsAllThatIsWrongInItsFilesAtOnce) {
    folder_.limits =
        "schema: 1\nhome_rad: TODO\nacceleration_radps2: TODO\njerk_radps3: [100, x]\nvelocity_radps: -1\ntool_lnk: "
        "a\n";
    folder_.actuation =
        "schema: 1\ngear_ratio: [100, 50]\nrotor_inertia_kgm2: TODO\ntorque_limit_Nm: TODO\n"
        "friction: {coulomb_Nm: TODO, viscous_Nm: 3, viscous_velocity_radps: 0}\n";
    expectContains(findFault(), {"9 things are wrong", "home_rad", "acceleration_radps2", "jerk_radps3[1]",
                                 "velocity_radps", "tool_lnk", "rotor_inertia_kgm2", "torque_limit_Nm",
                                 "friction.coulomb_Nm", "friction.viscous_velocity_radps"});
}

TEST_F(LoadRobotTest, AMisspeltKeyIsOneComplaint) {
    folder_.limits = "schema: 1\nhome_rad: [0, 0]\nacceleration_radps2: 4\njerk_radps: 100\nassumed: [jerk_radps3]\n";
    RobotFolder::replace(folder_.actuation, "gear_ratio", "gear_ration");
    RobotFolder::replace(folder_.actuation, "coulomb_Nm", "coulomb_nm");
    expectContains(findFault(), {"3 things are wrong", "Did you mean `jerk_radps3`", "Did you mean `gear_ratio`",
                                 "Did you mean `coulomb_Nm`"});
}

TEST_F(LoadRobotTest, ReadsWhatTheFilesSay) {
    folder_.limits =
        "schema: 1\nhome_rad: [0.1, -0.2]\nacceleration_radps2: {lower: -4, upper: [5, 6]}\n"
        "jerk_radps3: [100, 200]\nvelocity_radps: [1, 2]\nallow_large_angles: true\n";
    folder_.actuation =
        "schema: 1\ngear_ratio: [100, 50]\nrotor_inertia_kgm2: [1e-4, 2e-4]\n"
        "rotor_inertia_source: a guess\ntorque_limit_Nm: [80, .inf]\n"
        "encoder_counts_per_motor_turn: 4096\n"
        "friction: {coulomb_Nm: [1, 2], viscous_Nm: 3, viscous_velocity_radps: 0.5, source: x}\n";
    const RobotDescription robot = folder_.load();
    EXPECT_EQ(robot.name, "arm");
    EXPECT_EQ(robot.jointNames(), (std::vector<std::string>{"shoulder", "elbow"}));
    EXPECT_EQ(robot.toolLink, "fore");
    EXPECT_EQ(robot.toolParent, 1);
    EXPECT_TRUE(robot.toolPlacement.isApprox(Eigen::Isometry3d::Identity()));
    EXPECT_EQ(robot.joints[0].parent, -1);
    EXPECT_EQ(robot.joints[1].parent, 0);
    EXPECT_EQ(robot.joints[1].axis, Eigen::Vector3d::UnitY());
    EXPECT_EQ(robot.joints[1].placement.translation(), Eigen::Vector3d(0.4, 0.0, 0.0));
    EXPECT_EQ(robot.joints[1].body.com, Eigen::Vector3d(0.2, 0.01, 0.0));
    EXPECT_EQ(robot.joints[1].body.inertia(0, 2), -0.002);
    const AxisLimits limits = robot.limits.axis(1);
    EXPECT_EQ(limits.positionLower, -2.0) << "from the URDF";
    EXPECT_EQ(limits.velocityUpper, 2.0) << "limits.yaml goes first";
    EXPECT_EQ(limits.accelerationLower, -4.0);
    EXPECT_EQ(limits.accelerationUpper, 6.0);
    EXPECT_EQ(limits.jerkLower, -200.0);
    EXPECT_TRUE(robot.allowLargeAngles);
    EXPECT_EQ(robot.home[1], -0.2);
    EXPECT_DOUBLE_EQ(robot.actuation.rotorInertia[0], 1.0);
    EXPECT_DOUBLE_EQ(robot.actuation.rotorInertia[1], 0.5);
    EXPECT_EQ(robot.actuation.encoderCounts[1], 4096.0 * 50.0);
    EXPECT_TRUE(std::isinf(robot.actuation.torqueLimit[1]));
    EXPECT_EQ(robot.actuation.friction.viscous[0], 3.0);
}

TEST_F(LoadRobotTest, FixedLinksBelongToTheBodyThatCarriesThem) {
    // A dumb-bell: the carrier and a ball half a metre ahead, turned so that its y axis is along z.
    const char* const ball = "ixx='0.01' iyy='0.02' izz='0.025' ixy='0' ixz='0' iyz='0'";
    folder_.urdf = "<robot name='arm'><link name='base'/>" +
                   makeJoint("spin", "continuous", "base", "bar", "xyz='0 0 0' rpy='0 0 0'", "0 0 2") +
                   makeLink("bar", 1.0, "0 0 0", "0 0 0", ball) +
                   makeJoint("weld", "fixed", "bar", "ball", "xyz='0.5 0 0' rpy='1.5707963267948966 0 0'", "0 0 1") +
                   makeLink("ball", 3.0, "0 0 0", "0 0 0", ball) +
                   makeJoint("tip", "fixed", "ball", "tcp", "xyz='0 0.1 0' rpy='0 0 0'", "0 0 1") +
                   "<link name='tcp'/></robot>";
    const RobotDescription robot = folder_.load();
    ASSERT_EQ(robot.size(), 1);
    const BodyInertia& body = robot.joints[0].body;
    EXPECT_DOUBLE_EQ(body.mass, 4.0);
    EXPECT_TRUE(body.com.isApprox(Eigen::Vector3d(0.375, 0.0, 0.0), 1e-15));
    const double apart = 1.0 * 3.0 / 4.0 * 0.25;  // reduced mass times distance squared
    EXPECT_NEAR(body.inertia(0, 0), 0.01 + 0.01, 1e-15);
    EXPECT_NEAR(body.inertia(1, 1), 0.02 + 0.025 + apart, 1e-15);
    EXPECT_NEAR(body.inertia(2, 2), 0.025 + 0.02 + apart, 1e-15);
    EXPECT_TRUE(robot.toolPlacement.translation().isApprox(Eigen::Vector3d(0.5, 0.0, 0.1), 1e-14));
    EXPECT_EQ(robot.joints[0].axis, Eigen::Vector3d::UnitZ());
    EXPECT_EQ(robot.joints[0].type, JointType::Continuous);
    EXPECT_TRUE(std::isinf(robot.limits.position.upper[0]));
}

TEST_F(LoadRobotTest, KeepsTheOrderOfTheFile) {
    makeBranchedArm(folder_);
    const RobotDescription robot = folder_.load();
    EXPECT_EQ(robot.jointNames(), (std::vector<std::string>{"lift", "right1", "left1", "left2"}));
    EXPECT_EQ(robot.joints[1].parent, 0);
    EXPECT_EQ(robot.joints[2].parent, 0);
    EXPECT_EQ(robot.joints[3].parent, 2);
    EXPECT_EQ(robot.joints[0].type, JointType::Prismatic);
    EXPECT_EQ(robot.toolParent, 3);
}

TEST_F(LoadRobotTest, JointsThatCannotBeSimulatedAreNamed) {
    const std::string elbow = "<joint name='elbow' type='revolute'>";
    change(elbow, "<joint name='elbow' type='floating'>");
    expectContains(findFault(), {"arm.urdf:5:1: ", "joint `elbow` is of type floating",
                                 "revolute, continuous, prismatic and fixed"});
    change("<joint name='elbow' type='floating'>", "<joint name='elbow' type='planar'>");
    expectContains(findFault(), {"joint `elbow` is of type planar"});
    change("<joint name='elbow' type='planar'>", elbow + "<mimic joint='shoulder'/>");
    expectContains(findFault(), {"joint `elbow` mimics joint `shoulder`", "Make it fixed"});
    change("<mimic joint='shoulder'/>", "");
    change("<axis xyz='0 1 0'/>", "<axis xyz='0 0 0'/>");
    expectContains(findFault(), {"the axis of joint `elbow` has no direction"});
}

TEST_F(LoadRobotTest, LimitsWithoutARangeAreNamed) {
    change("<axis xyz='0 1 0'/><limit lower='-2' upper='2' velocity='3'",
           "<axis xyz='0 1 0'/><limit lower='2' upper='-2' velocity='3'");
    expectContains(findFault(),
                   {"arm.urdf:5:1", "position limits of joint `elbow` are 2 to -2 rad", "position_rad in limits.yaml"});
    folder_.limits += "position_rad: 1\n";
    EXPECT_NO_THROW(folder_.load()) << "limits.yaml replaces them";
    change("lower='2' upper='-2' velocity='3'", "lower='-2' upper='2' velocity='0'");
    expectContains(findFault(), {"velocity limits of joint `elbow` are", "velocity_radps"});
    expectContains(findLimitsFault(std::string(kSomeLimits) + "velocity_radps: 1\n"
                                                              "position_rad: {lower: 1, upper: -1}\n"),
                   {"limits.yaml:6:15: position_rad", "are 1 to -1 rad", "must be below the upper"});
}

TEST_F(LoadRobotTest, BodiesThatCannotExistAreNamed) {
    const std::string fore = "<mass value='1.000000'/>";
    change(fore, "<mass value='-1'/>");
    expectContains(findFault(), {"arm.urdf:6:1: ", "link `fore`: the mass is -1"});
    change("<mass value='-1'/>", "<mass value='0'/>");
    expectContains(findFault(), {"link `fore`: there is an inertia without a mass"});
    folder_.urdf = folder_.urdf.substr(0, folder_.urdf.find("<link name='fore'")) + "<link name='fore'/>\n</robot>";
    expectContains(findFault(), {"arm.urdf:6:1: ", "link `fore`, moved by joint `elbow`, has no mass", "<inertial>"});
}

TEST_F(LoadRobotTest, InertiasThatCannotExistAreNamed) {
    const auto tryInertia = [&](const std::string& inertia) {
        makeSimpleArm(folder_);
        const std::size_t at = folder_.urdf.rfind(kSomeInertia);
        folder_.urdf.replace(at, std::string(kSomeInertia).size(), inertia);
        return findFault();
    };
    expectContains(tryInertia("ixx='1' iyy='1' izz='2.1' ixy='0' ixz='0' iyz='0'"),
                   {"link `fore`: the inertia tensor belongs to no body", "principal moments are 1, 1 and 2.1",
                    "above the sum of the other two", "centre of mass"});
    expectContains(tryInertia("ixx='1' iyy='1' izz='1' ixy='1.5' ixz='0' iyz='0'"),
                   {"link `fore`: the inertia tensor is not positive definite"});
    expectContains(tryInertia("ixx='1' iyy='1' izz='0' ixy='0' ixz='0' iyz='0'"),
                   {"link `fore`, moved by joint `elbow`", "not positive definite"});
    expectContains(tryInertia("ixx='nan' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'"), {"arm.urdf"});
}

TEST_F(LoadRobotTest, TreesThatAreNoneAreRefused) {
    change("<parent link='upper'/>", "<parent link='ghost'/>");
    expectContains(findFault(), {"arm.urdf", "ghost", "not found"});
    makeSimpleArm(folder_);
    change("</robot>", makeJoint("loop", "revolute", "base", "fore", "xyz='0 0 0' rpy='0 0 0'", "0 0 1") + "</robot>");
    expectContains(findFault(), {"link `fore` is the child of two joints, `elbow` and `loop`", "open the loop"});
    folder_.urdf = "<robot name='arm'><link name='base'/></robot>";
    expectContains(findFault(), {"has no moving joint"});
    makeSimpleArm(folder_);
    change("<link name='base'/>", "<link name='base'/><link name='base'/>");
    expectContains(findFault(), {"there is a second link `base`", "the first is at line"});
}

TEST_F(LoadRobotTest, MoreJointsThanSupportedAreRefused) {
    folder_.urdf = "<robot name='arm'><link name='l0'/>";
    for (int i = 1; i <= kMaxJoints + 1; ++i) {
        const std::string n = std::to_string(i);
        folder_.urdf += makeJoint("j" + n, "revolute", "l" + std::to_string(i - 1), "l" + n,
                                  "xyz='0.1 0 0' rpy='0 0 0'", i % 2 ? "0 0 1" : "0 1 0") +
                        makeLink("l" + n, 1.0, "0.1 0 0", "0 0 0", kSomeInertia);
    }
    const std::string sixteen = folder_.urdf.substr(0, folder_.urdf.rfind("<joint")) + "</robot>";
    folder_.urdf += "</robot>";
    expectContains(findFault(), {"has 17 moving joints; at most 16 are supported"});
    folder_.urdf = sixteen;
    EXPECT_EQ(folder_.load().size(), kMaxJoints);
}

TEST_F(LoadRobotTest, OtherFormatsAreToldApart) {
    folder_.urdf =
        "<robot name='arm' xmlns:xacro='http://ros.org/wiki/xacro'>\n"
        "<xacro:include filename='other.xacro'/></robot>";
    expectContains(findFault(), {"arm.urdf:2:1: ", "this is xacro input", "<xacro:include>", "Run `xacro"});
    makeSimpleArm(folder_);
    change("xyz='0.4 0 0'", "xyz='${length} 0 0'");
    expectContains(findFault(), {"arm.urdf:5:", "this is xacro input"});
    folder_.urdf = "<sdf version='1.9'><model name='arm'/></sdf>";
    expectContains(findFault(), {"root is <sdf>, not <robot>"});
}

TEST_F(LoadRobotTest, Fault01_WhatIsNoXmlIsToldInWords) {
    folder_.urdf = "<robot name='arm'>\n<link name='base'>\n</joint></robot>";
    expectContains(findFault(),
                   {"arm.urdf:2: ", "this is not XML: an element begins here that is not closed by its own name"});
    for (const std::string attribute : {"name=base", "name='base' name='base'"}) {
        folder_.urdf = "<robot name='arm'>\n\n<link " + attribute + "/></robot>";
        expectContains(findFault(),
                       {"arm.urdf:3: ", "this is not XML: an attribute is not of the form name=\"value\""});
    }
    folder_.urdf = "<robot name='arm'/>\n<?xml version='1.0'?>";
    expectContains(findFault(), {"arm.urdf:2: ", "this is not XML: an <?xml ...?> stands behind the first element"});
    folder_.urdf =
        "<!-- <link/> -->\n<robot name='a>b'><link name='base'/>\n\t<link name='base'/><link name='base'/></robot>";
    expectContains(findFault(), {"arm.urdf:3:2: ", "arm.urdf:3:21: ", "the first is at line 2"});
}

TEST_F(LoadRobotTest, Fault01_BrokenUrdfIsRefusedQuietly) {
    const std::string whole = folder_.urdf;
    CaptureStderr();
    for (std::size_t length = 0; length + 10 < whole.size(); length += 7) {
        folder_.urdf = whole.substr(0, length);
        expectContains(findFault(), {"arm.urdf"});
    }
    folder_.urdf = std::string(
        "\x7f"
        "ELF\0\1\2",
        7);
    expectContains(findFault(), {"arm.urdf", "binary"});
    folder_.urdf = "";
    expectContains(findFault(), {"the file is empty"});
    change("", "<robot name='arm'>");
    for (int i = 0; i < 100000; ++i) folder_.urdf += "<a>";
    expectContains(findFault(), {"nested deeper than 64 levels"});
    folder_.urdf = whole + std::string(5 << 20, ' ');
    expectContains(findFault(), {"bytes; at most 4194304 are read"});
    EXPECT_EQ(GetCapturedStderr(), "") << "urdfdom's messages are in the error instead";
}

TEST_F(LoadRobotTest, Fault02_UnknownKeysAreRefused) {
    expectContains(findLimitsFault(std::string(kSomeLimits) + "velocity_radp: 1\n"),
                   {"limits.yaml:5:", "velocity_radp", "Did you mean `velocity_radps`?"});
    expectContains(findLimitsFault(std::string(kSomeLimits) + "velocity_radps: {lowr: 1}\n"),
                   {"limits.yaml:5:", "lower"});
    expectContains(findLimitsFault("schema: 2\nhome_rad: 0\n"), {"limits.yaml:1:9: schema"});
    makeSimpleArm(folder_);
    expectContains(findActuationFault("gear_ratio: 1", "gear_ratio: 1\ngears: 2"), {"actuation.yaml:3:", "gears"});
    expectContains(findActuationFault("coulomb_Nm: 0", "coulomb_Nm: 0, stiction_Nm: 1"), {"friction.stiction_Nm"});
}

TEST_F(LoadRobotTest, MissingKeysAreNamed) {
    expectContains(findLimitsFault("schema: 1\nacceleration_radps2: 1\njerk_radps3: 1\n"),
                   {"limits.yaml", "`home_rad` is missing"});
    expectContains(findLimitsFault("schema: 1\nhome_rad: 0\njerk_radps3: 1\n"), {"`acceleration_radps2` is missing"});
    expectContains(findLimitsFault("schema: 1\nhome_rad: 0\nacceleration_radps2: 1\n"), {"`jerk_radps3` is missing"});
    makeSimpleArm(folder_);
    expectContains(findActuationFault("rotor_inertia_kgm2: 0\n", ""), {"`rotor_inertia_kgm2` is missing"});
    expectContains(findActuationFault("torque_limit_Nm: .inf\n", ""), {"`torque_limit_Nm` is missing"});
}

TEST_F(LoadRobotTest, Fault05_WrongSizesAreRefused) {
    expectContains(findLimitsFault("schema: 1\nhome_rad: [0, 0, 0]\nacceleration_radps2: 1\n"
                                   "jerk_radps3: 1\n"),
                   {"limits.yaml:2:11: home_rad", "a list of 2"});
    makeSimpleArm(folder_);
    expectContains(findActuationFault("gear_ratio: 1", "gear_ratio: [1, 1, 1]"), {"actuation.yaml:2:13: gear_ratio"});
}

TEST_F(LoadRobotTest, ValuesOutOfRangeAreRefused) {
    expectContains(findActuationFault("gear_ratio: 1", "gear_ratio: 0"), {"gear_ratio", "(0, inf)"});
    expectContains(findActuationFault("rotor_inertia_kgm2: 0", "rotor_inertia_kgm2: -1e-5"),
                   {"rotor_inertia_kgm2", "[0, inf)"});
    expectContains(findActuationFault("torque_limit_Nm: .inf", "torque_limit_Nm: [10, 0]"),
                   {"torque_limit_Nm[1]", "(0, inf) or .inf"});
    expectContains(findActuationFault("coulomb_Nm: 0", "coulomb_Nm: -1"), {"friction.coulomb_Nm"});
    expectContains(findActuationFault("viscous_Nm: 0", "viscous_Nm: .inf"), {"friction.viscous_Nm"});
    expectContains(findActuationFault("velocity_radps: 1", "velocity_radps: 0"),
                   {"friction.viscous_velocity_radps", "(0, inf)"});
    expectContains(findLimitsFault(std::string(kSomeLimits) + "velocity_radps: -1\n"),
                   {"limits.yaml:5:17: velocity_radps", "(0, inf) or .inf"});
    expectContains(findLimitsFault("schema: 1\nhome_rad: [0, 2.5]\nacceleration_radps2: 1\n"
                                   "jerk_radps3: 1\n"),
                   {"limits.yaml:2:11: home_rad", "joint `elbow` is 2.5 rad", "[-2, 2] rad"});
}

TEST_F(LoadRobotTest, TheToolMustBeClear) {
    makeBranchedArm(folder_);
    expectContains(findLimitsFault(kSomeLimits),
                   {"`tool_link` is missing", "several links: `l2`, `r1`", "`tool_link: l2`"});
    expectContains(findLimitsFault(std::string(kSomeLimits) + "tool_link: truk\n"),
                   {"limits.yaml:5:12: tool_link", "no link `truk`", "Did you mean `trunk`?"});
    expectContains(findLimitsFault(std::string(kSomeLimits) + "tool_link: base\n"), {"`base` is fixed to the base"});
    folder_.limits = std::string(kSomeLimits) + "tool_link: trunk\n";
    EXPECT_EQ(folder_.load().toolParent, 0) << "any moving link will do";
}

TEST_F(LoadRobotTest, Fault11_MissingFilesAreNamed) {
    namespace fs = std::filesystem;
    const fs::path path = folder_.write();
    for (const char* name : {"limits.yaml", "actuation.yaml", "arm.urdf"}) {
        folder_.write();
        fs::remove(path / name);
        expectContains(folder_.findFault(),
                       {"the file ", name, " is missing", "NAME.urdf, limits.yaml and actuation.yaml"});
    }
    folder_.put("robot.urdf", folder_.urdf);
    expectContains(folder_.findFault(), {"the file arm.urdf is missing", "There is robot.urdf", "the folder's name"});
    fs::rename(path / "robot.urdf", path / "arm.urdf.xacro");
    expectContains(folder_.findFault(), {"arm.urdf is missing", "`xacro arm.urdf.xacro > arm.urdf`"});
    fs::remove_all(path);
    expectContains(folder_.findFault(), {"there is no such robot folder"});
    std::ofstream(path.string()) << "x";
    expectContains(folder_.findFault(), {"this is not a folder"});
}

TEST_F(LoadRobotTest, Fault11_OnlyPlainFilesInsideTheFolderAreRead) {
    namespace fs = std::filesystem;
    const fs::path path = folder_.write();
    for (const char* name : {"limits.yaml", "actuation.yaml", "arm.urdf"}) {
        const fs::path file = path / name;
        folder_.write();
        fs::remove(file);
        fs::create_directory(file);
        expectContains(folder_.findFault(), {name, "this is a folder, not a file"});
        fs::remove(file);
        fs::create_symlink("nowhere", file);
        expectContains(folder_.findFault(), {name, "a link to nowhere, which does not exist"});
        fs::remove(file);
        fs::create_symlink(file, file);
        expectContains(folder_.findFault(), {name});
        fs::remove(file);
        std::ofstream(folder_.temporary.path() / "outside") << folder_.limits;
        fs::create_symlink("../outside", file);
        expectContains(folder_.findFault(), {name, "outside the robot's folder"});
        fs::remove(file);
        ASSERT_EQ(mkfifo(file.c_str(), 0600), 0);
        expectContains(folder_.findFault(), {name, "not a plain file"});
        fs::remove(file);
    }
    folder_.write();
    fs::rename(path / "limits.yaml", path / "limits-slow.yaml");
    fs::create_symlink("limits-slow.yaml", path / "limits.yaml");
    EXPECT_NO_THROW(loadRobot(path)) << "a link within the folder";
    fs::create_directory_symlink(path, folder_.temporary.path() / "arm2");
    EXPECT_THROW(loadRobot(folder_.temporary.path() / "arm2"), Error) << "has no arm2.urdf";
    EXPECT_EQ(loadRobot(path.string() + "/").name, "arm");
    EXPECT_EQ(loadRobot(path / ".").name, "arm");
}

TEST_F(LoadRobotTest, Fault21_ArmsThatAreNearlySingularAreRefused) {
    const auto tryLightHand = [&](double scale) {
        makeSimpleArm(folder_);
        char mass[32], moment[32];
        std::snprintf(mass, sizeof mass, "%.3e", scale);
        std::snprintf(moment, sizeof moment, "%.3e", scale * 1e-3);
        const std::string m = moment;
        change("</robot>", makeJoint("wrist", "revolute", "fore", "hand", "xyz='0.3 0 0' rpy='0 0 0'", "1 0 0") +
                               "<link name='hand'><inertial><mass value='" + mass + "'/><inertia ixx='" + m +
                               "' iyy='" + m + "' izz='" + m + "' ixy='0' ixz='0' iyz='0'/></inertial></link></robot>");
        folder_.write();
    };
    tryLightHand(1e-9);
    expectContains(folder_.findFault(), {"arm.urdf", "too near to singular", "mainly joint `wrist`",
                                         "mainly joint `shoulder`", "rotor inertia"});
    RobotFolder::replace(folder_.actuation, "rotor_inertia_kgm2: 0", "rotor_inertia_kgm2: 0.01");
    EXPECT_NO_THROW(folder_.load()) << "a rotor inertia is a remedy";
    RobotFolder::replace(folder_.actuation, "rotor_inertia_kgm2: 0.01", "rotor_inertia_kgm2: 0");
    tryLightHand(1e-4);
    EXPECT_NO_THROW(folder_.load());
}

TEST_F(LoadRobotTest, PayloadsAndFactorsAreChecked) {
    const RobotDescription robot = folder_.load();
    EXPECT_THROW(withPayload(robot, -1.0, Eigen::Vector3d::Zero()), Error);
    EXPECT_THROW(withPayload(robot, std::nan(""), Eigen::Vector3d::Zero()), Error);
    EXPECT_THROW(withScaledMasses(robot, JointVector::Zero(2)), Error);
    const RobotDescription same = withPayload(robot, 0.0, Eigen::Vector3d::Ones());
    EXPECT_EQ(same.joints[1].body.com, robot.joints[1].body.com);
    EXPECT_EQ(same.joints[1].body.inertia, robot.joints[1].body.inertia);
    EXPECT_DOUBLE_EQ(withPayload(robot, 2.0, Eigen::Vector3d::Ones()).joints[1].body.mass, 3.0);
}

}  // namespace
}  // namespace viable
