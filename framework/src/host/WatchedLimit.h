#pragma once

#include <memory>
#include <string>

#include "viable/limits/ArmLimit.h"

namespace viable {

/** The limit of that kind for a case, not null. One of a library's code is called as plugins are: a crash or a hang there
names the library, and the arithmetic is set back. A sample() that throws, or changed the arithmetic, counts as broken.
Throws Error (PluginFailed) where the limit cannot be made. */
std::unique_ptr<ArmLimit> makeLimit(LimitKind kind, const LimitScene& scene);

/** The plugin library whose code judges that kind; empty: none's does. */
std::string findLimitLibrary(LimitKind kind);

}  // namespace viable
