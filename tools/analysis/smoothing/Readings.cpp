#include "analysis/smoothing/Readings.h"

#include <array>
#include <cmath>

#include "analysis/records/MotionRecord.h"
#include "analysis/smoothing/Median.h"

namespace viable::detail {

/** Gaps longer than this many readings part the record. */
constexpr double kLongGap = 256.0;

/** The step that all distances of the values are multiples of, by Euclid's algorithm; 0 where there is none. */
static double findQuantum(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const double size = std::max(std::abs(values.front()), std::abs(values.back()));
    const double blur = 64.0 * std::numeric_limits<double>::epsilon() * size;  // rounding of the file's own numbers
    std::vector<double> steps;
    for (std::size_t i = 1; i < values.size(); ++i)
        if (values[i] - values[i - 1] > blur) steps.push_back(values[i] - values[i - 1]);
    if (steps.empty()) return 0.0;
    std::sort(steps.begin(), steps.end());
    constexpr double kTolerance = 0.05;  // steps
    constexpr double kFew = 16.0;        // steps: so many tell the quantum, and not the quantum them
    double begin = steps.front();
    double quantum = begin;
    for (std::size_t i = 1; i < steps.size(); ++i) {
        // Few are compared with what was found first: one that follows the steps would fit all of a dense row.
        const bool isFew = steps[i] < (kFew - 0.5) * begin;
        const double unit = isFew ? begin : quantum;
        const double multiple = std::round(steps[i] / unit);
        const double rest = std::abs(steps[i] - multiple * unit);
        if (rest <= kTolerance * unit) {
            if (isFew && multiple > 0.0) quantum += (steps[i] / multiple - quantum) / 16.0;  // sharper with each
            continue;
        }
        if (rest < 16.0 * blur / kTolerance) return 0.0;
        begin = quantum = rest;  // little more than half of the one before, at most: few turns lead from size to blur
        i = 0;                   // the steps before are to be multiples of it, too
    }
    return quantum;
}

Readings Readings::makeEmpty() const {
    Readings empty;
    empty.offset = offset;
    empty.interval_s = interval_s;
    empty.quantum = quantum;
    empty.leastVariance = leastVariance;
    empty.knownVariance = knownVariance;
    return empty;
}

void Readings::addSegment(const Readings& other, std::size_t first, std::size_t end) {
    const auto append = [&](auto& to, const auto& from) {
        to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(first),
                  from.begin() + static_cast<std::ptrdiff_t>(end));
    };
    segments.emplace_back(values.size(), values.size() + end - first);
    append(times_s, other.times_s);
    append(values, other.values);
    append(relative, other.relative);
    append(isUsed, other.isUsed);
    append(source, other.source);
}

/** Leaves out single readings far from a smooth curve through their neighbours. */
static void dropSpikes(Readings& r) {
    // Distance of a reading from the cubic through two neighbours on each side.
    std::vector<double> distances(r.values.size(), 0.0);
    for (const auto& [first, end] : r.segments)
        for (std::size_t i = first + 2; i + 2 < end; ++i) {
            const std::array<std::size_t, 4> others{i - 2, i - 1, i + 1, i + 2};
            double cubic = 0.0;
            for (const std::size_t a : others) {
                double share = 1.0;
                for (const std::size_t b : others)
                    if (a != b) share *= (r.times_s[i] - r.times_s[b]) / (r.times_s[a] - r.times_s[b]);
                cubic += share * r.values[a];
            }
            distances[i] = std::abs(r.values[i] - cubic);
        }
    std::vector<double> sorted = distances;
    const auto upper = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 9 / 10);
    std::nth_element(sorted.begin(), upper, sorted.end());
    // The upper tenth of a normal distribution begins at 1.64 deviations.
    constexpr double kFar = 12.0 / 1.64;
    const double limit = kFar * std::max(*upper, r.quantum);
    for (std::size_t i = 2; i + 2 < distances.size(); ++i)
        if (distances[i] > limit && distances[i] >= distances[i - 1] && distances[i] >= distances[i + 1])
            r.isUsed[i] = 0;
}

/** What rounding does to the readings that are used. */
static void findGrain(Readings& r) {
    std::vector<double> values;
    for (std::size_t i = 0; i < r.values.size(); ++i)
        if (r.isUsed[i]) values.push_back(r.values[i]);
    // Without the outermost: one wild reading off the grid is not to hide it.
    std::sort(values.begin(), values.end());
    const auto outer = static_cast<std::ptrdiff_t>(std::max<std::size_t>(1, values.size() / 100));
    values = std::vector<double>(values.begin() + outer, values.end() - outer);
    r.quantum = findQuantum(values);
    double size = std::abs(r.offset);
    for (const double v : values) size = std::max(size, std::abs(v + r.offset));
    // Numbers themselves are rounded; what is below that is no noise.
    const double grain = std::max(r.quantum, std::numeric_limits<double>::epsilon() * size);
    r.leastVariance = grain * grain / 12.0;
}

static std::vector<double> listIntervals(const Readings& r) {
    std::vector<double> intervals;
    for (const auto& [first, end] : r.segments)
        for (std::size_t i = first; i + 1 < end; ++i) intervals.push_back(r.times_s[i + 1] - r.times_s[i]);
    return intervals;
}

Readings makeReadings(const std::vector<double>& times_s, const std::vector<double>& values, const std::string& where) {
    VIABLE_CHECK(times_s.size() == values.size(), "one reading per time");
    Readings r;
    r.times_s.reserve(values.size());
    r.values.reserve(values.size());
    r.source.reserve(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) continue;
        r.times_s.push_back(times_s[i]);
        r.values.push_back(values[i]);
        r.source.push_back(i);
    }
    const auto refuseShort = [&](std::size_t left, const char* what) {
        if (left >= kLeastSamples) return;
        throw badInput(where, std::to_string(left) + " readings" + what + ": at least " +
                                  std::to_string(kLeastSamples) + " are needed to tell a jerk from noise");
    };
    refuseShort(r.values.size(), "");
    r.offset = calcMedian(r.values);
    for (double& v : r.values) v -= r.offset;
    if (std::all_of(r.values.begin(), r.values.end(), [](double v) { return v == 0.0; }))
        throw badInput(where, "all readings are the same: the sensor is stuck, or the joint did not move",
                       "Leave the joint out, or give a record in which it moves.");
    r.segments.emplace_back(0, r.values.size());
    const std::vector<double> intervals = listIntervals(r);
    r.interval_s = calcMedian(intervals);

    // Segments between long gaps; what is too short to be one is left out.
    r.relative.assign(r.values.size(), 1.0);
    r.isUsed.assign(r.values.size(), 1);
    Readings kept = r.makeEmpty();
    std::size_t first = 0;
    const auto keep = [&](std::size_t end) {
        if (end - first >= kLeastSamples) kept.addSegment(r, first, end);
        first = end;
    };
    for (std::size_t i = 0; i + 1 < r.times_s.size(); ++i)
        if (intervals[i] > kLongGap * r.interval_s) keep(i + 1);
    keep(r.values.size());
    refuseShort(kept.values.size(), " without a long gap between them");
    kept.interval_s = calcMedian(listIntervals(kept));
    findGrain(kept);
    dropSpikes(kept);
    findGrain(kept);
    return kept;
}

std::vector<std::size_t> dropBarrenSegments(Readings& readings) {
    Readings kept = readings.makeEmpty();
    std::vector<std::size_t> dropped;
    for (const auto& [first, end] : readings.segments) {
        const auto begin = readings.isUsed.begin();
        const auto used =
            std::count(begin + static_cast<std::ptrdiff_t>(first), begin + static_cast<std::ptrdiff_t>(end), 1);
        if (static_cast<std::size_t>(used) >= kLeastSamples / 2)
            kept.addSegment(readings, first, end);
        else
            dropped.insert(dropped.end(), readings.source.begin() + static_cast<std::ptrdiff_t>(first),
                           readings.source.begin() + static_cast<std::ptrdiff_t>(end));
    }
    if (!dropped.empty() && !kept.values.empty()) readings = std::move(kept);
    return dropped;
}

}  // namespace viable::detail
