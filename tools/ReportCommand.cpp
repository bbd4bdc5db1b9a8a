#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "viable/report/RunReport.h"

namespace viable {

std::filesystem::path findReportPage() {
    std::error_code error;
    const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
    return program.parent_path() / ".." / "share" / "viable" / "report_template.html";
}

void addReportCommand(CLI::App& app, int& exitCode) {
    auto folder = std::make_shared<std::string>();
    CLI::App* command = app.add_subcommand(
        "report", "Write the report of a run again: one HTML file that opens from disk");
    command->add_option("DIR", *folder, "Folder of a run, with its logs")->required();
    command->callback([folder, &exitCode] {
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        for (const std::filesystem::path& file : writeReport(*folder, findReportPage()))
            std::printf("wrote %s\n", file.c_str());
        exitCode = 0;
    });
}

}  // namespace viable
