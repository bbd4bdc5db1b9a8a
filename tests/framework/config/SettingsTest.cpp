
#include "Complaint.h"
#include "TemporaryFolder.h"
#include "config/ParameterJson.h"
#include "host/PluginDescription.h"

namespace viable::test {
namespace {

namespace fs = std::filesystem;

enum class Window { Hann, Box };

struct Options {
    double gamma = 20.0, forceLimit_N = kInfinity;
    std::int64_t seed = 7;
    bool gravity = true;
    Window window = Window::Box;
    std::string label;
    fs::path map;
    PerJoint stiffness = 2 * kPi;
    Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
    std::vector<std::vector<double>> waypoints;

    template <class V>
    void describe(V& v) {
        v(gamma, "gamma", "1/s", "How fast the jerk follows.").above(0).upTo(1000);
        v(forceLimit_N, "force_limit_N", "N", "Largest force.").above(0).orInfinite();
        v(seed, "seed", "Seed of the noise.").atLeast(0);
        v(gravity, "gravity", "Adds gravity torque.");
        v(window, "window", "hann|box", "Shape of the window.");
        v(label, "label", "Shown in the report.");
        v(map, "map", "Obstacles; none when empty.");
        v(stiffness, "stiffness", "1/s^2", "Gain of each joint.").atLeast(0);
        v(axis, "axis", "", "Direction.");
        v(waypoints, "waypoints", "rad", "Way.").count(2, 3);
    }
};
const ParameterSpec* const kSpecs = settingsOf<Options>().data();
const std::size_t kCount = settingsOf<Options>().size();

/** A row by itself. */
ParameterSpec makeRow(ParameterType type, const char* name, const char* unit, const char* standard, const char* help,
                      const char* choices = nullptr) {
    ParameterSpec row{name, unit, type, standard, help};
    row.choices = choices;
    return row;
}

ConfigNode makeBlock(const std::string& text, const std::string& file = "f.yaml") {
    return *parseConfig("block: " + text + "\n", file).find("block");
}
Parameters read(const std::string& text, int jointCount = 3) {
    return readParameters(makeBlock(text), kSpecs, kCount, jointCount);
}
std::string refuseBlock(const std::string& text) {
    return catchError([&] { read(text); });
}
TEST(Parameters, DefaultsFillWhatIsNotWritten) {
    const Parameters p = read("{plugin: x}");
    const auto options = p.get<Options>();
    EXPECT_EQ(options.gamma, 20.0);
    EXPECT_EQ(options.forceLimit_N, kInfinity);
    EXPECT_EQ(options.seed, 7);
    EXPECT_TRUE(options.gravity);
    EXPECT_EQ(options.window, Window::Box);
    EXPECT_EQ(options.label, "");
    EXPECT_TRUE(options.map.empty());
    EXPECT_EQ(options.stiffness.expand(3), JointVector::Constant(3, 2 * kPi));
    EXPECT_EQ(options.axis, Eigen::Vector3d(0, 0, 1));
    EXPECT_TRUE(options.waypoints.empty());
    EXPECT_EQ(p.place("gamma"), "f.yaml:1:8: block");
}

TEST(Parameters, WrittenValuesOfEveryType) {
    const Parameters p = read(
        "{plugin: x, gamma: 2*5, seed: 9, gravity: false, window: hann, label: '3', "
        "stiffness: [1, 2, 3], axis: [1, 0, 0], waypoints: [[1, 2], [3, 4, pi]]}");
    const auto options = p.get<Options>();
    EXPECT_EQ(options.gamma, 10.0);
    EXPECT_EQ(options.seed, 9);
    EXPECT_FALSE(options.gravity);
    EXPECT_EQ(options.window, Window::Hann);
    EXPECT_EQ(options.label, "3");
    EXPECT_EQ(options.stiffness[2], 3.0);
    EXPECT_EQ(options.axis[0], 1.0);
    ASSERT_EQ(options.waypoints.size(), 2u);
    EXPECT_EQ(options.waypoints[1][2], kPi);
    EXPECT_EQ(p.place("gamma"), "f.yaml:1:27: block.gamma");
}

TEST(Parameters, ResolvedBlockIsCompleteAndReadsBackToTheSame) {
    const Parameters p = read("{plugin: x, gamma: 2*5, waypoints: [[1, 2], [3, 4]]}");
    const ConfigNode& resolved = p.resolved();
    ASSERT_EQ(resolved.entries.size(), kCount + 1);
    EXPECT_EQ(resolved.entries[0].first, "plugin");
    EXPECT_EQ(resolved.find("plugin")->text, "x");
    EXPECT_EQ(resolved.find("gamma")->text, "2*5");
    EXPECT_EQ(resolved.find("seed")->text, "7");
    EXPECT_EQ(resolved.find("seed")->place(), "default of seed: block.seed");
    const ConfigNode again = parseConfig(writeConfig(resolved), "log");
    const Parameters q = readParameters(again, kSpecs, kCount, 3);
    EXPECT_EQ(q.get<Options>().gamma, 10.0);
    EXPECT_EQ(q.get<Options>().forceLimit_N, kInfinity);
    EXPECT_EQ(q.get<Options>().waypoints, p.get<Options>().waypoints);
    EXPECT_TRUE(q.get<Options>().map.empty());
    EXPECT_EQ(writeConfig(q.resolved()), writeConfig(resolved));
    EXPECT_EQ(read("{}").resolved().find("plugin"), nullptr);
}

TEST(Parameters, MissingRequiredParameterIsExplained) {
    const ParameterSpec specs[] = {
        makeRow(ParameterType::Number, "k_alpha", "1/s", nullptr, "Rate of approach to a limit.").above(0)};
    expectError({"f.yaml:1:8: block: `k_alpha` [1/s] is missing: Rate of approach to a limit.", "Add `k_alpha: ...`"},
                [&] { readParameters(makeBlock("{plugin: x}"), specs, 1, 3); });
    EXPECT_EQ(readParameters(makeBlock("{k_alpha: 5}"), specs, 1, 3).resolved().find("k_alpha")->text, "5");
}

TEST(Parameters, Fault02_UnknownKeysNameTheClosest) {
    for (const ParameterSpec& spec : settingsOf<Options>()) {
        const std::string name = spec.name;
        std::string slip = name;
        slip.erase(1, 1);
        expectContains(refuseBlock("{plugin: x, " + slip + ": 1}"),
                       {"block." + slip, "`" + slip + "` is unknown", "Did you mean `" + name + "`?",
                        "Known keys: `plugin`, `gamma`"});
    }
    expectContains(refuseBlock("{plugni: x}"), {"Did you mean `plugin`?"});
    expectContains(refuseBlock("3"), {"f.yaml:1:8: block", "must be a map"});
    expectContains(refuseBlock("~"), {"must be a map"});
}

TEST(Parameters, Fault04_Fault05_WrongValuesNamePlaceValueAndRange) {
    expectContains(refuseBlock("{gamma: 0}"), {"f.yaml:1:16: block.gamma: 0 is out of range; allowed is (0, 1000]"});
    expectContains(refuseBlock("{gamma: 1001}"), {"1001 is out of range"});
    expectContains(refuseBlock("{gamma: .inf}"), {"must be finite"});
    expectContains(refuseBlock("{gamma: .nan}"), {"is not a number"});
    expectContains(refuseBlock("{gamma: 20 1/s}"), {"block.gamma"});
    expectContains(refuseBlock("{gamma: [20]}"), {"must be a number; it is a list of 1"});
    expectContains(refuseBlock("{gamma: }"), {"it is empty"});
    expectContains(refuseBlock("{force_limit_N: -.inf}"), {"(0, inf) or .inf"});
    expectContains(refuseBlock("{seed: -1}"), {"out of range", "[0, 9223372036854775807]"});
    expectContains(refuseBlock("{seed: 1.5}"), {"is not a whole number"});
    expectContains(refuseBlock("{seed: 010}"), {"leading zeros"});
    expectContains(refuseBlock("{gravity: yes}"), {"`true` or `false`"});
    expectContains(refuseBlock("{window: han}"), {"Did you mean `hann`?", "`hann`, `box`"});
    expectContains(refuseBlock("{stiffness: [1, 2]}"), {"list of 3 numbers, one per joint"});
    expectContains(refuseBlock("{stiffness: [1, -2, 3]}"), {"block.stiffness[1]: -2 is out of"});
    expectContains(refuseBlock("{axis: 1}"), {"must be a list of 3 numbers"});
    expectContains(refuseBlock("{waypoints: 1}"), {"must be a list of lists of numbers"});
    expectContains(refuseBlock("{waypoints: [1, 2]}"), {"block.waypoints[0]", "must be a list of 2 to 3 numbers"});
    expectContains(refuseBlock("{waypoints: [[1, 2], [1]]}"), {"block.waypoints[1]"});
}

TEST(Parameters, RangeOfIntegersFollowsOpenAndFractionalBounds) {
    const ParameterSpec specs[] = {makeRow(ParameterType::Integer, "n", "", nullptr, "Count.").above(0).below(5),
                                   makeRow(ParameterType::Integer, "m", "", "1", "Count.").atLeast(0.5).upTo(2.5)};
    const auto readCount = [&](const std::string& text) { return readParameters(makeBlock(text), specs, 2, 3); };
    EXPECT_EQ(readCount("{n: 1}").resolved().find("n")->text, "1");
    EXPECT_EQ(readCount("{n: 4, m: 2}").resolved().find("m")->text, "2");
    expectError({"[1, 4]"}, [&] { readCount("{n: 0}"); });
    expectError({"[1, 4]"}, [&] { readCount("{n: 5}"); });
    expectError({"[1, 2]"}, [&] { readCount("{n: 1, m: 3}"); });
}

TEST(Parameters, DefaultThatDoesNotFitSaysSo) {
    const ParameterSpec specs[] = {makeRow(ParameterType::JointNumbers, "gain", "", "[1, 2, 3, 4, 5, 6]", "Gain.")};
    EXPECT_EQ(readParameters(makeBlock("{}"), specs, 1, 6).resolved().find("gain")->items[5].text, "6");
    expectError({"default of gain: block.gain", "list of 7 numbers", "it is a list of 6"},
                [&] { readParameters(makeBlock("{}"), specs, 1, 7); });
    const ParameterSpec wrong[] = {makeRow(ParameterType::Number, "k", "", "-1", "K.").above(0)};
    expectError({"default of k: block.k: -1 is out of range"}, [&] { readParameters(makeBlock("{}"), wrong, 1, 7); });
    EXPECT_EQ(readParameters(makeBlock("{k: 2}"), wrong, 1, 7).resolved().find("k")->text, "2");
}

TEST(Parameters, FilesStartInTheFolderOfTheFileThatNamesThem) {
    const TemporaryFolder folder;
    fs::create_directories(folder.path() / "maps");
    fs::create_directories(folder.path() / "experiments");
    std::ofstream(folder.path() / "maps" / "floor.bt") << "x";
    const std::string experiment = (folder.path() / "experiments" / "e.yaml").string();
    const auto readFile = [&](const std::string& name) {
        return readParameters(makeBlock("{map: " + name + "}", experiment), kSpecs, kCount, 3);
    };
    const fs::path path = readFile("../maps/floor.bt").get<Options>().map;
    EXPECT_TRUE(path.is_absolute());
    EXPECT_TRUE(fs::equivalent(path, folder.path() / "maps" / "floor.bt"));
    EXPECT_EQ(readFile((folder.path() / "maps/floor.bt").string()).get<Options>().map, folder.path() / "maps/floor.bt");
    fs::create_symlink("../maps/floor.bt", folder.path() / "experiments" / "link.bt");
    EXPECT_TRUE(fs::equivalent(readFile("link.bt").get<Options>().map, path));
    EXPECT_EQ(readFile("link.bt").resolved().find("map")->text, (folder.path() / "experiments" / "link.bt").string());
    EXPECT_TRUE(readFile("''").get<Options>().map.empty());

    // From the command line: the current folder.
    ConfigNode root = parseConfig("block: {}\n", experiment);
    applyOverride(root, "block.map=floor.bt");
    const fs::path before = fs::current_path();
    fs::current_path(folder.path() / "maps");
    fs::path fromHere;
    try {
        fromHere = readParameters(*root.find("block"), kSpecs, kCount, 3).get<Options>().map;
    } catch (...) {
        fs::current_path(before);
        throw;
    }
    fs::current_path(before);
    EXPECT_TRUE(fromHere.is_absolute());
    EXPECT_TRUE(fs::equivalent(fromHere, path));
}

TEST(Parameters, Fault11_FileMissingFolderOrDanglingLink) {
    const TemporaryFolder folder;
    const std::string experiment = (folder.path() / "e.yaml").string();
    const auto refuseFile = [&](const std::string& name) {
        return catchError([&] { readParameters(makeBlock("{map: " + name + "}", experiment), kSpecs, kCount, 3); });
    };
    fs::create_directories(folder.path() / "sub");
    fs::create_symlink("nowhere", folder.path() / "dangling.bt");
    expectContains(refuseFile("missing.bt"),
                   {"e.yaml:1:14: block.map", "`missing.bt`", (folder.path() / "missing.bt").string(), "does not exist",
                    "folder of the file that names them"});
    expectContains(refuseFile("../../../missing.bt"), {"does not exist"});
    expectContains(refuseFile("sub"), {"is a folder"});
    expectContains(refuseFile("dangling.bt"), {"symbolic link to a missing file"});
    expectContains(refuseFile("/dev/null"), {"is no regular file"});
    expectContains(refuseFile("[a]"), {"must be text"});
    const ParameterSpec required[] = {makeRow(ParameterType::File, "poses", "", nullptr, "Recorded motion.")};
    expectError({"block.poses", "is empty"}, [&] { readParameters(makeBlock("{poses: ''}"), required, 1, 3); });
}

struct Misspelt {
    double gama = 1.0;

    template <class V>
    void describe(V& v) {
        v(gama, "gama", "", "");
    }
};

TEST(Parameters, MistakesOfThePluginAreItsOwn) {
    const Parameters p = read("{}");
    expectError({"f.yaml:1:8: block", "`gama`, which it does not declare"}, ErrorKind::PluginFailed,
                [&] { p.get<Misspelt>(); });
    expectError({"`x`"}, ErrorKind::PluginFailed, [&] { p.place("x"); });
    const ParameterSpec twice[] = {makeRow(ParameterType::Flag, "a", "", "true", ""),
                                   makeRow(ParameterType::Flag, "a", "", "true", "")};
    expectError({"`a` twice"}, ErrorKind::PluginFailed, [&] { readParameters(makeBlock("{}"), twice, 2, 3); });
    const ParameterSpec reserved[] = {makeRow(ParameterType::Text, "plugin", "", "x", "")};
    expectError({"named `plugin`"}, ErrorKind::PluginFailed, [&] { readParameters(makeBlock("{}"), reserved, 1, 3); });
}

TEST(Parameters, DescriptionShowsEveryDeclaration) {
    expectContains(describeParameters(kSpecs, kCount),
                   {"gamma [1/s]: number in (0, 1000]; default 20\n",
                    "force_limit_N [N]: number in (0, inf) or .inf; default .inf\n",
                    "seed: whole number from 0; default 7\n", "window: hann, box; default box\n",
                    "map: file; default \"\"\n", "waypoints [rad]: list of lists of 2 to 3 numbers; default []\n",
                    "axis: list of 3 numbers; default [0, 0, 1]\n", "How fast the jerk follows."});
    const ParameterSpec required[] = {makeRow(ParameterType::File, "poses", "", nullptr, "Recorded motion.")};
    EXPECT_EQ(describeParameters(required, 1), "  poses: file; required\n      Recorded motion.\n");
    EXPECT_EQ(describeParameters(nullptr, 0), "  (no parameters)\n");
}

TEST(Parameters, MarkdownHasOneRowPerDeclaration) {
    const ParameterSpec specs[] = {
        makeRow(ParameterType::Choice, "a", "", "x", "One|two\nthree.", "x|y"),
        makeRow(ParameterType::JointNumbers, "b", "Nm", nullptr, "Gain.").atLeast(0),
        makeRow(ParameterType::Number, "c", "", ".inf", "").above(-1).upTo(5).orInfinite(),
        makeRow(ParameterType::Rows, "d", "m", "[]", "").count(2, 3),
        makeRow(ParameterType::Integer, "e", "", "1", "").atLeast(0).below(10),
        makeRow(ParameterType::Text, "f", "", "", ""),
        makeRow(ParameterType::Numbers, "g", "", "[1]", "").count(1, std::numeric_limits<int>::max()),
    };
    EXPECT_EQ(describeParametersAsMarkdown(specs, 7),
              "| Parameter | Unit | Value | Default | Meaning |\n"
              "|---|---|---|---|---|\n"
              "| `a` |  | `x`, `y` | `x` | One\\|two three. |\n"
              "| `b` | Nm | number in [0, inf), or one per joint | required | Gain. |\n"
              "| `c` |  | number in (-1, 5], .inf or -.inf | `.inf` |  |\n"
              "| `d` | m | list of lists of 2 to 3 numbers | `[]` |  |\n"
              "| `e` |  | whole number from 0 up to 9 | `1` |  |\n"
              "| `f` |  | text | none |  |\n"
              "| `g` |  | list of at least 1 numbers | `[1]` |  |\n");
    EXPECT_EQ(describeParametersAsMarkdown(nullptr, 0), "It has no parameters.\n");
}

TEST(PluginDescription, JsonHoldsTheWholeDeclarationOfEveryType) {
    PluginEntry entry{PluginKind::RobustLoop, "x", "s", kSpecs, kCount, nullptr, nullptr};
    const std::vector<PluginInfo> plugins = {{PluginKind::RobustLoop, "x", "Sum\xff.", "/x.so", &entry}};
    const nlohmann::json root = nlohmann::json::parse(describePluginsAsJson(plugins, {{"/y.so", "broken"}}, true));
    EXPECT_EQ(root["refused"], nlohmann::json::parse(R"([{"library": "/y.so", "reason": "broken"}])"));
    const nlohmann::json& plugin = root["plugins"][0];
    EXPECT_EQ(plugin["kind"], "robust_loop");
    EXPECT_EQ(plugin["library"], "/x.so");
    EXPECT_EQ(plugin["summary"], "Sum\xef\xbf\xbd.");    // a byte that is no UTF-8 is replaced
    EXPECT_FALSE(plugin.contains("guarantees_limits"));  // of filters only
    std::map<std::string, nlohmann::json> p;
    for (const nlohmann::json& parameter : plugin["parameters"]) p[parameter["name"]] = parameter;
    ASSERT_EQ(p.size(), kCount);
    EXPECT_EQ(p["gamma"], nlohmann::json::parse(R"({"name": "gamma", "type": "number", "unit": "1/s",
        "required": false, "default": 20.0, "per_joint": false, "help": "How fast the jerk follows.",
        "range": {"min": 0.0, "min_is_open": true, "max": 1000.0, "max_is_open": false, "may_be_infinite": false}})"));
    EXPECT_EQ(p["force_limit_N"]["default"], ".inf");
    EXPECT_EQ(p["force_limit_N"]["range"]["max"], ".inf");
    EXPECT_EQ(p["force_limit_N"]["range"]["may_be_infinite"], true);
    EXPECT_EQ(p["seed"]["default"], 7);
    EXPECT_EQ(p["seed"]["range"]["max"], std::numeric_limits<std::int64_t>::max());
    EXPECT_EQ(p["gravity"]["default"], true);
    EXPECT_FALSE(p["gravity"].contains("range"));
    EXPECT_EQ(p["window"]["choices"], nlohmann::json::parse(R"(["hann", "box"])"));
    EXPECT_EQ(p["label"]["default"], "");
    EXPECT_EQ(p["stiffness"]["default"], 2 * kPi);
    EXPECT_EQ(p["stiffness"]["per_joint"], true);
    EXPECT_EQ(p["axis"]["default"], nlohmann::json::parse("[0.0, 0.0, 1.0]"));
    EXPECT_EQ(p["waypoints"]["type"], "rows");
    EXPECT_EQ(p["waypoints"]["min_count"], 2);
    EXPECT_EQ(p["waypoints"]["max_count"], 3);

    const ParameterSpec any =
        makeRow(ParameterType::Numbers, "n", "", nullptr, "").count(1, std::numeric_limits<int>::max());
    entry.parameters = &any;
    entry.parameterCount = 1;
    const auto list = nlohmann::json::parse(describePluginsAsJson(plugins, {}, true));
    EXPECT_TRUE(list["plugins"][0]["parameters"][0]["max_count"].is_null());
    EXPECT_TRUE(list["plugins"][0]["parameters"][0]["default"].is_null());
    EXPECT_EQ(list["plugins"][0]["parameters"][0]["required"], true);
}

// --- one line for everything ------------------------------------------------------------------------

struct Grip {
    double force_N = 40.0;

    template <class V>
    void describe(V& v) {
        v(force_N, "force_N", "N", "How hard the gripper closes.").above(0).upTo(140);
    }
};

TEST(Settings, OneLineIsReadCheckedToldAndInTheSchema) {
    const std::vector<ParameterSpec>& rows = settingsOf<Grip>();
    const auto readGrip = [&](const std::string& text) { return readParameters(makeBlock(text), rows.data(), 1, 3); };
    EXPECT_EQ(readGrip("{force_N: 60}").get<Grip>().force_N, 60.0);
    EXPECT_EQ(readGrip("{}").get<Grip>().force_N, 40.0);
    EXPECT_EQ(readGrip("{}").resolved().find("force_N")->text, "40");
    expectError({"f.yaml:1:18: block.force_N: 200 is out of range; allowed is (0, 140]"},
                [&] { readGrip("{force_N: 200}"); });
    EXPECT_EQ(describeParameters(rows.data(), 1),
              "  force_N [N]: number in (0, 140]; default 40\n      How hard the gripper closes.\n");
    expectContains(describeParametersAsMarkdown(rows.data(), 1),
                   {"| `force_N` | N | number in (0, 140] | `40` | How hard the gripper closes. |"});
    const detail::Json schema = detail::makeSchema(rows[0]);
    EXPECT_EQ(schema["description"], "How hard the gripper closes. [N] In (0, 140]. Default: 40");
    EXPECT_EQ(schema["exclusiveMinimum"], 0);
    EXPECT_EQ(schema["maximum"], 140);
    EXPECT_EQ(schema["default"], 40.0);
}

struct Hand {
    std::string name;
    std::optional<Grip> grip;
    std::vector<Grip> fingers;
    std::optional<double> width_m;

    template <class V>
    void describe(V& v) {
        v(grip, "grip", "Of all fingers.");
        v(fingers, "fingers", "One by one.").count(0, 2);
        v(width_m, "width_m", "m", "Between them.").above(0);
    }
    void check(const ConfigNode& block) const {
        if (grip && !fingers.empty()) throw badInput(block.place(), "one grip and several", "Leave one out");
    }
};
struct Hands {
    std::vector<Hand> hands;

    template <class V>
    void describe(V& v) {
        v(hands, "hands", "By name.").required();
    }
};

TEST(Settings, BlocksListsAndNamesAreReadAsOne) {
    const auto readHands = [](const std::string& text) {
        Hands hands;
        readSettings(makeBlock(text), hands);
        return hands.hands;
    };
    const std::vector<Hand> hands =
        readHands("{hands: {left: {grip: {}, width_m: 0.1}, right: {fingers: [{force_N: 5}, {}]}}}");
    ASSERT_EQ(hands.size(), 2u);
    EXPECT_EQ(hands[0].name, "left");
    ASSERT_TRUE(hands[0].grip && hands[0].width_m);
    EXPECT_EQ(hands[0].grip->force_N, 40.0);
    EXPECT_EQ(*hands[0].width_m, 0.1);
    EXPECT_FALSE(hands[1].grip || hands[1].width_m);
    ASSERT_EQ(hands[1].fingers.size(), 2u);
    EXPECT_EQ(hands[1].fingers[0].force_N, 5.0);

    const auto refuseHands = [&](const std::string& text) { return catchError([&] { readHands(text); }); };
    expectContains(refuseHands("{}"), {"`hands` is missing: By name.", "Add `hands: ...` (blocks by name) here"});
    expectContains(refuseHands("{hands: [1]}"), {"no hands by name", "{NAME: {...}, ...}"});
    expectContains(refuseHands("{hands: {a: {fingers: {}}}}"), {"hands.a.fingers", "fingers must be a list; it is"});
    expectContains(refuseHands("{hands: {a: {fingers: [{}, {}, {}]}}}"), {"there are 3 fingers", "up to 2"});
    expectContains(refuseHands("{hands: {a: {width: 1}}}"), {"Did you mean `width_m`? A key carries its unit."});
    expectContains(refuseHands("{hands: {a: {grip: {}, fingers: [{}]}}}"), {"hands.a", "one grip and several"});
    // What is wrong is told together.
    expectContains(refuseHands("{hands: {a: {grip: {force_N: 0}, width_m: -1}, b: {fingers: [{force_N: 0}]}}}"),
                   {"3 things are wrong", "hands.a.grip.force_N", "hands.a.width_m", "hands.b.fingers[0].force_N"});
}

}  // namespace
}  // namespace viable::test
