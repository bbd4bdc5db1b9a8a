// `viable new`, used from outside.
#include <sys/stat.h>

#include "Complaint.h"
#include "Program.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::test {
namespace {

namespace fs = std::filesystem;
using Folder = TemporaryFolder;

/** `viable new ...` in a folder of the test's. */
Outcome makeNew(const Folder& folder, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "new");
    const std::string path = folder.path();
    return run(std::move(arguments), [path] {
        if (chdir(path.c_str()) != 0) _exit(98);
    });
}

/** Bad input, told with `parts`, and nothing written. */
void expectRefused(const std::vector<std::string>& arguments, const std::vector<std::string>& parts) {
    SCOPED_TRACE(arguments.empty() ? "" : arguments.back());
    Folder folder;
    const Outcome o = makeNew(folder, arguments);
    EXPECT_EQ(o.code, 2) << o.out;
    expectContains(o.err, parts);
    EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(NewPlugin, EveryKindIsACompleteProjectWithoutPlaceholders) {
    Folder folder;
    for (const char* kind : {"filter", "controller", "robust_loop", "command", "plant"}) {
        SCOPED_TRACE(kind);
        const std::string name = std::string("my_2nd_") + kind;
        const Outcome o = makeNew(folder, {kind, name});
        ASSERT_EQ(o.code, 0) << o.err;
        std::string className = "My2nd" + std::string(kind);
        className[5] = static_cast<char>(std::toupper(className[5]));
        if (className == "My2ndRobust_loop") className = "My2ndRobustLoop";
        EXPECT_EQ(listNames(folder / name),
                  (std::vector<std::string>{"CMakeLists.txt", className + ".cpp", className + ".h",
                                            className + "Test.cpp", "README.md", "experiment.yaml"}));
        for (const std::string& file : listNames(folder / name)) {
            const std::string text = readFile(folder / name / file);
            for (const char* mark : {"@NAME@", "@CLASS@", "@KIND@"})
                EXPECT_EQ(text.find(mark), std::string::npos) << file;
        }
        expectContains(readFile(folder / name / "CMakeLists.txt"),
                       {"viable_add_plugin(" + name + " KIND " + kind + " SOURCES " + className});
        expectContains(o.out, {"  cd " + name + "\n", "ctest --test-dir build",
                               "export VIABLE_PLUGIN_PATH=$PWD/build/bin/plugins"});
    }
    EXPECT_EQ(listNames(folder.path()).size(), 5u) << "something else was left";
}

TEST(NewPlugin, OfABuildTreeSaysThatItMustBeInstalled) {
    Folder folder;
    const Outcome o = makeNew(folder, {"filter", "my_filter", "--out", "some where"});
    ASSERT_EQ(o.code, 0) << o.err;
    EXPECT_TRUE(fs::exists(folder.path() / "some where/my_filter/MyFilter.cpp"));
    expectContains(o.out,
                   {"cmake --install " VIABLE_BINARY_DIR " --prefix ~/viable", "-DCMAKE_PREFIX_PATH=$HOME/viable",
                    "~/viable/bin/viable run experiment.yaml", "cd 'some where/my_filter'"});
}

TEST(NewPlugin, TheFolderHasTheRightsThatTheUserGivesNewFolders) {
    Folder folder;
    ASSERT_EQ(run({"new", "filter", "mine", "--out", folder.path()}, [] { umask(0027); }).code, 0);
    EXPECT_EQ(static_cast<int>(fs::status(folder / "mine").permissions()), 0750);
}

TEST(NewPlugin, RefusesNamesThatAreNotSnakeCaseAndSuggestsOne) {
    const std::vector<std::pair<std::string, std::string>> names = {
        {"MyFilter", "my_filter"}, {"my-filter", "my_filter"}, {"MyPDLaw2", "my_pd_law2"},
        {"2fast", "filter_2fast"}, {"my filter", "my_filter"}, {"x_", "x"},
        {"a__b", "a_b"},           {"\xC3\xA4", "my_filter"},  {"Class", "class_filter"},
        {"x.so", "x_so"},          {"...", "my_filter"},       {"_x", "x"}};
    for (const auto& [name, better] : names)
        expectRefused({"filter", name}, {"new filter: the name `" + name + "` is not snake_case",
                                         "beginning with a letter: `" + better + "`."});
    expectRefused({"filter", "a\x1b[2Jb"}, {"the name `a?[2Jb` is not snake_case", "`a_2_jb`"});
}

TEST(NewPlugin, RefusesOtherNamesThatCannotWork) {
    expectRefused({"filter", "class"}, {"the name `class` is a keyword of C++", "Add a word to it: `class_filter`."});
    expectRefused({"plant", "test"}, {"the name `test` would clash", "`test_plant`"});
    expectRefused({"filter", std::string(80, 'x')}, {"has 80 letters; at most 60 are allowed"});
    expectRefused({"filter", "laws/MyLaw"}, {"the name `laws/MyLaw` is a path", "`my_law --out laws`"});
    expectRefused({"filter", "../law/"}, {"is a path", "`law --out ..`"});
    expectRefused({"filter", "certified_braking"}, {"there is already a filter `certified_braking`: " VIABLE_PLUGIN_DIR,
                                                    "such as `my_certified_braking`"});
    Folder folder;  // of another kind it is no clash
    EXPECT_EQ(makeNew(folder, {"command", "certified_braking"}).code, 0);
}

TEST(NewPlugin, RefusesAnUnclearRequest) {
    expectRefused({}, {"the kind is missing", "KIND is filter, controller"});
    expectRefused({"filtre", "x"}, {"there is no kind `filtre`", "Did you mean `filter`?"});
    expectRefused({"filter"}, {"the name is missing", "`viable new filter NAME`"});
    expectRefused({"filter", ""}, {"the name is missing"});
    expectRefused({"filter", "x", "--urdf", "a.urdf"}, {"--urdf is for robots only"});
    expectRefused({"filter", "x", "y"}, {"new: `y` is more than it takes", "`viable new --help`"});
}

TEST(NewPlugin, OverwritesNothingAndLeavesNothingBehind) {
    Folder folder;
    fs::create_directory(folder / "full");
    folder.write("full/thesis.txt", "mine");
    folder.write("file", "mine");
    fs::create_symlink("nowhere", folder / "link");
    EXPECT_EQ(makeNew(folder, {"filter", "full"}).code, 2);
    expectContains(makeNew(folder, {"filter", "full"}).err,
                   {"full: this folder is not empty", "Nothing is overwritten"});
    expectContains(makeNew(folder, {"filter", "file"}).err, {"file: there is already a file of that name"});
    expectContains(makeNew(folder, {"filter", "link"}).err, {"link: there is already a file of that name"});
    expectContains(makeNew(folder, {"filter", "good", "--out", "file"}).err,
                   {"file: this cannot be written: Not a directory"});
    EXPECT_EQ(listNames(folder.path()), (std::vector<std::string>{"file", "full", "link"}));
    EXPECT_EQ(listNames(folder / "full"), std::vector<std::string>{"thesis.txt"});
    fs::create_directory(folder / "empty");
    EXPECT_EQ(makeNew(folder, {"filter", "empty"}).code, 0);
    EXPECT_TRUE(fs::exists(folder / "empty/Empty.cpp"));
}

TEST(NewPlugin, Fault72_WritesAllOrNothing) {
    // A file size limit stands for a full disk: the small files fit, the larger ones do not.
    Folder folder;
    const std::string path = folder.path();
    const Outcome o = run({"new", "filter", "half", "--out", "new/folder"}, [path] {
        if (chdir(path.c_str()) != 0) _exit(98);
        signal(SIGXFSZ, SIG_IGN);
        const rlimit most{900, 900};
        setrlimit(RLIMIT_FSIZE, &most);
    });
    EXPECT_EQ(o.code, 5);
    expectContains(o.err, {"new/folder/half/", "this cannot be written: File too large", "Nothing was left behind"});
    EXPECT_TRUE(fs::is_empty(folder.path()));
    // /proc lets nobody make a folder, as a disk that is read-only.
    expectRun({"new", "filter", "half", "--out", "/proc"}, 5, {"/proc", "this cannot be written: "});
}

// ---------------------------------------------------------------------------------------- robots

const char* const kArm = R"(<robot name="any">
<link name="base"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
  <limit effort="30" velocity="2"/></joint>
<link name="a"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="revolute"><origin xyz="0 0 0.4"/><parent link="a"/><child link="b"/>
  <axis xyz="0 1 0"/><limit lower="0.5" upper="1.5" effort="20" velocity="3"/></joint>
<link name="b"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
)";

void replaceAll(const fs::path& file, const std::string& from, const std::string& to) {
    std::string text = readFile(file);
    ASSERT_NE(text.find(from), std::string::npos) << from;
    for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
        text.replace(at, from.size(), to);
    std::ofstream(file, std::ios::binary) << text;
}

Outcome describe(const fs::path& robot) {
    return run({"robots", "--describe", robot});
}

TEST(NewRobot, IsRefusedBlankByBlankAndRunsWhenAllAreFilledIn) {
    Folder folder;
    const Outcome made = makeNew(folder, {"robot", "my_arm", "--urdf", folder.write("some.urdf", kArm)});
    ASSERT_EQ(made.code, 0) << made.err;
    EXPECT_EQ(made.err, "");
    EXPECT_EQ(listNames(folder / "my_arm"), (std::vector<std::string>{"README.md", "actuation.yaml", "collision.yaml",
                                                                      "first_run.yaml", "limits.yaml", "my_arm.urdf"}));
    expectContains(made.out, {"my_arm/collision.yaml:", ": links: TODO"});  // no shapes in there
    EXPECT_EQ(readFile(folder / "my_arm/my_arm.urdf"), kArm);
    const fs::path limits = folder / "my_arm/limits.yaml";
    const fs::path actuation = folder / "my_arm/actuation.yaml";
    expectContains(readFile(limits), {"lower: [-.inf, 0.5]", "upper: [.inf, 1.5]", "velocity_radps: [2, 3]",
                                      "home_rad: [0, 1]", "tool_link: \"b\"", "# Joints, in this order: turn, lift"});
    expectContains(readFile(actuation), {"torque_limit_Nm: [30, 20]"});

    // Every blank that was listed is refused by its place, in turn.
    const std::vector<std::pair<fs::path, std::string>> blanks = {
        {limits, "acceleration_radps2: "},      {limits, "jerk_radps3: "},   {actuation, "gear_ratio: "},
        {actuation, "rotor_inertia_kgm2: "},    {actuation, "coulomb_Nm: "}, {actuation, "viscous_Nm: "},
        {actuation, "viscous_velocity_radps: "}};
    for (const auto& [file, key] : blanks) {
        SCOPED_TRACE(key);
        expectContains(made.out, {key + "TODO"});
        std::istringstream lines(readFile(file));
        std::string line;
        int number = 1;
        while (std::getline(lines, line) && line.find(key + "TODO") == std::string::npos) ++number;
        const std::string place =
            file.string() + ":" + std::to_string(number) + ":" + std::to_string(line.find("TODO") + 1) + ": ";
        for (const Outcome& o : {describe(folder / "my_arm"), run({"check", folder / "my_arm/first_run.yaml"})}) {
            EXPECT_EQ(o.code, 2);
            expectContains(o.err, {place, key.substr(0, key.size() - 2) + ": not filled in yet",
                                   "Write the value in place of TODO"});
        }
        replaceAll(file, key + "TODO", key + (file == limits ? "[10, 12]" : "1"));
    }
    replaceAll(limits, "jerk_radps3: [10, 12]", "jerk_radps3: 200");
    const Outcome described = describe(folder / "my_arm");
    EXPECT_EQ(described.code, 0) << described.err;
    expectContains(described.out, {"my_arm: 2 joints, tool frame b", "-inf .. inf", "-12 .. 12"});
    expectRun({"run", folder / "my_arm/first_run.yaml", "--out", folder / "out", "--details", "--set", "duration_s=5"},
              0, {"First run of my_arm", "all limits kept"});
    // By name, from a folder that the environment names.
    const std::string path = folder.path();
    EXPECT_EQ(run({"check", VIABLE_SOURCE_DIR "/experiments/arena_one_joint.yaml", "--set", "robot=my_arm", "--set",
                   "limits.position_rad=1.4", "--set", "start.position_rad=[0, 1]"},
                  [path] { setenv("VIABLE_ROBOT_PATH", path.c_str(), 1); })
                  .code,
              0);
}

TEST(NewRobot, LeavesBlanksForWhatTheUrdfSaysWronglyAndWarns) {
    Folder folder;
    std::string urdf = kArm;
    const auto change = [&](const std::string& from, const std::string& to) {
        ASSERT_NE(urdf.find(from), std::string::npos) << from;
        urdf.replace(urdf.find(from), from.size(), to);
    };
    change("effort=\"20\" velocity=\"3\"", "effort=\"0\" velocity=\"0\"");
    change("</robot>",
           "<joint name='left' type='fixed'><parent link='b'/><child link='tip 1: x'/></joint>"
           "<link name='tip 1: x'><visual><geometry><mesh filename='package://arm/tip.stl'/>"
           "</geometry></visual></link><joint name='right' type='fixed'><parent link='b'/>"
           "<child link='TODO'/></joint><link name='TODO'/></robot>");
    const Outcome made = makeNew(folder, {"robot", "my_arm", "--urdf", folder.write("some.urdf", urdf)});
    ASSERT_EQ(made.code, 0) << made.err;
    expectContains(made.err, {"warning: ", "some.urdf:7:1: joint `lift`: its velocity limit is 0",
                              "joint `lift`: its effort limit is 0 or missing",
                              "link `tip 1: x`: it is drawn but has no mass (no <inertial>)"});
    expectContains(made.out, {"velocity_radps: [2, TODO]", "torque_limit_Nm: [30, TODO]", "tool_link: TODO",
                              "the report needs 1 mesh file in the folder"});
    expectContains(readFile(folder / "my_arm/README.md"), {"package://arm/tip.stl"});
    const fs::path limits = folder / "my_arm/limits.yaml";
    expectContains(readFile(limits), {"The robot ends in several: tip 1: x, TODO"});
    replaceAll(limits, "[2, TODO]", "2");
    replaceAll(limits, "_radps2: TODO", "_radps2: 9");
    replaceAll(limits, "_radps3: TODO", "_radps3: 90");
    expectContains(describe(folder / "my_arm").err, {"tool_link: not filled in yet"});
    replaceAll(limits, "tool_link: TODO", "tool_link: \"TODO\"");  // in quotes it is a name
    expectContains(describe(folder / "my_arm").err, {"actuation.yaml", "not filled in yet"});
}

TEST(NewRobot, DraftsCapsulesThatAreReadBack) {
    Folder folder;
    std::string urdf = kArm;
    const auto addShape = [&](const std::string& link, const std::string& geometry) {
        const std::string from = "<link name=\"" + link + "\">";
        ASSERT_NE(urdf.find(from), std::string::npos);
        urdf.insert(urdf.find(from) + from.size(), "<collision><geometry>" + geometry + "</geometry></collision>");
    };
    addShape("a", "<sphere radius='0.1'/>");
    addShape("b", "<box size='0.1 0.1 0.4'/>");
    const std::string more =
        "<joint name='left' type='fixed'><parent link='b'/><child link='no'/></joint><link "
        "name='no'><collision><geometry><mesh filename='package://arm/tip.stl'/></geometry>"
        "</collision></link></robot>";
    urdf.replace(urdf.find("</robot>"), 8, more);
    folder.write("some.urdf", urdf);
    const Outcome made = makeNew(folder, {"robot", "my_arm", "--urdf", "some.urdf"});
    ASSERT_EQ(made.code, 0) << made.err;
    const fs::path file = folder / "my_arm/collision.yaml";
    expectContains(readFile(file), {"What of my_arm can hit something",
                                    "  \"a\":\n    - {from: [0, 0, 0], to: [0, 0, 0], radius: 0.1001}",
                                    "  # not read: package://arm/tip.stl\n  \"no\": TODO",
                                    "# without a shape in the URDF: base", "  - [\"a\", \"b\"]  # next to each other"});
    EXPECT_EQ(readFile(file).find('@'), std::string::npos);
    expectContains(made.out, {"my_arm/collision.yaml:", ": \"no\": TODO"});

    for (const char* blank :
         {"gear_ratio: ", "rotor_inertia_kgm2: ", "coulomb_Nm: ", "viscous_Nm: ", "viscous_velocity_radps: "})
        replaceAll(folder / "my_arm/actuation.yaml", std::string(blank) + "TODO", std::string(blank) + "1");
    replaceAll(folder / "my_arm/limits.yaml", "TODO", "10");
    const RobotDescription robot = loadRobot(folder / "my_arm");
    expectError({"collision.yaml:", "links.no: not filled in yet"}, [&] { loadArmGeometry(robot); });
    replaceAll(file, "\"no\": TODO", "\"no\": [{from: [0, 0, 0], to: [0, 0, 1], radius: 0.1}]");
    const ArmGeometry arm = loadArmGeometry(robot);
    EXPECT_EQ(arm.links, (std::vector<std::string>{"a", "b", "no"}));
    EXPECT_EQ(arm.capsules.size(), 3u);
    EXPECT_EQ(arm.pairs, (std::vector<std::pair<int, int>>{{0, 2}}));  // b carries `no`
}

TEST(NewRobot, RefusesAUrdfThatCannotBeSimulated) {
    const auto refuse = [](const std::string& from, const std::string& to, const std::vector<std::string>& parts) {
        SCOPED_TRACE(to);
        std::string urdf = kArm;
        const std::size_t at = urdf.find(from);
        ASSERT_NE(at, std::string::npos);
        urdf.replace(at, from.size(), to);
        Folder folder;
        const Outcome o = makeNew(folder, {"robot", "my_arm", "--urdf", folder.write("some.urdf", urdf)});
        EXPECT_EQ(o.code, 2);
        expectContains(o.err, parts);
        EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{"some.urdf"});
    };
    const std::string lift = "name=\"lift\" type=\"revolute\"";
    refuse(lift, "name=\"lift\" type=\"floating\"",
           {"some.urdf:7:1: ", "joint `lift` is of type floating", "replace it"});
    refuse(lift, "name=\"lift\" type=\"planar\"", {"joint `lift` is of type planar", "replace it"});
    refuse("</robot>", "<joint name='loop' type='fixed'><parent link='base'/><child link='b'/></joint></robot>",
           {"link `b` is the child of two joints", "open the loop"});
    refuse("<link name=\"base\"/>", "<xacro:base/>", {"this is xacro input", "Run `xacro"});
    refuse("value=\"2\"", "value=\"-2\"", {"link `a`: the mass is -2"});
    refuse("izz=\"0.01\"", "izz=\"0.1\"", {"link `a`: the inertia tensor belongs to no body", "Correct <inertia>"});
    refuse("izz=\"0.01\"", "izz=\"-0.01\"", {"link `a`: the inertia tensor is not positive definite"});
    refuse("<mass value=\"1\"/>", "<mass value=\"0\"/>", {"link `b`: there is an inertia without"});
}

TEST(NewRobot, Fault78_RepairsWhatItCanAndSaysSo) {
    Folder folder;
    std::string urdf = kArm;
    urdf.replace(
        urdf.find("</robot>"), 8,
        "<joint name='grip' type='prismatic'><parent link='b'/><child link='finger'/><limit lower='0' upper='1' "
        "effort='1' velocity='1'/></joint><link name='finger'/></robot>");
    const Outcome made = makeNew(
        folder, {"robot", "my_arm", "--urdf", folder.write("some.urdf", urdf), "--fix", "turn=0.5", "--tip", "b"});
    ASSERT_EQ(made.code, 0) << made.err;
    expectContains(made.err, {"viable: repaired: ", "some.urdf:3:1: joint `turn` is frozen at 0.5: --fix",
                              "outside of the chosen chain, and frozen: grip at 0"});
    const std::string written = readFile(folder / "my_arm/my_arm.urdf");
    expectContains(written, {"<!-- Changed from the file given:", "joint `turn` is frozen at 0.5: option fix"});
    EXPECT_EQ(written.find("some.urdf:3:1") != std::string::npos, true);
    expectContains(readFile(folder / "my_arm/limits.yaml"), {"# Joints, in this order: lift", "tool_link: \"b\""});
    const Outcome wrong =
        makeNew(folder, {"robot", "other", "--urdf", folder / "some.urdf", "--fix", "trn", "--tip", "c"});
    EXPECT_EQ(wrong.code, 2);
    expectContains(wrong.err, {"2 things are wrong", "--tip: the robot has no link `c`",
                               "--fix: the robot has no joint `trn`. Did you mean `turn`?"});
    EXPECT_FALSE(fs::exists(folder / "other"));
}

TEST(NewRobot, RunsAtOnceWithAssumedFiguresAndSaysSo) {
    for (const std::string name : {"panda", "ur5e", "indy7"}) {
        SCOPED_TRACE(name);
        Folder folder;
        const Outcome made = makeNew(folder, {"robot", "my_arm", "--assume", "--urdf",
                                              std::string(VIABLE_SOURCE_DIR "/robots/") + name + "/" + name + ".urdf"});
        ASSERT_EQ(made.code, 0) << made.err;
        expectContains(made.out, {"Assumed, because the URDF does not say it",
                                  "jerk limits: the acceleration limit in 0.05 s", "run my_arm/hand.yaml"});
        expectContains(readFile(folder / "my_arm/README.md"), {"assumption: the acceleration limit in 0.05 s"});
        expectContains(describe(folder / "my_arm").out, {"Assumed, not given: acceleration_radps2, jerk_radps3"});
        for (const char* file : {"first_run.yaml", "hand.yaml", "obstacles.yaml"}) {
            if (!fs::exists(folder / "my_arm" / file)) {
                EXPECT_EQ(name, "indy7") << "its URDF has no shapes";
                continue;
            }
            const bool hasBall = file == std::string("obstacles.yaml");
            std::vector<std::string> run{"run", folder / "my_arm" / file, "--out", folder / "out" / file, "--details"};
            if (!hasBall) run.insert(run.end(), {"--set", "duration_s=4"});  // else to the end: the hand meets the ball
            const Outcome ran = test::run(run);
            EXPECT_EQ(ran.code, 0) << ran.err;
            if (hasBall)
                expectContains(ran.out, {"deep in ball",
                                         "and clearances; those of acceleration and jerk are assumed); no collision"});
            expectContains(ran.out, {"verdict       all limits kept (nominal arm; the filter guarantees all",
                                     "assumed       figures of the robot that nobody gave: acceleration_radps2"});
        }
        // The figure that is known now is taken from the list.
        replaceAll(folder / "my_arm/actuation.yaml", "assumed: [rotor_inertia_kgm2, friction]",
                   "assumed: [gear, friction]");
        expectContains(describe(folder / "my_arm").err, {"actuation.yaml:", "there is no figure `gear` in this file"});
        replaceAll(folder / "my_arm/actuation.yaml", "assumed: [gear, friction]", "assumed: [fricton]");
        expectContains(describe(folder / "my_arm").err,
                       {"no figure `fricton` in this file. Did you mean `friction`? "});
    }
}

/** An arm of 0.8 m as CAD leaves it: no masses, one tensor of no body, definitions of xacro. */
std::string makePoorUrdf() {
    const std::string shape =
        "<visual><origin xyz='0 0 0.1'/><geometry><cylinder radius='0.03' length='0.2'/></geometry></visual>";
    std::string urdf = "<robot name='poor' xmlns:xacro='x'><xacro:property name='w' value='1'/><link name='base'/>";
    for (int i = 1; i <= 4; ++i) {
        const std::string n = std::to_string(i);
        urdf += "<joint name='j" + n + "' type='revolute'><parent link='" +
                (i > 1 ? "l" + std::to_string(i - 1) : "base") + "'/><child link='l" + n +
                "'/><origin xyz='0 0 0.2'/><axis xyz='" +
                (i == 1   ? "0 0 1"
                 : i == 4 ? "1 0 0"
                          : "0 1 0") +
                "'/><limit lower='-2' upper='2' velocity='2' effort='0'/></joint><link name='l" + n + "'>" + shape +
                (i == 2 ? "<inertial><mass value='1'/><inertia ixx='0.001' iyy='0.001' izz='0.009' ixy='0' ixz='0' "
                          "iyz='0'/></inertial>"
                        : "") +
                "</link>";
    }
    return urdf + "</robot>";
}

TEST(NewRobot, APoorUrdfMovesAtItsFirstRunWhichNamesWhatIsAssumed) {
    Folder folder;
    std::ofstream(folder / "poor.urdf") << makePoorUrdf();
    const Outcome refused = makeNew(folder, {"robot", "arm", "--urdf", folder / "poor.urdf"});
    EXPECT_EQ(refused.code, 2);
    expectContains(refused.err, {"2 things are wrong", "`viable new robot --assume` takes a mass from the shapes"});
    EXPECT_FALSE(fs::exists(folder / "arm"));
    const Outcome made = makeNew(folder, {"robot", "arm", "--assume", "--urdf", folder / "poor.urdf"});
    ASSERT_EQ(made.code, 0) << made.err;
    expectContains(made.err,
                   {"<xacro:property> is left out", "from 0.001, 0.001, 0.009 kg m^2 to 0.00333, 0.00333, 0.00667"});
    expectContains(made.out, {"  mass: l1 0.724 kg, l3 0.724 kg, l4 0.724 kg: the volume", "  inertia: l2: "});
    expectContains(readFile(folder / "arm/README.md"), {"assumption: l1 0.724 kg"});
    const std::string all = "inertia (l2), mass (l1, l3, l4), acceleration_radps2";
    expectContains(describe(folder / "arm").out, {"Assumed, not given: " + all});
    expectRun({"run", folder / "arm/hand.yaml", "--out", folder / "out", "--details", "--set", "duration_s=3"}, 0,
              {"verdict       all limits kept", "figures of the robot that nobody gave: " + all,
               "tool          its joints move it in 4 of 6 directions, 3 of 3 without turning"});
}

TEST(NewRobot, AToolThatItsOnlyJointDoesNotMoveGetsNoTask) {
    Folder folder;
    std::ofstream(folder / "turn.urdf") << "<robot name='turn'><link name='base'/><link name='arm'><inertial><origin "
                                           "xyz='0 0 0.2'/><mass value='1'/><inertia "
                                           "ixx='0.02' iyy='0.02' izz='0.01' ixy='0' ixz='0' "
                                           "iyz='0'/></inertial><collision><origin xyz='0 0 0.2'/><geometry>"
                                           "<cylinder radius='0.03' length='0.4'/></geometry></collision></link><joint "
                                           "name='turn' type='revolute'><parent "
                                           "link='base'/><child link='arm'/><axis xyz='0 1 0'/><limit lower='-2' "
                                           "upper='2' velocity='2' effort='20'/></joint></robot>";
    const Outcome made = makeNew(folder, {"robot", "turn", "--assume", "--urdf", folder / "turn.urdf"});
    EXPECT_EQ(made.code, 0) << made.err;
    EXPECT_TRUE(fs::exists(folder / "turn/first_run.yaml"));
    EXPECT_FALSE(fs::exists(folder / "turn/obstacles.yaml"));
}

TEST(NewRobot, RefusesAnUnclearRequest) {
    expectRefused({"robot", "arm"}, {"the robot's URDF is missing", "Add --urdf FILE.urdf"});
    expectRefused({"robot"}, {"the name is missing", "`viable new robot NAME --urdf FILE`"});
    expectRefused({"robot", "arm", "--urdf", "none.urdf"}, {"there is no file none.urdf"});
    expectRefused({"robot", "arm", "--urdf", "/"}, {"/ is not a file"});
    expectRefused({"robot", "Arm", "--urdf", "x"}, {"`Arm` is not snake_case", "`arm`"});
    expectRefused({"filter", "x", "--assume"}, {"--assume is for robots only", "--urdf FILE"});
    expectRefused({"filter", "x", "--fix", "j"}, {"--fix is for robots only"});
    expectRefused({"robot", "indy7", "--urdf", VIABLE_SOURCE_DIR "/robots/indy7/indy7.urdf"},
                  {"there is already a robot `indy7`", "such as `my_indy7`"});
    expectRefused({"robot", "arm", "--urdf", VIABLE_SOURCE_DIR "/CHANGELOG.md"}, {"CHANGELOG.md", "this is not XML"});
}

}  // namespace
}  // namespace viable::test
