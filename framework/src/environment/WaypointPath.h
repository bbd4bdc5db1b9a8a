#pragma once

#include "viable/config/ConfigNode.h"
#include "viable/environment/People.h"

namespace viable::detail {

/** Reads a list of {time_s, xyz}. Throws Error (BadInput) with the place: not a list, times that do not rise, a path that repeats and
does not end where it begins.
@param who   that moves, such as "person", for messages
@param what  the path is called, such as "walk" */
std::vector<Waypoint> readWaypoints(const ConfigNode& node, bool repeats, const char* who, const char* what);

/** Numbers are finite and times rise. */
bool isUsable(const std::vector<Waypoint>& path);

}  // namespace viable::detail
