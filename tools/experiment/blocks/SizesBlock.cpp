#include "experiment/CaseBlocks.h"

#include "config/ConfigText.h"
#include "core/Complaints.h"
#include "core/Text.h"
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
    Complaints complaints;
    for (const auto& [key, value] : block.entries)
        for (const ExperimentKey& known : keys)
            if (std::string(known.spec.name).compare(0, key.size() + 1, key + "_") == 0)
                complaints.add(value.place(), "the key " + quoteText(key) + " is unknown",
                               std::string("Did you mean `") + known.spec.name + "`? A key carries its unit.");
    complaints.throwIfAny(block.place());
}

Parameters readDisturbances(const ConfigNode& block, int joints) {
    return readSizes(block, "disturbance_set", "{friction_scale: 2, payload_kg: 3}", disturbanceKeys(), joints);
}

Parameters readStream(const ConfigNode& block, double tick_s) {
    Parameters stream = readSizes(block, "stream", "{rate_hz: 30, jitter: 0.3}", streamKeys(), 0);
    const double rate = stream.number("rate_hz");
    if (rate * tick_s > 1.0)
        throw badInput(
            stream.place("rate_hz"),
            "rate_hz is " + formatNumber(rate) + ", more than one sample a tick of " + formatNumber(tick_s) + " s",
            "Allowed is up to " + formatNumber(1.0 / tick_s) + "; without `stream` every tick has its command.");
    const double gap = stream.number("gap_s"), every = stream.number("gap_every_s");
    if (!(gap < every))
        throw badInput(stream.place("gap_s"),
                       "a gap of " + formatNumber(gap) + " s has no place in every " + formatNumber(every) + " s",
                       "Make gap_s shorter than gap_every_s.");
    return stream;
}

StreamOptions makeStreamOptions(const Parameters& stream) {
    StreamOptions options;
    options.rate_hz = stream.number("rate_hz");
    options.jitter = stream.number("jitter");
    options.loss = stream.number("loss");
    options.gap_s = stream.number("gap_s");
    options.gapEvery_s = stream.number("gap_every_s");
    options.seed = static_cast<std::uint64_t>(stream.integer("seed"));
    for (const auto between : {BetweenSamples::Hold, BetweenSamples::Interpolate, BetweenSamples::Extrapolate})
        if (stream.text("between") == getName(between)) options.between = between;
    return options;
}

Parameters readPayload(const ConfigNode& block, int joints) {
    return readSizes(block, "payload", "{mass_kg: 1.5, offset_m: [0, 0, 0.1]}", payloadKeys(), joints);
}

}  // namespace viable::detail
