#include <chrono>

#include "RobotFolder.h"
#include "core/Text.h"
#include "draft/RobotDraft.h"
#include "robot/ArmRecursion.h"
#include "robot/urdf/UrdfReader.h"

namespace viable::test {
namespace {

constexpr const char* kBody =
    "<inertial><origin xyz='0.1 0 0'/><mass value='2'/>"
    "<inertia ixx='0.01' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'/></inertial>";
constexpr const char* kRange = "lower='-2' upper='2' effort='30' velocity='2'";

std::string writeLink(const std::string& name, const std::string& inside = kBody) {
    return "<link name='" + name + "'>" + inside + "</link>\n";
}

std::string writeJoint(const std::string& name, const std::string& parent, const std::string& child,
                       const std::string& more = {}, const std::string& type = "revolute",
                       const std::string& limit = kRange) {
    return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent + "'/><child link='" + child +
           "'/><origin xyz='0.3 0 0.1' rpy='0.2 0.3 0.4'/><axis xyz='0 1 0'/>" +
           (limit.empty() ? "" : "<limit " + limit + "/>") + more + "</joint>\n";
}

/** An arm of two joints, and what a test adds to it. Line 1 is the robot, 2 the base, then joints and links in turn. */
struct PoorUrdf : ::testing::Test {
    std::string arm_ = "<robot name='poor'>\n" + writeLink("base", "") + writeJoint("j1", "base", "l1") +
                       writeLink("l1") + writeJoint("j2", "l1", "l2") + writeLink("l2");
    DraftOptions options_;

    std::filesystem::path write(const std::string& more) const {
        const std::filesystem::path file = folder_.path() / "poor.urdf";
        std::ofstream(file) << arm_ << more << "</robot>\n";
        return file;
    }
    RobotDraft read(const std::string& more) const { return readRobotDraft(write(more), options_); }
    std::string findFault(const std::string& more) const {
        return catchError([&] { read(more); });
    }
    /** The draft's joints and the only thing that was changed. */
    void expectRepaired(const std::string& more, const std::vector<std::string>& joints,
                        const std::vector<std::string>& parts) const {
        const RobotDraft draft = read(more);
        std::vector<std::string> names;
        for (const DraftJoint& joint : draft.joints) names.push_back(joint.name);
        EXPECT_EQ(names, joints);
        ASSERT_EQ(draft.repairs.size(), 1u) << detail::join(draft.repairs, "\n");
        expectContains(draft.repairs[0], parts);
        EXPECT_NE(draft.urdf, arm_ + more + "</robot>\n");
    }
    /** The arm as repaired. */
    detail::UrdfRobot reread(const RobotDraft& draft) const {
        const std::filesystem::path file = folder_.path() / "repaired.urdf";
        std::ofstream(file) << draft.urdf;
        return detail::readUrdf(file);
    }

    TemporaryFolder folder_;
};

TEST_F(PoorUrdf, ASoundOneStaysAsItIs) {
    const RobotDraft draft = read("");
    EXPECT_TRUE(draft.repairs.empty());
    EXPECT_EQ(draft.urdf, arm_ + "</robot>\n");
    EXPECT_EQ(draft.tool, "l2");
}

TEST_F(PoorUrdf, Fault78_CoupledJointsAreFrozenWhereTheirLeaderLeavesThem) {
    options_.choice.fixed = {"left=0.5"};
    const RobotDraft draft =
        read(writeJoint("left", "l2", "a") + writeLink("a") +
             writeJoint("right", "l2", "b", "<mimic joint='left' multiplier='-2' offset='0.1'/>") + writeLink("b"));
    EXPECT_EQ(draft.joints.size(), 2u);
    ASSERT_EQ(draft.repairs.size(), 2u);
    expectContains(draft.repairs[0], {"poor.urdf:7:1: ", "joint `left` is frozen at 0.5: --fix"});
    expectContains(draft.repairs[1], {"poor.urdf:9:1: ", "joint `right` is frozen at -0.9: it mimics joint `left`"});
}

TEST_F(PoorUrdf, Fault78_GrippersAreFrozenAndNamed) {
    const std::string fingers = writeJoint("Left_Finger", "l2", "a", "", "prismatic") + writeLink("a");
    expectRepaired(fingers, {"j1", "j2"},
                   {"joint `Left_Finger` is frozen at 0", "is named as the joint of a gripper", "--tip a"});
    options_.choice.tip = "a";
    EXPECT_EQ(read(fingers).joints.size(), 3u) << "on the chosen chain it moves";

    options_ = {};
    const RobotDraft led = read(writeJoint("drive", "l2", "a") + writeLink("a") +
                                writeJoint("slave", "l2", "b", "<mimic joint='drive'/>") + writeLink("b"));
    EXPECT_EQ(led.joints.size(), 2u);
    ASSERT_EQ(led.repairs.size(), 2u);
    expectContains(led.repairs[1], {"joint `drive` is frozen at 0", "others mimic it"});
}

TEST_F(PoorUrdf, Fault78_LinksWithoutMassAreLumpedOrTheirJointsFrozen) {
    EXPECT_TRUE(read(writeJoint("flange", "l2", "dummy", "", "fixed", "") + writeLink("dummy", "") +
                     writeJoint("tcp", "dummy", "tool", "", "fixed", "") + writeLink("tool", ""))
                    .repairs.empty());
    expectRepaired(writeJoint("j3", "l2", "bare") + writeLink("bare", ""), {"j1", "j2"},
                   {"poor.urdf:7:1: joint `j3` is frozen at 0: nothing that it moves has a mass"});
    expectContains(findFault(writeJoint("j3", "l2", "bare") + writeLink("bare", "") + writeJoint("j4", "bare", "hand") +
                             writeLink("hand")),
                   {"poor.urdf:8:1: link `bare`, moved by joint `j3`, has no mass", "make the joint fixed"});
}

TEST_F(PoorUrdf, Fault78_SmallSlipsOfAnInertiaAreMendedAndLargeOnesRefused) {
    const auto withMoment = [](const std::string& izz) {
        return writeJoint("j3", "l2", "l3") +
               writeLink("l3", "<inertial><mass value='1'/><inertia ixx='0.01' iyy='0.02' izz='" + izz +
                                   "' ixy='0' ixz='0' iyz='0'/></inertial>");
    };
    expectRepaired(withMoment("0.031"), {"j1", "j2", "j3"},
                   {"poor.urdf:8:1: link `l3`: ", "above the sum of the other two by 3.2 %", "nearest tensor"});
    const Eigen::Matrix3d mended = reread(read(withMoment("0.031"))).joints[2].body.inertia;
    EXPECT_TRUE(mended.isApprox(
        Eigen::Vector3d(0.01 + 0.001 / 3, 0.02 + 0.001 / 3, 0.031 - 0.001 / 3).asDiagonal().toDenseMatrix(), 1e-6))
        << mended;
    expectContains(findFault(withMoment("0.035")), {"poor.urdf:8:1: link `l3`: the inertia tensor belongs to no body"});
    expectContains(findFault(withMoment("-0.001")), {"not positive definite"});
}

TEST_F(PoorUrdf, Fault78_MissingLimitsAreBlanks) {
    RobotDraft draft = read(writeJoint("j3", "l2", "l3", "", "revolute", "") + writeLink("l3"));
    ASSERT_EQ(draft.repairs.size(), 1u);
    expectContains(draft.repairs[0], {"poor.urdf:7:1: joint `j3` had no <limit>: 0 stands for it"});
    EXPECT_TRUE(std::isnan(draft.joints[2].positionLower));
    EXPECT_TRUE(std::isnan(draft.joints[2].velocity));
    expectRepaired(writeJoint("j3", "l2", "l3", "", "revolute", "lower='-1' upper='1'") + writeLink("l3"),
                   {"j1", "j2", "j3"}, {"joint `j3` had no `effort` and `velocity` in its <limit>"});
}

TEST_F(PoorUrdf, Fault78_JointsOfOtherTypesCanBeFrozen) {
    arm_ = "<robot name='poor'>\n" + writeLink("world", "") + writeJoint("free", "world", "base", "", "floating", "") +
           writeLink("base") + writeJoint("j1", "base", "l1") + writeLink("l1") +
           writeJoint("flat", "l1", "l2", "", "planar", "") + writeLink("l2");
    expectContains(findFault(""),
                   {"poor.urdf: 2 things are wrong:", "1. ", "poor.urdf:3:1: joint `free` is of type floating", "2. ",
                    "joint `flat` is of type planar", "--fix JOINT"});
    options_.choice.fixed = {"free", "flat"};
    EXPECT_EQ(read("").joints.size(), 1u);
}

TEST_F(PoorUrdf, Fault78_TooManyJointsAreToldWithTheChainsThereAre) {
    std::string more;
    for (const std::string side : {"left", "right"})
        for (int i = 0; i < 8; ++i)
            more += writeJoint(side + std::to_string(i), i ? side + "_link" + std::to_string(i - 1) : "l1",
                               side + "_link" + std::to_string(i)) +
                    writeLink(side + "_link" + std::to_string(i));
    expectContains(findFault(more),
                   {"the robot has 18 moving joints; at most 16 are supported", "--tip left_link7",
                    "`left_link7` (9: j1, left0, left1, ", "`right_link7` (9: j1, right0", "`l2` (2: j1, j2)"});
    options_.choice.tip = "right_link7";
    expectRepaired(more, {"j1", "right0", "right1", "right2", "right3", "right4", "right5", "right6", "right7"},
                   {"outside of the chosen chain, and frozen: j2 at 0, left0 at 0"});
    const RobotDraft draft = read(more);
    EXPECT_EQ(draft.tool, "right_link7");
    EXPECT_DOUBLE_EQ(reread(draft).joints[0].body.mass, 2.0 + 2.0 + 8 * 2.0) << "l1 carries the other arm";
    options_.choice.base = "l1";
    EXPECT_EQ(read(more).joints.size(), 8u);
}

TEST_F(PoorUrdf, Fault78_AFrozenJointIsWhereItWas) {
    const std::string more =
        writeJoint("slide", "l2", "l3", "", "prismatic") + writeLink("l3") +
        writeJoint("upright", "l3", "l4", "", "revolute", "lower='-4' upper='4' effort='1' velocity='1'") +
        writeLink("l4");
    const auto placeTip = [](const detail::UrdfRobot& robot, const JointVector& q) {
        RobotDescription arm;
        arm.joints = robot.joints;
        arm.actuation.rotorInertia.setZero(arm.size());
        ArmRecursion::Frames frames;
        ArmRecursion(arm).calcFrames(q, frames);
        const detail::UrdfRobot::LinkPlace& place = robot.links.at("l4");
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        pose.linear() = frames.rotation[static_cast<std::size_t>(place.carrier)];
        pose.translation() = frames.origin[static_cast<std::size_t>(place.carrier)];
        return pose * place.placement;
    };
    // The joints' own frames are pitched by 0.3 rad about the axis of the joint: the second value brings it upright.
    for (const double angle : {0.7, M_PI / 2, -2.5}) {
        options_ = {};
        JointVector q(4);
        q << 0.3, -0.4, 0.25, angle;
        const Eigen::Isometry3d whole = placeTip(detail::readUrdf(write(more)), q);
        options_.choice.fixed = {"slide=0.25", "upright=" + detail::formatNumber(angle)};
        const Eigen::Isometry3d frozen = placeTip(reread(read(more)), q.head(2));
        EXPECT_TRUE(frozen.isApprox(whole, 1e-12)) << frozen.matrix() << "\n" << whole.matrix();
    }
    arm_ = "<robot name='poor'>\n" + writeLink("base", "") + writeJoint("j1", "base", "l1") + writeLink("l1") +
           "<joint name='up' type='continuous'><parent link='l1'/><child link='l4'/><axis xyz='0 1 0'/></joint>" +
           writeLink("l4");
    options_.choice.fixed = {"up=" + detail::formatNumber(M_PI / 2)};
    const Eigen::Isometry3d turned = reread(read("")).links.at("l4").placement;
    EXPECT_TRUE(
        turned.linear().isApprox(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()).toRotationMatrix(), 1e-9));
}

TEST_F(PoorUrdf, Fault78_AllThatIsWrongIsToldAtOnce) {
    const std::string fault =
        findFault(writeJoint("j2", "l1", "l3") + writeLink("l1") + "<link/>\n" + writeJoint("j3", "ghost", "l2") +
                  "<joint type='fixed'/>\n" + writeJoint("j4", "l22", ""));
    expectContains(
        fault,
        {"poor.urdf: 9 things are wrong:", "1. ", "poor.urdf:7:1: there is a second joint `j2`; the first is at line 5",
         "poor.urdf:11:1: the joint has no name", "poor.urdf:8:1: there is a second link `l1`",
         "poor.urdf:9:1: the link has no name", "poor.urdf:10:1: the parent link `ghost` of joint `j3` was not found",
         "link `l2` is the child of two joints, `j2` and `j3`", "the child link `l3` of joint `j2` was not found",
         "Did you mean `l2`?", "joint `j4` names no child link", "9. "});
}

TEST_F(PoorUrdf, Fault78_LinksThatHangNowhereAreTold) {
    expectContains(findFault(writeLink("lost") + writeLink("a") + writeLink("b") + writeJoint("ab", "a", "b") +
                             writeJoint("ba", "b", "a")),
                   {"3 things are wrong", "link `lost` is not connected; the base is link `base`",
                    "joint `ba` is part of a loop", "joint `ab` is part of a loop"});
}

TEST_F(PoorUrdf, Fault78_NumbersThatAreNoneAreTold) {
    arm_ = "<robot name='poor'>\n" + writeLink("base", "");
    const std::string fault = findFault(
        "<joint name='a' type='revolute'><parent link='base'/><child link='la'/><origin xyz='0 0'/><axis xyz='0 0 0'/>"
        "<limit lower='x' upper='1e999' effort='1' velocity='nan'/></joint>" +
        writeLink("la", "<inertial><mass value='heavy'/></inertial>") +
        "<joint name='b' type='bend'><parent link='la'/><child link='lb'/></joint>" +
        writeLink("lb",
                  "<inertial><mass value='-1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>") +
        writeJoint("c", "lb", "lc") +
        writeLink("lc",
                  "<inertial><mass value='0'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"));
    expectContains(fault, {"7 things are wrong", "the origin of joint `a` does not consist of finite numbers",
                           "the axis of joint `a` has no direction",
                           "`lower` is \"x\", `upper` is \"1e999\", `velocity` is \"nan\": no finite number",
                           "joint `b` is of an unknown type, `bend`", "link `la`: the <inertial> element is incomplete",
                           "link `lb`: the mass is -1 kg", "link `lc`: there is an inertia without a mass"});
}

TEST_F(PoorUrdf, Fault78_AMisspeltJointTypeIsToldWithTheClosest) {
    arm_ = "<robot name='poor'>\n" + writeLink("base", "");
    expectContains(findFault(writeJoint("a", "base", "la", "", "revolut") + writeLink("la", kBody)),
                   {"joint `a` is of an unknown type, `revolut`. Did you mean `revolute`? "});
}

TEST_F(PoorUrdf, Fault78_AChoiceThatCannotBeIsToldAtOnce) {
    options_.choice = {"bse", "l3", {"j9", "j1=5", "j2=much", "j2", "weld", "j1", "j1"}};
    const std::string weld = writeJoint("weld", "l2", "tool", "", "fixed", "") + writeLink("tool", "");
    expectContains(
        findFault(weld),
        {"things are wrong", "--base: the robot has no link `bse`. Did you mean `base`?",
         "--tip: the robot has no link `l3`", "--fix: the robot has no joint `j9`", "Its moving joints are j1, j2",
         "--fix: joint `j1` cannot be at 5: its limits are -2 to 2", "--fix: `much` is no position for joint `j2`",
         "--fix: joint `weld` is fixed already", "--fix: joint `j1` is named twice"});
    options_.choice = {"l2", "l1", {}};
    expectContains(findFault(weld), {"--tip: link `l1` does not hang on the base `l2`", "such as `base`"});
    options_.choice = {"", "base", {}};
    expectContains(findFault(weld), {"--tip: no joint moves link `base`"});
    options_.choice = {"l2", "tool", {}};
    expectContains(findFault(weld), {"--tip: no joint moves link `tool`"});
}

TEST_F(PoorUrdf, Fault78_CoupledJointsFollowEachOtherInAnyOrder) {
    const std::string chain = writeJoint("a", "l2", "la", "<mimic joint='b'/>") + writeLink("la") +
                              writeJoint("b", "l2", "lb", "<mimic joint='c' offset='0.5'/>") + writeLink("lb") +
                              writeJoint("c", "l2", "lc", "") + writeLink("lc");
    options_.choice.tip = "l2";
    expectRepaired(chain, {"j1", "j2"}, {"a at 0.5, b at 0.5, c at 0"});
    options_.choice.fixed = {"c=0.2", "a"};
    const RobotDraft draft = read(chain);
    EXPECT_EQ(draft.joints.size(), 2u);
    expectContains(detail::join(draft.repairs, "; "),
                   {"joint `a` is frozen at 0.7: --fix", "`c` is frozen at 0.2", "b at 0.7"});
    options_ = {};
    expectContains(findFault(writeJoint("a", "l2", "la", "<mimic joint='nosuch'/>") + writeLink("la") +
                             writeJoint("b", "l2", "lb", "<mimic joint='j1' multiplier='-1,5'/>") + writeLink("lb") +
                             writeJoint("c", "l2", "lc", "<mimic joint='c'/>") + writeLink("lc")),
                   {"3 things are wrong", "`a` mimics joint `nosuch`, which is not there", "--fix a=VALUE",
                    "`b` mimics joint `j1`, but where that leaves it is not known: a multiplier",
                    "`c` mimics joint `c`, but", "in a circle"});
}

TEST_F(PoorUrdf, Fault78_NoRepairTakesTheArmAway) {
    arm_ = "<robot name='claw'>\n" + writeLink("base", "") + writeJoint("clawbot_1", "base", "l1") + writeLink("l1") +
           writeJoint("clawbot_2", "l1", "l2") + writeLink("l2");
    EXPECT_EQ(read("").joints.size(), 2u) << "all joints are named so";
    EXPECT_EQ(read(writeJoint("clawbot_claw", "l2", "l3") + writeLink("l3")).joints.size(), 2u);
    EXPECT_EQ(read(writeJoint("clawbot_jaw", "l2", "l3") + writeLink("l3")).joints.size(), 2u);
    arm_ = "<robot name='poor'>\n" + writeLink("base", "") + writeJoint("joint1", "base", "l1") + writeLink("l1");
    EXPECT_EQ(read(writeJoint("jaw", "l1", "l2") + writeLink("l2")).joints.size(), 1u) << "not `aw`";
    arm_ = "<robot name='bare'>\n" + writeLink("base", "") + writeJoint("j1", "base", "l1") + writeLink("l1", "") +
           writeJoint("j2", "l1", "l2") + writeLink("l2", "");
    expectContains(findFault(""), {"2 things are wrong", "link `l1`, moved by joint `j1`, has no mass", "link `l2`"});
}

TEST_F(PoorUrdf, Fault78_WhatIsMendedIsNotToldWithWhatIsNot) {
    options_.choice.tip = "l22";
    const std::string fault =
        findFault(writeJoint("f", "l2", "lf", "<mimic joint='j1'/>", "revolute", "") + writeLink("lf", ""));
    EXPECT_EQ(fault.find("things are wrong"), std::string::npos) << fault;
    expectContains(fault, {"--tip: the robot has no link `l22`. Did you mean `l2`?"});
    options_.choice = {"", "", {"j1=0.5"}};
    arm_ = "<robot name='poor'>\n" + writeLink("base", "") + writeJoint("j1", "base", "l1", "", "floating", "") +
           writeLink("l1") + writeJoint("j2", "l1", "l2") + writeLink("l2");
    expectContains(findFault(""), {"--fix: joint `j1` of type floating has no single position", "1. ", "2. "});
}

TEST_F(PoorUrdf, Fault01_HugeOrHostileFilesAreJudgedInTime) {
    std::string deep = "<robot name='x'>";
    for (int i = 0; i < 150000; ++i) deep += "<a x=\"/>\">";
    std::ofstream(folder_.path() / "deep.urdf") << deep;
    const auto check = [&](const std::string& file) {
        try {
            readRobotDraft(folder_.path() / file);
        } catch (const Error& error) {
            return std::string(error.what());
        }
        return std::string("accepted");
    };
    expectContains(check("deep.urdf"), {"nested deeper than 64 levels"});
    std::string opens, closes;
    for (int i = 0; i < 20000; ++i) {
        opens += "<a>";
        closes += "</a>";
    }
    for (const std::string& hidden :
         {closes + "<robot name=\"x\">", std::string("<robot name=\"x\"><?x>"),
          "<robot name=\"x\"><!-->" + closes + "-->", std::string("<robot name=\"x\"><1 \">"),
          std::string("<robot b=\"\xF0\" c=d\">")}) {
        std::ofstream(folder_.path() / "hidden.urdf") << hidden << opens;
        const std::string fault = check("hidden.urdf");
        EXPECT_TRUE(fault.find("this is not XML") != std::string::npos ||
                    fault.find("nested deeper") != std::string::npos)
            << fault;
    }
    std::string many = "<robot name='x'><link ";
    for (int i = 0; i < 100000; ++i) many += "a" + std::to_string(i) + "='' ";
    std::ofstream(folder_.path() / "many.urdf") << many << "/></robot>";
    expectContains(check("many.urdf"), {"an element has more than 100 attributes"});
    std::string chain = "<robot name='x'><link name='l0'/>", unknown = chain;
    for (int i = 1; i < 5000; ++i) {
        const std::string n = std::to_string(i), before = std::to_string(i - 1);
        chain += "<joint name='j" + n + "' type='fixed'><parent link='l" + before + "'/><child link='l" + n +
                 "'/></joint><link name='l" + n + "'/>";
        unknown += "<joint name='j" + n + "' type='fixed'><parent link='l0'/><child link='lonk" + n +
                   "'/></joint><link name='l" + n + "'/>";
    }
    std::ofstream(folder_.path() / "chain.urdf") << chain << "</robot>";
    std::ofstream(folder_.path() / "unknown.urdf") << unknown << "</robot>";
    std::ofstream(folder_.path() / "crowd.urdf") << chain << "<joint name='j1'/><joint/></robot>";
    expectContains(check("crowd.urdf"), {"more than 10000 joints and links"});
    const auto begin = std::chrono::steady_clock::now();
    expectContains(check("chain.urdf"), {"the robot has no moving joint"});
    expectContains(check("unknown.urdf"), {"things are wrong", "... and "});
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    EXPECT_LT(taken.count(), 20.0) << "minutes, where each joint looks at all others";
}

TEST_F(PoorUrdf, LinksThatTouchAtHomeAreDraftedTogether) {
    const std::string ball = "<collision><geometry><sphere radius='0.15'/></geometry></collision>";
    const auto withBall = [&](const std::string& name) { return writeLink(name, kBody + ball); };
    arm_ = "<robot name='poor'>\n" + withBall("base");
    for (int i = 1; i <= 4; ++i)  // a ring that closes at zero
        arm_ += "<joint name='j" + std::to_string(i) + "' type='revolute'><parent link='" +
                (i > 1 ? "l" + std::to_string(i - 1) : "base") + "'/><child link='l" + std::to_string(i) +
                "'/><origin xyz='0.4 0 0' rpy='0 0 1.5708'/><axis xyz='0 0 1'/><limit " + kRange + "/></joint>" +
                withBall("l" + std::to_string(i));
    const RobotDraft draft = read("");
    std::vector<std::string> doubtful;
    for (const DraftContact& contact : draft.contacts)
        if (contact.isDoubtful) doubtful.push_back(contact.first + " " + contact.second + " " + contact.reason);
    EXPECT_EQ(doubtful, (std::vector<std::string>{"base l4 overlap by 300 mm at the home pose"}));
    options_.assumes = true;
    for (const DraftContact& contact : read("").contacts) EXPECT_FALSE(contact.isDoubtful) << "another pose is assumed";
}

TEST_F(PoorUrdf, WhatIsAssumedIsCompleteAndSaid) {
    options_.assumes = true;
    const RobotDraft draft = read(writeJoint("j3", "l2", "l3", "", "revolute", "") + writeLink("l3"));
    for (const DraftJoint& joint : draft.joints)
        for (const double figure : {joint.positionLower, joint.positionUpper, joint.velocity, joint.effort,
                                    joint.acceleration, joint.jerk, joint.rotorInertia, joint.coulomb})
            EXPECT_TRUE(std::isfinite(figure)) << joint.name;
    EXPECT_DOUBLE_EQ(draft.joints[0].coulomb, 0.3);
    EXPECT_LE(draft.joints[0].acceleration, 2.0 / 0.2);
    EXPECT_NEAR(draft.joints[0].jerk, draft.joints[0].acceleration / 0.05, 0.01 * draft.joints[0].jerk);
    EXPECT_DOUBLE_EQ(draft.joints[0].rotorInertia, 0.3);  // 10 % of 30 Nm at 10 rad/s^2
    std::string figures;
    for (const DraftAssumption& assumption : draft.assumptions) figures += assumption.figure + "; ";
    expectContains(figures, {"velocity limits", "position limits", "torque limits", "acceleration limits",
                             "jerk limits", "rotor_inertia_kgm2", "friction"});
    // The same again.
    const RobotDraft again = read(writeJoint("j3", "l2", "l3", "", "revolute", "") + writeLink("l3"));
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(draft.joints[i].home, again.joints[i].home);
}

TEST_F(PoorUrdf, MotorsThatDoNotHoldTheArmAndPlaceholdersAreTold) {
    options_.assumes = true;
    const auto withEffort = [&](const std::string& effort) {
        arm_ = "<robot name='poor'>\n" + writeLink("base", "") +
               writeJoint("j1", "base", "l1", "", "revolute",
                          "lower='-2' upper='2' velocity='2' effort='" + effort + "'") +
               writeLink("l1");
        return read("");
    };
    expectContains(detail::join(withEffort("1").warnings, "; "),
                   {"joint `j1`: its torque limit of 1 does not hold the arm with a fifth to spare: gravity asks"});
    const RobotDraft placeholder = withEffort("1000");
    EXPECT_LT(placeholder.joints[0].rotorInertia, 0.3) << "not 10";
    expectContains(placeholder.assumptions.back().figure + ": " + placeholder.assumptions.back().rule,
                   {"friction: 1 %", "ten times the need counts"});
    EXPECT_TRUE(withEffort("10").warnings.empty());
}

}  // namespace
}  // namespace viable::test
