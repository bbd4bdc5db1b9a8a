#include "sweep/SweepStore.h"

#include <sqlite3.h>

#include <sstream>

#include "Complaint.h"
#include "TemporaryFolder.h"

namespace viable {
namespace {

using Folder = test::TemporaryFolder;

/** Two cases, a draw, two results. */
SweepPlan makePlan() {
    using Kind = SweepColumn::Kind;
    SweepPlan plan;
    plan.title = "a \"sweep\"";
    plan.file = "e.yaml";
    plan.experiment = "schema: 1\n";
    plan.fileHash = "abc";
    plan.seed = 18446744073709551615u;
    plan.runs = 10;
    plan.cases = {"B", "A"};  // in this order, not by name
    plan.joints = {"joint0"};
    plan.columns = {
        {Kind::Status, "status", "", "How", ""},   {Kind::Status, "exit_code", "", "Code", ""},
        {Kind::Status, "message", "", "What", ""}, {Kind::Status, "replay", "", "Again", ""},
        {Kind::Status, "wall_s", "s", "Time", ""}, {Kind::Draw, "draw.a.mass_kg", "kg", "a.mass_kg", "uniform(0, 1)"},
        {Kind::Result, "worst", "", "Worst", ""},  {Kind::Result, "ticks", "", "Ticks", ""}};
    return plan;
}

SweepRow makeRow(std::int64_t run, const std::string& name, double worst = 0.1, const std::string& status = "ok",
                 std::int64_t code = 0) {
    return {run,
            name,
            {status, code, std::string("it said \"no\",\nand left"), std::string("viable run x"), 0.25, 1.0 / 3.0,
             worst, std::int64_t{5}}};
}

void execute(const std::filesystem::path& file, const std::string& sql) {
    sqlite3* base = nullptr;
    ASSERT_EQ(sqlite3_open(file.c_str(), &base), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(base, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(base);
    sqlite3_close(base);
}

TEST(SweepRow, ComesBackFromItsBytes) {
    SweepRow row = makeRow(1 << 20, "A", -kInfinity);
    row.values[5] = {};
    row.values[2] = std::string("zero \0 and \xc3\xa4", 11);
    const std::string bytes = packRow(row);
    const SweepRow same = unpackRow(bytes);
    EXPECT_EQ(same.run, row.run);
    EXPECT_EQ(same.caseName, row.caseName);
    EXPECT_EQ(same.values, row.values);
    for (std::size_t size = 0; size < bytes.size(); ++size)
        EXPECT_THROW(unpackRow(bytes.substr(0, size)), std::runtime_error) << size;
    EXPECT_THROW(unpackRow(bytes + "x"), std::runtime_error);
}

TEST(SweepStore, KeepsWhatItIsGiven) {
    const Folder folder;
    {
        SweepStore store(folder / "s", makePlan());
        store.add({makeRow(7, "A"), makeRow(7, "B", kInfinity)});
        store.add({makeRow(2, "B"), makeRow(2, "A", 1e-300)});
    }
    const SweepStore store(folder / "s");
    EXPECT_EQ(store.plan().title, "a \"sweep\"");
    EXPECT_EQ(store.plan().seed, 18446744073709551615u);
    EXPECT_EQ(store.plan().cases, makePlan().cases);
    ASSERT_EQ(store.plan().columns.size(), 8u);
    EXPECT_EQ(store.plan().columns[5].distribution, "uniform(0, 1)");
    EXPECT_EQ(store.findRuns(), (std::vector<std::int64_t>{2, 7}));
    std::vector<SweepRow> rows;
    store.forEach([&](const SweepRow& row) { rows.push_back(row); });
    ASSERT_EQ(rows.size(), 4u);
    EXPECT_EQ(rows[0].caseName, "B") << "not in the order of the cases";
    EXPECT_EQ(rows[1].values, makeRow(2, "A", 1e-300).values);
    EXPECT_EQ(rows[2].values, makeRow(7, "B", kInfinity).values);
}

TEST(SweepStore, ARunIsAddedWholeOrNotAtAll) {
    const Folder folder;
    SweepStore store(folder / "s", makePlan());
    store.add({makeRow(1, "A"), makeRow(1, "B")});
    const auto addTwice = [&] { store.add({makeRow(2, "A"), makeRow(1, "A")}); };
    EXPECT_NE(test::findComplaint(addTwice, ErrorKind::LogNotWritten), "");
    EXPECT_EQ(store.findRuns(), (std::vector<std::int64_t>{1}));
    store.add({makeRow(2, "A"), makeRow(2, "B")});
    EXPECT_EQ(store.findRuns(), (std::vector<std::int64_t>{1, 2}));
}

TEST(SweepStore, TakesMoreRunsButNoOtherSweep) {
    const Folder folder;
    SweepPlan plan = makePlan();
    SweepStore(folder / "s", plan).add({makeRow(1, "A"), makeRow(1, "B")});
    const auto complain = [&] { return test::findComplaint([&] { SweepStore(folder / "s", plan); }); };
    plan.runs = 20;
    EXPECT_EQ(complain(), "");
    plan.runs = 5;
    test::expectContains(complain(), {"begun with 20 runs, and 5 are asked for now. --runs 20 continues it"});
    EXPECT_EQ(SweepStore(folder / "s").plan().runs, 20);
    plan.fileHash = "abd";
    EXPECT_CONTAINS(complain(), "the experiment file, its overrides");
    plan = makePlan();
    plan.seed = 4;
    EXPECT_CONTAINS(complain(), "its seed is 18446744073709551615, not 4");
    plan = makePlan();
    plan.cases = {"A"};
    EXPECT_CONTAINS(complain(), "its cases are [\"B\",\"A\"]");
    plan = makePlan();
    plan.columns.pop_back();
    test::expectContains(complain(), {"its columns are others", "--out"});
}

TEST(SweepStore, RefusesFoldersThatHoldSomethingElse) {
    const Folder folder;
    test::expectError({"there is no sweep.sqlite"}, [&] { SweepStore(folder / "none"); });
    std::filesystem::create_directory(folder / "a");
    folder.write("a/x", "");
    test::expectError({"not a sweep"}, [&] { SweepStore(folder / "a", makePlan()); });
    std::filesystem::create_directory(folder / "b");
    const std::string words = "this is text, and long enough to look like a file's header";
    folder.write("b/sweep.sqlite", words);
    std::filesystem::create_directory(folder / "c");
    execute(folder / "c/sweep.sqlite", "CREATE TABLE meta(other); CREATE TABLE runs(x)");
    const std::string foreign = test::readFile(folder / "c/sweep.sqlite");
    for (const char* name : {"b", "c"}) {
        SCOPED_TRACE(name);
        test::catchError([&] { SweepStore(folder / name, makePlan()); });
        test::catchError([&] { const SweepStore store(folder / name); });
    }
    EXPECT_EQ(test::readFile(folder / "b/sweep.sqlite"), words);
    EXPECT_EQ(test::readFile(folder / "c/sweep.sqlite"), foreign);
}

TEST(SweepStore, BearsATableEditedElsewhere) {
    const Folder folder;
    SweepStore(folder / "s", makePlan()).add({makeRow(1, "A"), makeRow(1, "B")});
    const std::filesystem::path file = folder / "s/sweep.sqlite";
    execute(file, "ALTER TABLE runs ADD COLUMN note TEXT DEFAULT 'mine'");
    {
        SweepStore store(folder / "s", makePlan());
        store.add({makeRow(2, "A"), makeRow(2, "B")});
        store.forEach([&](const SweepRow& row) { EXPECT_EQ(row.values, makeRow(row.run, row.caseName).values); });
    }
    execute(file, "ALTER TABLE runs DROP COLUMN worst");
    test::expectError({"worst"}, [&] { SweepStore(folder / "s", makePlan()); });
    test::expectError({"worst"}, [&] { const SweepStore store(folder / "s"); });
}

TEST(SweepStore, ARunWithoutAllItsCasesIsDoneAgain) {
    const Folder folder;
    {
        SweepStore store(folder / "s", makePlan());
        store.add({makeRow(1, "A"), makeRow(1, "B")});
        store.add({makeRow(2, "A"), makeRow(2, "B")});
    }
    execute(folder / "s/sweep.sqlite", "DELETE FROM runs WHERE run = 1 AND case_name = 'B'");
    EXPECT_EQ(SweepStore(folder / "s").findRuns(), (std::vector<std::int64_t>{2}));
    SweepStore store(folder / "s", makePlan());
    store.add({makeRow(1, "A"), makeRow(1, "B")});
    EXPECT_EQ(store.findRuns(), (std::vector<std::int64_t>{1, 2}));
}

TEST(SweepStore, LostRunsCanBeRemoved) {
    const Folder folder;
    SweepStore store(folder / "s", makePlan());
    const char* const ends[] = {"ok", "crashed", "timed_out", "failed", "tripped", "guarantee_broken"};
    for (int run = 0; run < 6; ++run) store.add({makeRow(run, "A"), makeRow(run, "B", 0.1, ends[run], run)});
    EXPECT_EQ(store.removeLost(), 2);
    EXPECT_EQ(store.findRuns(), (std::vector<std::int64_t>{0, 3, 4, 5}));
}

TEST(SweepColumns, ThatDifferInCaseOnlyAreRefused) {
    const std::string told = test::findComplaint([] {
        makeSweepColumns({{"cases.A.gain", "uniform(0, 1)"}, {"cases.a.gain", "uniform(0, 1)"}}, {});
    });
    EXPECT_CONTAINS(told, "`draw.cases.A.gain` and `draw.cases.a.gain`");
    test::expectError({"tracking.elbow"}, [] { makeSweepColumns({}, {"Elbow", "elbow"}); });
}

TEST(SweepHash, IsOfNamesAndContentsWhereverTheyLie) {
    const Folder folder;
    std::filesystem::create_directory(folder / "z");
    const auto hash = [&](const std::string& a, const std::string& b, const std::string& library) {
        SweepFiles files;
        files.data = {folder / a, folder / b};
        files.libraries = {folder / library};
        return calcSweepHash("x", {}, files);
    };
    for (const char* file : {"a.csv", "z/a.csv"}) folder.write(file, "1");
    for (const char* file : {"b.csv", "z/b.csv"}) folder.write(file, "2");
    for (const char* file : {"p.so", "z/p.so"}) folder.write(file, "code");
    const std::string one = hash("a.csv", "b.csv", "p.so");
    EXPECT_EQ(hash("z/a.csv", "b.csv", "p.so"), one);
    EXPECT_EQ(hash("a.csv", "z/b.csv", "z/p.so"), one);
    folder.write("z/p.so", "other code");
    EXPECT_NE(hash("a.csv", "b.csv", "z/p.so"), one);
    folder.write("z/b.csv", "3");
    EXPECT_NE(hash("a.csv", "z/b.csv", "p.so"), one);
}

TEST(SweepStore, HasOneWriter) {
    const Folder folder;
    const SweepStore store(folder / "s", makePlan());
    test::expectError({"another run or sweep is writing"}, [&] { SweepStore(folder / "s", makePlan()); });
    EXPECT_EQ(SweepStore(folder / "s").findRuns().size(), 0u) << "readers are welcome";
}

TEST(SweepCsv, IsSortedQuotedAndWithoutTimes) {
    const Folder folder;
    SweepStore store(folder / "s", makePlan());
    store.add({makeRow(3, "A", kInfinity), makeRow(3, "B")});
    store.add({makeRow(0, "A"), makeRow(0, "B")});
    writeSweepCsv(store);
    const std::string text = test::readFile(folder / "s/sweep.csv");
    EXPECT_EQ(text.substr(0, text.find('\n')), "run,case,status,exit_code,message,draw.a.mass_kg,worst,ticks");
    const std::string said = "\"it said \"\"no\"\",\nand left\"";
    const std::string third = "0.3333333333333333";
    EXPECT_EQ(text.substr(text.find('\n') + 1),
              "0,B,ok,0," + said + "," + third + ",0.1,5\n" +  //
                  "0,A,ok,0," + said + "," + third + ",0.1,5\n" + "3,B,ok,0," + said + "," + third + ",0.1,5\n" +
                  "3,A,ok,0," + said + "," + third + ",inf,5\n");
}

TEST(SweepSummary, CountsMediansAndTroubles) {
    const Folder folder;
    SweepStore store(folder / "s", makePlan());
    for (int run = 0; run < 4; ++run) store.add({makeRow(run, "A", run == 2 ? 9.0 : run), makeRow(run, "B", 1.0)});
    EXPECT_EQ(findSweepExitCode(store), 0);
    store.add({makeRow(4, "A", 2.0, "tripped", 6), makeRow(4, "B")});
    EXPECT_EQ(findSweepExitCode(store), 6);
    store.add({makeRow(5, "A", 2.0, "crashed", 4), makeRow(5, "B")});
    EXPECT_EQ(findSweepExitCode(store), 6);
    store.add({makeRow(6, "A", 2.0, "guarantee_broken", 3), makeRow(6, "B")});
    EXPECT_EQ(findSweepExitCode(store), 3);
    store.add({makeRow(7, "A", 2.0, "failed", 2), makeRow(7, "B")});
    EXPECT_EQ(findSweepExitCode(store), 3);
    const std::string text = formatSweepSummary(store);
    test::expectContains(text, {"A: 1 crashed, 1 failed, 1 guarantee_broken, 4 ok, 1 tripped", "B: 8 ok"});
    std::istringstream lines(text.substr(text.find("A: 1")));
    std::string line, name, min, median, max, run;
    while (std::getline(lines, line) && line.find(" worst ") == std::string::npos) {
    }
    std::istringstream(line) >> name >> min >> median >> max >> run;
    EXPECT_EQ(min + " " + median + " " + max + " " + run, "0 2 9 2") << text;
    test::expectContains(text, {"4 not ok", "run 5, case A: crashed: it said", "    viable run x\n"});
}

TEST(SweepSummary, CommandsNoTerminal) {
    const Folder folder;
    SweepStore store(folder / "s", makePlan());
    SweepRow row = makeRow(0, "A", 0.1, "fai\033led", 2);
    row.values[2] = std::string("\033[2J and \xc2\x9b and \xc3\xa4");
    row.values[3] = std::string("viable\007");
    store.add({row, makeRow(0, "B")});
    const std::string text = formatSweepSummary(store);
    EXPECT_CONTAINS(text, "case A: fai?led: ?[2J and ? and \xc3\xa4\n    viable?\n");
    for (const char c : text) EXPECT_TRUE(c == '\n' || static_cast<unsigned char>(c) >= 0x20);
}

}  // namespace
}  // namespace viable
