#include <ctime>
#include <random>

#include "Paths.h"
#include "RobotFolder.h"
#include "core/Text.h"
#include "draft/RobotDraft.h"
#include "robot/RigidBody.h"
#include "robot/urdf/UrdfReader.h"

namespace viable::test::assumed {
namespace {

using Parts = std::vector<std::string>;

/** Processor time in which a hostile file is refused. [s] */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr double kPatience_s = 2.0;
#else
constexpr double kPatience_s = 0.1;
#endif

constexpr const char* kMoments = "<inertia ixx='0.01' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'/>";

std::string writeLink(const std::string& name, const std::string& inside = {}) {
    return "<link name='" + name + "'>" + inside + "</link>\n";
}
std::string writeBody(const std::string& mass = "2", const std::string& inertia = kMoments) {
    return "<inertial><mass value='" + mass + "'/>" + inertia + "</inertial>";
}
std::string writeShape(const std::string& shape, const std::string& origin = "xyz='0 0 0'") {
    return "<visual><origin " + origin + "/><geometry>" + shape + "</geometry></visual>";
}
std::string writeJoint(const std::string& name, const std::string& parent, const std::string& child,
                       const std::string& type = "revolute") {
    return "<joint" + (name.empty() ? "" : " name='" + name + "'") + " type='" + type + "'><parent link='" + parent +
           "'/><child link='" + child + "'/><origin xyz='0 0 0.4'/><axis xyz='0 1 0'/>" +
           "<limit lower='-2' upper='2' effort='30' velocity='2'/></joint>\n";
}
const std::string kArm = writeLink("base") + writeJoint("j1", "base", "l1") + writeLink("l1", writeBody());

/** A folder with a file of the given elements. */
struct PoorFile {
    TemporaryFolder folder;
    std::filesystem::path write(const std::string& elements, const std::string& name = "poor.urdf") const {
        std::ofstream(folder.path() / name) << "<robot name='poor'>\n" << elements << "</robot>\n";
        return folder.path() / name;
    }
    RobotDraft assume(const std::string& elements, const detail::UrdfChoice& choice = {}) const {
        return readRobotDraft(write(elements), {choice, true});
    }
    std::string findFault(const std::string& elements, bool assumes) const {
        return catchError([&] { readRobotDraft(write(elements), {{}, assumes}); });
    }
    detail::UrdfRobot reread(const RobotDraft& draft) const {
        std::ofstream(folder.path() / "mended.urdf") << draft.urdf;
        return detail::readUrdf(folder.path() / "mended.urdf");
    }
};

/** One trouble: what is told without --assume, what is mended with it, and what of that runs repeat. */
struct Trouble {
    std::string name, elements;
    Parts told, mended;
    std::vector<std::string> assumed;
};

std::vector<Trouble> listTroubles() {
    const std::string j2 = writeJoint("j2", "l1", "l2"), l2 = writeLink("l2", writeBody());
    const auto withLink = [&](const std::string& inside) {
        return kArm + j2 + writeLink("l2", inside) + writeJoint("j3", "l2", "l3") + writeLink("l3", writeBody());
    };
    const std::string box = writeShape("<box size='0.1 0.1 0.2'/>");
    const std::string takes = "`viable new robot --assume`";
    return {
        {"no mass, a box",
         withLink(box),
         {"has no mass", takes + " takes a mass from the shapes"},
         {"`l2`, moved by joint `j2`, had no mass"},
         {"mass (l2)"}},
        {"no mass, no shape", withLink(""), {"has no mass"}, {"had no mass"}, {"mass (l2)"}},
        {"no mass, a lost mesh",
         withLink(writeShape("<mesh filename='package://none/no.stl'/>")),
         {"has no mass"},
         {"had no mass"},
         {"mass (l2)"}},
        {"a negative mass",
         withLink(writeBody("-1") + box),
         {"the mass is -1 kg", takes},
         {"its mass is -1 kg", "had no mass"},
         {"mass (l2)"}},
        {"an inertia without a mass",
         withLink(writeBody("0") + box),
         {"inertia without a mass", takes},
         {"its mass is 0 kg"},
         {"mass (l2)"}},
        {"an <inertial> without a mass",
         withLink("<inertial>" + std::string(kMoments) + "</inertial>" + box),
         {"is incomplete", takes},
         {"it states no mass"},
         {"mass (l2)"}},
        {"no inertia",
         withLink("<inertial><mass value='1'/></inertial>" + box),
         {"is incomplete"},
         {"no inertia is given"},
         {"inertia (l2)"}},
        {"an inertia of no body",
         withLink(writeBody("1", "<inertia ixx='0.01' iyy='0.01' izz='0.05' ixy='0' ixz='0' iyz='0'/>")),
         {"belongs to no body", takes + " takes the nearest"},
         {"from 0.01, 0.01, 0.05 kg m^2 to 0.02, 0.02, 0.04"},
         {"inertia (l2)"}},
        {"a negative moment",
         withLink(writeBody("1", "<inertia ixx='-0.01' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'/>")),
         {"not positive definite"},
         {"was negative", "to 0.0002, 0.02, 0.02"},
         {"inertia (l2)"}},
        {"all moments negative",
         withLink(writeBody("1", "<inertia ixx='-0.01' iyy='-0.02' izz='-0.02' ixy='0' ixz='0' iyz='0'/>") + box),
         {"not positive definite"},
         {"no body is near its principal moments"},
         {"inertia (l2)"}},
        {"a misspelt parent",
         kArm + writeJoint("j2", "L-1", "l2") + l2,
         {"parent link `L-1` of joint `j2` was not found", takes},
         {"`L-1`, is not there; `l1` is taken"},
         {"parent (j2)"}},
        {"a misspelt child",
         kArm + writeJoint("j2", "l1", "forarm") + writeLink("forearm", writeBody()),
         {"was not found"},
         {"`forearm` is taken"},
         {"child (j2)"}},
        {"a world that nobody describes",
         kArm + j2 + l2 + writeJoint("stand", "world", "base", "fixed"),
         {"`world` of joint `stand` was not found"},
         {"`world`, which joints name and nobody describes, is added"},
         {"link (world)"}},
        {"a tool that nobody describes",
         kArm + j2 + l2 + writeJoint("flange", "l2", "tool0", "fixed"),
         {"`tool0` of joint `flange` was not found"},
         {"`tool0`, which joints name"},
         {"link (tool0)"}},
        {"a link that hangs nowhere",
         kArm + j2 + l2 + writeLink("lost", box),
         {"`lost` is not connected", takes + " leaves out"},
         {"link `lost` is left out"},
         {}},
        {"a link twice",
         kArm + j2 + l2 + l2,
         {"second link `l2`", "where both are the same"},
         {"second link `l2` is left out"},
         {}},
        {"two joints of a name",
         kArm + writeJoint("j1", "l1", "l2") + l2,
         {"second joint `j1`"},
         {"second joint `j1` is called `j1_2`"},
         {}},
        {"a joint without a name",
         kArm + writeJoint("", "l1", "l2") + l2,
         {"the joint has no name", takes},
         {"is called `l2_joint`"},
         {}},
        {"a misspelt type",
         kArm + writeJoint("j2", "l1", "l2", "Revolut") + l2,
         {"of an unknown type, `Revolut`"},
         {"is taken as revolute"},
         {"type (j2)"}},
        {"a floating base",
         kArm + j2 + l2 + writeLink("map") + writeJoint("free", "map", "base", "floating"),
         {"of type floating"},
         {"`free` is frozen at 0: it is of type floating"},
         {}},
        {"a leader that is not there",
         kArm + j2 + l2 +
             "<joint name='m' type='revolute'><parent link='l2'/><child link='lm'/><mimic joint='gone'/></joint>" +
             writeLink("lm", writeBody()),
         {"mimics joint `gone`, which is not there"},
         {"`m` is frozen at 0: it mimics joint `gone`, which is not there"},
         {}},
    };
}

TEST(AssumedUrdf, Fault96_EachTroubleIsToldWithoutAndMendedWithIt) {
    const PoorFile file;
    for (const Trouble& trouble : listTroubles()) {
        SCOPED_TRACE(trouble.name);
        expectContains(file.findFault(trouble.elements, false), trouble.told);
        const RobotDraft draft = file.assume(trouble.elements);
        expectContains(detail::join(draft.repairs, "\n"), trouble.mended);
        EXPECT_EQ(draft.joints.size(), trouble.elements.find("'j3'") != std::string::npos ? 3u : 2u);
        const detail::UrdfRobot arm = file.reread(draft);
        EXPECT_EQ(arm.assumed, trouble.assumed);
        for (const JointDescription& joint : arm.joints) {
            EXPECT_GT(joint.body.mass, 0.0);
            EXPECT_EQ(detail::findInertiaFault(joint.body.inertia, true), "");
        }
    }
}

TEST(AssumedUrdf, WhatCanBeMeantInSeveralWaysIsRefusedAllTheSame) {
    const PoorFile file;
    const std::string l2 = writeLink("l2", writeBody());
    for (const auto& [elements, told] : std::vector<std::pair<std::string, std::string>>{
             {kArm + writeJoint("j2", "l7", "l2") + l2, "parent link `l7` of joint `j2` was not found"},
             {writeLink("r_arm", writeBody()) + kArm + writeJoint("j2", "l_arm", "l2") + l2, "`l_arm`"},
             {kArm + writeLink("l1", writeBody("3")), "second link `l1`"},
             {kArm + writeJoint("j2", "l1", "l2") + writeJoint("k2", "base", "l2") + l2, "child of two joints"},
             {kArm + writeLink("b2") + writeJoint("j2", "b2", "l2") + l2, "`b2` is not connected"},
             {kArm + writeJoint("j2", "l1", "l2", "fixed_or_not") + l2, "unknown type"},
             {kArm + writeJoint("j2", "l1", "l2") + writeLink("l2", writeBody("nan")), "not finite"},
             {kArm + writeJoint("j2", "l1", "l2") +
                  writeLink("l2", writeBody("1", "<inertia ixx='1e999' iyy='1' izz='1'/>")),
              "not finite"}})
        expectContains(file.findFault(elements, true), {told});
}

// By hand: a box, a cylinder that lies, and a ball, of one body; and a mesh against the box that it is.
TEST(AssumedUrdf, AMassIsTheShapesVolumeAndItsInertiaTheirs) {
    const PoorFile file;
    const auto body = [&](const std::string& inside) {
        return file.reread(file.assume(writeLink("base") + writeJoint("j", "base", "l") + writeLink("l", inside)))
            .joints.at(0)
            .body;
    };
    const BodyInertia box = body(writeShape("<box size='0.1 0.2 0.4'/>", "xyz='0 0 0.2'"));
    EXPECT_NEAR(box.mass, 1280 * 0.008, 1e-9);
    EXPECT_TRUE(box.com.isApprox(Eigen::Vector3d(0, 0, 0.2)));
    EXPECT_NEAR(box.inertia(0, 0), box.mass / 12 * (0.04 + 0.16), 1e-9);
    const BodyInertia both =
        body(writeShape("<box size='0.1 0.2 0.4'/>", "xyz='0 0 0.2'") +
             writeShape("<cylinder radius='0.05' length='0.3'/>", "xyz='0 0 0.2' rpy='0 1.5707963268 0'") +
             writeShape("<sphere radius='0.1'/>", "xyz='0 0 0.2'"));
    const double tube = 1280 * M_PI * 0.0025 * 0.3, ball = 1280 * 4 / 3.0 * M_PI * 0.001;
    EXPECT_NEAR(both.mass, box.mass + tube + ball, 1e-6);
    EXPECT_NEAR(both.inertia(0, 0), box.inertia(0, 0) + 0.5 * tube * 0.0025 + 0.4 * ball * 0.01, 1e-6);
    EXPECT_NEAR(both.inertia(1, 1), box.mass / 12 * (0.01 + 0.16) + tube * (0.0025 / 4 + 0.09 / 12) + 0.4 * ball * 0.01,
                1e-6);

    std::string obj;
    for (int k = 0; k < 8; ++k)
        obj += detail::format("v %g %g %g\n", k & 1 ? 0.05 : -0.05, k & 2 ? 0.1 : -0.1, k & 4 ? 0.4 : 0.0);
    for (const char* face : {"1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"})
        obj += std::string("f ") + face + "\n";
    std::ofstream(file.folder.path() / "box.obj") << obj;
    const BodyInertia mesh = body(writeShape("<mesh filename='box.obj'/>"));
    EXPECT_NEAR(mesh.mass, box.mass, 1e-5);
    EXPECT_TRUE(mesh.com.isApprox(box.com, 1e-6));
    EXPECT_TRUE(mesh.inertia.isApprox(box.inertia, 1e-5)) << mesh.inertia;
    // Turned inside out it is the same; without two of its sides it fills what its capsule does, in part.
    std::string turned = obj.substr(0, obj.find("f "));
    for (const char* face : {"2 4 3 1", "7 8 6 5", "5 6 2 1", "4 8 7 3", "3 7 5 1", "6 8 4 2"})
        turned += std::string("f ") + face + "\n";
    std::ofstream(file.folder.path() / "box.obj") << turned;
    EXPECT_NEAR(body(writeShape("<mesh filename='box.obj'/>")).mass, box.mass, 1e-5);
    std::ofstream(file.folder.path() / "box.obj") << obj.substr(0, obj.find("f 1 2")) << "f 1 2 6\n";
    const double loose = body(writeShape("<mesh filename='box.obj'/>")).mass;
    EXPECT_GT(loose, 0.3 * box.mass);
    EXPECT_LT(loose, 3.0 * box.mass);
    // A bracket of two thin plates encloses little of its capsule, and weighs no more than them.
    std::string bracket;
    for (int k = 0; k < 8; ++k)
        bracket += detail::format("v %g %g %g\n", k & 1 ? 0.05 : 0.048, k & 2 ? 0.1 : -0.1, k & 4 ? 0.4 : 0.0);
    for (int k = 0; k < 8; ++k)
        bracket += detail::format("v %g %g %g\n", k & 1 ? 0.4 : 0.05, k & 2 ? 0.1 : -0.1, k & 4 ? 0.402 : 0.4);
    bracket += obj.substr(obj.find("f "));
    for (const char* face : {"9 11 12 10", "13 14 16 15", "9 10 14 13", "11 15 16 12", "9 13 15 11", "10 12 16 14"})
        bracket += std::string("f ") + face + "\n";
    std::ofstream(file.folder.path() / "box.obj") << bracket;
    EXPECT_NEAR(body(writeShape("<mesh filename='box.obj'/>")).mass, 1280 * (0.002 * 0.2 * 0.4 + 0.35 * 0.2 * 0.002),
                1e-5);
}

TEST(AssumedUrdf, LinksWithoutAShapeGetATubeToTheNextJoint) {
    const PoorFile file;
    const RobotDraft draft =
        file.assume(writeLink("base") + writeJoint("a", "base", "la") + writeLink("la") + writeJoint("b", "la", "lb") +
                    writeLink("lb") + writeJoint("f", "lb", "tip", "fixed") + writeLink("tip"));
    const auto arm = file.reread(draft);
    ASSERT_EQ(arm.joints.size(), 2u);
    // Radius 3.5 % of 0.8 m; 0.4 m long with round ends.
    const double mass = 1280 * M_PI * 0.028 * 0.028 * (0.4 + 4.0 / 3 * 0.028);
    for (const JointDescription& joint : arm.joints) {
        EXPECT_NEAR(joint.body.mass, mass, 1e-6);
        EXPECT_TRUE(joint.body.com.isApprox(Eigen::Vector3d(0, 0, 0.2), 1e-9));
    }
    EXPECT_EQ(arm.assumed, std::vector<std::string>{"mass (la, lb)"});
    ASSERT_FALSE(draft.assumptions.empty());
    expectContains(draft.assumptions[0].figure + " " + draft.assumptions[0].rule,
                   {"mass la 1.38 kg, lb 1.38 kg: no shape", "1280 kg/m^3"});
}

// Of 1000 tensors: what is taken is a body's, and no sampled body's is nearer.
TEST(AssumedUrdf, AMendedInertiaIsTheNearest) {
    const PoorFile file;
    std::mt19937_64 random(3);
    std::uniform_real_distribution<> draw(0.0, 1.0);
    for (int trial = 0; trial < 40; ++trial) {
        Eigen::Vector3d m(draw(random), draw(random), 0.0);
        m[2] = (m[0] + m[1]) * (1.1 + draw(random));
        const Eigen::Matrix3d R =
            Eigen::Quaterniond(draw(random), draw(random), draw(random), 1).normalized().toRotationMatrix();
        const Eigen::Matrix3d given = R * m.asDiagonal() * R.transpose();
        std::string entries;
        for (const auto& [name, value] : {std::pair("ixx", given(0, 0)),
                                          {"ixy", given(0, 1)},
                                          {"ixz", given(0, 2)},
                                          {"iyy", given(1, 1)},
                                          {"iyz", given(1, 2)},
                                          {"izz", given(2, 2)}})
            entries += std::string(name) + "='" + detail::formatNumber(value) + "' ";
        const auto arm = file.reread(file.assume(writeLink("base") + writeJoint("j", "base", "l") +
                                                 writeLink("l", writeBody("1.5", "<inertia " + entries + "/>"))));
        const BodyInertia& body = arm.joints[0].body;
        EXPECT_EQ(body.mass, 1.5);
        EXPECT_EQ(detail::findInertiaFault(body.inertia, true), "");
        const double distance = (body.inertia - given).norm();
        for (int k = 0; k < 200; ++k) {
            // A body's tensor: of second moments that are not negative.
            const Eigen::Vector3d s(draw(random), draw(random), 0.1 * draw(random) * draw(random));
            const Eigen::Matrix3d other = R * (Eigen::Vector3d::Constant(s.sum()) - s).asDiagonal() * R.transpose();
            EXPECT_GE((other - given).norm(), distance * (1.0 - 1e-6));
        }
    }
}

// A rod whose moments are rounded the wrong way, and so little that a third of it is lost beside the margin.
TEST(AssumedUrdf, RodsRoundedTheWrongWayAreMended) {
    const PoorFile file;
    for (const char* moments : {"ixx='0' iyy='0.02' izz='0.020000000000001'", "ixx='-1e-12' iyy='0.02' izz='0.02'"})
        for (const bool assumes : {false, true}) {
            if (!assumes && moments[5] == '-') continue;  // refused
            const auto path = file.write(
                writeLink("base") + writeJoint("j", "base", "l") +
                writeLink("l", writeBody("1", std::string("<inertia ixy='0' ixz='0' iyz='0' ") + moments + "/>")));
            const BodyInertia body = file.reread(readRobotDraft(path, {{}, assumes})).joints.at(0).body;
            EXPECT_EQ(detail::findInertiaFault(body.inertia, true), "") << moments << assumes;
            EXPECT_NEAR(body.inertia(0, 0), assumes ? 0.0002 : 0.0, 1e-9);
        }
}

// ---------------------------------------------------------------------------------------- chains

std::string makeTwoArms(int left, int right) {
    std::string text = writeLink("torso");
    for (const auto& [side, count] : {std::pair<std::string, int>("left", left), {"right", right}})
        for (int i = 1; i <= count; ++i) {
            const std::string link = side + "_" + std::to_string(i);
            text += writeJoint(side + "_j" + std::to_string(i), i > 1 ? side + "_" + std::to_string(i - 1) : "torso",
                               link) +
                    writeLink(link, writeBody());
        }
    return text + writeJoint("left_flange", "left_" + std::to_string(left), "left_tool", "fixed") +
           writeLink("left_tool");
}

TEST(AssumedUrdf, TooManyJointsAreToldByTheirChainsAndACommandForEachArm) {
    const PoorFile file;
    expectContains(file.findFault(makeTwoArms(9, 9), true),
                   {"18 moving joints", "--at JOINT=VALUE", "There are two alike: `viable new robot ONE --urdf ",
                    "poor.urdf --tip left_tool` and `viable new robot OTHER", "--tip right_9`",
                    "`right_9` (9: right_j1, right_j2, "});
    const std::string one = file.findFault(makeTwoArms(7, 10), false);
    expectContains(one, {"such as `viable new robot NAME --urdf ", "--tip right_10`", "--tip auto"});
    EXPECT_EQ(one.find("two alike"), std::string::npos);
    expectContains(file.findFault(makeTwoArms(20, 1), true), {"--tip left_tool --base left_4`"});
}

TEST(AssumedUrdf, TheLongestArmIsTakenAndTheOthersStayWhereTheyArePut) {
    const PoorFile file;
    const RobotDraft draft = file.assume(makeTwoArms(7, 10), {"", detail::kAutoTip, {}, {"left_j2=0.5"}});
    EXPECT_EQ(draft.joints.size(), 10u);
    EXPECT_EQ(draft.tool, "right_10");
    expectContains(detail::join(draft.repairs, "\n"),
                   {"--tip auto takes the longest arm, that of `right_10` (10: ", "--tip left_tool",
                    "left_j1 at 0, left_j2 at 0.5, left_j3 at 0"});
    const auto refuse = [&](const std::vector<std::string>& at) {
        return catchError([&] { file.assume(makeTwoArms(2, 3), {"", detail::kAutoTip, {}, at}); });
    };
    expectContains(refuse({"right_j1=0.5"}),
                   {"--at: joint `right_j1` is one of those that move", "--fix right_j1=0.5"});
    expectContains(refuse({"left_j1"}), {"--at: no position is given for joint `left_j1`"});
    expectContains(refuse({"left_j1=5"}), {"--at: joint `left_j1` cannot be at 5"});
}

// ----------------------------------------------------------------------------------------- xacro

TEST(AssumedUrdf, XacroThatNothingUsesIsLeftOutAndOtherIsExpandedOnlyWithAssume) {
    const PoorFile file;
    const std::string unused =
        "<xacro:property name='w' value='${2*v}'/><xacro:macro name='m'><link name='${x}'/></xacro:macro>";
    const RobotDraft draft = readRobotDraft(file.write(unused + kArm));
    EXPECT_EQ(draft.repairs.size(), 2u);
    expectContains(detail::join(draft.repairs, "\n"), {"poor.urdf:2:1: <xacro:property> is left out", "<xacro:macro>"});
    EXPECT_EQ(draft.urdf.find("xacro:"), std::string::npos);
    // Nobody can define what the file calls: a remainder.
    const std::string rest = kArm + "<xacro:grey/><gazebo><x value='${y}'/></gazebo>";
    expectContains(file.findFault(rest, false), {"<xacro:grey> still has to be expanded"});
    expectContains(detail::join(file.assume(rest).repairs), {"<xacro:grey> is left out: nothing defines it"});
    const std::string used = unused + kArm + writeJoint("j2", "${w}", "l2") + writeLink("l2", writeBody());
    expectContains(file.findFault(used, false), {"this is xacro input", "Run `xacro", "--assume` does so"});

    // A program of that name instead: what it gets and what becomes of what it does.
    const std::filesystem::path bin = file.folder.path() / "bin";
    std::filesystem::create_directories(bin);
    const std::string path = std::getenv("PATH");
    const auto install = [&](const std::string& script) {
        std::ofstream(bin / "xacro") << "#!/bin/sh\n" << script;
        std::filesystem::permissions(bin / "xacro", std::filesystem::perms::owner_all);
    };
    setenv("PATH", bin.c_str(), 1);
    const std::string missing = file.findFault(used, true);
    setenv("PATH", (bin.string() + ":" + path).c_str(), 1);
    install("sed -e 's/${w}/l1/' -e 's/<xacro.*macro>//' \"$1\"\n");
    const RobotDraft expanded = file.assume(used);
    install("echo oops >&2; echo '<robot/>'; exit 3\n");
    const std::string failed = file.findFault(used, true);
    install("yes\n");
    const std::string endless = file.findFault(used, true);
    setenv("PATH", path.c_str(), 1);
    EXPECT_EQ(expanded.joints.size(), 2u);
    expectContains(expanded.repairs.at(0), {"xacro was expanded"});
    expectContains(missing, {"the program xacro, which reads it, was not found", "Run `xacro "});
    expectContains(failed, {"xacro failed: oops"});
    expectContains(endless, {"xacro gave more than 4194304 bytes"});
}

// --------------------------------------------------------------------------------------- hostile

TEST(AssumedUrdf, Fault01_HostileFilesAreRefusedAtOnce) {
    const PoorFile file;
    std::string bomb = "<?xml version='1.0'?><!DOCTYPE robot [<!ENTITY a 'ha'>", many, comb;
    for (char c = 'b'; c < 'k'; ++c)
        bomb += std::string("<!ENTITY ") + c + " '" + [&] {
            std::string ten;
            for (int k = 0; k < 10; ++k) ten += std::string("&") + static_cast<char>(c - 1) + ";";
            return ten;
        }() + "'>";
    for (int i = 0; i < 10000; ++i) {
        const auto add = [&](std::string& text, int parent) {
            const std::string n = std::to_string(i), before = parent < 0 ? "base" : "n" + std::to_string(parent);
            text += "<link name='n" + n + "'/><joint name='j" + n + "' type='continuous'><parent link='" + before +
                    "'/><child link='n" + n + "'/></joint>\n";
        };
        add(many, i - 1);
        if (i < 900) add(comb, i % 2 ? i - 1 : i - 2);
    }
    std::ofstream(file.folder.path() / "bomb.urdf") << bomb << "]><robot name='x'><link name='&j;'/></robot>";
    std::ofstream(file.folder.path() / "huge.stl") << "solid";
    std::filesystem::resize_file(file.folder.path() / "huge.stl", std::uintmax_t{1} << 30);
    const std::string cycle = writeJoint("x", "l8", "l9") + writeJoint("y", "l9", "l8") + writeLink("l8", writeBody()) +
                              writeLink("l9", writeBody());
    const std::string nan = writeJoint("j2", "l1", "l2") + writeLink("l2", writeBody("nan"));
    for (const bool assumes : {false, true})
        for (const auto& [path, told] : std::vector<std::pair<std::filesystem::path, std::string>>{
                 {file.folder.path() / "bomb.urdf", "declares an entity"},
                 {file.write("<link name='base'/>" + many, "many.urdf"), "more than 1000 joints that move"},
                 {file.write("<link name='base'/>" + comb, "comb.urdf"), "900 moving joints"},
                 {file.write(kArm + cycle, "cycle.urdf"), "part of a loop"},
                 {file.write(kArm + nan, "nan.urdf"), "not finite"}}) {
            const std::clock_t begin = std::clock();
            const std::string fault = catchError([&, p = path] { readRobotDraft(p, {{}, assumes}); });
            const double taken = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
            expectContains(fault, {told});
            EXPECT_LT(taken, kPatience_s) << path;
        }
    // A mesh that is none, too large, or elsewhere, is lost; the link's mass is assumed all the same.
    for (const std::string name : {"huge.stl", "../../../../../../etc/passwd", "file:///dev/zero", "poor.urdf"})
        EXPECT_EQ(file.assume(writeLink("base") + writeJoint("j", "base", "l") +
                              writeLink("l", writeShape("<mesh filename='" + name + "'/>")))
                      .links.at(1)
                      .lostMeshes,
                  std::vector<std::string>{name});
}

}  // namespace
}  // namespace viable::test::assumed
