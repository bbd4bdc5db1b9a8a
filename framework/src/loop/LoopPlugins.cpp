#include "loop/LoopPlugins.h"

namespace viable {

void destroyPlugins(LoopPlugins& plugins) noexcept {
    const auto destroy = [&](auto& plugin, PluginKind kind) {
        const PluginCall call(plugins.watches[static_cast<std::size_t>(kind)], kAfterLastTick);
        plugin.reset();
    };
    destroy(plugins.realPlant, PluginKind::RealPlant);
    destroy(plugins.robustLoop, PluginKind::RobustLoop);
    destroy(plugins.filter, PluginKind::SafetyFilter);
    destroy(plugins.controller, PluginKind::NominalController);
    destroy(plugins.command, PluginKind::CommandSource);
}

}  // namespace viable
