#include "analysis/Readings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "viable/analysis/MotionRecord.h"
#include "viable/core/Error.h"

namespace viable::detail {

namespace {

/** Gaps longer than this many readings part the record. */
constexpr double kLongGap = 256.0;

double takeMedian(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/** The step that all distances of the values are multiples of, by Euclid's algorithm; 0 where there is none. */
double findQuantum(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const double size = std::max(std::abs(values.front()), std::abs(values.back()));
    const double blur = 64.0 * std::numeric_limits<double>::epsilon() * size;  // rounding of the file's own numbers
    std::vector<double> steps;
    for (std::size_t i = 1; i < values.size(); ++i)
        if (values[i] - values[i - 1] > blur) steps.push_back(values[i] - values[i - 1]);
    if (steps.empty()) return 0.0;
    std::sort(steps.begin(), steps.end());
    constexpr double kTolerance = 0.05;  // steps
    double quantum = steps.front();
    for (std::size_t i = 1; i < steps.size(); ++i) {
        const double multiple = std::round(steps[i] / quantum);
        const double rest = std::abs(steps[i] - multiple * quantum);
        if (rest <= kTolerance * quantum) {
            if (multiple < 16.0) quantum += (steps[i] / multiple - quantum) / 16.0;  // sharper with each
            continue;
        }
        if (rest < 16.0 * blur / kTolerance) return 0.0;
        quantum = rest;
        i = 0;  // the steps before are to be multiples of it, too
    }
    return quantum;
}

}  // namespace

void Readings::clear() {
    times_s.clear();
    values.clear();
    relative.clear();
    isUsed.clear();
    source.clear();
    stretches.clear();
}

void Readings::addStretch(const Readings& other, std::size_t first, std::size_t end) {
    const auto append = [&](auto& to, const auto& from) {
        to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(first),
                  from.begin() + static_cast<std::ptrdiff_t>(end));
    };
    stretches.emplace_back(values.size(), values.size() + end - first);
    append(times_s, other.times_s);
    append(values, other.values);
    append(relative, other.relative);
    append(isUsed, other.isUsed);
    append(source, other.source);
}

Readings takeReadings(const std::vector<double>& times_s, const std::vector<double>& values, const std::string& where) {
    VIABLE_CHECK(times_s.size() == values.size(), "one reading per time");
    Readings r;
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) continue;
        if (r.values.empty()) r.offset = values[i];
        r.times_s.push_back(times_s[i]);
        r.values.push_back(values[i] - r.offset);
        r.source.push_back(i);
    }
    const auto refuseShort = [&](std::size_t left, const char* what) {
        if (left >= kLeastSamples) return;
        throw badInput(where, std::to_string(left) + " readings" + what + ": at least " + std::to_string(kLeastSamples) +
                                  " are needed to tell a jerk from noise");
    };
    refuseShort(r.values.size(), "");
    if (std::all_of(r.values.begin(), r.values.end(), [](double v) { return v == 0.0; }))
        throw badInput(where, "all readings are the same: the sensor is stuck, or the joint did not move",
                       "Leave the joint out, or give a record in which it moves.");
    std::vector<double> intervals(r.times_s.size() - 1);
    for (std::size_t i = 0; i + 1 < r.times_s.size(); ++i) intervals[i] = r.times_s[i + 1] - r.times_s[i];
    r.interval_s = takeMedian(intervals);

    // Stretches between long gaps; what is too short to be one is left out.
    r.relative.assign(r.values.size(), 1.0);
    r.isUsed.assign(r.values.size(), 1);
    Readings kept;
    kept.offset = r.offset;
    kept.interval_s = r.interval_s;
    std::size_t first = 0;
    const auto keep = [&](std::size_t end) {
        if (end - first >= kLeastSamples) kept.addStretch(r, first, end);
        first = end;
    };
    for (std::size_t i = 0; i + 1 < r.times_s.size(); ++i)
        if (intervals[i] > kLongGap * r.interval_s) keep(i + 1);
    keep(r.values.size());
    refuseShort(kept.values.size(), " without a long gap between them");
    kept.quantum = findQuantum(kept.values);
    // Numbers themselves are rounded; what is below that is no noise.
    const double size = std::abs(r.offset) + std::abs(*std::max_element(kept.values.begin(), kept.values.end(),
                                                                          [](double a, double b) { return std::abs(a) < std::abs(b); }));
    const double grain = std::max(kept.quantum, std::numeric_limits<double>::epsilon() * size);
    kept.leastVariance = grain * grain / 12.0;
    return kept;
}

void dropSpikes(Readings& r) {
    // Distance of a reading from the cubic through two neighbours on each side.
    std::vector<double> distances(r.values.size(), 0.0);
    for (const auto& [first, end] : r.stretches)
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

}  // namespace viable::detail
