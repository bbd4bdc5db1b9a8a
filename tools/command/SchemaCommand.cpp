#include <CLI/CLI.hpp>

#include "Commands.h"
#include "experiment/ExperimentSchema.h"

namespace viable {

void addSchemaCommand(CLI::App& app, int&) {
    CLI::App* command =
        app.add_subcommand("schema", "Print the JSON Schema of experiment files, for editors, with the plugins found");
    command->callback([] {
        const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
        std::vector<RefusedLibrary> refused;
        const std::string schema = makeExperimentSchema(loader.list(refused));
        for (const RefusedLibrary& r : refused)
            std::fprintf(stderr, "viable: refused %s: %s\n", r.library.c_str(), r.reason.c_str());
        std::fputs(schema.c_str(), stdout);
    });
}

}  // namespace viable
