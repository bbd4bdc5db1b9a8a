#include "experiment/ExperimentFile.h"

#include <algorithm>

#include "config/Draws.h"
#include "core/ErrorList.h"
#include "core/Text.h"
#include "experiment/CaseReader.h"
#include "experiment/ExperimentKeys.h"
#include "experiment/ResolvedNodes.h"

namespace viable {

namespace {

bool isCaseKey(const std::string& name) {
    for (const detail::ExperimentKey& key : detail::experimentKeys())
        if (name == key.spec.name) return !key.isTopOnly;
    return false;
}

/** Case names become file names. */
void checkCaseName(const std::string& name, const ConfigNode& node) {
    const bool plain = !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) || c == '_' || c == '-' || c == '+';
    });
    if (!plain)
        throw badInput(node.place(), "'" + name + "' cannot be the name of a case",
                       "Use 1 to 64 letters, digits, '_', '-' or '+': the name becomes a file name.");
}

/** Refuses what no case would ever see: a key at the top that every case replaces. */
void checkUse(const ConfigNode& shared, const ConfigNode& cases, detail::ErrorList& errors) {
    for (const auto& [key, node] : shared.entries) {
        if (!isCaseKey(key)) continue;
        bool used = false;
        for (const auto& [name, own] : cases.entries) {
            const ConfigNode* replacement = own.find(key);
            const ConfigNode* mine = node.find("plugin");
            const ConfigNode* theirs = replacement ? replacement->find("plugin") : nullptr;
            used |= !replacement || (node.kind == ConfigNode::Kind::Map && replacement->kind == ConfigNode::Kind::Map &&
                                     (!mine || !theirs || mine->text == theirs->text));
        }
        if (!used)
            errors.add(node.place(), "no case uses this: every case has a `" + key + "` of its own",
                       "Remove it, or set it in the case: `cases." + cases.entries.front().first + "." + key + "`.");
    }
}

/** The keys that all cases need and none has, nor the top: no single case is to blame. */
std::vector<std::string> listLacking(const ConfigNode& root) {
    std::vector<std::string> lacking;
    const auto& cases = root.find("cases")->entries;
    for (const detail::ExperimentKey& key : detail::experimentKeys())
        if (!key.spec.defaultText && !root.find(key.spec.name) &&
            std::none_of(cases.begin(), cases.end(), [&](const auto& one) { return one.second.find(key.spec.name); }))
            lacking.emplace_back(key.spec.name);
    return lacking;
}

/** What a case changes. */
ConfigNode readChanges(const ConfigNode& node) {
    ConfigNode own = node;
    if (own.kind == ConfigNode::Kind::Empty) own.kind = ConfigNode::Kind::Map;
    if (own.kind != ConfigNode::Kind::Map)
        throw badInput(node.place(), "a case must be a map of the keys that it changes");
    for (const detail::ExperimentKey& key : detail::experimentKeys())
        if (const ConfigNode* misplaced = key.isTopOnly ? own.find(key.spec.name) : nullptr)
            throw badInput(misplaced->place(),
                           "'" + std::string(key.spec.name) + "' belongs to the top of the file, not to a case");
    return own;
}

/** An override may change a case, not invent one. */
void checkCaseIsInFile(const std::string& name, const ConfigNode& node, const ConfigNode& cases) {
    if (node.kind != ConfigNode::Kind::Map || node.file == cases.file) return;
    std::vector<std::string> names;
    for (const auto& [other, itsNode] : cases.entries)
        if (itsNode.file == cases.file) names.push_back(other);
    const std::string closest = findClosestName(name, names);
    throw badInput(
        node.place(), "there is no case '" + name + "'",
        (closest.empty() ? "" : "Did you mean '" + closest + "'? ") + "The file's cases: " + detail::join(names) + ".");
}

}  // namespace

std::vector<const PluginChoice*> CasePlan::plugins() const {
    std::vector<const PluginChoice*> all{&command, &controller};
    for (const PluginChoice& filter : filters) all.push_back(&filter);
    if (robustLoop) all.push_back(&*robustLoop);
    if (realPlant) all.push_back(&*realPlant);
    return all;
}

std::string CasePlan::filterName() const {
    std::string text;
    for (const PluginChoice& filter : filters) detail::addItem(text, filter.plugin.name, " + ");
    return text;
}

ConfigNode readExperimentTree(const std::filesystem::path& file, const std::vector<std::string>& overrides) {
    ConfigNode root = readConfigFile(file);
    for (const std::string& assignment : overrides) applyOverride(root, assignment);
    return root;
}

Experiment readExperiment(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                          const PluginLoader& loader, const std::vector<std::filesystem::path>& robotPath) {
    return readExperiment(readExperimentTree(file, overrides), file, overrides, loader, robotPath);
}

Experiment readExperiment(const ConfigNode& root, const std::filesystem::path& file,
                          const std::vector<std::string>& overrides, const PluginLoader& loader,
                          const std::vector<std::filesystem::path>& robotPath) {
    const std::vector<DrawnKey> draws = listDraws(root);
    if (!draws.empty())
        throw badInput(
            draws.front().place, "`~" + draws.front().distribution + "` is drawn anew for every run of a sweep",
            "`viable sweep " + file.string() + "` runs them; `--draw SEED:INDEX` takes the values of one of its runs");

    Experiment experiment;
    experiment.file = file;
    {
        ConfigMap top(root);
        const std::int64_t schema = toInteger(top.require("schema"), 0, 1000000);
        if (schema != 1)
            throw badInput(root.find("schema")->place(),
                           "schema is " + std::to_string(schema) + ", this program reads 1",
                           "Use the version of viable that the file was written for.");
        experiment.title = toText(top.require("title"));
        const ConfigNode& cases = top.require("cases");
        if (cases.kind != ConfigNode::Kind::Map || cases.entries.empty())
            throw badInput(cases.place(), "cases must be a map with at least one case",
                           "Write for example `cases: {mine: {filter: {plugin: tosbp}}}`.");
    }
    const ConfigNode shared = detail::dropEntry(root, "cases");
    const std::vector<std::string> lacking = listLacking(root);
    detail::ErrorList errors;
    checkUse(shared, *root.find("cases"), errors);
    for (const auto& entry : root.find("cases")->entries) {
        if (errors.isFull()) break;  // each reads its robot
        errors.collect([&, &name = entry.first, &node = entry.second] {
            checkCaseName(name, node);
            checkCaseIsInFile(name, node, *root.find("cases"));
            const ConfigNode merged = overlay(shared, readChanges(node));
            experiment.cases.push_back(
                detail::readCase(merged, name, experiment.title, loader, robotPath, overrides, lacking));
        });
    }
    errors.throwIfAny(file.string());
    std::set<std::string> libraries;
    for (const CasePlan& plan : experiment.cases)
        for (const PluginChoice* choice : plan.plugins()) libraries.insert(choice->plugin.library);
    for (CasePlan& plan : experiment.cases) plan.libraries = libraries;
    return experiment;
}

}  // namespace viable
