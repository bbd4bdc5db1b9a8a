#include "environment/WaypointPath.h"

#include <cmath>
#include <string>

#include "config/ConfigText.h"
#include "core/Text.h"
#include "viable/core/Error.h"

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

namespace {

constexpr NumberRange kPathPlace{-1000.0, 1000.0}, kPathTime{0.0, 1e6};

}  // namespace

std::vector<Waypoint> readWaypoints(const ConfigNode& node, bool repeats, const char* who, const char* what) {
    const std::string path(what);
    if (node.kind != ConfigNode::Kind::List || node.items.empty())
        throw badInput(node.place(), "a " + path + " is a list of places and times", "Write a list of {time_s, xyz}.");
    std::vector<Waypoint> found;
    for (const ConfigNode& item : node.items) {
        ConfigMap map(item);
        const ConfigNode& time = map.require("time_s");
        const double time_s = toNumber(time, kPathTime);
        const std::vector<double> x = toNumbers(map.require("xyz"), 3, 3, kPathPlace);
        map.finish();
        if (!found.empty() && time_s <= found.back().time_s)
            throw badInput(time.place(),
                           "the time " + formatNumber(time_s) + " s is not after the one before (" +
                               formatNumber(found.back().time_s) + " s)",
                           "Times of a " + path + " rise.");
        found.push_back({time_s, {x[0], x[1], x[2]}});
    }
    if (repeats && found.front().position != found.back().position)
        throw badInput(node.items.back().place(),
                       std::string("the ") + who + " would jump: a " + path + " that repeats ends where it begins",
                       "Add the first place again as the last one.");
    return found;
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
