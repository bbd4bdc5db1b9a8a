#include "Waypoints.h"

#include <algorithm>
#include <cmath>

#include "core/MinimumJerk.h"
#include "core/Text.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

// A point counts as reached this much early [s], because k * tick falls on either side of a time
// written in decimals.
constexpr double kTimeTolerance_s = 1e-9;

static std::string text(double value) {
    return detail::format("%.10g", value);
}

// Where row i stands in the file.
static std::string findRowPlace(const Parameters& parameters, std::size_t i) {
    const ConfigNode* node = parameters.resolved().find("points");
    if (node && i < node->items.size() && node->items[i].line > 0) return node->items[i].place();
    return parameters.place("points") + "[" + std::to_string(i) + "]";
}

void Waypoints::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    options_ = parameters.get<WaypointsOptions>();
    const auto& rows = options_.points;
    if (rows.empty())
        throw badInput(parameters.place("points"), "there are no points",
                       "Give at least one row [time_s, position of each joint in rad]");
    times_.clear();
    points_.clear();
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const std::vector<double>& row = rows[i];
        if (static_cast<int>(row.size()) != n_ + 1)
            throw badInput(
                findRowPlace(parameters, i),
                "the row has " + std::to_string(row.size()) + " numbers, but it needs " + std::to_string(n_ + 1),
                "Write the time, then one position for each of the " + std::to_string(n_) + " joints of " +
                    setup.robot.name);
        if (row[0] < 0.0)
            throw badInput(findRowPlace(parameters, i),
                           "the time " + text(row[0]) + " s is before the start of the run", "Times begin at 0");
        if (i > 0 && !(row[0] > times_.back()))
            throw badInput(findRowPlace(parameters, i),
                           "the time " + text(row[0]) + " s is not later than that of the row before, " +
                               text(times_.back()) + " s",
                           "Times must increase from row to row");
        times_.push_back(row[0]);
        points_.push_back(Eigen::Map<const Eigen::VectorXd>(row.data() + 1, n_));
    }

    if (options_.repeat_s > 0.0) {
        if (options_.repeat_s < times_.back())
            throw badInput(parameters.place("repeat_s"),
                           "repeat_s = " + text(options_.repeat_s) + " s ends before the last point at " +
                               text(times_.back()) + " s",
                           "Give at least the time of the last point, or 0 to run once");
        if (options_.interpolation != WaypointsOptions::Interpolation::Hold &&
            options_.repeat_s + times_.front() - times_.back() <= kTimeTolerance_s && points_.front() != points_.back())
            throw badInput(parameters.place("repeat_s"),
                           "the next round begins where the last point is (" + text(times_.back()) +
                               " s), but first and last point differ",
                           "Let the last point equal the first, leave time between the last point "
                           "and repeat_s, or choose interpolation: hold");
    }
    reset(setup.start);
}

TickStatus Waypoints::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    if (!isFinite(offset_, n_)) return TickStatus::Faulted;
    t += kTimeTolerance_s;
    bool laterRound = false;
    if (options_.repeat_s > 0.0 && t >= options_.repeat_s) {
        t = std::fmod(t, options_.repeat_s);
        laterRound = true;
    }
    out.space = MotionCommand::Space::Joint;
    out.qd.setZero(n_);

    // The piece from point i to point k, which begins at `begin` and takes `length`.
    const auto next = std::upper_bound(times_.begin(), times_.end(), t);
    std::size_t i, k;
    double begin, length;
    if (next != times_.begin() && next != times_.end()) {
        k = static_cast<std::size_t>(next - times_.begin());
        i = k - 1;
        begin = times_[i];
        length = times_[k] - begin;
    } else {
        const bool before = next == times_.begin();
        if ((before && !laterRound) || (!before && options_.repeat_s == 0.0)) {
            out.q = points_[before ? 0 : times_.size() - 1] + offset_;
            return TickStatus::Ok;
        }
        i = times_.size() - 1;
        k = 0;
        begin = before ? times_[i] - options_.repeat_s : times_[i];
        length = options_.repeat_s + times_[0] - times_[i];
    }

    if (options_.interpolation == WaypointsOptions::Interpolation::Hold || length <= kTimeTolerance_s) {
        out.q = points_[i] + offset_;
        return TickStatus::Ok;
    }
    const double u = std::clamp((t - kTimeTolerance_s - begin) / length, 0.0, 1.0);
    MinimumJerk way{u, 1.0};
    if (options_.interpolation == WaypointsOptions::Interpolation::Smooth) way = calcMinimumJerk(u);
    out.q = points_[i] + way.value * (points_[k] - points_[i]) + offset_;
    out.qd = (way.slope / length) * (points_[k] - points_[i]);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::Waypoints, "waypoints",
              "Joint positions at given times: steps, straight or smooth.", viable::WaypointsOptions)
