#pragma once

#include "host/IsolatedPlugin.h"
#include "simulation/CommandStream.h"

namespace viable {

/** By PluginKind: who is called, for messages; null: nobody watches. */
using PluginWatches = std::array<PluginWatch*, kPluginKinds.size()>;

/** The plugins of a loop, configured. Robust loop and real plant may be null, both or none. */
struct LoopPlugins {
    PluginPtr<CommandSource> command{nullptr, nullptr};
    std::unique_ptr<CommandStream> stream;  ///< that the command comes over to the controller; null: none
    PluginPtr<NominalController> controller{nullptr, nullptr};
    PluginPtr<SafetyFilter> filter{nullptr, nullptr};
    PluginPtr<RobustLoop> robustLoop{nullptr, nullptr};
    PluginPtr<RealPlant> realPlant{nullptr, nullptr};
    /** Must outlive the loop. A chain of filters watches its own. */
    PluginWatches watches{};
};

/** Destroys them one by one, each under its watch. */
void destroyPlugins(LoopPlugins& plugins) noexcept;

}  // namespace viable
