#pragma once

#include "viable/environment/People.h"

namespace viable::detail {

/** Throws Error (BadInput) with the place for a path without waypoints, times that do not rise, a path that repeats and does
not end where it begins.
@param node  where it was written
@param who   that moves, such as "person", for messages
@param what  the path is called, such as "walk" */
void checkWaypoints(const std::vector<Waypoint>& path, const ConfigNode& node, bool repeats, const char* who,
                    const char* what);

/** Numbers are finite and times rise. */
bool isUsable(const std::vector<Waypoint>& path);

}  // namespace viable::detail
