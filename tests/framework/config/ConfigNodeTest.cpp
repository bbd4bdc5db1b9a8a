#include "ConfigTestSupport.h"

namespace viable {
namespace {

const char* const kFile = R"(robot: indy7
filter: {plugin: tosbp, gamma: 20, k_alpha: 5}
points: [1, 2, 3]
cases:
  C1: {}
  C2: {filter: {plugin: nothing}}
later:
)";

std::string refuseOverride(const std::string& assignment) {
    ConfigNode root = parseConfig(kFile, "f");
    const ConfigNode before = root;
    const std::string text = catchError([&] { applyOverride(root, assignment); });
    EXPECT_TRUE(isSameTree(root, before)) << "the tree was changed in spite of the error";
    return text;
}

ConfigNode override(const std::string& assignment) {
    ConfigNode root = parseConfig(kFile, "f");
    applyOverride(root, assignment);
    return root;
}

TEST(ConfigOverride, ReplacesAndAdds) {
    const ConfigNode root = override("filter.gamma=3");
    const ConfigNode& gamma = *root.find("filter")->find("gamma");
    EXPECT_EQ(gamma.text, "3");
    EXPECT_EQ(gamma.file, "--set");
    EXPECT_EQ(gamma.place(), "--set filter.gamma");
    EXPECT_EQ(root.find("filter")->find("k_alpha")->text, "5");
    EXPECT_EQ(root.find("filter")->entries.size(), 3u);
    expectError({"--set filter.gamma: 3 is out of range; allowed is [0, 2]"}, [&] { toNumber(gamma, {0.0, 2.0}); });

    const ConfigNode made = override("cases.C3.filter.gamma=2*pi/3");
    const ConfigNode& added = *made.find("cases")->find("C3")->find("filter")->find("gamma");
    EXPECT_EQ(added.text, "2*pi/3");
    EXPECT_EQ(added.keyPath, "cases.C3.filter.gamma");
    EXPECT_EQ(made.find("cases")->find("C3")->place(), "--set cases.C3");

    EXPECT_EQ(override("later.x=1").find("later")->find("x")->text, "1");
    EXPECT_EQ(override("title=a = b").find("title")->text, "a = b");
    EXPECT_EQ(override("title=\"\"").find("title")->text, "");
    EXPECT_EQ(override("points=[4, 5]").find("points")->items[1].place(), "--set points[1]");
    EXPECT_EQ(override("points[1]=7").find("points")->items[1].text, "7");
    EXPECT_EQ(override("points[1]=7").find("points")->items[2].text, "3");
    EXPECT_EQ(override("new={a: [1], b: x}").find("new")->find("a")->items[0].keyPath, "new.a[0]");
}

TEST(ConfigOverride, AnotherPluginDropsTheParametersOfTheOneBefore) {
    const ConfigNode other = override("filter.plugin=acceleration_viability");
    ASSERT_EQ(other.find("filter")->entries.size(), 1u);
    EXPECT_EQ(other.find("filter")->find("plugin")->text, "acceleration_viability");
    EXPECT_EQ(other.find("robot")->text, "indy7");
    EXPECT_EQ(override("filter.plugin=tosbp").find("filter")->entries.size(), 3u);
    ConfigNode root = override("filter.plugin=tovzbp");
    applyOverride(root, "filter.gamma=7");
    EXPECT_EQ(root.find("filter")->find("gamma")->text, "7");
    const ConfigNode whole = override("filter={plugin: nric}");
    EXPECT_EQ(whole.find("filter")->entries.size(), 1u);
}

TEST(ConfigOverride, RefusesAndNamesTheArgument) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> table = {
        {"filter.gamma", {"no `=`", "`cases.C2.filter.gamma=3`"}},
        {"=3", {"key path"}},
        {"a..b=3", {"key path `a..b`"}},
        {".a=3", {"key path"}},
        {"a.=3", {"key path"}},
        {"a b=3", {"key path"}},
        {"filter.gamma=", {"no value", "`\"\"`"}},
        {"filter.gamma=  ", {"no value"}},
        {"filter.gamma=#x", {"the value cannot be read", "empty"}},
        {"filter.gamma=[1", {"the value cannot be read", "close every `[`"}},
        {"filter.gamma=&a 1", {"anchor"}},
        {"filter.gamma=!!int 1", {"tag"}},
        {"filter.gamma={a: 1, a: 2}", {"stands twice"}},
        {"filter.gamma=1\n---\n2", {"second document"}},
        {"robot.x=1", {"f:1:8: robot is the single value `indy7`", "no entry `x`"}},
        {"points.x=1", {"f:3:9: points is a list of 3"}},
        {"points[3]=1", {"points is a list of 3", "no entry [3]"}},
        {"points[x]=1", {"wrong index"}},
        {"robot[0]=1", {"no entry [0]"}},
        {"nothing[0]=1", {"no list"}},
        {"a=" + repeat("[", 32) + repeat("]", 32), {"more than 32"}},
        {repeat("a.", 32) + "a=1", {"deeper than 32"}},
        {repeat("a", 500) + "=1", {"longer than 400 bytes"}},
    };
    for (const auto& [assignment, message] : table) {
        SCOPED_TRACE(assignment);
        const std::string text = refuseOverride(assignment);
        expectContains(text, message);
        EXPECT_EQ(text.compare(0, 7, "--set `"), 0) << text;
    }
}

TEST(ConfigOverlay, MapsMergeEntryByEntryAndTheRestIsReplaced) {
    const ConfigNode base = parseConfig(
        "a: 1\nb: [1, 2, 3]\nfilter: {plugin: tosbp, gamma: 20, k: 5}\nloop: {plugin: nric, k: 1}\n", "base");
    const ConfigNode top = parseConfig("b: [4]\nfilter: {gamma: 7}\nloop: {plugin: other}\nextra: {x: 1}\n", "top");
    const ConfigNode merged = overlay(base, top);
    EXPECT_EQ(merged.find("a")->place(), "base:1:4: a");
    ASSERT_EQ(merged.find("b")->items.size(), 1u);
    EXPECT_EQ(merged.find("b")->file, "top");
    EXPECT_EQ(merged.find("filter")->find("plugin")->text, "tosbp");
    EXPECT_EQ(merged.find("filter")->find("gamma")->place(), "top:2:17: filter.gamma");
    EXPECT_EQ(merged.find("filter")->find("k")->text, "5");
    EXPECT_EQ(merged.find("filter")->place(), "top:2:9: filter");
    EXPECT_EQ(merged.find("loop")->entries.size(), 1u);
    EXPECT_EQ(merged.find("extra")->find("x")->text, "1");
    EXPECT_TRUE(isSameTree(overlay(base, parseConfig("{}", "t")), base));
    EXPECT_EQ(overlay(base, parseConfig("filter: none\n", "t")).find("filter")->text, "none");
    EXPECT_EQ(overlay(base, parseConfig("filter: {plugin: tosbp, x: 1}\n", "t")).find("filter")->entries.size(), 4u);
}

TEST(ConfigMapTest, Fault02_UnknownKeyNamesTheClosestKnownOne) {
    const ConfigNode root = parseConfig("gamma: 1\nk_alhpa: 2\n", "f");
    ConfigMap map(root);
    EXPECT_EQ(map.require("gamma").text, "1");
    EXPECT_EQ(map.find("k_alpha"), nullptr);
    EXPECT_EQ(map.find("dt"), nullptr);
    expectError(
        {"f:2:10: k_alhpa", "`k_alhpa` is unknown", "Did you mean `k_alpha`?", "Known keys: `gamma`, `k_alpha`, `dt`"},
        [&] { map.finish(); });
    EXPECT_NE(map.find("k_alhpa"), nullptr);
    EXPECT_NO_THROW(map.finish());
}

TEST(ConfigMapTest, Fault02_EveryOneLetterSlipIsFound) {
    const std::vector<std::string> keys = {"velocity_radps", "gamma", "tick_s", "plugin"};
    for (const std::string& key : keys)
        for (std::size_t i = 0; i < key.size(); ++i) {
            std::string dropped = key;
            dropped.erase(i, 1);
            std::string changed = key;
            changed[i] = 'z';
            for (const std::string& slip : {dropped, changed}) {
                const ConfigNode root = parseConfig(slip + ": 1\n", "f");
                ConfigMap map(root);
                for (const std::string& known : keys) map.find(known);
                expectError({"`" + slip + "` is unknown", "Did you mean `" + key + "`?"}, [&] { map.finish(); });
            }
        }
}

TEST(ConfigMapTest, MissingKeyAndWrongKind) {
    const ConfigNode root = parseConfig("a: {b: 1}\nc: 3\nd:\n", "f");
    ConfigMap map(*root.find("a"));
    expectError({"f:1:4: a", "`dt` is missing", "Add `dt: ...`"}, [&] { map.require("dt"); });
    expectError({"f:2:4: c", "must be a map of entries; it is the single value `3`"},
                [&] { ConfigMap scalar(*root.find("c")); });
    expectError({"f:3:1: d", "it is empty"}, [&] { ConfigMap empty(*root.find("d")); });
}

}  // namespace
}  // namespace viable
