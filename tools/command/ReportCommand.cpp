#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "report/RunReport.h"
#include "report/SweepReport.h"

namespace viable {

namespace {

std::filesystem::path findPage(const char* name) {
    std::error_code error;
    const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
    return program.parent_path() / ".." / "share" / "viable" / name;
}

}  // namespace

std::filesystem::path findReportPage() {
    return findPage("report_template.html");
}

std::filesystem::path findSweepPage() {
    return findPage("sweep_template.html");
}

std::filesystem::path findLivePage() {
    return findPage("live.html");
}

void addReportCommand(CLI::App& app, int& exitCode) {
    auto folder = std::make_shared<std::string>();
    CLI::App* command =
        app.add_subcommand("report", "Write the report of a run or a sweep again: one HTML file that opens from disk");
    command->add_option("DIR", *folder, "Folder of a run, with its logs, or of a sweep")->required();
    command->callback([folder, &exitCode] {
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        const std::filesystem::path directory = *folder;
        const bool isSweep = std::filesystem::exists(directory / kSweepStore);
        for (const std::filesystem::path& file : isSweep ? std::vector{writeSweepReport(directory, findSweepPage())}
                                                         : writeReport(directory, findReportPage()))
            std::printf("wrote %s\n", file.c_str());
        exitCode = 0;
    });
}

}  // namespace viable
