#include "report/SweepReport.h"

#include <sqlite3.h>

#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <unordered_map>

#include "core/Text.h"
#include "report/Page.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using detail::BinaryBlock;
using nlohmann::json;

constexpr const char* kSchema = "1";

Error refuse(const fs::path& store, const std::string& what) {
    return badInput(store.string(), what, "Run the sweep again, or name the folder of another one.");
}
Error refuseHalfWritten(const fs::path& store, const std::string& what) {
    return refuse(store, "this store of a sweep is half-written or damaged: " + what);
}

/** A query and its rows. */
class Query {
public:
    Query(sqlite3* database, const fs::path& store, const std::string& text) : database_(database), store_(store) {
        sqlite3_stmt* statement = nullptr;
        check(sqlite3_prepare_v2(database, text.c_str(), -1, &statement, nullptr));
        statement_.reset(statement);
    }
    /** Steps to the next row; false behind the last. */
    bool next() {
        const int status = sqlite3_step(statement_.get());
        if (status != SQLITE_ROW && status != SQLITE_DONE) check(status);
        return status == SQLITE_ROW;
    }
    int type(int column) const { return sqlite3_column_type(statement_.get(), column); }
    double number(int column) const { return sqlite3_column_double(statement_.get(), column); }
    std::int64_t integer(int column) const { return sqlite3_column_int64(statement_.get(), column); }
    /** Up to the first zero byte; empty where there is NULL. */
    std::string text(int column) const {
        const unsigned char* text = sqlite3_column_text(statement_.get(), column);
        return text ? reinterpret_cast<const char*>(text) : "";
    }

private:
    void check(int status) const {
        if (status == SQLITE_OK) return;
        if (status == SQLITE_NOTADB) throw refuse(store_, "this is no SQLite file");
        throw refuseHalfWritten(store_, sqlite3_errmsg(database_));
    }

    sqlite3* database_;
    const fs::path& store_;
    std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> statement_{nullptr, sqlite3_finalize};
};

/** A store opened to be read, at one point in time, whoever writes to it meanwhile. */
class Store {
public:
    explicit Store(const fs::path& file) : file_(file) {
        sqlite3* database = nullptr;
        const int status = sqlite3_open_v2(file.c_str(), &database, SQLITE_OPEN_READONLY, nullptr);
        database_.reset(database);
        if (status != SQLITE_OK)
            throw badInput(file.string(),
                           std::string("the store of the sweep cannot be opened: ") +
                               (database ? sqlite3_errmsg(database) : "no memory"),
                           "Remove the cause, or name the folder of another sweep.");
        constexpr int kPatience_ms = 5000;
        sqlite3_busy_timeout(database, kPatience_ms);
        query("BEGIN").next();  // all that follows sees the same state
    }
    Query query(const std::string& text) const { return {database_.get(), file_, text}; }
    const fs::path& file() const { return file_; }

private:
    fs::path file_;
    std::unique_ptr<sqlite3, int (*)(sqlite3*)> database_{nullptr, sqlite3_close};
};

/** The table `meta`. */
class Meta {
public:
    explicit Meta(const Store& store) : store_(store) {
        for (Query rows = store.query("SELECT key, value FROM meta"); rows.next();)
            values_[rows.text(0)] = rows.text(1);
        if (const std::string schema = text("schema"); schema != kSchema)
            throw badInput(store.file().string(),
                           "this store of a sweep has schema " + schema + "; this program reads schema " + kSchema,
                           "Make the report with the viable that wrote it" +
                               (writer().empty() ? "" : " (version " + writer() + ")") + ".");
    }
    /** The version that wrote the store; empty where it does not tell. */
    std::string writer() const {
        const auto entry = values_.find("version");
        return entry == values_.end() ? "" : entry->second;
    }
    const std::string& text(const std::string& key) const {
        const auto entry = values_.find(key);
        if (entry == values_.end()) throw refuseHalfWritten(store_.file(), "its table meta has no " + key);
        return entry->second;
    }
    json list(const std::string& key) const {
        json value = json::parse(text(key), nullptr, false);
        if (!value.is_array()) throw refuseHalfWritten(store_.file(), key + " in its table meta is no list");
        return value;
    }

private:
    const Store& store_;
    std::map<std::string, std::string> values_;
};

std::string formatExactly(double x) {
    for (int digits = 1; digits < 17; ++digits) {
        const std::string text = detail::format("%.*g", digits, x);
        if (std::strtod(text.c_str(), nullptr) == x) return text;
    }
    return detail::format("%.17g", x);
}

/** The values of one column: numbers, or, as soon as one of them is a word, words. */
class ColumnData {
public:
    void add(const Query& row, int column) {
        const int type = row.type(column);
        const bool isNumber = type == SQLITE_FLOAT || type == SQLITE_INTEGER;
        numbers_.push_back(isNumber ? row.number(column) : std::numeric_limits<double>::quiet_NaN());
        codes_.push_back(type == SQLITE_TEXT ? codeOf(row.text(column)) : kNone);
    }

    /** {"numbers": f64, NaN where there is none}, or {"words": u8, every word ended by a zero byte, "codes": u32, an
    index of a word, kNone where there is none}. */
    json describe(BinaryBlock& block) {
        if (words_.empty()) return {{"numbers", block.add(numbers_)}};
        for (std::size_t i = 0; i < numbers_.size(); ++i)
            if (numbers_[i] == numbers_[i]) codes_[i] = codeOf(formatExactly(numbers_[i]));
        std::vector<std::uint8_t> text;
        for (const std::string& word : words_) text.insert(text.end(), word.c_str(), word.c_str() + word.size() + 1);
        return {{"words", block.add(text)}, {"codes", block.add(codes_)}};
    }

private:
    static constexpr std::uint32_t kNone = 0xffffffff;
    std::uint32_t codeOf(const std::string& word) {
        const auto [entry, isNew] = known_.emplace(word, static_cast<std::uint32_t>(words_.size()));
        if (isNew) words_.push_back(word);
        return entry->second;
    }

    std::vector<double> numbers_;
    std::vector<std::uint32_t> codes_;
    std::vector<std::string> words_;
    std::unordered_map<std::string, std::uint32_t> known_;
};

/** The columns that the store declares, each with the values of all runs. */
void describeRuns(const Store& store, json columns, json& data, BinaryBlock& block) {
    std::string names;
    for (const json& column : columns) {
        if (!column.is_object() || !column.value("name", json()).is_string() ||
            !column.value("kind", json()).is_string())
            throw refuseHalfWritten(store.file(), "columns in its table meta is no list of columns");
        names += ", runs." + detail::quoteDoubled(column["name"].get<std::string>());
    }
    std::vector<ColumnData> values(columns.size());
    std::vector<std::uint32_t> runs, cases;
    std::map<std::string, std::uint32_t> caseIndices;
    for (const json& name : data["cases"])
        if (name.is_string()) caseIndices.emplace(name, static_cast<std::uint32_t>(caseIndices.size()));
    if (caseIndices.size() != data["cases"].size())
        throw refuseHalfWritten(store.file(), "cases in its table meta is no list of names");
    for (Query row =
             store.query("SELECT runs.run, runs.case_name" + names + " FROM runs ORDER BY runs.run, runs.case_name");
         row.next();) {
        const auto known = caseIndices.find(row.text(1));
        if (known == caseIndices.end())
            throw refuseHalfWritten(store.file(),
                                    "a run of the case \"" + row.text(1) + "\", which its table meta does not name");
        runs.push_back(static_cast<std::uint32_t>(row.integer(0)));
        cases.push_back(known->second);
        for (std::size_t i = 0; i < values.size(); ++i) values[i].add(row, static_cast<int>(i) + 2);
    }
    data["rows"] = runs.size();
    data["run"] = block.add(runs);
    data["case"] = block.add(cases);
    for (std::size_t i = 0; i < values.size(); ++i) columns[i].update(values[i].describe(block));
    data["columns"] = std::move(columns);
}

}  // namespace

fs::path writeSweepReport(const fs::path& folder, const fs::path& pageFile) {
    const fs::path file = folder / kSweepStore;
    std::error_code failed;
    if (!fs::is_regular_file(file, failed))
        throw badInput(folder.string(), std::string("there is no store (") + kSweepStore + ") in this folder",
                       "Name the folder of a sweep.");
    const detail::Page page(pageFile);
    const Store store(file);
    const Meta meta(store);
    BinaryBlock block;
    json data = {{"format", 1}, {"cases", meta.list("cases")}, {"joints", meta.list("joints")}};
    for (const char* key : {"title", "file", "experiment", "file_hash", "seed", "runs"}) data[key] = meta.text(key);
    data["writer"] = meta.writer();
    describeRuns(store, meta.list("columns"), data, block);
    const fs::path report = folder / "report.html";
    page.write(report, std::move(data), block);
    return report;
}

}  // namespace viable
