#include <CLI/CLI.hpp>

#include "Commands.h"
#include "host/PluginDescription.h"

namespace viable {

namespace {

struct PluginsOptions {
    std::string name;  ///< empty: all
    bool json = false, markdown = false;
};

void listPlugins(const PluginLoader& loader, const std::vector<PluginInfo>& plugins,
                 const std::vector<RefusedLibrary>& refused, bool json) {
    if (json)
        std::fputs(describePluginsAsJson(plugins, refused, false).c_str(), stdout);
    else
        for (const PluginInfo& p : plugins)
            std::printf("%-12s %-24s %s\n", getName(p.kind), p.name.c_str(), p.summary.c_str());
    for (const RefusedLibrary& r : refused)
        std::fprintf(stderr, "viable: refused %s: %s\n", r.library.c_str(), r.reason.c_str());
    if (!plugins.empty()) return;
    std::string tried;
    for (const auto& folder : loader.searchPath()) tried += "\n  " + folder.string();
    throw badInput("", "no plugin was found; these folders were searched:" + tried,
                   "Build the project or set VIABLE_PLUGIN_PATH.");
}

void describeAsText(const PluginInfo& p) {
    std::printf("%s %s: %s\nlibrary: %s\n", getName(p.kind), p.name.c_str(), p.summary.c_str(), p.library.c_str());
    if (p.kind == PluginKind::SafetyFilter)
        std::printf("guarantees: %s\n", PluginLoader::create<SafetyFilter>(p)->traits().guarantees.hasJoints()
                                            ? "all limits, in every tick"
                                            : "nothing");
    std::printf("parameters:\n%s", describeParameters(p.entry->parameters, p.entry->parameterCount).c_str());
}

/** All plugins of that name: two kinds may share one. */
std::vector<PluginInfo> findByName(const std::vector<PluginInfo>& plugins, const std::vector<RefusedLibrary>& refused,
                                   const std::string& name) {
    std::vector<PluginInfo> found;
    std::vector<std::string> names;
    for (const PluginInfo& p : plugins) {
        names.push_back(p.name);
        if (p.name == name) found.push_back(p);
    }
    if (!found.empty()) return found;
    for (const RefusedLibrary& r : refused)
        if (r.library.stem().string().find("_" + name) != std::string::npos)
            throw badInput(r.library.string(), r.reason);
    const std::string closest = findClosestName(name, names);
    throw badInput(
        "--describe", "there is no plugin '" + name + "'",
        (closest.empty() ? "" : "Did you mean '" + closest + "'? ") + std::string("`viable plugins` lists them all."));
}

void runPlugins(const PluginsOptions& options) {
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    std::vector<RefusedLibrary> refused;
    const std::vector<PluginInfo> plugins = loader.list(refused);
    if (options.name.empty()) return listPlugins(loader, plugins, refused, options.json);

    const std::vector<PluginInfo> found = findByName(plugins, refused, options.name);
    if (options.json) {
        std::fputs(describePluginsAsJson(found, {}, true).c_str(), stdout);
        return;
    }
    for (const PluginInfo& p : found) {
        if (!options.markdown) {
            describeAsText(p);
            continue;
        }
        if (found.size() > 1) std::printf("**%s**\n\n", getName(p.kind));
        std::printf("%s%s", describeParametersAsMarkdown(p.entry->parameters, p.entry->parameterCount).c_str(),
                    &p == &found.back() ? "" : "\n");
    }
}

}  // namespace

void addPluginsCommand(CLI::App& app, int&) {
    auto options = std::make_shared<PluginsOptions>();
    CLI::App* command = app.add_subcommand("plugins", "List the plugins, or describe one");
    CLI::Option* name = command->add_option("--describe", options->name, "Name of a plugin: print its parameters");
    CLI::Option* json =
        command->add_flag("--json", options->json, "Print JSON: all plugins with their parameters, or those described");
    command->add_flag("--markdown", options->markdown, "Print the parameters as a table in Markdown")
        ->needs(name)
        ->excludes(json);
    command->callback([options] { runPlugins(*options); });
}

}  // namespace viable
