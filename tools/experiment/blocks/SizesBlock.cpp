#include "experiment/CaseBlocks.h"

#include "config/ConfigText.h"
#include "config/ParameterText.h"
#include "core/ErrorList.h"
#include "core/Text.h"

namespace viable::detail {

namespace {

/** Reads a block of sizes. @param example  what to write */
template <class Settings>
Parameters readSizes(const ConfigNode& block, const char* name, const char* example, int joints) {
    if (const ConfigNode* plugin = block.find("plugin"))
        throw badInput(plugin->place(), std::string(name) + " is no plugin",
                       std::string("Write sizes: `") + name + ": " + example + "`.");
    ConfigMap known(block);  // readParameters() would offer `plugin`, too
    const std::vector<ParameterSpec>& specs = settingsOf<Settings>();
    for (const ParameterSpec& spec : specs) known.find(spec.name);
    known.finish();
    return readParameters(block, specs.data(), specs.size(), joints);
}

}  // namespace

Parameters readDisturbances(const ConfigNode& block, int joints) {
    return readSizes<DisturbanceSet>(block, "disturbance_set", "{friction_scale: 2, payload_kg: 3}", joints);
}

Parameters readStream(const ConfigNode& block, double tick_s) {
    Parameters stream = readSizes<StreamOptions>(block, "stream", "{rate_hz: 30, jitter: 0.3}", 0);
    const auto options = stream.get<StreamOptions>();
    const double rate = options.rate_hz;
    if (rate * tick_s > 1.0)
        throw badInput(
            stream.place("rate_hz"),
            "rate_hz is " + formatNumber(rate) + ", more than one sample a tick of " + formatNumber(tick_s) + " s",
            "Allowed is up to " + formatNumber(1.0 / tick_s) + "; without `stream` every tick has its command.");
    const double gap = options.gap_s, every = options.gapEvery_s;
    if (!(gap < every))
        throw badInput(stream.place("gap_s"),
                       "a gap of " + formatNumber(gap) + " s has no place in every " + formatNumber(every) + " s",
                       "Make gap_s shorter than gap_every_s.");
    return stream;
}

}  // namespace viable::detail
