
#include "core/Sha256.h"
#include "core/WholeFile.h"
#include "sweep/SweepStore.h"

namespace viable {

namespace fs = std::filesystem;

/** A named piece; the lengths keep the borders. */
static void addPiece(detail::Sha256& hash, const std::string& name, const std::string& content) {
    for (const std::string* text : {&name, &content}) {
        hash.add(std::to_string(text->size()) + ":");
        hash.add(*text);
    }
}

static std::string readFile(const fs::path& file) {
    if (std::optional<std::string> text = readWhole(file)) return *std::move(text);
    throw badInput(file.string(), "cannot be read", "Check its permissions.");
}

SweepFiles findSweepFiles(const Experiment& experiment) {
    SweepFiles files;
    for (const CasePlan& plan : experiment.cases) {
        for (const fs::directory_entry& entry : fs::directory_iterator(plan.robot.folder)) {
            const std::string kind = entry.path().extension().string();
            if (kind == ".urdf" || kind == ".yaml") files.data.insert(entry.path());
        }
        if (plan.environment && plan.environment->map) files.data.insert(plan.environment->map->file);
        for (const PluginChoice* choice : plan.plugins()) {
            files.libraries.insert(choice->plugin.library);
            for (std::uint64_t i = 0; i < choice->plugin.entry->parameterCount; ++i) {
                const ParameterSpec& spec = choice->plugin.entry->parameters[i];
                if (spec.type != ParameterType::File) continue;
                const ConfigNode* file = choice->parameters.resolved().find(spec.name);
                if (file && fs::is_regular_file(file->text)) files.data.insert(file->text);
            }
        }
    }
    return files;
}

std::string calcSweepHash(const std::string& text, const std::vector<std::string>& overrides, const SweepFiles& files) {
    // By name and content: the same files may lie elsewhere on another machine.
    std::set<std::pair<std::string, std::string>> contents;
    for (const std::set<fs::path>* some : {&files.data, &files.libraries})
        for (const fs::path& file : *some) {
            const std::string name = file.filename().string();
            detail::Sha256 own;
            addPiece(own, name, readFile(file));
            contents.emplace(name, own.take());
        }
    detail::Sha256 hash;
    addPiece(hash, "viable", VIABLE_VERSION);
    addPiece(hash, "experiment", text);
    for (const std::string& assignment : overrides) addPiece(hash, "--set", assignment);
    for (const auto& [name, content] : contents) addPiece(hash, name, content);
    return hash.take();
}

}  // namespace viable
