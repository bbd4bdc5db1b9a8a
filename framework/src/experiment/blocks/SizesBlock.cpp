#include "experiment/CaseBlocks.h"

#include "config/ConfigText.h"
#include "plugin/ParameterText.h"
#include "viable/core/Error.h"

namespace viable::detail {

namespace {

/** Reads a block of sizes. @param example  what to write */
Parameters readSizes(const ConfigNode& block, const char* name, const char* example,
                     const std::vector<ExperimentKey>& keys, int joints) {
    if (const ConfigNode* plugin = block.find("plugin"))
        throw badInput(plugin->place(), std::string(name) + " is no plugin",
                       std::string("Write sizes: `") + name + ": " + example + "`.");
    ConfigMap known(block);  // readParameters() would offer `plugin`, too
    std::vector<ParameterSpec> specs;
    for (const ExperimentKey& key : keys) {
        known.find(key.spec.name);
        specs.push_back(key.spec);
    }
    known.finish();
    return readParameters(block, specs.data(), specs.size(), joints);
}

}  // namespace

void refuseMissingUnit(const ConfigNode& block, const std::vector<ExperimentKey>& keys) {
    for (const auto& [key, value] : block.entries)
        for (const ExperimentKey& known : keys)
            if (std::string(known.spec.name).compare(0, key.size() + 1, key + "_") == 0)
                throw badInput(value.place(), "the key " + quoteText(key) + " is unknown",
                               std::string("Did you mean `") + known.spec.name + "`? A key carries its unit.");
}

Parameters readDisturbances(const ConfigNode& block, int joints) {
    return readSizes(block, "disturbance_set", "{friction_scale: 2, payload_kg: 3}", disturbanceKeys(), joints);
}

Parameters readPayload(const ConfigNode& block, int joints) {
    return readSizes(block, "payload", "{mass_kg: 1.5, offset_m: [0, 0, 0.1]}", payloadKeys(), joints);
}

}  // namespace viable::detail
