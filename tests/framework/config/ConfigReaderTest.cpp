#include <random>

#include "ConfigTestSupport.h"

namespace viable {
namespace {

const char* const kExperiment = R"(# One question each
schema: 1
title: "Unilateral teleoperation: Indy7"   # quoted, with a colon
robot: indy7
duration_s: 30.0
limits: {velocity_radps: 2*pi/3, acceleration_radps2: [1, 2.5, -3e-2], flag: true}
command:
  plugin: recorded_poses
  file: '../data/it''s.txt'
  waypoints:
    - [0, 0.5, 1]
    - {time_s: 2, pose: [1, 2, 3]}
    - name: last
      q_rad:
        - 1
        - pi/2
  nothing: ~
  notes: |
    first line
      second: line
cases:
  C1: {filter: {plugin: acceleration_viability}}
  C2:
    filter: {plugin: tosbp, k_alpha: 5.0, gamma: 20.0}
empty_list: []
empty_map: {}
last: (1+2)*3
)";

TEST(ConfigReader, KeepsKindTextQuotesAndPlace) {
    const ConfigNode root = parseConfig(kExperiment, "file.yaml");
    ASSERT_EQ(root.kind, ConfigNode::Kind::Map);
    EXPECT_EQ(root.entries.size(), 10u);
    EXPECT_EQ(root.entries[0].first, "schema");

    const ConfigNode& title = *root.find("title");
    EXPECT_EQ(title.text, "Unilateral teleoperation: Indy7");
    EXPECT_TRUE(title.quoted);
    EXPECT_EQ(title.place(), "file.yaml:3:8: title");

    const ConfigNode& duration = *root.find("duration_s");
    EXPECT_EQ(duration.text, "30.0");
    EXPECT_FALSE(duration.quoted);

    const ConfigNode& command = *root.find("command");
    EXPECT_EQ(command.find("file")->text, "../data/it's.txt");
    EXPECT_EQ(command.find("notes")->text, "first line\n  second: line\n");
    EXPECT_EQ(command.find("nothing")->kind, ConfigNode::Kind::Empty);
    const ConfigNode& pose = *command.find("waypoints")->items[1].find("pose");
    EXPECT_EQ(pose.items[2].place(), "file.yaml:12:32: command.waypoints[1].pose[2]");
    EXPECT_EQ(command.find("waypoints")->items[2].find("q_rad")->items[1].text, "pi/2");

    EXPECT_EQ(root.find("cases")->find("C2")->find("filter")->find("gamma")->keyPath, "cases.C2.filter.gamma");
    EXPECT_EQ(root.find("empty_list")->kind, ConfigNode::Kind::List);
    EXPECT_EQ(root.find("empty_map")->kind, ConfigNode::Kind::Map);
    EXPECT_EQ(root.find("absent"), nullptr);
}

TEST(ConfigReader, ColumnsCountCharactersNotBytes) {
    const ConfigNode root = parseConfig("a: {\xC3\xA9\xE2\x82\xAC: 1, b: 2}\n", "f");
    EXPECT_EQ(root.find("a")->find("b")->place(), "f:1:15: a.b");
}

TEST(ConfigReader, ValueAbsentAtTheEndHasThePlaceOfItsKey) {
    const ConfigNode root = parseConfig("a: 1\nb:\n\n\nc: 2\n", "f");
    EXPECT_EQ(root.find("b")->kind, ConfigNode::Kind::Empty);
    EXPECT_EQ(root.find("b")->place(), "f:2:1: b");
}

struct Refusal {
    const char* text;
    std::vector<std::string> message;
};

TEST(ConfigReader, RefusesWhatYamlAllowsAndConfigurationsMustNot) {
    const std::vector<Refusal> table = {
        {"a: &x 1\nb: 2\n", {"f:1:4: a", "anchor", "Write values out"}},
        {"a: *x\n", {"f:1:4", "alias"}},
        {"b: &x {c: 1}\na: {<<: *x}\n", {"f:1:4: b", "anchor"}},
        {"a: {<<: {b: 1}}\n", {"f:1:5: a", "merge key"}},
        {"a: !!str 3\n", {"f:1:4: a", "tag"}},
        {"a: ! 3\n", {"f:1:4: a", "tag"}},
        {"a: !x [1]\n", {"f:1:4: a", "tag"}},
        {"a: ! {b: 1}\n", {"f:1:4: a", "tag"}},
        {"a: !x\n", {"f:1:4: a", "tag"}},
        {"%TAG ! tag:x,2000:\n---\na: 1\n", {"f:1:1", "directive"}},
        {"# c\n%YAML 1.2\n---\na: 1\n", {"f:2:1", "directive"}},
        {"? [a]\n: 1\n", {"f:1:3", "a key must be text"}},
        {"{a: 1}: 2\n", {"f:1:1", "a key must be text"}},
        {": 1\n", {"f:1:1", "a key must be text"}},
        {"~: 1\n", {"f:1:1", "a key must be text"}},
        {"'': 1\n", {"f:1:1", "a key is empty"}},
        {"\"a\\nb\": 1\n", {"f:1:1", "control character"}},
        {"a: 1\nkey\n", {"f:2:1", "the file ends behind `key`", "`key: value`"}},
        {"a: 1\nkey # c\n", {"f:2:1", "does not fit into the map", "`key: value`"}},
        {"a: 1\nkey\nb: 2\n", {"f:"}},
        {"a:\n- 1\n -2\n", {"f:2:3: a[0]", "`1 -2` goes over several lines"}},
        {"a: [1\n 2]\n", {"f:1:5: a[0]", "several lines", "commas"}},
        {"a: b\n  c\n", {"f:1:4: a", "several lines", "in quotes"}},
        {"a: {b, c: 1}\n", {"f:1:5: a", "`b` stands where a key is expected"}},
        {"a: {b:1}\n", {"f:1:5: a", "`b:1`", "blank after the colon"}},
        {"? a\n: 1\n", {"f:1:3", "on one line"}},
        {"a: \"x\\0y\"\n", {"f:1:4: a", "NUL"}},
        {"just text\n", {"f:1:1", "must be a map", "`just text`"}},
        {"- 1\n- 2\n", {"f:1:1", "must be a map", "a list"}},
        {"a:1\n", {"f:1:1", "must be a map", "blank after the colon"}},
    };
    for (const Refusal& row : table) {
        SCOPED_TRACE(row.text);
        expectError(row.message, [&] { parseConfig(row.text, "f"); });
    }
}

TEST(ConfigReader, SaysInPlainWordsWhatIsWrongWithTheSyntax) {
    const std::vector<Refusal> table = {
        {"a: [1, 2\nb: 3\n", {"f:1:8", "several lines", "commas"}},
        {"a: [1, '2'\nb: 3\n", {"f:2:1", "list in brackets", "Close `[` with `]`"}},
        {"a: {b: '1'\nc: 3\n", {"f:2:1", "map in braces", "Close `{` with `}`"}},
        {"a: [1, 2\n", {"f:1:8: a[1]", "the file ends behind `2`", "close every `[`"}},
        {"a: [1\n", {"f:1:5: a[0]", "close every `[`"}},
        {"a: {b: [1, 2}\n", {"f:1:13", "bracket"}},
        {"a: [1, 2]]\n", {"f:1:10", "closing bracket"}},
        {"a: [1] x\n", {"f:1:8", "does not fit"}},
        {"a: 'x' y\n", {"f:1:8", "does not fit"}},
        {"a: b: c\n", {"f:1:5", "colon", "in quotes"}},
        {"a: - b\n", {"f:1:4", "list entry"}},
        {"a: @b\n", {"f:1:4", "cannot begin a value", "in quotes"}},
        {"a: \"x\n", {"f:", "quote", "never closed"}},
        {"a: 'x\nb: 1\n", {"f:1:4: a", "quote ' is never closed"}},
        {"a: 'x\n...\n", {"f:"}},
        {"a: \"\\q\"\n", {"f:1:", "is not valid YAML", "unknown escape character"}},
        {"a:\n  b: 1\n c: 2\n", {"f:3:2", "same column"}},
        {" a: 1\nb: 2\n", {"f:2:1", "does not belong", "same column"}},
        {"a: \"x\n---\ny\"\n", {"f:2:1", "inside quoted text"}},
    };
    for (const Refusal& row : table) {
        SCOPED_TRACE(row.text);
        expectError(row.message, [&] { parseConfig(row.text, "f"); });
    }
}

TEST(ConfigReader, Fault01_FileMissingEmptyOrNotAFile) {
    const TemporaryFolder folder;
    const auto read = [](const std::filesystem::path& file) { return catchError([&] { readConfigFile(file); }); };
    const std::string missing = (folder.path() / "missing.yaml").string();
    expectContains(read(missing), {missing, "does not exist"});
    expectContains(read(folder.path() / "a" / "b.yaml"), {"does not exist"});
    expectContains(read(folder.path()), {folder.path().string(), "is a folder"});
    expectContains(read("/dev/null"), {"/dev/null", "not a regular file"});
    std::filesystem::create_symlink("nowhere", folder.path() / "link.yaml");
    expectContains(read(folder.path() / "link.yaml"), {"link.yaml", "symbolic link"});
    for (const char* text : {"", "\n\n", "# nothing\n", "---\n", "~\n", "\xEF\xBB\xBF", "--- \n...\n"}) {
        SCOPED_TRACE(text);
        expectContains(read(folder.write("empty.yaml", text)), {"empty.yaml", "is empty", "`key: value`"});
    }
    const std::filesystem::path file = folder.write("good.yaml", kExperiment);
    EXPECT_TRUE(isSameTree(readConfigFile(file), parseConfig(kExperiment, "x")));
    EXPECT_EQ(readConfigFile(file).find("robot")->file, file.string());
}

TEST(ConfigReader, Fault01_UnreadableFile) {
    // Root may read everything, but nobody can read address 0 of a process.
    if (std::filesystem::exists("/proc/self/mem"))
        expectError({"/proc/self/mem", "cannot be read", "permissions"}, [] { readConfigFile("/proc/self/mem"); });
    if (geteuid() == 0) GTEST_SKIP() << "root may read a file without permissions";
    const TemporaryFolder folder;
    const std::filesystem::path file = folder.write("secret.yaml", "a: 1\n");
    std::filesystem::permissions(file, std::filesystem::perms::none);
    expectError({"secret.yaml", "cannot be read", "Permission denied"}, [&] { readConfigFile(file); });
}

TEST(ConfigReader, Fault01_FileCutAtEveryByte) {
    const std::string whole = kExperiment;
    const auto original = listLeaves(parseConfig(whole, "f"));
    int refused = 0, read = 0;
    for (std::size_t size = 0; size < whole.size(); ++size) {
        SCOPED_TRACE("first " + std::to_string(size) + " bytes");
        std::vector<std::pair<std::string, std::string>> leaves;
        try {
            leaves = listLeaves(parseConfig(whole.substr(0, size), "f"));
            ++read;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind(), ErrorKind::BadInput);
            EXPECT_EQ(std::string(error.what()).compare(0, 1, "f"), 0) << error.what();
            ++refused;
            continue;
        }
        ASSERT_FALSE(leaves.empty());
        ASSERT_LE(leaves.size(), original.size());
        for (std::size_t i = 0; i + 1 < leaves.size(); ++i) EXPECT_EQ(leaves[i], original[i]);
        // The last entry is the one that was cut: its place is right, its content may be short.
        const std::string& path = leaves.back().first;
        EXPECT_EQ(original[leaves.size() - 1].first.compare(0, path.size(), path), 0) << path;
    }
    EXPECT_GT(refused, 100);
    EXPECT_GT(read, 100);
}

TEST(ConfigReader, Fault01_RandomBytesAndMutationsAreReadOrRefusedNeverWorse) {
    std::mt19937 random(1);
    const std::string whole = kExperiment;
    const std::string special = "{}[]:,-?&*!|>'\"%@`#~ \n\t\\<=0\xC3\xFF";
    int refused = 0;
    for (int i = 0; i < 4000; ++i) {
        std::string text = whole;
        const bool isNoise = i % 4 == 0;
        if (isNoise) {
            text.resize(1 + random() % 300);
            for (char& c : text) c = static_cast<char>(random());
        } else {
            const int changes = 1 + static_cast<int>(random() % 4);
            for (int k = 0; k < changes; ++k) {
                const std::size_t at = random() % text.size();
                const char c = special[random() % special.size()];
                if (random() % 2 == 0) {
                    text[at] = c;
                } else {
                    text.insert(at, 1, c);
                }
            }
        }
        try {
            const ConfigNode root = parseConfig(text, "f");
            // What is read can be written and read again.
            EXPECT_TRUE(isSameTree(root, parseConfig(writeConfig(root), "g"))) << text;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind(), ErrorKind::BadInput);
            ++refused;
        }
    }
    EXPECT_GT(refused, 1000);
    EXPECT_LT(refused, 4000);
}

TEST(ConfigReader, Fault01_BinaryIsRefusedWithThePlaceOfItsFirstByte) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> table = {
        {std::string("a: 1\nb: \0\n", 10), {"f:2:4", "control byte 0x00", "binary"}},
        {"a: \x1B[31m\n", {"f:1:4", "control byte 0x1b"}},
        {"a: \x7F\n", {"f:1:4", "control byte 0x7f"}},
        {"a: 1\rb: 2\n", {"f:1:5", "control byte 0x0d", "CR LF"}},
        {"a: \xFF\n", {"f:1:4", "not UTF-8"}},
        {"a: \xC0\xAF\n", {"f:1:4", "not UTF-8"}},          // overlong
        {"a: \xE0\x80\xAF\n", {"f:1:4", "not UTF-8"}},      // overlong
        {"a: \xF0\x80\x80\xAF\n", {"f:1:4", "not UTF-8"}},  // overlong
        {"a: \xED\xA0\x80\n", {"f:1:4", "not UTF-8"}},      // surrogate
        {"a: \xF4\x90\x80\x80\n", {"f:1:4", "not UTF-8"}},  // beyond U+10FFFF
        {"a: \xC3", {"f:1:4", "not UTF-8"}},                // cut in a character
        {std::string("\xFF\xFE"
                     "a\0:\0 \0",
                     8),
         {"f:1:1", "not UTF-8"}},  // UTF-16
    };
    for (const auto& [text, message] : table) {
        SCOPED_TRACE(text);
        expectError(message, [&, &t = text] { parseConfig(t, "f"); });
    }
    EXPECT_EQ(parseConfig("a: \xF0\x9F\x98\x80 \xC2\xB5\n", "f").find("a")->text, "\xF0\x9F\x98\x80 \xC2\xB5");
}

TEST(ConfigReader, Fault03_DuplicateKeyNamesBothLines) {
    expectError({"f:3:1: dt", "`dt` stands twice", "line 1", "line 3", "Remove one"},
                [] { parseConfig("dt: 0.001\nx: 2\ndt: 1.0\n", "f"); });
    expectError({"f:3:3: a.b", "line 2", "line 3"}, [] { parseConfig("a:\n  b: 1\n  \"b\": 2\n", "f"); });
    expectError({"f:1:17: a.b", "stands twice"}, [] { parseConfig("a: {b: 1, c: 2, b: 1}\n", "f"); });
    EXPECT_NO_THROW(parseConfig("a: {x: 1}\nb: {x: 1}\n", "f"));
}

TEST(ConfigReader, Fault09_AliasBombAndSelfAlias) {
    std::string bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n";
    for (int i = 1; i < 9; ++i) {
        const std::string before = "*a" + std::to_string(i - 1);
        bomb += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [";
        for (int k = 0; k < 9; ++k) bomb += (k ? ", " : "") + before;
        bomb += "]\n";
    }
    std::string text;
    EXPECT_LT(measure_ms([&] { text = catchError([&] { parseConfig(bomb, "f"); }); }), 100.0);
    expectContains(text, {"f:1:5: a0", "anchor"});
    EXPECT_LT(measure_ms([&] { text = catchError([] { parseConfig("a: &a [*a]\n", "f"); }); }), 100.0);
    expectContains(text, {"f:1:4: a", "anchor"});
}

TEST(ConfigReader, Fault09_DepthOf100000) {
    std::string indented = "a:\n";
    for (int i = 1; i < 1000; ++i) indented += repeat(" ", i) + "a:\n";
    const std::vector<std::string> bombs = {
        "a: " + repeat("[", 100000),    "a: " + repeat("[", 100000) + repeat("]", 100000),
        "a: " + repeat("{a: ", 100000), "a:\n" + repeat("- ", 100000) + "1\n",
        repeat("? ", 100000) + "1\n",   "a: [" + repeat("{? [", 25000),
        "a: " + repeat("[\n", 100000),  indented,
        "a: " + repeat("[", 1000000),   "a: " + repeat("[{", 400),
    };
    for (const std::string& bomb : bombs) {
        SCOPED_TRACE(bomb.substr(0, 20));
        std::string text;
        EXPECT_LT(measure_ms([&] { text = catchError([&] { parseConfig(bomb, "f"); }); }), 100.0);
        EXPECT_EQ(text.compare(0, 2, "f:"), 0) << text;
    }
    const std::string deepest = "a: " + repeat("[", kMaxConfigDepth - 1) + repeat("]", kMaxConfigDepth - 1) + "\n";
    EXPECT_NO_THROW(parseConfig(deepest, "f"));
    const std::string tooDeep = "a: " + repeat("[", kMaxConfigDepth) + repeat("]", kMaxConfigDepth) + "\n";
    expectError({"f:1:35: a[0][0]", "more than 32 maps and lists"}, [&] { parseConfig(tooDeep, "f"); });
}

TEST(ConfigReader, Fault09_TooManyNodes) {
    const auto makeList = [](int count) { return "a: [" + repeat("1,\n ", count - 1) + "1]\n"; };
    // The root, its key, the list and the entries.
    EXPECT_EQ(parseConfig(makeList(kMaxConfigNodes - 3), "f").find("a")->items.size(),
              static_cast<std::size_t>(kMaxConfigNodes - 3));
    expectError({"f:49998:2: a[49997]", "more than 50000 keys and values"},
                [&] { parseConfig(makeList(kMaxConfigNodes - 2), "f"); });
    expectError({"f:1:", "more than 50000 list entries"}, [&] { parseConfig("a: [" + repeat("1,", 500000), "f"); });
    std::string keys;
    for (int i = 0; i < 60000; ++i) keys += "k" + std::to_string(i) + ": 1\n";
    expectError({"f:25000:", "more than 50000 keys and values"}, [&] { parseConfig(keys, "f"); });
}

TEST(ConfigReader, Fault09_LongKeysCannotMultiply) {
    const std::string key(1000, 'k');
    expectError({"f:1:1", "key path of 1000 bytes", "at most 400"}, [&] { parseConfig(key + ": 1\n", "f"); });
    const std::string part(150, 'k');
    expectError({"key path of 452 bytes"}, [&] { parseConfig(part + ": {" + part + ": {" + part + ": 1}}\n", "f"); });
}

TEST(ConfigReader, Fault09_FileOfOneGigabyte) {
    const TemporaryFolder folder;
    const std::filesystem::path file = folder.write("huge.yaml", "a: 1\n");
    std::filesystem::resize_file(file, std::uintmax_t{1} << 30);  // sparse: takes no room
    std::string text;
    EXPECT_LT(measure_ms([&] { text = catchError([&] { readConfigFile(file); }); }), 100.0);
    expectContains(text, {"huge.yaml", "1073741824 bytes", "1048576"});

    const std::string atLimit = "a: 1\n#" + std::string(kMaxConfigBytes - 6, 'x');
    EXPECT_NO_THROW(readConfigFile(folder.write("large.yaml", atLimit)));
    const std::filesystem::path larger = folder.write("larger.yaml", atLimit + "x");
    expectError({"1048577 bytes"}, [&] { readConfigFile(larger); });
    expectError({"1048577 bytes"}, [&] { parseConfig(atLimit + "x", "f"); });
}

TEST(ConfigReader, Fault10_SecondDocument) {
    for (const char* text : {"a: 1\n---\nb: 2\n", "a: 1\n---\n", "a: 1\n---\na: 1\n", "---\na: 1\n--- {b: 2}\n"}) {
        SCOPED_TRACE(text);
        expectError({"a second document begins here", "`---`"}, [&] { parseConfig(text, "f"); });
    }
    expectError({"f:3:1"}, [&] { parseConfig("a: 1\n...\nb: 2\n", "f"); });
    EXPECT_TRUE(isSameTree(parseConfig("---\na: 1\n...\n", "f"), parseConfig("a: 1\n", "f")));
}

TEST(ConfigReader, Fault10_TabsInTheIndentation) {
    for (const char* text : {"a:\n\tb: 1\n", "a:\n\t- 1\n", "a:\n\tb\n"}) {
        SCOPED_TRACE(text);
        expectError({"f:2:1", "tab stands in the indentation", "blanks only"}, [&] { parseConfig(text, "f"); });
    }
    expectError({"f:2:3", "tab"}, [&] { parseConfig("a:\n  \tb: 1\n", "f"); });
    EXPECT_EQ(parseConfig("a:\t1\t# comment\n", "f").find("a")->text, "1");
}

TEST(ConfigReader, Fault10_ByteOrderMarkAndCarriageReturnsChangeNothing) {
    const std::string text = kExperiment;
    std::string windows;
    for (const char c : text) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
    const ConfigNode expected = parseConfig(text, "f");
    for (const std::string& variant : {"\xEF\xBB\xBF" + text, windows, "\xEF\xBB\xBF" + windows}) {
        const ConfigNode root = parseConfig(variant, "f");
        EXPECT_TRUE(isSameTree(root, expected));
        EXPECT_EQ(root.find("last")->place(), expected.find("last")->place());
    }
}

TEST(ConfigWriter, WritesWhatIsReadBackToTheSameTree) {
    const ConfigNode root = parseConfig(kExperiment, "f");
    const std::string text = writeConfig(root);
    EXPECT_TRUE(isSameTree(parseConfig(text, "g"), root)) << text;
    expectContains(text, {"title: \"Unilateral teleoperation: Indy7\"\n", "duration_s: 30.0\n",
                          "  velocity_radps: 2*pi/3\n", "acceleration_radps2: [1, 2.5, -3e-2]\n", "last: (1+2)*3\n",
                          "empty_list: []\n", "nothing: ~\n", "    - name: last\n      q_rad: [1, pi/2]\n"});
}

TEST(ConfigWriter, QuotesOnlyWhatNeedsIt) {
    const std::vector<std::string> texts = {
        "",      "~",    "null", "NULL",  "a: b", "a #b",     "#a",
        "- a",   "-a",   "-",    "-1",    "? a",  ":",        "a:",
        "a:b",   " a",   "a ",   "[a",    "a]",   "{a}",      "a, b",
        "\"a\"", "'a'",  "it's", "a\nb",  "a\tb", "\x01",     "\x7F",
        "a\\n",  "%a",   "@a",   "`a",    "!a",   "&a",       "*a",
        "|",     ">",    "---",  "--- a", "...",  "true",     "1e3",
        ".inf",  "<<",   "=",    "a?b",   "2*pi", "\xC3\xA9", std::string("\xEF\xBB\xBF") + "a",
        "a\\",   "a\"b", "\n",   "  "};
    for (const std::string& text : texts) {
        SCOPED_TRACE(text);
        ConfigNode scalar;
        scalar.kind = ConfigNode::Kind::Scalar;
        scalar.text = text;
        for (const bool quoted : {false, true}) {
            scalar.quoted = quoted;
            ConfigNode list;
            list.kind = ConfigNode::Kind::List;
            list.items = {scalar, scalar};
            ConfigNode outer;
            outer.kind = ConfigNode::Kind::List;
            outer.items = {list, scalar, list};
            ConfigNode root;
            root.kind = ConfigNode::Kind::Map;
            root.entries = {{"value", scalar}, {"list", list}, {"outer", outer}};
            const std::string written = writeConfig(root);
            const ConfigNode back = parseConfig(written, "f");
            ASSERT_EQ(back.entries.size(), 3u) << written;
            ASSERT_EQ(back.find("list")->items.size(), 2u) << written;
            for (const ConfigNode* node : {back.find("value"), &back.find("list")->items[1],
                                           &back.find("outer")->items[1], &back.find("outer")->items[2].items[0]}) {
                EXPECT_EQ(node->kind, ConfigNode::Kind::Scalar) << written;
                EXPECT_EQ(node->text, text) << written;
                EXPECT_TRUE(node->quoted || !quoted) << written;
            }
            EXPECT_TRUE(isSameTree(back, parseConfig(writeConfig(back), "f"))) << written;
        }
    }
    EXPECT_EQ(writeConfig(parseConfig("a: 2*pi/3\nb: [-.inf, 1]\n", "f")), "a: 2*pi/3\nb: [-.inf, 1]\n");
}

TEST(ConfigWriter, QuotesKeys) {
    for (const char* key : {"a b", "~", "null", "- a", "a: b", "#a", "\xEF\xBB\xBFk", "a\\b", "a\"b", "[a]", "-", "a,b",
                            "true", "\xC3\xA9"}) {
        SCOPED_TRACE(key);
        ConfigNode value;
        value.kind = ConfigNode::Kind::Scalar;
        value.text = "1";
        ConfigNode root;
        root.kind = ConfigNode::Kind::Map;
        root.entries = {{key, value}};
        const ConfigNode back = parseConfig(writeConfig(root), "f");
        ASSERT_EQ(back.entries.size(), 1u);
        EXPECT_EQ(back.entries[0].first, key);
        EXPECT_EQ(back.entries[0].second.text, "1");
    }
}

TEST(ConfigWriter, RandomTreesSurviveWritingAndReading) {
    std::mt19937 random(2);
    const std::vector<std::string> words = {"a",  "-1",   "x, y", "b: c", "",  "~",    "2*pi", "é",
                                            "#h", "a\nb", "[1]",  "k?",   "'", "\"\\", "a:b",  "-"};
    const std::function<ConfigNode(int)> make = [&](int depth) {
        ConfigNode node;
        const auto kind = random() % (depth > 0 ? 5 : 3);
        if (kind == 0) return node;
        if (kind <= 2) {
            node.kind = ConfigNode::Kind::Scalar;
            node.text = words[random() % words.size()];
            node.quoted = random() % 2 == 0;
            return node;
        }
        node.kind = kind == 3 ? ConfigNode::Kind::List : ConfigNode::Kind::Map;
        for (int i = static_cast<int>(random() % 4); i > 0; --i) {
            if (kind == 3) {
                node.items.push_back(make(depth - 1));
            } else {
                node.entries.emplace_back("k" + std::to_string(i), make(depth - 1));
            }
        }
        return node;
    };
    for (int i = 0; i < 2000; ++i) {
        ConfigNode root;
        root.kind = ConfigNode::Kind::Map;
        root.entries = {{"a", make(5)}, {"b c", make(5)}};
        const std::string text = writeConfig(root);
        const ConfigNode once = parseConfig(text, "f");
        // Writing may have had to add quotes; content and structure are the same.
        const std::function<bool(const ConfigNode&, const ConfigNode&)> isSame = [&](const ConfigNode& a,
                                                                                     const ConfigNode& b) {
            bool same = a.kind == b.kind && a.text == b.text && a.items.size() == b.items.size() &&
                        a.entries.size() == b.entries.size();
            for (std::size_t k = 0; same && k < a.items.size(); ++k) same = isSame(a.items[k], b.items[k]);
            for (std::size_t k = 0; same && k < a.entries.size(); ++k)
                same = a.entries[k].first == b.entries[k].first && isSame(a.entries[k].second, b.entries[k].second);
            return same;
        };
        ASSERT_TRUE(isSame(root, once)) << text;
        ASSERT_TRUE(isSameTree(once, parseConfig(writeConfig(once), "f"))) << text;
    }
}

}  // namespace
}  // namespace viable
