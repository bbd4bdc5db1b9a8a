#include "ExpectContains.h"
#include "viable/core/Numbers.h"
#include "viable/plugin/Parameters.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "TemporaryFolder.h"
#include "host/PluginDescription.h"
#include "viable/core/Error.h"

namespace viable {
namespace {

using test::expectContains;

namespace fs = std::filesystem;

const ParameterSpec kSpecs[] = {
    parameter::number("gamma", "1/s", "20", "How fast the jerk follows.").above(0).upTo(1000),
    parameter::number("force_limit_N", "N", ".inf", "Largest force.").above(0).orInfinite(),
    parameter::integer("seed", "7", "Seed of the noise.").atLeast(0),
    parameter::flag("gravity", "true", "Adds gravity torque."),
    parameter::choice("window", "hann|box", "box", "Shape of the window."),
    parameter::text("label", "", "Shown in the report."),
    parameter::file("map", "", "Obstacles; none when empty."),
    parameter::jointNumbers("stiffness", "1/s^2", "2*pi", "Gain of each joint.").atLeast(0),
    parameter::numbers("axis", "", 3, 3, "[0, 0, 1]", "Direction."),
    parameter::rows("waypoints", "rad", 2, 3, "[]", "Way."),
};
constexpr std::size_t kCount = sizeof(kSpecs) / sizeof(kSpecs[0]);

ConfigNode makeBlock(const std::string& text, const std::string& file = "f.yaml") {
    return *parseConfig("block: " + text + "\n", file).find("block");
}
Parameters read(const std::string& text, int jointCount = 3) {
    return readParameters(makeBlock(text), kSpecs, kCount, jointCount);
}
std::string refuse(const std::function<void()>& action, ErrorKind kind = ErrorKind::BadInput) {
    try {
        action();
    } catch (const Error& error) {
        EXPECT_EQ(error.kind(), kind) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "no error was thrown";
    return {};
}
std::string refuseBlock(const std::string& text) {
    return refuse([&] { read(text); });
}
TEST(Parameters, DefaultsFillWhatIsNotWritten) {
    const Parameters p = read("{plugin: x}");
    EXPECT_EQ(p.number("gamma"), 20.0);
    EXPECT_EQ(p.number("force_limit_N"), kInfinity);
    EXPECT_EQ(p.integer("seed"), 7);
    EXPECT_TRUE(p.flag("gravity"));
    EXPECT_EQ(p.text("window"), "box");
    EXPECT_EQ(p.text("label"), "");
    EXPECT_TRUE(p.file("map").empty());
    EXPECT_EQ(p.jointNumbers("stiffness"), JointVector::Constant(3, 2 * kPi));
    EXPECT_EQ(p.numbers("axis"), (std::vector<double>{0, 0, 1}));
    EXPECT_TRUE(p.rows("waypoints").empty());
    EXPECT_EQ(p.place("gamma"), "f.yaml:1:8: block");
}

TEST(Parameters, WrittenValuesOfEveryType) {
    const Parameters p = read(
        "{plugin: x, gamma: 2*5, seed: 9, gravity: false, window: hann, label: '3', "
        "stiffness: [1, 2, 3], axis: [1, 0, 0], waypoints: [[1, 2], [3, 4, pi]]}");
    EXPECT_EQ(p.number("gamma"), 10.0);
    EXPECT_EQ(p.integer("seed"), 9);
    EXPECT_FALSE(p.flag("gravity"));
    EXPECT_EQ(p.text("window"), "hann");
    EXPECT_EQ(p.text("label"), "3");
    EXPECT_EQ(p.jointNumbers("stiffness")[2], 3.0);
    EXPECT_EQ(p.numbers("axis")[0], 1.0);
    ASSERT_EQ(p.rows("waypoints").size(), 2u);
    EXPECT_EQ(p.rows("waypoints")[1][2], kPi);
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
    EXPECT_EQ(q.number("gamma"), 10.0);
    EXPECT_EQ(q.number("force_limit_N"), kInfinity);
    EXPECT_EQ(q.rows("waypoints"), p.rows("waypoints"));
    EXPECT_TRUE(q.file("map").empty());
    EXPECT_EQ(writeConfig(q.resolved()), writeConfig(resolved));
    EXPECT_EQ(read("{}").resolved().find("plugin"), nullptr);
}

TEST(Parameters, MissingRequiredParameterIsExplained) {
    const ParameterSpec specs[] = {
        parameter::number("k_alpha", "1/s", nullptr, "Rate of approach to a limit.").above(0)};
    expectContains(
        refuse([&] { readParameters(makeBlock("{plugin: x}"), specs, 1, 3); }),
        {"f.yaml:1:8: block: `k_alpha` [1/s] is missing: Rate of approach to a limit.", "Add `k_alpha: ...`"});
    EXPECT_EQ(readParameters(makeBlock("{k_alpha: 5}"), specs, 1, 3).number("k_alpha"), 5.0);
}

TEST(Parameters, Fault02_UnknownKeysNameTheClosest) {
    for (const ParameterSpec& spec : kSpecs) {
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
    const ParameterSpec specs[] = {parameter::integer("n", nullptr, "Count.").above(0).below(5),
                                   parameter::integer("m", "1", "Count.").atLeast(0.5).upTo(2.5)};
    const auto readCount = [&](const std::string& text) { return readParameters(makeBlock(text), specs, 2, 3); };
    EXPECT_EQ(readCount("{n: 1}").integer("n"), 1);
    EXPECT_EQ(readCount("{n: 4, m: 2}").integer("m"), 2);
    expectContains(refuse([&] { readCount("{n: 0}"); }), {"[1, 4]"});
    expectContains(refuse([&] { readCount("{n: 5}"); }), {"[1, 4]"});
    expectContains(refuse([&] { readCount("{n: 1, m: 3}"); }), {"[1, 2]"});
}

TEST(Parameters, DefaultThatDoesNotFitSaysSo) {
    const ParameterSpec specs[] = {parameter::jointNumbers("gain", "", "[1, 2, 3, 4, 5, 6]", "Gain.")};
    EXPECT_EQ(readParameters(makeBlock("{}"), specs, 1, 6).jointNumbers("gain")[5], 6.0);
    expectContains(refuse([&] { readParameters(makeBlock("{}"), specs, 1, 7); }),
                   {"default of gain: block.gain", "list of 7 numbers", "it is a list of 6"});
    const ParameterSpec wrong[] = {parameter::number("k", "", "-1", "K.").above(0)};
    expectContains(refuse([&] { readParameters(makeBlock("{}"), wrong, 1, 7); }),
                   {"default of k: block.k: -1 is out of range"});
    EXPECT_EQ(readParameters(makeBlock("{k: 2}"), wrong, 1, 7).number("k"), 2.0);
}

TEST(Parameters, FilesStartInTheFolderOfTheFileThatNamesThem) {
    const test::TemporaryFolder folder;
    fs::create_directories(folder.path() / "maps");
    fs::create_directories(folder.path() / "experiments");
    std::ofstream(folder.path() / "maps" / "floor.bt") << "x";
    const std::string experiment = (folder.path() / "experiments" / "e.yaml").string();
    const auto readFile = [&](const std::string& name) {
        return readParameters(makeBlock("{map: " + name + "}", experiment), kSpecs, kCount, 3);
    };
    const fs::path path = readFile("../maps/floor.bt").file("map");
    EXPECT_TRUE(path.is_absolute());
    EXPECT_TRUE(fs::equivalent(path, folder.path() / "maps" / "floor.bt"));
    EXPECT_EQ(readFile((folder.path() / "maps/floor.bt").string()).file("map"), folder.path() / "maps/floor.bt");
    fs::create_symlink("../maps/floor.bt", folder.path() / "experiments" / "link.bt");
    EXPECT_TRUE(fs::equivalent(readFile("link.bt").file("map"), path));
    EXPECT_EQ(readFile("link.bt").resolved().find("map")->text, (folder.path() / "experiments" / "link.bt").string());
    EXPECT_TRUE(readFile("''").file("map").empty());

    // From the command line: the current folder.
    ConfigNode root = parseConfig("block: {}\n", experiment);
    applyOverride(root, "block.map=floor.bt");
    const fs::path before = fs::current_path();
    fs::current_path(folder.path() / "maps");
    fs::path fromHere;
    try {
        fromHere = readParameters(*root.find("block"), kSpecs, kCount, 3).file("map");
    } catch (...) {
        fs::current_path(before);
        throw;
    }
    fs::current_path(before);
    EXPECT_TRUE(fromHere.is_absolute());
    EXPECT_TRUE(fs::equivalent(fromHere, path));
}

TEST(Parameters, Fault11_FileMissingFolderOrDanglingLink) {
    const test::TemporaryFolder folder;
    const std::string experiment = (folder.path() / "e.yaml").string();
    const auto refuseFile = [&](const std::string& name) {
        return refuse([&] { readParameters(makeBlock("{map: " + name + "}", experiment), kSpecs, kCount, 3); });
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
    const ParameterSpec required[] = {parameter::file("poses", nullptr, "Recorded motion.")};
    expectContains(refuse([&] { readParameters(makeBlock("{poses: ''}"), required, 1, 3); }),
                   {"block.poses", "is empty"});
}

TEST(Parameters, MistakesOfThePluginAreItsOwn) {
    const Parameters p = read("{}");
    expectContains(refuse([&] { p.number("gama"); }, ErrorKind::PluginFailed),
                   {"f.yaml:1:8: block", "`gama`, which it does not declare"});
    expectContains(refuse([&] { p.integer("gamma"); }, ErrorKind::PluginFailed),
                   {"`gamma` as Integer, but declares it as Number"});
    expectContains(refuse([&] { p.place("x"); }, ErrorKind::PluginFailed), {"`x`"});
    const ParameterSpec twice[] = {parameter::flag("a", "true", ""), parameter::flag("a", "true", "")};
    expectContains(refuse([&] { readParameters(makeBlock("{}"), twice, 2, 3); }, ErrorKind::PluginFailed),
                   {"`a` twice"});
    const ParameterSpec reserved[] = {parameter::text("plugin", "x", "")};
    expectContains(refuse([&] { readParameters(makeBlock("{}"), reserved, 1, 3); }, ErrorKind::PluginFailed),
                   {"named `plugin`"});
}

TEST(Parameters, DescriptionShowsEveryDeclaration) {
    const std::string text = describeParameters(kSpecs, kCount);
    expectContains(
        text,
        {"gamma [1/s]: number in (0, 1000]; default 20\n",
         "force_limit_N [N]: number in (0, inf) or .inf; default .inf\n",
         "seed: whole number in [0, 9223372036854775807]; default 7\n", "window: choice of hann, box; default box\n",
         "map: file; default \"\"\n", "waypoints [rad]: list of lists of numbers (2 to 3 per row)",
         "axis: list of numbers (3) in (-inf, inf); default [0, 0, 1]\n", "How fast the jerk follows."});
    const ParameterSpec required[] = {parameter::file("poses", nullptr, "Recorded motion.")};
    EXPECT_EQ(describeParameters(required, 1), "  poses: file; required\n      Recorded motion.\n");
    EXPECT_EQ(describeParameters(nullptr, 0), "  (no parameters)\n");
}

TEST(Parameters, MarkdownHasOneRowPerDeclaration) {
    const ParameterSpec specs[] = {
        parameter::choice("a", "x|y", "x", "One|two\nthree."),
        parameter::jointNumbers("b", "Nm", nullptr, "Gain.").atLeast(0),
        parameter::number("c", "", ".inf", "").above(-1).upTo(5).orInfinite(),
        parameter::rows("d", "m", 2, 3, "[]", ""),
        parameter::integer("e", "1", "").atLeast(0).below(10),
        parameter::text("f", "", ""),
        parameter::numbers("g", "", 1, std::numeric_limits<int>::max(), "[1]", ""),
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
    EXPECT_EQ(p["stiffness"]["default"], "2*pi");  // an expression stays as it is written
    EXPECT_EQ(p["stiffness"]["per_joint"], true);
    EXPECT_EQ(p["axis"]["default"], nlohmann::json::parse("[0.0, 0.0, 1.0]"));
    EXPECT_EQ(p["waypoints"]["type"], "rows");
    EXPECT_EQ(p["waypoints"]["min_count"], 2);
    EXPECT_EQ(p["waypoints"]["max_count"], 3);

    const ParameterSpec any = parameter::numbers("n", "", 1, std::numeric_limits<int>::max(), nullptr, "");
    entry.parameters = &any;
    entry.parameterCount = 1;
    const auto list = nlohmann::json::parse(describePluginsAsJson(plugins, {}, true));
    EXPECT_TRUE(list["plugins"][0]["parameters"][0]["max_count"].is_null());
    EXPECT_TRUE(list["plugins"][0]["parameters"][0]["default"].is_null());
    EXPECT_EQ(list["plugins"][0]["parameters"][0]["required"], true);
}

}  // namespace
}  // namespace viable
