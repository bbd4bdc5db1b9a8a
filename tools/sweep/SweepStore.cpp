#include "sweep/SweepStore.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <nlohmann/json.hpp>

#include "core/Descriptor.h"
#include "core/Text.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr char kFile[] = "sweep.sqlite";
constexpr char kSchema[] = "1";
/** How long to wait for a reader's lock before giving up [ms]. */
constexpr int kBusy_ms = 10000;

const char* getName(SweepColumn::Kind kind) {
    return detail::enumName<SweepColumn::Kind::Result>(kind, {"status", "draw", "result"}, "");
}

/** Text columns are TEXT. The rest keeps what it is given: a draw is a number or a word. */
std::string getSqlType(const SweepColumn& column) {
    return column.name == "status" || column.name == "message" || column.name == "replay" ? " TEXT" : "";
}

std::string dump(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json makeJson(const std::vector<SweepColumn>& columns) {
    Json list = Json::array();
    for (const SweepColumn& column : columns) {
        Json entry = {
            {"name", column.name}, {"kind", getName(column.kind)}, {"unit", column.unit}, {"label", column.label}};
        if (column.kind == SweepColumn::Kind::Draw) entry["distribution"] = column.distribution;
        list.push_back(std::move(entry));
    }
    return list;
}

std::vector<SweepColumn> readColumns(const Json& list) {
    std::vector<SweepColumn> columns;
    for (const Json& entry : list) {
        SweepColumn column;
        const std::string kind = entry.at("kind");
        column.kind = kind == "draw"     ? SweepColumn::Kind::Draw
                      : kind == "status" ? SweepColumn::Kind::Status
                                         : SweepColumn::Kind::Result;
        column.name = entry.at("name");
        column.unit = entry.at("unit");
        column.label = entry.at("label");
        column.distribution = entry.value("distribution", "");
        columns.push_back(std::move(column));
    }
    return columns;
}

}  // namespace

struct SweepStore::Impl {
    fs::path folder, file;
    SweepPlan plan;
    sqlite3* base = nullptr;
    sqlite3_stmt* insert = nullptr;
    mutable sqlite3_stmt* select = nullptr;
    detail::Descriptor lock;

    ~Impl() {
        sqlite3_finalize(insert);
        sqlite3_finalize(select);
        sqlite3_close(base);
    }

    [[noreturn]] void fail(const std::string& what) const {
        throw Error(ErrorKind::LogNotWritten, file.string(),
                    what + ": " + (base ? sqlite3_errmsg(base) : "out of memory"),
                    "What was stored before is complete; remove the cause and give the same command again.");
    }

    void open(int flags) {
        // One thread uses it: no locks of its own.
        if (sqlite3_open_v2(file.c_str(), &base, flags | SQLITE_OPEN_NOMUTEX, nullptr) != SQLITE_OK)
            fail("cannot be opened");
        sqlite3_busy_timeout(base, kBusy_ms);
    }

    void run(const std::string& sql) const {
        if (sqlite3_exec(base, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail("cannot be written");
    }

    sqlite3_stmt* prepare(const std::string& sql) const {
        sqlite3_stmt* statement = nullptr;
        if (sqlite3_prepare_v2(base, sql.c_str(), -1, &statement, nullptr) != SQLITE_OK)
            throw badInput(file.string(), std::string("this is not a table of a sweep: ") + sqlite3_errmsg(base),
                           "Name the folder of a sweep.");
        return statement;
    }

    void acquireLock() {
        lock = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (lock < 0 || flock(lock, LOCK_EX | LOCK_NB) == 0) return;
        if (errno == EWOULDBLOCK)
            throw badInput(folder.string(), "another run or sweep is writing into this folder",
                           "Wait for its end, or name another folder with --out.");
    }

    bool isEmpty() const {
        sqlite3_stmt* statement = prepare("SELECT count(*) FROM sqlite_master");
        const bool empty = sqlite3_step(statement) == SQLITE_ROW && sqlite3_column_int64(statement, 0) == 0;
        sqlite3_finalize(statement);
        return empty;
    }

    /** Run, case and the plan's columns. */
    std::string listColumns(const std::string& prefix) const {
        std::string list = prefix + "run, " + prefix + "case_name";
        for (const SweepColumn& column : plan.columns) list += ", " + prefix + detail::quoteDoubled(column.name);
        return list;
    }

    /** SELECT of the runs that have a row of each case. */
    std::string selectWhole() const {
        return "SELECT run FROM runs GROUP BY run HAVING count(*) = " + std::to_string(plan.cases.size());
    }

    /** Throws where a column is missing. With `runs.`, as a quoted name alone that is none would be a text. */
    void checkTable() const { sqlite3_finalize(prepare("SELECT " + listColumns("runs.") + " FROM runs")); }

    void create() {
        run("BEGIN IMMEDIATE");
        run("CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT)");
        std::string columns;
        for (const SweepColumn& column : plan.columns)
            columns += ", " + detail::quoteDoubled(column.name) + getSqlType(column);
        run("CREATE TABLE runs(run INTEGER, case_name TEXT" + columns + ", PRIMARY KEY(run, case_name))");
        sqlite3_stmt* statement = prepare("INSERT INTO meta VALUES(?, ?)");
        const std::pair<const char*, std::string> entries[] = {
            {"schema", kSchema},
            {"title", plan.title},
            {"file", plan.file},
            {"experiment", plan.experiment},
            {"file_hash", plan.fileHash},
            {"seed", std::to_string(plan.seed)},
            {"runs", std::to_string(plan.runs)},
            {"cases", dump(plan.cases)},
            {"joints", dump(plan.joints)},
            {"columns", dump(makeJson(plan.columns))},
        };
        for (const auto& [key, value] : entries) {
            bindText(statement, 1, key);
            bindText(statement, 2, value);
            step(statement);
        }
        sqlite3_finalize(statement);
        run("COMMIT");
    }

    static void bindText(sqlite3_stmt* statement, int at, const std::string& text) {
        sqlite3_bind_text(statement, at, text.data(), static_cast<int>(text.size()), SQLITE_TRANSIENT);
    }

    void step(sqlite3_stmt* statement) const {
        const int code = sqlite3_step(statement);
        sqlite3_reset(statement);
        if (code != SQLITE_DONE) fail("cannot be written");
    }

    SweepPlan readPlan() const {
        std::map<std::string, std::string> meta;
        sqlite3_stmt* statement = prepare("SELECT key, value FROM meta");
        while (sqlite3_step(statement) == SQLITE_ROW) meta[getText(statement, 0)] = getText(statement, 1);
        sqlite3_finalize(statement);
        if (meta["schema"] != kSchema)
            throw badInput(file.string(), "its schema is '" + meta["schema"] + "', this program reads " + kSchema,
                           "Use the version of viable that made it.");
        try {
            SweepPlan read;
            read.title = meta["title"];
            read.file = meta["file"];
            read.experiment = meta["experiment"];
            read.fileHash = meta["file_hash"];
            read.seed = std::stoull(meta["seed"]);
            read.runs = std::stoll(meta["runs"]);
            read.cases = Json::parse(meta["cases"]).get<std::vector<std::string>>();
            read.joints = Json::parse(meta["joints"]).get<std::vector<std::string>>();
            read.columns = readColumns(Json::parse(meta["columns"]));
            return read;
        } catch (const std::exception& e) {
            throw badInput(file.string(), std::string("its table `meta` is damaged: ") + e.what(),
                           "Name the folder of a sweep.");
        }
    }

    static std::string getText(sqlite3_stmt* statement, int at) {
        const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, at));
        return text ? std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement, at))) : std::string();
    }
};

SweepStore::SweepStore(const fs::path& folder, const SweepPlan& plan) : impl_(std::make_unique<Impl>()) {
    impl_->folder = folder;
    impl_->file = folder / kFile;
    impl_->plan = plan;
    std::error_code error;
    fs::create_directories(folder, error);
    if (error)
        throw Error(ErrorKind::LogNotWritten, folder.string(), "cannot create the folder: " + error.message(),
                    "Name another place with --out.");
    impl_->acquireLock();
    if (!fs::exists(impl_->file) && !fs::is_empty(folder, error))
        throw badInput(folder.string(), "this folder already holds something that is not a sweep",
                       "Name a new or empty folder.");
    impl_->open(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
    const bool isNew = impl_->isEmpty();
    if (!isNew) {  // looked at before anything is written: it may be somebody else's
        impl_->plan = impl_->readPlan();
        checkSame(plan, "the command");
        const std::string begun = std::to_string(impl_->plan.runs);
        if (plan.runs < impl_->plan.runs)
            throw badInput(
                folder.string(),
                "this sweep was begun with " + begun + " runs, and " + std::to_string(plan.runs) + " are asked for now",
                "--runs " + begun + " continues it; another --out begins a new one.");
        impl_->checkTable();
    }
    impl_->run("PRAGMA journal_mode=WAL");
    impl_->run("PRAGMA synchronous=NORMAL");
    if (isNew) {
        impl_->create();
    } else {
        if (plan.runs > impl_->plan.runs) {
            impl_->run("UPDATE meta SET value='" + std::to_string(plan.runs) + "' WHERE key='runs'");
            impl_->plan.runs = plan.runs;
        }
        impl_->run("DELETE FROM runs WHERE run NOT IN (" + impl_->selectWhole() + ")");
    }
    std::string places = "?, ?";
    for (std::size_t i = 0; i < impl_->plan.columns.size(); ++i) places += ", ?";
    impl_->insert = impl_->prepare("INSERT INTO runs(" + impl_->listColumns("") + ") VALUES(" + places + ")");
}

SweepStore::SweepStore(const fs::path& folder) : impl_(std::make_unique<Impl>()) {
    impl_->folder = folder;
    impl_->file = folder / kFile;
    if (!fs::exists(impl_->file))
        throw badInput(folder.string(), "there is no " + std::string(kFile) + " in it", "Name the folder of a sweep.");
    impl_->open(SQLITE_OPEN_READWRITE);
    impl_->plan = impl_->readPlan();
    impl_->checkTable();
}

SweepStore::~SweepStore() = default;

const SweepPlan& SweepStore::plan() const {
    return impl_->plan;
}

const fs::path& SweepStore::folder() const {
    return impl_->folder;
}

void SweepStore::checkSame(const SweepPlan& other, const fs::path& where) const {
    const SweepPlan& own = plan();
    const auto refuse = [&](const std::string& what) {
        throw badInput(folder().string(), "this folder holds another sweep than " + where.string() + ": " + what,
                       "Name another folder with --out, or give the command of that sweep.");
    };
    if (own.fileHash != other.fileHash)
        refuse("the experiment file, its overrides, a robot's folder, a data file, a plugin or the program is another");
    if (own.seed != other.seed)
        refuse("its seed is " + std::to_string(own.seed) + ", not " + std::to_string(other.seed));
    if (own.cases != other.cases) refuse("its cases are " + dump(own.cases));
    if (makeJson(own.columns) != makeJson(other.columns)) refuse("its columns are others");
}

void SweepStore::add(const std::vector<SweepRow>& rows) {
    VIABLE_CHECK(impl_->insert != nullptr, "the store was opened to read");
    impl_->run("BEGIN IMMEDIATE");
    try {
        for (const SweepRow& row : rows) {
            VIABLE_CHECK(row.values.size() == impl_->plan.columns.size(), "a row has a value per column");
            sqlite3_bind_int64(impl_->insert, 1, row.run);
            Impl::bindText(impl_->insert, 2, row.caseName);
            int at = 3;
            for (const SweepValue& value : row.values) {
                if (const auto* number = std::get_if<double>(&value))
                    sqlite3_bind_double(impl_->insert, at, *number);
                else if (const auto* whole = std::get_if<std::int64_t>(&value))
                    sqlite3_bind_int64(impl_->insert, at, *whole);
                else if (const auto* text = std::get_if<std::string>(&value))
                    Impl::bindText(impl_->insert, at, *text);
                else
                    sqlite3_bind_null(impl_->insert, at);
                ++at;
            }
            impl_->step(impl_->insert);
        }
        impl_->run("COMMIT");
    } catch (...) {
        sqlite3_exec(impl_->base, "ROLLBACK", nullptr, nullptr, nullptr);
        throw;
    }
}

std::vector<std::int64_t> SweepStore::findRuns() const {
    std::vector<std::int64_t> runs;
    sqlite3_stmt* statement = impl_->prepare(impl_->selectWhole() + " ORDER BY run");
    int code = SQLITE_OK;
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) runs.push_back(sqlite3_column_int64(statement, 0));
    sqlite3_finalize(statement);
    if (code != SQLITE_DONE) impl_->fail("cannot be read");
    return runs;
}

std::int64_t SweepStore::removeLost() {
    VIABLE_CHECK(impl_->insert != nullptr, "the store was opened to read");
    const std::string lost = std::string("('") + viable::getName(SweepStatus::Crashed) + "', '" +
                             viable::getName(SweepStatus::TimedOut) + "')";
    const std::size_t before = findRuns().size();
    impl_->run("DELETE FROM runs WHERE run IN (SELECT run FROM runs WHERE runs.status IN " + lost + ")");
    return static_cast<std::int64_t>(before - findRuns().size());
}

void SweepStore::begin() const {
    sqlite3_finalize(impl_->select);
    std::string order;
    for (std::size_t i = 0; i < impl_->plan.cases.size(); ++i)
        order += " WHEN ?" + std::to_string(i + 1) + " THEN " + std::to_string(i);
    impl_->select = impl_->prepare("SELECT " + impl_->listColumns("runs.") + " FROM runs ORDER BY run, CASE case_name" +
                                   order + " END");
    for (std::size_t i = 0; i < impl_->plan.cases.size(); ++i)
        Impl::bindText(impl_->select, static_cast<int>(i + 1), impl_->plan.cases[i]);
}

bool SweepStore::next(SweepRow& row) const {
    sqlite3_stmt* const from = impl_->select;
    const int code = sqlite3_step(from);
    if (code == SQLITE_DONE) return false;
    if (code != SQLITE_ROW) impl_->fail("cannot be read");
    row.run = sqlite3_column_int64(from, 0);
    row.caseName = Impl::getText(from, 1);
    row.values.clear();
    for (int i = 2; i < sqlite3_column_count(from); ++i) {
        SweepValue& value = row.values.emplace_back();
        const int type = sqlite3_column_type(from, i);
        if (type == SQLITE_INTEGER) value = static_cast<std::int64_t>(sqlite3_column_int64(from, i));
        if (type == SQLITE_FLOAT) value = sqlite3_column_double(from, i);
        if (type == SQLITE_TEXT) value = Impl::getText(from, i);
    }
    return true;
}

void SweepStore::abandon() {
    impl_->lock = -1;
    impl_.release();
}

}  // namespace viable
