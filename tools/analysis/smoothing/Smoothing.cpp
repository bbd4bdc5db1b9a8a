#include "analysis/smoothing/Smoothing.h"

#include "analysis/records/MotionRecord.h"
#include "analysis/smoothing/SplineSearch.h"

namespace viable {

struct SmoothedMotion::Impl {
    detail::Readings readings;
    std::optional<detail::SplineFit> fit;
    detail::Roughness roughness;
    std::vector<std::size_t> outliers;
    std::vector<OutlierRun> runs;
    double freedom = 0.0;

    /** Once the fit is the last one. */
    void findOutliers() {
        double used = 0.0, taken = 0.0;
        std::size_t last = 0;
        fit->forEachReading([&](std::size_t i, double expected, double leverage, double) {
            if (readings.isUsed[i]) {
                used += 1.0;
                taken += leverage / readings.relative[i];
                return;
            }
            outliers.push_back(readings.source[i]);
            const double distance = std::abs(readings.values[i] - expected);
            if (runs.empty() || i != last + 1) runs.push_back({readings.times_s[i], readings.times_s[i], 0, 0.0});
            OutlierRun& run = runs.back();
            run.end_s = readings.times_s[i];
            run.distance = std::max(run.distance, distance);
            ++run.count;
            last = i;
        });
        std::sort(outliers.begin(), outliers.end());
        // Noise is known from what the motion leaves over; how smooth the motion is, from its windows.
        double windows = 0.0;
        for (const detail::SplineFit::Segment& s : fit->segments())
            windows += (s.end_s - s.begin_s) / (detail::kKnotsPerWindow * fit->step_s());
        freedom = std::max(2.0, std::min(used - taken, windows));
    }
};

SmoothedMotion::SmoothedMotion(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SmoothedMotion::~SmoothedMotion() = default;
SmoothedMotion::SmoothedMotion(SmoothedMotion&&) noexcept = default;
SmoothedMotion& SmoothedMotion::operator=(SmoothedMotion&&) noexcept = default;

double SmoothedMotion::noise() const {
    return std::sqrt(impl_->fit->variance());
}
double SmoothedMotion::quantum() const {
    return impl_->readings.quantum;
}
double SmoothedMotion::window_s() const {
    return detail::kKnotsPerWindow * impl_->fit->step_s();
}
const std::vector<std::size_t>& SmoothedMotion::outliers() const {
    return impl_->outliers;
}
MotionEstimate SmoothedMotion::evaluate(double time_s) const {
    MotionEstimate estimate = impl_->fit->evaluate(time_s);
    estimate.mean[0] += impl_->readings.offset;
    return estimate;
}
double SmoothedMotion::calcArc(int order) const {
    return impl_->fit->calcArc(order);
}
std::vector<std::pair<double, double>> SmoothedMotion::segments() const {
    std::vector<std::pair<double, double>> all;
    for (const detail::SplineFit::Segment& s : impl_->fit->segments()) all.emplace_back(s.begin_s, s.end_s);
    return all;
}
const std::vector<OutlierRun>& SmoothedMotion::outlierRuns() const {
    return impl_->runs;
}
double SmoothedMotion::freedom() const {
    return impl_->freedom;
}
double SmoothedMotion::interval_s() const {
    return impl_->readings.interval_s;
}

std::vector<MeanEstimate> SmoothedMotion::calcMeans(int order, double duration_s) const {
    return impl_->fit->calcMeans(order, duration_s);
}

SmoothedMotion::Tried SmoothedMotion::tryPulse(const MotionPulse& pulse) const {
    constexpr double kWindows = 12.0;  // to either side: what is farther has no say
    constexpr int kRounds = 2;         // of the roughness
    constexpr int kLooks = 7;          // at the plateau
    const detail::Readings& all = impl_->readings;
    const double reach = pulse.reach_s() + kWindows * window_s();
    detail::Readings near = all.makeEmpty();
    for (const auto& [first, end] : all.segments) {
        const auto begin = all.times_s.begin();
        const auto at = [&](std::size_t i) { return begin + static_cast<std::ptrdiff_t>(i); };
        if (*at(first) > pulse.middle_s || *at(end - 1) < pulse.middle_s) continue;
        near.addSegment(all,
                        static_cast<std::size_t>(std::lower_bound(at(first), at(end), pulse.middle_s - reach) - begin),
                        static_cast<std::size_t>(std::lower_bound(at(first), at(end), pulse.middle_s + reach) - begin));
    }
    Tried tried;
    if (near.values.size() < kLeastSamples) return tried;
    near.knownVariance = impl_->fit->variance();
    for (std::size_t i = 0; i < near.values.size(); ++i) near.values[i] += pulse.calcPosition(near.times_s[i]);
    const double step_s = impl_->fit->step_s();
    detail::Roughness roughness;
    std::optional<detail::SplineFit> fit;
    for (int round = 0;; ++round) {
        fit.emplace(near, step_s, round == 0 ? impl_->roughness : roughness);
        if (!fit->ok()) return tried;
        fit->finish();
        if (round == kRounds) break;
        roughness = detail::refine(*fit);
    }
    const double begin_s = pulse.middle_s - 0.5 * pulse.duration_s;
    for (int look = 0; look < kLooks; ++look) {
        tried.times_s.push_back(begin_s + pulse.duration_s * look / (kLooks - 1));
        tried.estimates.push_back(fit->evaluate(tried.times_s.back()));
        tried.estimates.back().mean[0] += all.offset;
    }
    for (const MeanEstimate& mean : fit->calcMeans(pulse.order, pulse.duration_s))
        if (mean.begin_s >= begin_s && mean.begin_s + mean.duration_s <= begin_s + pulse.duration_s)
            tried.means.push_back(mean);
    return tried;
}

SmoothedMotion smoothMotion(const std::vector<double>& times_s, const std::vector<double>& values,
                            const std::string& where) {
    auto impl = std::make_unique<SmoothedMotion::Impl>();
    detail::Readings& readings = impl->readings;
    readings = detail::makeReadings(times_s, values, where);
    detail::Roughness& roughness = impl->roughness;
    const auto fit = [&](double coarsest_s, std::size_t maxWorseSteps) {
        const double step_s = detail::findKnotStep(readings, roughness, coarsest_s, maxWorseSteps);
        std::vector<double> storage;
        if (impl->fit) storage = impl->fit->releaseStorage();
        impl->fit.emplace(readings, step_s, roughness, std::move(storage));
        if (!impl->fit->ok())
            throw badInput(where, "the readings cannot be smoothed: their times or values differ too much in size");
        impl->fit->finish();
    };
    double longest_s = 0.0;
    for (const auto& [first, end] : readings.segments)
        longest_s = std::max(longest_s, readings.times_s[end - 1] - readings.times_s[first]);
    fit(longest_s / 4.0, 8);
    const auto refit = [&] { fit(4.0 * impl->fit->step_s(), 4); };
    const auto weighAgain = [&] {
        const bool changed = detail::reweigh(readings, *impl->fit);
        const std::vector<std::size_t> dropped = detail::dropBarrenSegments(readings);
        impl->outliers.insert(impl->outliers.end(), dropped.begin(), dropped.end());
        return changed || !dropped.empty();
    };
    constexpr int kWeightRounds = 6, kRoughnessRounds = 3;
    for (int round = 1; round < kWeightRounds && weighAgain(); ++round) refit();
    for (int round = 0; round < kRoughnessRounds; ++round) {
        roughness = detail::refine(*impl->fit);
        detail::normalise(roughness);
        if (round > 0) weighAgain();
        refit();
    }
    impl->findOutliers();
    return SmoothedMotion(std::move(impl));
}

}  // namespace viable
