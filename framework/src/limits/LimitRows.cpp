#include "limits/LimitRows.h"

#include <atomic>
#include <map>
#include <mutex>

#include "core/Text.h"

namespace viable {

namespace {

using detail::format;
using detail::formatPlain;
using detail::makeUnitSuffix;

constexpr int kFirst = static_cast<int>(kFirstArmLimit);

std::string tellAnyWorst(const ArmLimitRecord& r) {
    std::string text = "worst " + formatPlain(r.worst);
    if (!r.part.empty()) text += " (" + r.part + (r.other.empty() ? "" : " to " + r.other) + ")";
    return text + format(" at %.3f s", r.worst_s);
}

std::string tellAnyArm(const LimitAccount& account, const ArmLimitRecord& r) {
    std::string text = tellAnyWorst(r);
    if (account.limit) text += ", limit " + formatPlain(*account.limit);
    text += format(", beyond it in %lld ticks", r.brokenTicks);
    if (r.firstBroken_s) text += format(" (first at %.3f s)", *r.firstBroken_s);
    return text;
}

void setIfEmpty(std::string& text, const std::string& value) {
    if (text.empty()) text = value;
}

/** Rows are never changed nor destroyed: a kind that gets another one keeps the first for those who have it. */
struct RowTable {
    RowTable() {
        set(LimitKind::Clearance, detail::makeClearanceRow());
        set(LimitKind::Speed, detail::makePointSpeedRow());
        set(LimitKind::Separation, detail::makeSeparationRow());
    }
    void set(LimitKind kind, LimitRow row) {
        at(kind) = kept.emplace_back(std::make_unique<const LimitRow>(detail::complete(std::move(row), kind))).get();
    }
    std::atomic<const LimitRow*>& at(LimitKind kind) {
        VIABLE_CHECK(kind >= kFirstArmLimit && static_cast<int>(kind) < kMostLimitKinds,
                     "a kind of limit that is not of the whole arm has no row");
        return rows[static_cast<int>(kind) - kFirst];
    }

    std::array<std::atomic<const LimitRow*>, kMostLimitKinds - kFirst> rows{};
    std::vector<std::unique_ptr<const LimitRow>> kept;     ///< those that others took the place of, too
    std::map<LimitKind, std::set<std::string>> libraries;  ///< see findLimitLibraries()
    std::mutex adding;
};

RowTable& getRows() {
    static RowTable& rows = *new RowTable;
    return rows;
}

thread_local std::string opening;  // the library whose open() runs

struct ReservedNames {
    const char* what;
    std::vector<std::string> (*list)();
};

std::vector<ReservedNames>& updReserved() {
    static std::vector<ReservedNames>& reserved = *new std::vector<ReservedNames>;
    return reserved;
}

/** What has the name of a kind, or of its block, already; null: nothing has. */
const char* findOther(const std::string& name, const std::string& block) {
    for (const LimitKind kind : listArmLimits())
        if (name != getName(kind, LimitSide::Neither) && block == getLimitRow(kind).block)
            return "another limit's block";
    for (const ReservedNames& reserved : updReserved())
        for (const std::string& taken : reserved.list())
            if (taken == name || taken == block) return reserved.what;
    return nullptr;
}

}  // namespace

LimitRow detail::complete(LimitRow row, LimitKind kind) {
    const std::string name = getName(kind, LimitSide::Neither), unit = getUnit(kind, false);
    const std::string end = unit.empty() ? "" : "_" + makeUnitSuffix(unit);
    setIfEmpty(row.label, name);
    setIfEmpty(row.limitWord, row.label);
    setIfEmpty(row.kept, row.label + " kept");
    setIfEmpty(row.guarantee, row.label);
    setIfEmpty(row.broken, "the arm broke its limit of " + row.label);
    setIfEmpty(row.verdict, "the %s arm broke its limit of " + row.label + ": ");
    setIfEmpty(row.breach, row.verdict);
    setIfEmpty(row.remedy, " (larger limits of that kind, or a command that keeps to them)");
    setIfEmpty(row.heading, row.label + (unit.empty() ? "" : "[" + unit + "]"));
    setIfEmpty(row.block, name);
    setIfEmpty(row.columnBlock, row.block);
    if (!row.tellWorst) row.tellWorst = tellAnyWorst;
    if (!row.tellArm) row.tellArm = tellAnyArm;
    using R = LimitReport;
    if (row.columns.empty() && row.lessIsWorse)
        row.columns = {{"known", &R::isKnown}, {"margin" + end, &R::margin}, {"link", &R::link}};
    else if (row.columns.empty())
        row.columns = {
            {"known", &R::isKnown}, {"value" + end, &R::value}, {"limit" + end, &R::limit}, {"link", &R::link}};
    using A = ArmLimitRecord;
    if (row.figures.empty()) {
        setIfEmpty(row.limitKey, "limit" + end);
        row.figures = {{"worst" + end, &A::worst, "worst" + end, unit, "Worst of " + row.label},
                       {"ticks_broken", &A::brokenTicks, "ticks_broken", "", "Ticks beyond the limit of " + row.label},
                       {"ticks_at_fault", &A::violatedTicks},
                       {"worst_s", &A::worst_s},
                       {"first_broken_s", &A::firstBroken_s},
                       {"part", &A::part}};
    }
    return row;
}

bool detail::reserveLimitNames(const char* what, std::vector<std::string> (*list)()) {
    updReserved().push_back({what, list});
    return true;
}

void detail::addLimitsOf(const std::string& library, void (*open)()) {
    struct Opening {
        ~Opening() { opening.clear(); }
    } const ends;
    opening = library;
    open();
}

std::set<std::string> detail::findLimitLibraries(LimitKind kind) {
    RowTable& rows = getRows();
    const std::lock_guard<std::mutex> guard(rows.adding);
    const auto found = rows.libraries.find(kind);
    return found == rows.libraries.end() ? std::set<std::string>() : found->second;
}

LimitKind addLimit(const std::string& name, const std::string& unit, LimitRow row) {
    static std::mutex taking;  // a name, from the look at the others on: they are listed without rows.adding
    const std::lock_guard<std::mutex> one(taking);
    RowTable& rows = getRows();
    const auto refuse = [&](const std::string& what, const char* remedy = "Choose another name.") {
        throw badInput("kind of limit '" + name + "'", what, remedy);
    };
    if (const char* other = findOther(name, row.block.empty() ? name : row.block))
        refuse(std::string("that is the name of ") + other);
    const std::lock_guard<std::mutex> guard(rows.adding);
    const LimitKind kind = addLimitKind(name, unit);
    if (kind < kFirstArmLimit) refuse("that is a limit of the joints");
    const LimitRow* const old = rows.at(kind);
    const bool isCounted = old && old->make;
    std::set<std::string>& libraries = rows.libraries[kind];
    const bool isOfProgram = isCounted && libraries.empty();
    if (isCounted && row.make && row.make != old->make)
        refuse("it is counted by " + (isOfProgram ? "the program" : *libraries.begin()) + " already",
               "Load one library that counts it, put it into a library that both link, or choose another name.");
    if (row.make && !opening.empty() && !isOfProgram) libraries.insert(opening);
    if (!isCounted) rows.set(kind, std::move(row));
    return kind;
}

const LimitRow& getLimitRow(LimitKind kind) {
    RowTable& rows = getRows();
    if (const LimitRow* row = rows.at(kind)) return *row;
    const std::lock_guard<std::mutex> guard(rows.adding);
    if (!rows.at(kind)) rows.set(kind, {});
    return *rows.at(kind);
}

LimitSet findPeopleLimits() {
    LimitSet found;
    for (const LimitKind kind : listArmLimits()) found.set(kind, getLimitRow(kind).watchesPeople);
    return found;
}

}  // namespace viable
