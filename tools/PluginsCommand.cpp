#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "viable/core/Error.h"
#include "viable/plugin/PluginLoader.h"

namespace viable {

void addPluginsCommand(CLI::App& app, int& exitCode) {
    auto name = std::make_shared<std::string>();
    CLI::App* command = app.add_subcommand("plugins", "List the plugins, or describe one");
    command->add_option("--describe", *name, "Name of a plugin: print its parameters");
    command->callback([name, &exitCode] {
        const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
        std::vector<RefusedLibrary> refused;
        const std::vector<PluginInfo> plugins = loader.list(refused);
        exitCode = 0;
        if (name->empty()) {
            for (const PluginInfo& p : plugins)
                std::printf("%-12s %-24s %s\n", getName(p.kind), p.name.c_str(), p.summary.c_str());
            for (const RefusedLibrary& r : refused)
                std::fprintf(stderr, "viable: refused %s: %s\n", r.library.c_str(),
                             r.reason.c_str());
            if (plugins.empty()) {
                std::string tried;
                for (const auto& folder : loader.searchPath()) tried += "\n  " + folder.string();
                throw badInput("", "no plugin was found; these folders were searched:" + tried,
                               "Build the project or set VIABLE_PLUGIN_PATH.");
            }
            return;
        }
        bool found = false;
        std::vector<std::string> names;
        for (const PluginInfo& p : plugins) {
            names.push_back(p.name);
            if (p.name != *name) continue;
            found = true;
            std::printf("%s %s: %s\nlibrary: %s\n", getName(p.kind), p.name.c_str(),
                        p.summary.c_str(), p.library.c_str());
            if (p.kind == PluginKind::SafetyFilter)
                std::printf("promises: %s\n",
                            PluginLoader::create<SafetyFilter>(p)->promisesLimits()
                                ? "all limits, in every tick"
                                : "nothing");
            std::printf("parameters:\n%s",
                        describeParameters(p.entry->parameters, p.entry->parameterCount).c_str());
        }
        if (!found) {
            for (const RefusedLibrary& r : refused)
                if (r.library.stem().string().find("_" + *name) != std::string::npos)
                    throw badInput(r.library.string(), r.reason);
            const std::string closest = findClosestName(*name, names);
            throw badInput("--describe", "there is no plugin '" + *name + "'",
                           (closest.empty() ? "" : "Did you mean '" + closest + "'? ") +
                               std::string("`viable plugins` lists them all."));
        }
    });
}

}  // namespace viable
