#include "report/SweepReport.h"

#include <sqlite3.h>

#include "CaseSupport.h"
#include "ReportSupport.h"

namespace viable::test {
namespace {

using nlohmann::json;

/** A store of a sweep, written as a sweep does: with a write-ahead log, kept open. */
class SmallSweep {
public:
    SmallSweep() {
        page_ = folder_.write("page.html", kPage);
        if (sqlite3_open((folder_ / kSweepStore).c_str(), &store_) != SQLITE_OK) throw std::runtime_error("no store");
        run("PRAGMA journal_mode=WAL");
    }
    ~SmallSweep() { sqlite3_close(store_); }
    SmallSweep(const SmallSweep&) = delete;

    void run(const std::string& sql) const {
        char* message = nullptr;
        if (sqlite3_exec(store_, sql.c_str(), nullptr, nullptr, &message) == SQLITE_OK) return;
        const std::string text = message;
        sqlite3_free(message);
        throw std::runtime_error(sql + ": " + text);
    }
    void setMeta(const std::string& key, std::string value) const {
        for (std::size_t at = 0; (at = value.find('\'', at)) != std::string::npos; at += 2) value.insert(at, 1, '\'');
        run("INSERT OR REPLACE INTO meta VALUES('" + key + "','" + value + "')");
    }
    /** The tables, and what a sweep knows before its first run. */
    void create() const {
        run("CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT)");
        const json columns = {{{"name", "draw.real_plant.payload_kg"},
                               {"kind", "draw"},
                               {"unit", "kg"},
                               {"label", "payload"},
                               {"distribution", "uniform from 0 to 1"}},
                              {{"name", "draw.a \"quoted\" key"},
                               {"kind", "draw"},
                               {"unit", ""},
                               {"label", ""},
                               {"distribution", "one of sine, 2"}},
                              {{"name", "bound.share"}, {"kind", "result"}, {"unit", ""}, {"label", "share"}},
                              {{"name", "status"}, {"kind", "status"}, {"unit", ""}, {"label", ""}},
                              {{"name", "replay"}, {"kind", "status"}, {"unit", ""}, {"label", ""}}};
        std::string names;
        for (const json& column : columns) {
            const std::string name = column["name"];
            names += ", \"";
            for (char c : name) names += c == '"' ? "\"\"" : std::string(1, c);
            names += '"';
        }
        run("CREATE TABLE runs(run INTEGER, case_name TEXT" + names + ", PRIMARY KEY(run, case_name))");
        for (const auto& [key, value] : std::map<std::string, std::string>{{"schema", "1"},
                                                                           {"title", "it's </script> a sweep"},
                                                                           {"file", "sweep.yaml"},
                                                                           {"experiment", "schema: 1\n"},
                                                                           {"file_hash", "abc"},
                                                                           {"seed", "42"},
                                                                           {"runs", "3"},
                                                                           {"version", "9.9"},
                                                                           {"cases", R"(["B", "A"])"},
                                                                           {"joints", R"(["joint0"])"},
                                                                           {"columns", columns.dump()}})
            setMeta(key, value);
    }
    void add(const std::string& row) const { run("INSERT INTO runs VALUES(" + row + ")"); }
    std::filesystem::path path() const { return folder_.path(); }
    ReadReport report() const { return ReadReport(writeSweepReport(path(), page_)); }
    std::string refusal() const {
        return catchError([&] { writeSweepReport(path(), page_); });
    }

private:
    TemporaryFolder folder_;
    std::filesystem::path page_;
    sqlite3* store_ = nullptr;
};

/** The words of a column, row by row; "(none)" where there is none. */
std::vector<std::string> readWords(const ReadReport& report, const json& column) {
    const auto text = report.letters(column["words"]);
    std::vector<std::string> words(1), rows;
    for (std::uint8_t c : text)
        if (c == 0)
            words.emplace_back();
        else
            words.back() += static_cast<char>(c);
    for (std::uint32_t code : report.array<std::uint32_t>(column["codes"], "u32"))
        rows.push_back(code == 0xffffffff ? "(none)" : words.at(code));
    return rows;
}

TEST(SweepReport, HoldsEveryValueOfTheStoreInFull) {
    const SmallSweep sweep;
    sweep.create();
    sweep.add("1, 'A', 0.1, 'sine', 0.30000000000000004, 'ok', 'viable sweep --replay 1'");
    sweep.add("0, 'B', 0.2, 2.5, NULL, 'crashed', NULL");
    sweep.add("0, 'A', 1e-300, 'ünï', 9e999, 'tripped', 'x'");
    const ReadReport report = sweep.report();
    EXPECT_EQ(report.data["title"], "it's </script> a sweep");
    EXPECT_EQ(report.data["runs"], "3");
    EXPECT_EQ(report.data["seed"], "42");
    EXPECT_EQ(report.data["writer"], "9.9");
    EXPECT_EQ(report.data["cases"], json({"B", "A"}));
    EXPECT_EQ(report.data["rows"], 3);
    // Sorted by run and case, whatever the order of writing; cases by their place in the list.
    EXPECT_EQ(report.array<std::uint32_t>(report.data["run"], "u32"), (std::vector<std::uint32_t>{0, 0, 1}));
    EXPECT_EQ(report.array<std::uint32_t>(report.data["case"], "u32"), (std::vector<std::uint32_t>{1, 0, 1}));
    const json& columns = report.data["columns"];
    EXPECT_EQ(columns[0]["unit"], "kg");
    EXPECT_EQ(columns[0]["distribution"], "uniform from 0 to 1");
    EXPECT_EQ(report.array<double>(columns[0]["numbers"], "f64"), (std::vector<double>{1e-300, 0.2, 0.1}));
    EXPECT_EQ(readWords(report, columns[1]), (std::vector<std::string>{"ünï", "2.5", "sine"}));
    const auto shares = report.array<double>(columns[2]["numbers"], "f64");
    EXPECT_EQ(shares[0], INFINITY);
    EXPECT_TRUE(std::isnan(shares[1]));
    EXPECT_EQ(shares[2], 0.30000000000000004);
    EXPECT_EQ(readWords(report, columns[3]), (std::vector<std::string>{"tripped", "crashed", "ok"}));
    EXPECT_EQ(readWords(report, columns[4])[1], "(none)");
    EXPECT_EQ(cutOut(report.text, "<data>", "</data>").find('<'), std::string::npos);
}

TEST(SweepReport, ASweepBeforeItsFirstRunHasAReport) {
    const SmallSweep sweep;
    sweep.create();
    const ReadReport report = sweep.report();
    EXPECT_EQ(report.data["rows"], 0);
    EXPECT_EQ(report.data["columns"].size(), 5u);
}

TEST(SweepReport, WhileASweepWritesWhatIsFinishedIsShown) {
    const SmallSweep sweep;
    sweep.create();
    sweep.add("0, 'A', 0.1, 'x', 0.5, 'ok', 'r'");
    sweep.run("BEGIN IMMEDIATE");
    sweep.add("1, 'A', 0.1, 'x', 0.5, 'ok', 'r'");
    EXPECT_EQ(sweep.report().data["rows"], 1);
    sweep.run("COMMIT");
    EXPECT_EQ(sweep.report().data["rows"], 2);
}

TEST(SweepReport, WhatAKilledSweepLeftIsShown) {
    const SmallSweep sweep;
    sweep.create();
    sweep.add("0, 'A', 0.1, 'x', 0.5, 'ok', 'r'");
    const TemporaryFolder left;  // store and write-ahead log as they lie on the disk, nobody at them
    for (const char* end : {"", "-wal"})
        std::filesystem::copy(sweep.path() / (std::string(kSweepStore) + end), left / (std::string(kSweepStore) + end));
    EXPECT_EQ(ReadReport(writeSweepReport(left.path(), left.write("page.html", kPage))).data["rows"], 1);
}

TEST(SweepReport, RefusesWhatIsNoWholeStore) {
    {
        const TemporaryFolder folder;
        const auto page = folder.write("page.html", kPage);
        expectError({"there is no store (sweep.sqlite)"}, [&] { writeSweepReport(folder.path(), page); });
        folder.write(kSweepStore, "this is no database, however long the text may become here");
        expectError({"no SQLite file"}, [&] { writeSweepReport(folder.path(), page); });
        folder.write(kSweepStore, "");
        expectError({"half-written or damaged: no such table: meta"}, [&] { writeSweepReport(folder.path(), page); });
        EXPECT_FALSE(std::filesystem::exists(folder / "report.html"));
    }
    struct Damage {
        const char *sql, *message;
    };
    for (const Damage& damage : {
             Damage{"UPDATE meta SET value='2' WHERE key='schema'",
                    "has schema 2; this program reads schema 1. Make the report with the viable that wrote it "
                    "(version 9.9)"},
             Damage{"DELETE FROM meta WHERE key='columns'", "its table meta has no columns"},
             Damage{"DELETE FROM meta WHERE key='schema'", "its table meta has no schema"},
             Damage{"UPDATE meta SET value='[{]' WHERE key='columns'", "columns in its table meta is no list"},
             Damage{"UPDATE meta SET value='[{\"name\": 3}]' WHERE key='columns'", "no list of columns"},
             Damage{"UPDATE meta SET value='[1]' WHERE key='cases'", "no list of names"},
             Damage{"UPDATE meta SET value='[\"C\"]' WHERE key='cases'", "a run of the case \"A\""},
             Damage{"UPDATE meta SET value=replace(value, 'bound.share', 'absent') WHERE key='columns'",
                    "no such column: runs.absent"},
             Damage{"DROP TABLE runs", "no such table: runs"},
         }) {
        const SmallSweep sweep;
        sweep.create();
        sweep.add("0, 'A', 0.1, 'x', 0.5, 'ok', 'r'");
        sweep.run(damage.sql);
        EXPECT_CONTAINS(sweep.refusal(), damage.message) << damage.sql;
        EXPECT_FALSE(std::filesystem::exists(sweep.path() / "report.html")) << damage.sql;
    }
}

}  // namespace
}  // namespace viable::test
