#include "analysis/smoothing/SplineSearch.h"

#include "analysis/records/MotionRecord.h"

namespace viable::detail {

/** Knots at most [per reading]: where noise is small, motion changes between two readings. */
constexpr double kKnotsPerReading = 4.0;
/** Roughness of a piece of the motion over that of all, at most, and its inverse at least. */
constexpr double kLargestRoughness = 100.0;

/** Readings farther than this from what all others say of them are left out [standard deviations]. */
constexpr double kOutlier = 4.5;

/** Readings of so many windows have a say in one estimate. */
constexpr double kCounting = 4.0;

/** Readings that the search for the best distance of the knots looks at, at most. */
constexpr std::size_t kSearched = 16384, kSearchedPiece = 1024;

/** Pieces of a long record: half of them evenly spread, half where the readings stray most from a straight line. */
static Readings makeSample(const Readings& readings) {
    if (readings.values.size() <= kSearched) return readings;
    struct Candidate {
        std::size_t first, end;
        double straying;
    };
    std::vector<Candidate> candidates;
    for (const auto& [first, end] : readings.segments)
        for (std::size_t from = first; from + kLeastSamples <= end; from += kSearchedPiece) {
            const std::size_t to = std::min(from + kSearchedPiece, end);
            if (to < from + kLeastSamples) break;
            const double slope =
                (readings.values[to - 1] - readings.values[from]) / (readings.times_s[to - 1] - readings.times_s[from]);
            double straying = 0.0;
            for (std::size_t i = from; i < to; ++i)
                if (readings.isUsed[i])
                    straying = std::max(straying, std::abs(readings.values[i] - readings.values[from] -
                                                           slope * (readings.times_s[i] - readings.times_s[from])));
            candidates.push_back({from, to, straying});
        }
    constexpr std::size_t kPieces = kSearched / kSearchedPiece;
    std::vector<char> isTaken(candidates.size(), 0);
    for (std::size_t piece = 0; piece < kPieces / 2; ++piece)
        isTaken[(2 * piece + 1) * candidates.size() / kPieces] = 1;
    std::vector<std::size_t> order(candidates.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto middle = order.begin() + static_cast<std::ptrdiff_t>(std::min(kPieces / 2, order.size()));
    std::partial_sort(order.begin(), middle, order.end(),
                      [&](std::size_t a, std::size_t b) { return candidates[a].straying > candidates[b].straying; });
    for (auto i = order.begin(); i != middle; ++i) isTaken[*i] = 1;
    Readings sample = readings.makeEmpty();
    for (std::size_t i = 0; i < candidates.size(); ++i)
        if (isTaken[i]) sample.addSegment(readings, candidates[i].first, candidates[i].end);
    return sample;
}

Roughness refine(const SplineFit& fit) {
    constexpr std::size_t kReach = 8;     // pieces on either side that count
    constexpr double kPrior = 0.5;        // information that says 1
    constexpr double kDamping = 0.7;      // neighbouring pieces share information: a whole step goes too far
    constexpr double kLargestStep = 1.5;  // of the logarithm
    const double largest = std::log(kLargestRoughness);
    const auto [here, slope, information] = fit.calcRoughnessSlope();
    Roughness next = here;
    const std::size_t n = slope.size();
    for (std::size_t i = 0; i < n; ++i) {
        const double old = std::log(here.factors[i]);
        double sum = -kPrior * old, weight = kPrior;
        for (std::size_t j = i - std::min(i, kReach); j < std::min(n, i + kReach + 1); ++j) {
            const double distance = static_cast<double>(i > j ? i - j : j - i);
            const double share = 1.0 - distance / static_cast<double>(kReach + 1);
            sum += share * slope[j];
            weight += share * information[j];
        }
        const double step = std::clamp(kDamping * sum / weight, -kLargestStep, kLargestStep);
        next.factors[i] = std::exp(std::clamp(old + step, -largest, largest));
    }
    return next;
}

void normalise(Roughness& roughness) {
    double mean = 0.0;
    for (const double f : roughness.factors) mean += std::log(f) / static_cast<double>(roughness.factors.size());
    for (double& f : roughness.factors) f *= std::exp(-mean);
}

double findKnotStep(const Readings& readings, const Roughness& roughness, double coarsest_s,
                    std::size_t maxWorseSteps) {
    constexpr double kRatio = 0.70710678118654752;
    const Readings sample = makeSample(readings);
    std::vector<double> steps, values;
    std::size_t best = 0;
    const double finest_s = readings.interval_s / kKnotsPerReading;
    for (double step_s = std::max(coarsest_s, finest_s); step_s >= finest_s; step_s *= kRatio) {
        steps.push_back(step_s);
        values.push_back(SplineFit(sample, step_s, roughness).objective());
        if (values.back() < values[best]) best = values.size() - 1;
        if (values.size() > best + maxWorseSteps && std::isfinite(values[best])) break;
    }
    if (best == 0 || best + 1 >= values.size() || !std::isfinite(values[best - 1]) || !std::isfinite(values[best + 1]))
        return steps[best];
    const double left = values[best - 1], middle = values[best], right = values[best + 1];
    const double bend = left - 2.0 * middle + right;
    return steps[best] * std::pow(kRatio, bend > 0.0 ? 0.5 * (left - right) / bend : 0.0);
}

bool reweigh(Readings& readings, const SplineFit& fit) {
    const double variance = fit.variance(), quantum = readings.quantum;
    // A reading counts among those of some windows, not more.
    const double window = kCounting * kKnotsPerWindow * fit.step_s() / readings.interval_s;  // [readings]
    // Rounding's error is periodic in the position: over noise of variance s^2, the k-th harmonic of its mean has the
    // amplitude b = quantum / (pi k) exp(-2 (pi k s / quantum)^2) (Widrow and Kollar 2008). It hardly changes from one
    // reading to the next where the joint moves by nearly a whole number of its periods: at rest, and at some speeds.
    constexpr int kHarmonics = 4;
    const double noise = std::max(0.0, variance - quantum * quantum / 12.0);
    double shares[kHarmonics] = {};
    for (int k = 1; k <= kHarmonics && quantum > 0.0; ++k) {
        const double b = quantum / (M_PI * k) * std::exp(-2.0 * M_PI * M_PI * k * k * noise / (quantum * quantum));
        shares[k - 1] = 0.5 * b * b / variance;
    }
    const auto calcRelative = [&](double velocity) {
        double relative = 1.0;
        for (int k = 1; k <= kHarmonics && quantum > 0.0; ++k) {
            const double periods = k * velocity * readings.interval_s / quantum;
            const double change = std::abs(periods - std::round(periods));
            relative += shares[k - 1] * (std::min(1.0 / std::max(change, 1e-9), std::max(1.0, window)) - 1.0);
        }
        return relative;
    };
    bool changed = false;
    fit.forEachReading([&](std::size_t i, double expected, double leverage, double velocity) {
        const double rest = readings.values[i] - expected;
        double spread = readings.relative[i];
        spread += readings.isUsed[i] ? -leverage : leverage;
        spread = std::max(spread, 1e-3 * readings.relative[i]);  // rounding
        const bool isUsed = std::abs(rest) <= kOutlier * std::sqrt(variance * spread) + 0.5 * quantum;
        if (isUsed != bool(readings.isUsed[i])) changed = true;
        readings.isUsed[i] = isUsed;
        const double relative = calcRelative(velocity);
        if (std::abs(std::log(relative / readings.relative[i])) > 0.5) changed = true;
        readings.relative[i] = relative;
    });
    return changed;
}

}  // namespace viable::detail
