#include "experiment/CaseBlocks.h"

#include <algorithm>

#include "core/ErrorList.h"
#include "experiment/ResolvedNodes.h"
#include "host/PythonClass.h"

namespace viable::detail {

/** What the file says, as it is written, and `plugin` as given: which parameters a class in Python takes, it tells when it is
made. Values are scalars, lists of numbers, and lists of such lists. */
static Parameters readPythonParameters(ConfigNode block, const std::string& plugin, int joints) {
    std::vector<std::string> names;
    for (const auto& entry : block.entries) names.push_back(entry.first);
    std::vector<ParameterSpec> specs;
    for (std::size_t i = 0; i < names.size(); ++i) {
        ConfigNode& value = block.entries[i].second;
        const char* const name = names[i].c_str();
        if (names[i] == "plugin") {
            value.text = plugin;
            value.quoted = true;
        } else if (value.kind != ConfigNode::Kind::List) {
            if (value.kind == ConfigNode::Kind::Scalar) refuseBlank(value);
            specs.push_back({name, "", ParameterType::Text, nullptr, ""});
        } else {
            const bool hasRows = !value.items.empty() && value.items.front().kind == ConfigNode::Kind::List;
            const ParameterType type = hasRows ? ParameterType::Rows : ParameterType::Numbers;
            specs.push_back(ParameterSpec{name, "", type, nullptr, ""}.count(0, kMaxConfigNodes).orInfinite());
        }
    }
    return readParameters(block, specs.data(), specs.size(), joints);
}

PluginChoice readPlugin(const ConfigNode& block, PluginKind kind, const PluginLoader& loader, int joints) {
    if (block.kind != ConfigNode::Kind::Map || !block.find("plugin")) {
        std::vector<std::string> keys;
        for (const auto& entry : block.entries) keys.push_back(entry.first);
        const std::string closest = findClosestName("plugin", keys);
        throw badInput(block.place(), "the block must name a plugin",
                       (closest.empty() ? "" : "Did you mean `plugin` by `" + closest + "`? ") + "Write `{plugin: " +
                           (block.kind == ConfigNode::Kind::Scalar ? block.text : std::string("NAME")) +
                           ", ...parameters}`; `viable plugins` lists the names.");
    }
    const ConfigNode& name = *block.find("plugin");
    const PluginInfo info =
        loader.find(kind, toText(name), name.place(), std::filesystem::path(name.file).parent_path());
    PluginChoice choice{info, {}};
    if (isPython(info)) {
        choice.parameters = readPythonParameters(block, info.library.string() + ":" + info.name, joints);
        return choice;
    }
    // The host's own keys, for any loop that tells its law.
    std::vector<ParameterSpec> specs(info.entry->parameters, info.entry->parameters + info.entry->parameterCount);
    const std::vector<ParameterSpec>& ofHost = settingsOf<RobustLoopSettings>();
    const bool isDeclared = std::any_of(specs.begin(), specs.end(), [&](const ParameterSpec& spec) {
        return spec.name && std::any_of(ofHost.begin(), ofHost.end(),
                                        [&](const ParameterSpec& own) { return std::string(spec.name) == own.name; });
    });
    const bool takesHosts = kind == PluginKind::RobustLoop && !isDeclared;
    if (takesHosts) specs.insert(specs.end(), ofHost.begin(), ofHost.end());
    choice.parameters = readParameters(block, specs.data(), specs.size(), joints);
    if (takesHosts) choice.host = choice.parameters.get<RobustLoopSettings>();
    return choice;
}

std::vector<PluginChoice> readFilters(const ConfigNode& node, const PluginLoader& loader, int joints) {
    std::vector<PluginChoice> filters;
    if (node.kind != ConfigNode::Kind::List) {
        filters.push_back(readPlugin(node, PluginKind::SafetyFilter, loader, joints));
        return filters;
    }
    if (node.items.empty() || node.items.size() > kMaxFilters)
        throw badInput(node.place(),
                       "a list of filters must have 1 to " + std::to_string(kMaxFilters) + " entries, this one has " +
                           std::to_string(node.items.size()),
                       "Write for example `filter: [{plugin: tosbp}, certified_braking]`.");
    ErrorList errors;
    for (const ConfigNode& item : node.items) {
        ConfigNode block = item;
        if (item.kind == ConfigNode::Kind::Scalar) {
            block = makeMap({{"plugin", item}});
            block.file = item.file;
            block.line = item.line;
            block.column = item.column;
            block.keyPath = item.keyPath;
        }
        errors.collect([&] { filters.push_back(readPlugin(block, PluginKind::SafetyFilter, loader, joints)); });
    }
    errors.throwIfAny(node.place());
    return filters;
}

ConfigNode resolvePlugin(const PluginChoice& choice) {
    ConfigNode block = choice.parameters.resolved();
    if (isPython(choice.plugin)) return block;
    ConfigNode* name = block.find("plugin");
    if (name->text.find('/') != std::string::npos) {  // named by its path
        name->text = choice.plugin.library.string();
        name->quoted = true;
    }
    return block;
}

ConfigNode resolveFilters(const std::vector<PluginChoice>& filters) {
    if (filters.size() == 1) return resolvePlugin(filters.front());
    ConfigNode list;
    list.kind = ConfigNode::Kind::List;
    for (const PluginChoice& filter : filters) list.items.push_back(resolvePlugin(filter));
    return list;
}

}  // namespace viable::detail
