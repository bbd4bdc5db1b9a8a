
#include "core/Text.h"
#include "core/WholeFile.h"
#include "sweep/SweepStore.h"

namespace viable {

namespace {

using detail::format;
using detail::quoteCsv;

/** Runs that are not ok are listed up to here; the table holds all. */
constexpr int kListed = 10;

std::size_t findColumn(const SweepPlan& plan, const std::string& name) {
    for (std::size_t i = 0; i < plan.columns.size(); ++i)
        if (plan.columns[i].name == name) return i;
    throw badInput(plan.file, "the sweep has no column `" + name + "`", "Name a sweep's folder.");
}

std::string toText(const SweepValue& value) {
    if (const auto* number = std::get_if<double>(&value)) return detail::formatNumber(*number);
    if (const auto* whole = std::get_if<std::int64_t>(&value)) return std::to_string(*whole);
    if (const auto* text = std::get_if<std::string>(&value)) return *text;
    return {};
}

bool isInCsv(const SweepColumn& column) {
    return column.name != "replay" && column.name != "wall_s";
}

/** Of one case: a value and the run it belongs to. */
using Figures = std::vector<std::pair<double, std::int64_t>>;

}  // namespace

void writeSweepCsv(const SweepStore& store) {
    const SweepPlan& plan = store.plan();
    std::string text = "run,case";
    for (const SweepColumn& column : plan.columns)
        if (isInCsv(column)) text += "," + quoteCsv(column.name);
    text += "\n";
    store.forEach([&](const SweepRow& row) {
        text += std::to_string(row.run) + "," + quoteCsv(row.caseName);
        for (std::size_t i = 0; i < row.values.size(); ++i)
            if (isInCsv(plan.columns[i])) text += "," + quoteCsv(toText(row.values[i]));
        text += "\n";
    });
    replaceFile(store.folder() / "sweep.csv", text);
}

std::string formatSweepSummary(const SweepStore& store) {
    const SweepPlan& plan = store.plan();
    const std::size_t status = findColumn(plan, "status"), message = findColumn(plan, "message"),
                      replay = findColumn(plan, "replay");
    // Per case: how many ended how, and the figures of each result.
    std::map<std::string, std::map<std::string, std::int64_t>> counts;
    std::map<std::string, std::map<std::size_t, Figures>> figures;
    std::string troubles;
    std::int64_t troubled = 0;
    store.forEach([&](const SweepRow& row) {
        const std::string how = toText(row.values[status]);
        ++counts[row.caseName][how];
        for (std::size_t i = 0; i < plan.columns.size(); ++i) {
            if (plan.columns[i].kind != SweepColumn::Kind::Result) continue;
            if (const auto* number = std::get_if<double>(&row.values[i]))
                figures[row.caseName][i].emplace_back(*number, row.run);
            else if (const auto* whole = std::get_if<std::int64_t>(&row.values[i]))
                figures[row.caseName][i].emplace_back(static_cast<double>(*whole), row.run);
        }
        if (how == getName(SweepStatus::Ok) || ++troubled > kListed) return;
        const std::string said = toText(row.values[message]);
        troubles += makePrintable("run " + std::to_string(row.run) + ", case " + row.caseName + ": " + how +
                                  (said.empty() ? "" : ": " + said)) +
                    "\n    " + makePrintable(toText(row.values[replay])) + "\n";
    });
    std::string text;
    for (const std::string& name : plan.cases) {
        text += makePrintable(name) + ":";
        bool isFirst = true;
        for (const auto& [how, count] : counts[name]) {
            text += (isFirst ? " " : ", ") + std::to_string(count) + " " + makePrintable(how);
            isFirst = false;
        }
        text += isFirst ? " no run\n" : "\n";
        text += format("  %-38s %12s %12s %12s   %s\n", "", "min", "median", "max", "of run");
        for (auto& [column, values] : figures[name]) {
            // Of equal ones the first run: the same text whatever the order they ended in.
            const auto worst = std::max_element(values.begin(), values.end(), [](const auto& a, const auto& b) {
                return a.first != b.first ? a.first < b.first : a.second > b.second;
            });
            const auto [max, run] = *worst;
            std::sort(values.begin(), values.end());
            const std::size_t half = values.size() / 2;
            const double median =
                values.size() % 2 == 1 ? values[half].first : 0.5 * (values[half - 1].first + values[half].first);
            text += format("  %-38.80s %12.4g %12.4g %12.4g   %lld\n", makePrintable(plan.columns[column].name),
                           values.front().first, median, max, run);
        }
    }
    if (troubled > 0)
        text += std::to_string(troubled) + " not ok" +
                (troubled > kListed ? ", the first " + std::to_string(kListed) : std::string()) + ":\n" + troubles;
    return text;
}

int findSweepExitCode(const SweepStore& store) {
    const std::size_t code = findColumn(store.plan(), "exit_code");
    int gravest = 0;
    store.forEach([&](const SweepRow& row) {
        const auto* own = std::get_if<std::int64_t>(&row.values[code]);
        if (own && isGraver(static_cast<int>(*own), gravest)) gravest = static_cast<int>(*own);
    });
    return gravest;
}

}  // namespace viable
