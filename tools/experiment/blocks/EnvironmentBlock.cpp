#include "experiment/CaseBlocks.h"

#include "core/Sha256.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

Environment readEnvironmentBlock(const ConfigNode& block) {
    Environment environment = readEnvironment(block);
    if (environment.map && environment.map->sha256.empty()) environment.map->sha256 = calcSha256(environment.map->file);
    return environment;
}

ConfigNode resolveEnvironment(ConfigNode block, const Environment& environment) {
    const auto fill = [&](const char* key, double value) {
        if (!block.find(key)) block.entries.emplace_back(key, makeNumber(value));
    };
    fill("safety_distance_m", environment.safetyDistance_m);
    fill("field_cell_m", environment.fieldCell_m);
    ConfigNode* const map = environment.map ? block.find("map") : nullptr;
    if (!map) return block;
    const std::filesystem::path& file = environment.map->file;
    const ConfigNode path = makeScalar(
        (std::filesystem::canonical(std::filesystem::absolute(file).parent_path()) / file.filename()).string(), true);
    const ConfigNode sha256 = makeScalar(environment.map->sha256, true);
    for (const auto& [key, value] : {std::pair("file", path), std::pair("sha256", sha256)})
        if (ConfigNode* const known = map->find(key))
            *known = value;
        else
            map->entries.emplace_back(key, value);
    return block;
}

}  // namespace viable::detail
