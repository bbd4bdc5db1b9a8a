#pragma once

#include "host/PluginLoader.h"

namespace viable {

/** The plugin is a class in Python: its library is the .py file, its name that of the class. */
inline bool isPython(const PluginInfo& plugin) {
    return plugin.library.extension() == ".py";
}

/** What the author of such a class can do about what it raises in a tick. */
inline constexpr char kOnRaise[] =
    "Correct the class in its .py file: what it raises, and what is no result, brakes the arm.";

}  // namespace viable
