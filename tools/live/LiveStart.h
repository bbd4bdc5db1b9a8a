#pragma once

#include "experiment/CasePlan.h"

namespace viable {

/** Where the arm of a plant with a clock stands now, as the value of the key `start`: the nominal arm then begins there, at
rest, and the robust loop without an error that it would answer with a step. Connects to the plant and lets it go. Empty: the
case has no such plant. Throws Error where it cannot be reached, is not what the file says, or stands too far from the
file's start. */
std::string findLiveStart(const CasePlan& plan);

}  // namespace viable
