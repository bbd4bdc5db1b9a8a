#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "report/RunReport.h"
#include "report/SweepReport.h"

namespace viable {

void addReportCommand(CLI::App& app, int&) {
    auto folder = std::make_shared<std::string>();
    auto isFull = std::make_shared<bool>(false);
    CLI::App* command =
        app.add_subcommand("report", "Write the report of a run or a sweep again: one HTML file that opens from disk");
    command->add_option("DIR", *folder, "Folder of a run, with its logs, or of a sweep")->required();
    command->add_flag("--full", *isFull, "Of a run: eight times the points, so that single ticks show when enlarged");
    command->callback([folder, isFull] {
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        const std::filesystem::path directory = *folder;
        const bool isSweep = std::filesystem::exists(directory / kSweepStore);
        for (const std::filesystem::path& file : isSweep
                                                     ? std::vector{writeSweepReport(directory, findShared(kSweepPage))}
                                                     : writeReport(directory, findShared(kReportPage), *isFull))
            std::printf("wrote %s\n", file.c_str());
    });
}

}  // namespace viable
