#pragma once

#include <functional>

#include "host/PluginCall.h"

namespace viable {

/** How long an isolated plugin may take for one call unless told otherwise. */
inline constexpr double kDefaultWatchdog_s = 5.0;

/** Makes and configures a plugin in a process of its own, and returns a stand-in that passes every call on to it and
waits for the answer, through shared memory.

Guarantees: whatever the plugin does there (crash, exit, hang, writing over foreign memory), this process goes on; a call
that the plugin does not answer becomes a PluginFault, as does every later one. A call that takes longer than the watchdog
ends the process.
`make` runs in the new process; what it throws is thrown here, an Error as an Error of its kind. What the plugin does to
this process's own objects there stays there. `watch` is told what `make` wrote into its sharedChange there, what the plugin allocates in its ticks, and how it failed while it
was destroyed.
Costs: two switches between processes per call. Not for a real-time loop.
Thread: call this while the program has one thread; then one caller at a time. The process ends with the stand-in, and at
the latest with the thread that called this. */
template <class Interface>
PluginPtr<Interface> isolatePlugin(const std::function<PluginPtr<Interface>()>& make, PluginWatch& watch,
                                   double watchdog_s = kDefaultWatchdog_s);

}  // namespace viable
