#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "log/LogExport.h"
#include "log/LogReader.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

struct ExportArguments {
    std::string log;
    std::vector<std::string> target;  // format, file
};

}  // namespace

void addExportCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<ExportArguments>();
    CLI::App* command = app.add_subcommand("export", "Write a log in another format");
    command->add_option("LOG", arguments->log, "Log of a case (.mcap)")->required();
    command->add_option("--to", arguments->target, "Format and file: csv FILE, or hdf5 FILE")->required()->expected(2);
    command->callback([arguments, &exitCode] {
        const std::string& format = arguments->target[0];
        if (format != "csv" && format != "hdf5")
            throw badInput("--to", "'" + format + "' is not a format that viable writes",
                           "Use `--to csv FILE` or `--to hdf5 FILE`.");
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        if (!LogReader(arguments->log).isComplete())
            std::fprintf(stderr,
                         "viable: %s has no end (the run was killed or is still running): "
                         "every complete block of it is exported\n",
                         arguments->log.c_str());
        if (format == "csv")
            exportCsv(arguments->log, arguments->target[1]);
        else
            exportHdf5(arguments->log, arguments->target[1]);
        std::printf("wrote %s\n", arguments->target[1].c_str());
        exitCode = 0;
    });
}

}  // namespace viable
