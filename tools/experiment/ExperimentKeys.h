#pragma once

#include <string>
#include <vector>

#include "viable/plugin/Parameters.h"
#include "viable/plugin/PluginExport.h"

namespace viable::detail {

/** More filters in a row than anyone needs. */
inline constexpr std::size_t kMaxFilters = 16;

/** In a block of a robust loop, whatever its plugin. */
constexpr ParameterSpec makeAcceptUnstable() {
    return parameter::flag(
        "accept_unstable", "false",
        "A loop that is unstable on this arm is run all the same, and an arm that does not follow is "
        "not stopped: to show what happens.");
}

/** What stands at a key of an experiment file. */
enum class KeyForm {
    Value,      ///< as `spec` says
    Cases,      ///< a map of names to blocks with the keys that differ
    Block,      ///< a block with the keys of `keys`
    Blocks,     ///< a list of such blocks
    Named,      ///< a map of names to such blocks
    Bounds,     ///< a joint quantity for both sides, or `{lower, upper}`
    Positions,  ///< the same, or `{center, half_range}`
    Plugin,     ///< `{plugin: NAME, parameters}`
    Plugins,    ///< the same, or a list of up to kMaxFilters such blocks or names, the first one first
};

/** One key of an experiment file, declared once: the reader takes the names and the ranges from here, the JSON Schema
everything. A required one (without default) must stand at the top or in every case. */
struct ExperimentKey {
    ParameterSpec spec;  ///< an empty default: none, and not required; the type counts for Value only
    KeyForm form = KeyForm::Value;
    PluginKind kind = PluginKind::CommandSource;  ///< of Plugin and Plugins
    bool isTopOnly = false;                       ///< must not stand in a case
    /** Of Block, Blocks and Named: what stands in a block. */
    const std::vector<ExperimentKey>& (*keys)() = nullptr;
};

const std::vector<ExperimentKey>& experimentKeys();
const std::vector<ExperimentKey>& limitKeys();       ///< what readLimits() knows, and hold_on
const std::vector<ExperimentKey>& speedLimitKeys();  ///< what readSpeedLimits() knows
const std::vector<ExperimentKey>& startKeys();
const std::vector<ExperimentKey>& gapKeys();
const std::vector<ExperimentKey>& disturbanceKeys();
const std::vector<ExperimentKey>& payloadKeys();
const std::vector<ExperimentKey>& streamKeys();
const std::vector<ExperimentKey>& environmentKeys();  ///< what readEnvironment() knows

std::vector<std::string> listNames(const std::vector<ExperimentKey>& keys);
/** The key called `name`; it must be there. */
const ParameterSpec& getKey(const std::vector<ExperimentKey>& keys, const std::string& name);

}  // namespace viable::detail
