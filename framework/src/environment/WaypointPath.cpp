#include "environment/WaypointPath.h"

#include <cmath>

#include "core/Text.h"

namespace viable {

Eigen::Vector3d calcPlaceOnPath(const std::vector<Waypoint>& path, bool repeats, double t) {
    const Waypoint &first = path.front(), &last = path.back();
    if (!(t > first.time_s)) return first.position;
    if (repeats && path.size() > 1) t = first.time_s + std::fmod(t - first.time_s, last.time_s - first.time_s);
    for (std::size_t i = 1; i < path.size(); ++i) {
        const Waypoint &from = path[i - 1], &to = path[i];
        if (t < to.time_s)
            return from.position + (t - from.time_s) / (to.time_s - from.time_s) * (to.position - from.position);
    }
    return last.position;
}

namespace detail {

void checkWaypoints(const std::vector<Waypoint>& path, const ConfigNode& node, bool repeats, const char* who,
                    const char* what) {
    const std::string name(what);
    if (path.empty())
        throw badInput(node.place(), "a " + name + " is a list of places and times", "Write a list of {time_s, xyz}.");
    for (std::size_t i = 1; i < path.size(); ++i)
        if (path[i].time_s <= path[i - 1].time_s)
            throw badInput(node.items[i].find("time_s")->place(),
                           "the time " + formatNumber(path[i].time_s) + " s is not after the one before (" +
                               formatNumber(path[i - 1].time_s) + " s)",
                           "Times of a " + name + " rise.");
    if (repeats && path.front().position != path.back().position)
        throw badInput(node.items.back().place(),
                       std::string("the ") + who + " would jump: a " + name + " that repeats ends where it begins",
                       "Add the first place again as the last one.");
}

bool isUsable(const std::vector<Waypoint>& path) {
    for (std::size_t i = 0; i < path.size(); ++i)
        if (!path[i].position.allFinite() || !std::isfinite(path[i].time_s) ||
            (i > 0 && !(path[i].time_s > path[i - 1].time_s)))
            return false;
    return true;
}

}  // namespace detail

}  // namespace viable
