
#include "CaseSupport.h"
#include "Program.h"

// `viable export` and `viable recover`: exit codes, words and what lies in the folder afterwards. What they write is
// tested in framework/log and log_readers.

namespace viable::test {
namespace {

namespace fs = std::filesystem;

const char* const kRemedy = ". Choose a folder that exists, may be written to and has room\n";

struct LogCommands : testing::Test {
    static void SetUpTestSuite() {
        const TemporaryFolder folder;
        const Outcome o = run({"run", folder.write("e.yaml", kOneJoint), "--out", folder / "run", "--no-report",
                               "--set", "duration_s=1"});
        ASSERT_EQ(o.code, 0) << o.err;
        whole_ = readFile(folder / "run/A.mcap");
    }
    void SetUp() override {
        ASSERT_GT(whole_.size(), 10000u);
        folder_.write("A.mcap", whole_);
        folder_.write("cut.mcap", whole_.substr(0, whole_.size() * 6 / 10));
        before_ = list();
        rows_ = countRows(path("cut.mcap"));
        ASSERT_GT(rows_, 0);
    }

    fs::path path(const std::string& name) const { return folder_ / name; }
    /** All files by name, with what is in them. */
    std::map<std::string, std::string> list() const {
        std::map<std::string, std::string> files;
        for (const auto& entry : fs::directory_iterator(folder_.path()))
            files[entry.path().filename()] = readFile(entry.path());
        return files;
    }
    /** The command must fail with this text, and leave the folder as it was. */
    void expectRefused(int code, const std::string& text, std::vector<std::string> arguments,
                       std::function<void()> prepare = {}) {
        const Outcome o = run(std::move(arguments), std::move(prepare));
        EXPECT_EQ(o.code, code) << o.err;
        EXPECT_EQ(o.err, "viable: " + text);
        EXPECT_EQ(o.out, "");
        EXPECT_TRUE(list() == before_) << "the folder has changed";
    }

    static std::string whole_;
    TemporaryFolder folder_;
    std::map<std::string, std::string> before_;
    int rows_ = 0;  // of the log that was cut off
};

std::string LogCommands::whole_;

TEST_F(LogCommands, RecoverWritesBesideTheLogOrWhereItIsTold) {
    Outcome o = run({"recover", path("cut.mcap")});
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.err, "");
    EXPECT_EQ(o.out, "wrote " + path("cut.recovered.mcap").string() + ": " + std::to_string(rows_) + " rows\n");
    EXPECT_TRUE(LogReader(path("cut.recovered.mcap")).isComplete());
    EXPECT_EQ(countRows(path("cut.recovered.mcap")), rows_);

    o = run({"recover", path("cut.mcap"), "--out", path("other.mcap")});
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(readFile(path("other.mcap")), readFile(path("cut.recovered.mcap")));
    EXPECT_EQ(list().size(), before_.size() + 2);
    EXPECT_EQ(readFile(path("cut.mcap")), before_["cut.mcap"]);
}

TEST_F(LogCommands, AWholeLogIsOnlyCopiedWhenANewOneIsNamed) {
    Outcome o = run({"recover", path("A.mcap")});
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.out, path("A.mcap").string() + " is complete: nothing to recover\n");
    EXPECT_TRUE(list() == before_);
    o = run({"recover", path("A.mcap"), "--out", path("B.mcap")});
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.out, "wrote " + path("B.mcap").string() + ": 1000 rows; the old log was complete\n");
    EXPECT_TRUE(readFile(path("B.mcap")) == whole_);
}

TEST_F(LogCommands, NothingIsOverwritten) {
    folder_.write("mine", "mine");
    folder_.write("cut.recovered.mcap", "mine too");
    before_ = list();
    const std::string text =
        ": the file exists already and is never overwritten. Choose another name or move the old file away\n";
    for (const char* target : {"mine", "cut.mcap"})
        expectRefused(2, path(target).string() + text, {"recover", path("cut.mcap"), "--out", path(target)});
    expectRefused(2, path("cut.recovered.mcap").string() + text, {"recover", path("cut.mcap")});
    for (const char* format : {"csv", "hdf5"})
        for (const char* target : {"mine", "A.mcap"})
            expectRefused(2, path(target).string() + text, {"export", path("A.mcap"), "--to", format, path(target)});
}

TEST_F(LogCommands, WhatIsForcedReplacesAWholeFileAndNeverTheLog) {
    ASSERT_EQ(run({"export", path("A.mcap"), "--to", "csv", path("fresh.csv")}).code, 0);
    for (const char* format : {"csv", "hdf5"}) {
        folder_.write("mine", "mine");
        expectRun({"export", path("A.mcap"), "--to", format, path("mine"), "--force"}, 0);
        if (std::string(format) == "csv") EXPECT_TRUE(readFile(path("mine")) == readFile(path("fresh.csv")));
        EXPECT_GT(readFile(path("mine")).size(), 1000u);
        const Outcome itself = run({"export", path("A.mcap"), "--to", format, path("A.mcap"), "--force"});
        EXPECT_EQ(itself.code, 2);
        EXPECT_CONTAINS(itself.err, "is the log itself");
        EXPECT_TRUE(readFile(path("A.mcap")) == whole_);
    }
}

TEST_F(LogCommands, WhatIsNoLogIsRefused) {
    folder_.write("empty", "");
    folder_.write("text", "time_s\n0\n");
    folder_.write("head", whole_.substr(0, 500));
    before_ = list();
    const std::map<std::string, std::string> texts = {
        {"empty", ": the file is empty. Give a log written by `viable run`\n"},
        {"text", ": not an MCAP file of version 0. Give a log written by `viable run`\n"},
        {"absent", ": the log cannot be opened: No such file or directory. Check the path\n"}};
    for (const auto& [name, text] : texts) {
        expectRefused(2, path(name).string() + text, {"recover", path(name)});
        expectRefused(2, path(name).string() + text, {"export", path(name), "--to", "hdf5", path("new")});
        expectRefused(2, path(name).string() + text, {"export", path(name), "--to", "csv", path("new")});
    }
    expectRefused(2, folder_.path().string() + ": not a file. Give a log\n", {"recover", folder_.path()});
    const Outcome o = run({"recover", path("head")});
    EXPECT_EQ(o.code, 2);
    EXPECT_NE(o.err.find("ends within its opening and holds no rows"), o.err.npos) << o.err;
    EXPECT_TRUE(list() == before_);
    expectRefused(2,
                  "--to: 'xls' is not a format that viable writes. Use `--to csv FILE`, `--to hdf5 FILE` or "
                  "`--to mcap FILE`.\n",
                  {"export", path("A.mcap"), "--to", "xls", path("new")});
}

TEST_F(LogCommands, ALogThatWasCutOffIsExportedWithAWord) {
    for (const char* format : {"csv", "hdf5", "mcap"}) {
        const Outcome o = run({"export", path("cut.mcap"), "--to", format, path(format)});
        EXPECT_EQ(o.code, 0) << o.err;
        EXPECT_EQ(o.err, "viable: " + path("cut.mcap").string() +
                             " has no end (the run was killed or is still running): every complete "
                             "block of it is exported\n");
        EXPECT_EQ(o.out, "wrote " + path(format).string() + "\n");
    }
    const std::string csv = readFile(path("csv"));
    EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), rows_ + 1);
    EXPECT_EQ(readFile(path("hdf5")).substr(0, 8), "\x89HDF\r\n\x1a\n");
    EXPECT_EQ(countRows(path("mcap")), rows_);
    EXPECT_CONTAINS(readFile(path("mcap")), "zstd");
    EXPECT_EQ(list().size(), before_.size() + 3);
}

// SIGXFSZ has its default action, the end of the program, unless the command sees to it.
TEST_F(LogCommands, Fault72_AFullDiskExitsWith5AndLeavesNothing) {
    const std::string text = path("new").string() + ": the file cannot be written: File too large" + kRemedy;
    for (const rlim_t room : {rlim_t{1000}, rlim_t{whole_.size() / 2}}) {
        const auto limitFiles = [room] {
            const rlimit limit{room, room};
            setrlimit(RLIMIT_FSIZE, &limit);
        };
        expectRefused(5, text, {"recover", path("cut.mcap"), "--out", path("new")}, limitFiles);
        for (const char* format : {"csv", "hdf5"})
            expectRefused(5, text, {"export", path("A.mcap"), "--to", format, path("new")}, limitFiles);
    }
}

TEST_F(LogCommands, Fault72_WhereNothingCanBeWrittenTheReasonIsSaid) {
    const std::map<std::string, std::string> reasons = {{path("absent/new"), "No such file or directory"},
                                                        {path("A.mcap") / "new", "Not a directory"},
                                                        {path(std::string(256, 'x')), "File name too long"}};
    for (const auto& [target, reason] : reasons) {
        const std::string text = target + ": the file cannot be written: " + reason + kRemedy;
        expectRefused(5, text, {"export", path("A.mcap"), "--to", "csv", target});
        expectRefused(5, text, {"export", path("A.mcap"), "--to", "hdf5", target});
        expectRefused(5, text, {"recover", path("cut.mcap"), "--out", target});
    }
}

}  // namespace
}  // namespace viable::test
