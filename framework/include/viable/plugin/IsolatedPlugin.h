#pragma once

#include <functional>
#include <stdexcept>

#include "viable/plugin/PluginLoader.h"

namespace viable {

/** What the host found out about a plugin, as the end of a sentence about it: its process crashed, ended itself, or was
ended because it hung. */
class PluginFault : public std::runtime_error {
public:
    /** @param remedy  a literal: what the plugin's author can do */
    PluginFault(const std::string& what, const char* remedy)
        : std::runtime_error(what), remedy_(remedy) {}
    const char* remedy() const { return remedy_; }

private:
    const char* remedy_;
};

/** How long an isolated plugin may take for one call unless told otherwise. */
inline constexpr double kDefaultWatchdog_s = 5.0;

/** Makes and configures a plugin in a process of its own, and returns a stand-in that passes every call on to it and
waits for the answer, through shared memory.

Guarantees: whatever the plugin does there (crash, exit, hang, writing over foreign memory), this process goes on; a call
that the plugin does not answer becomes a PluginFault, as does every later one. A call that takes longer than the watchdog
ends the process.
`make` runs in the new process; what it throws is thrown here, an Error as an Error of its kind. What the plugin does to
this process's own objects there stays there.
Costs: two switches between processes per call. Not for a real-time loop.
Thread: call this while the program has one thread; then one caller at a time. The process ends with the stand-in, and at
the latest with the thread that called this. */
template <class Interface>
PluginPtr<Interface> isolatePlugin(const std::function<PluginPtr<Interface>()>& make,
                                   double watchdog_s = kDefaultWatchdog_s);

extern template PluginPtr<CommandSource> isolatePlugin(
    const std::function<PluginPtr<CommandSource>()>&, double);
extern template PluginPtr<NominalController> isolatePlugin(
    const std::function<PluginPtr<NominalController>()>&, double);
extern template PluginPtr<SafetyFilter> isolatePlugin(
    const std::function<PluginPtr<SafetyFilter>()>&, double);
extern template PluginPtr<RobustLoop> isolatePlugin(const std::function<PluginPtr<RobustLoop>()>&,
                                                    double);
extern template PluginPtr<RealPlant> isolatePlugin(const std::function<PluginPtr<RealPlant>()>&,
                                                   double);

}  // namespace viable
