#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>

#include "Commands.h"
#include "records/LogExport.h"
#include "records/LogReader.h"

namespace viable {

void addExportCommand(CLI::App& app, int&) {
    struct Arguments {
        std::string log;
        std::vector<std::string> target;  // format, file
        bool isReplacing = false;
        std::int64_t take = 0;
    };
    auto arguments = std::make_shared<Arguments>();
    CLI::App* command = app.add_subcommand("export", "Write a log in another format");
    command->add_option("LOG", arguments->log, "Log of a case (.mcap)")->required();
    command->add_option("--to", arguments->target, "Format and file: csv FILE, hdf5 FILE, or mcap FILE")
        ->required()
        ->expected(2);
    command->add_flag("--force", arguments->isReplacing, "Replace a file that is there already");
    command
        ->add_option("--take", arguments->take,
                     "Only the rows of that take: what the operator of a live arm recorded, from 1")
        ->check(CLI::PositiveNumber);
    command->callback([arguments] {
        const std::map<std::string, decltype(&exportCsv)> formats = {
            {"csv", exportCsv}, {"hdf5", exportHdf5}, {"mcap", exportMcap}};
        const auto format = formats.find(arguments->target[0]);
        if (format == formats.end())
            throw badInput("--to", "'" + arguments->target[0] + "' is not a format that viable writes",
                           "Use `--to csv FILE`, `--to hdf5 FILE` or `--to mcap FILE`.");
        std::error_code failed;
        if (std::filesystem::equivalent(arguments->log, arguments->target[1], failed) && arguments->isReplacing)
            throw badInput("--to", "'" + arguments->target[1] + "' is the log itself", "Choose another name.");
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        if (!LogReader(arguments->log).isComplete())
            std::fprintf(stderr,
                         "viable: %s has no end (the run was killed or is still running): every complete block of it "
                         "is exported\n",
                         arguments->log.c_str());
        format->second(arguments->log, arguments->target[1], arguments->isReplacing, arguments->take);
        std::printf("wrote %s\n", arguments->target[1].c_str());
    });
}

}  // namespace viable
