#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>

#include "Commands.h"
#include "records/LogExport.h"
#include "records/LogReader.h"

namespace viable {

void addRecoverCommand(CLI::App& app, int&) {
    struct Arguments {
        std::string log, out;
    };
    auto arguments = std::make_shared<Arguments>();
    CLI::App* command = app.add_subcommand("recover", "Complete a log that was cut off (the run was killed)");
    command->add_option("LOG", arguments->log, "Log of a case (.mcap)")->required();
    command->add_option("--out", arguments->out, "New log (default: LOG with .recovered.mcap)");
    command->callback([arguments] {
        std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
        LogReader reader(arguments->log);
        const bool isWhole = reader.isComplete();
        if (isWhole && arguments->out.empty()) {
            for (TickRecord record; reader.read(record);) {  // refuses what is damaged
            }
            std::printf("%s is complete: nothing to recover\n", arguments->log.c_str());
            return;
        }
        std::filesystem::path out = arguments->out;
        if (out.empty()) out = std::filesystem::path(arguments->log).replace_extension(".recovered.mcap");
        const std::uint64_t rows = recoverLog(arguments->log, out);
        std::printf("wrote %s: %llu rows%s\n", out.c_str(), static_cast<unsigned long long>(rows),
                    isWhole ? "; the old log was complete" : "");
    });
}

}  // namespace viable
