#pragma once

#include <functional>

#include "viable/limits/ArmLimit.h"

namespace viable {

// A library's code for a kind of limit is called as plugins are: a crash or a hang there names the library, and the
// arithmetic is set back.

/** Whether a case has that kind of limit, and somebody counts it. Throws Error (PluginFailed) where its row cannot say. */
bool hasLimit(LimitKind kind, const LimitScene& scene);

/** The limit of that kind for a case, not null. One of a library whose sample() throws, or changed the arithmetic, counts
as broken. Throws Error (PluginFailed) where the limit cannot be made. */
std::unique_ptr<ArmLimit> makeLimit(LimitKind kind, const LimitScene& scene);

/** What `words` tells, a call of a function of the kind's row; where that fails, that it did. */
std::string tellOf(LimitKind kind, const std::function<std::string()>& words);
/** The same of a function of the row, such as &LimitRow::tellWorst; empty: it has none. */
template <class... Of, class... Arguments>
std::string tell(LimitKind kind, std::string (*LimitRow::*function)(Of...), const Arguments&... arguments) {
    const auto words = getLimitRow(kind).*function;
    return words ? tellOf(kind, [&] { return words(arguments...); }) : "";
}

}  // namespace viable
