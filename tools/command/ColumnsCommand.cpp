#include <CLI/CLI.hpp>
#include <array>
#include <memory>
#include <nlohmann/json.hpp>

#include "Commands.h"
#include "analysis/records/MotionRecord.h"
#include "core/Text.h"

namespace viable {

namespace {

struct ColumnsArguments {
    std::string file;
    MotionRecordOptions options;
    bool isJson = false;
};

void printColumns(const ColumnTable& table, bool isJson) {
    nlohmann::json columns = nlohmann::json::array();
    std::vector<std::array<std::string, 4>> lines = {{"column", "unit", "shape", "meaning"}};
    std::array<std::size_t, 4> widths{};
    for (const ColumnTable::Row& row : table.columns) {
        columns.push_back({{"column", row.name},
                           {"unit", row.unit},
                           {"type", row.form},
                           {"shape", {table.rows, row.count}},
                           {"meaning", row.meaning}});
        lines.push_back({makePrintable(row.name), row.unit.empty() ? "-" : row.unit,
                         std::to_string(table.rows) + " x " + std::to_string(row.count), makePrintable(row.meaning)});
    }
    if (isJson) {
        std::printf("%s\n", columns.dump(1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
        return;
    }
    for (const auto& line : lines)
        for (std::size_t i = 0; i < 3; ++i) widths[i] = std::max(widths[i], line[i].size() + 2);
    const std::size_t begin = widths[0] + widths[1] + widths[2];
    for (const auto& line : lines) {
        for (std::size_t i = 0; i < 3; ++i) std::printf("%-*s", static_cast<int>(widths[i]), line[i].c_str());
        std::printf("%s\n", detail::wrap(line[3], begin, begin).c_str());
    }
}

}  // namespace

void addColumnsCommand(CLI::App& app, int&) {
    auto arguments = std::make_shared<ColumnsArguments>();
    CLI::App* command = app.add_subcommand("columns", "What is in a log: its columns with unit, shape and meaning");
    command->add_option("LOG", arguments->file, "Log of a case (.mcap), joint states (.mcap) or CSV")->required();
    command->add_option("--columns", arguments->options.columns,
                        "NAME:UNIT,...: columns of the CSV to use, with their units");
    command->add_option("--topic", arguments->options.topic, "Topic of the joint states, where the file has several");
    command->add_flag("--json", arguments->isJson, "For programs");
    command->callback(
        [arguments] { printColumns(describeColumns(arguments->file, arguments->options), arguments->isJson); });
}

}  // namespace viable
