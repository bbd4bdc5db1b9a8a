#include "analysis/smoothing/LimitVerdict.h"

#include <cmath>

#include "analysis/smoothing/Median.h"
#include "core/Text.h"
#include "records/WorkShare.h"

namespace viable {

namespace {

/** The limits of one quantity of one joint. */
struct Range {
    double lower, upper;
    bool isFinite() const { return std::isfinite(lower) || std::isfinite(upper); }
};

std::array<Range, kMotionOrders> getRanges(const AxisLimits& axis) {
    return {{{axis.positionLower, axis.positionUpper},
             {axis.velocityLower, axis.velocityUpper},
             {axis.accelerationLower, axis.accelerationUpper},
             {axis.jerkLower, axis.jerkUpper}}};
}

/** The band is wider by this: where jerk jumps, the error is what smoothing bends, and its tail is longer than that of a
normal distribution. From 1000 synthetic records (tests/tools/analysis), of which about 1 % were outside else. */
constexpr double kLongTail = 1.25;

/** Half width of the band [deviations] that is left anywhere with the probability `error`, both sides together. */
double findCritical(const SmoothedMotion& motion, double arc, double error) {
    // Student's t with n degrees of freedom. The tail beyond c is at most K n / ((n - 1) c) (1 + c^2 / n)^((1 - n) / 2).
    const double n = motion.freedom(), starts = static_cast<double>(motion.segments().size());
    const double K = std::exp(std::lgamma(0.5 * (n + 1.0)) - std::lgamma(0.5 * n)) / std::sqrt(M_PI * n);
    const auto calcError = [&](double c) {
        const double decay = std::log1p(c * c / n);
        const double tail = K * n / ((n - 1.0) * c) * std::exp(0.5 * (1.0 - n) * decay);
        return 2.0 * starts * tail + arc / M_PI * std::exp(-0.5 * n * decay);
    };
    double low = 1e-3, high = 1e4;
    for (int step = 0; step < 80; ++step) {
        const double middle = std::sqrt(low * high);
        (calcError(middle) > error ? low : high) = middle;
    }
    return kLongTail * high;
}

/** Estimates along the record, close enough to miss nothing. */
struct Walk {
    std::vector<double> times_s;
    std::vector<MotionEstimate> estimates;
    std::vector<double> steps_s;  // that each stands for
};

Walk walkAlong(const SmoothedMotion& motion) {
    constexpr double kLooksPerWindow = 5.0;
    Walk walk;
    const auto countLooks = [&](double span) {
        return static_cast<std::size_t>(std::ceil(span / motion.window_s() * kLooksPerWindow)) + 1;
    };
    std::size_t count = 0;
    for (const auto& [begin_s, end_s] : motion.segments()) count += countLooks(end_s - begin_s) + 1;
    walk.times_s.reserve(count);
    walk.estimates.reserve(count);
    walk.steps_s.reserve(count);
    for (const auto& [begin_s, end_s] : motion.segments()) {
        const double span = end_s - begin_s;
        const std::size_t looks = countLooks(span);
        for (std::size_t i = 0; i <= looks; ++i) {
            walk.times_s.push_back(begin_s + span * static_cast<double>(i) / static_cast<double>(looks));
            walk.estimates.push_back(motion.evaluate(walk.times_s.back()));
            walk.steps_s.push_back(span / static_cast<double>(looks + 1));
        }
    }
    return walk;
}

/** Where the band is not wide open. */
std::vector<std::size_t> listJudged(const Walk& walk, std::size_t order, LimitVerdict& verdict) {
    constexpr double kWideOpen = 3.0;  // medians
    std::vector<double> deviations;
    deviations.reserve(walk.estimates.size());
    for (const MotionEstimate& e : walk.estimates) deviations.push_back(e.deviation[order]);
    verdict.deviation = detail::calcMedian(std::move(deviations));
    std::vector<std::size_t> judged;
    double judged_s = 0.0;
    for (std::size_t i = 0; i < walk.estimates.size(); ++i)
        if (walk.estimates[i].deviation[order] <= kWideOpen * verdict.deviation) {
            judged.push_back(i);
            judged_s += walk.steps_s[i];
        }
    verdict.judged = judged_s / (walk.times_s.back() - walk.times_s.front());
    return judged;
}

/** Takes down where the band lies beyond the limits. @param half  half width of the band. True: beyond for certain. */
bool lookForBreak(double time_s, double mean, double half, LimitVerdict& verdict) {
    const double above = mean - verdict.upper, below = verdict.lower - mean;
    const bool isAbove = above > below;
    const double excess = isAbove ? above : below;
    if (!(excess > half)) return false;
    if (verdict.finding != Finding::Broken || time_s < verdict.first_s) verdict.first_s = time_s;
    verdict.finding = Finding::Broken;
    if (excess - half > verdict.certainExcess) {
        verdict.certainExcess = excess - half;
        verdict.excess = excess;
        verdict.worst_s = time_s;
        verdict.side = isAbove ? LimitSide::Upper : LimitSide::Lower;
    }
    return true;
}

void findBreaks(const SmoothedMotion& motion, const Walk& walk, std::size_t order, double duration_s,
                LimitVerdict& verdict) {
    verdict.lowest = kInfinity;
    verdict.highest = -kInfinity;
    double until_s = -kInfinity;  // of the time that counts already
    for (std::size_t i = 0; i < walk.estimates.size(); ++i) {
        const double mean = walk.estimates[i].mean[order];
        verdict.lowest = std::min(verdict.lowest, mean);
        verdict.highest = std::max(verdict.highest, mean);
        if (lookForBreak(walk.times_s[i], mean, verdict.critical * walk.estimates[i].deviation[order], verdict))
            verdict.duration_s += walk.steps_s[i];
    }
    double meansDuration_s = 0.0;
    for (const MeanEstimate& m : motion.calcMeans(static_cast<int>(order), duration_s)) {
        if (!lookForBreak(m.begin_s, m.mean, verdict.criticalMean * m.deviation, verdict)) continue;
        meansDuration_s += m.begin_s + m.duration_s - std::max(m.begin_s, until_s);
        until_s = m.begin_s + m.duration_s;
    }
    verdict.duration_s = std::max(verdict.duration_s, meansDuration_s);
}

/** Is an excess of this size at one place seen? */
bool isSeen(const SmoothedMotion& motion, std::size_t order, const LimitVerdict& verdict, double sign, double limit,
            double time_s, double duration_s, double excess) {
    constexpr double kPower = 1.645;  // 95 % of a normal distribution lie below [deviations]
    MotionPulse pulse;
    pulse.order = static_cast<int>(order);
    pulse.middle_s = time_s;
    pulse.duration_s = duration_s;
    const bool isJerk = order + 1 == kMotionOrders;
    // Jerk jumps from what it is to beyond the limit. What has bounded derivatives comes from the limit itself.
    if (!isJerk) pulse.rise_s = duration_s;
    pulse.height = isJerk ? sign * (limit + excess) - motion.evaluate(time_s).mean[order] : sign * excess;
    const SmoothedMotion::Tried tried = motion.tryPulse(pulse);
    const auto sees = [&](double mean, double before, double critical, double deviation) {
        return isJerk ? sign * mean - limit > critical * deviation
                      : sign * (mean - before) > (critical + kPower) * deviation;
    };
    for (std::size_t i = 0; i < tried.estimates.size(); ++i)
        if (sees(tried.estimates[i].mean[order], isJerk ? 0.0 : motion.evaluate(tried.times_s[i]).mean[order],
                 verdict.critical, tried.estimates[i].deviation[order]))
            return true;
    for (const MeanEstimate& m : tried.means) {
        const double rise =
            motion.evaluate(m.begin_s + m.duration_s).mean[order - 1] - motion.evaluate(m.begin_s).mean[order - 1];
        if (sees(m.mean, rise / m.duration_s, verdict.criticalMean, m.deviation)) return true;
    }
    return false;
}

/** The smallest excess that is seen at each of many places. */
double findVisibleExcess(const SmoothedMotion& motion, const Walk& walk, const std::vector<std::size_t>& judged,
                         std::size_t order, const LimitVerdict& verdict, double duration_s) {
    constexpr std::size_t kPlaces = 24;
    constexpr int kHalvings = 6;
    constexpr double kLargest = 1000.0;     // half widths of the band: beyond, it is not found at all
    constexpr double kLeastReadings = 4.0;  // in the pulse: fewer are outliers as well
    if (judged.empty() || duration_s < kLeastReadings * motion.interval_s()) return kInfinity;
    double visible = 0.0;
    for (std::size_t place = 0; place < kPlaces; ++place) {
        const std::size_t i = judged[(2 * place + 1) * judged.size() / (2 * kPlaces)];
        const MotionEstimate& e = walk.estimates[i];
        const bool isUpper = verdict.upper - e.mean[order] <= e.mean[order] - verdict.lower;
        const double sign = isUpper ? 1.0 : -1.0, limit = isUpper ? verdict.upper : -verdict.lower;
        const auto sees = [&](double excess) {
            return isSeen(motion, order, verdict, sign, limit, walk.times_s[i], duration_s, excess);
        };
        double high = std::max({visible, verdict.critical * e.deviation[order], std::numeric_limits<double>::min()});
        double low = 0.5 * high;
        const double largest = kLargest * verdict.critical * std::max(e.deviation[order], verdict.deviation);
        if (sees(high)) {
            if (high <= visible) continue;  // another place asks for more
        } else {
            do {
                low = high;
                high *= 2.0;
                if (high > largest) return kInfinity;
            } while (!sees(high));
        }
        for (int step = 0; step < kHalvings; ++step) {
            const double middle = 0.5 * (low + high);
            (sees(middle) ? high : low) = middle;
        }
        visible = std::max(visible, high);
    }
    return visible;
}

/** A run of readings that were left out, if there is one in which the joint may have been beyond a limit; not a number:
there is none. A motion that takes it by `distance` within its time, and back, needs derivatives of about these sizes. */
double findHiding(const SmoothedMotion& motion, std::size_t order, const LimitVerdict& verdict) {
    constexpr double kFactors[kMotionOrders] = {1.0, 2.0, 8.0, 32.0};
    for (const OutlierRun& run : motion.outlierRuns()) {
        if (run.count < 2) continue;  // one alone is shorter than what is looked for
        const double length_s = run.end_s - run.begin_s + 2.0 * motion.interval_s();
        const double change = kFactors[order] * run.distance / std::pow(length_s, static_cast<double>(order));
        const double mean = motion.evaluate(0.5 * (run.begin_s + run.end_s)).mean[order];
        if (mean + change > verdict.upper || mean - change < verdict.lower) return run.begin_s;
    }
    return std::numeric_limits<double>::quiet_NaN();
}

/** An angle that wraps looks like a joint that turns round within one sample. */
void refuseWrapped(const MotionRecord& record, std::size_t place) {
    constexpr double kTurn = 2.0 * M_PI, kNear = 0.3;  // [rad]
    const std::vector<double>& q = record.joints[place].positions;
    for (std::size_t i = 1; i + 1 < q.size(); ++i)
        if (std::abs(std::abs(q[i] - q[i - 1]) - kTurn) < kNear && std::abs(q[i + 1] - q[i]) < kNear)
            throw badInput(
                "",
                "the readings jump by a turn at t = " + std::to_string(record.times_s[i]) + " s: an angle that wraps",
                "Unwrap it before (add a turn wherever it jumps).");
}

void drawCurves(const RecordVerdict& all, const SmoothedMotion& motion, JointVerdict& joint) {
    constexpr double kLooksPerSegment = 4.0;
    std::array<MotionCurve, kMotionOrders>& curves = joint.motion->curves;
    curves.fill({Extremes(all.segments()), Extremes(all.segments())});
    const double look_s = std::min(all.segment_s() / kLooksPerSegment, motion.window_s() / kLooksPerSegment);
    for (const auto& [begin_s, end_s] : motion.segments()) {
        const auto looks = static_cast<std::size_t>((end_s - begin_s) / look_s);
        for (std::size_t i = 0; i <= looks; ++i) {
            const double time_s = begin_s + look_s * static_cast<double>(i);
            const std::size_t segment = all.findSegment(time_s);
            const MotionEstimate e = motion.evaluate(time_s);
            for (std::size_t order = 0; order < kMotionOrders; ++order) {
                const double half = joint.limits[order].critical * e.deviation[order];
                curves[order].mean.add(segment, e.mean[order]);
                curves[order].band.add(segment, e.mean[order] - half);
                curves[order].band.add(segment, e.mean[order] + half);
            }
        }
    }
}

/** The joint's motion lives for this joint only. */
void checkJoint(const MotionRecord& record, std::size_t place, const std::array<Range, kMotionOrders>& ranges,
                const RecordVerdict& all, JointVerdict& joint) {
    const JudgeOptions& options = all.options;
    if (!joint.isPrismatic) refuseWrapped(record, place);
    const SmoothedMotion motion = smoothMotion(record.times_s, record.joints[place].positions, "");
    joint.motion = {motion.noise(), motion.quantum(), motion.window_s(), motion.outliers().size(), {}};
    const double error = (1.0 - options.confidence) / static_cast<double>(kMotionOrders * record.joints.size());
    const Walk walk = walkAlong(motion);
    for (std::size_t order = 0; order < kMotionOrders; ++order) {
        LimitVerdict& verdict = joint.limits[order];
        const Range& range = ranges[order];
        verdict.lower = range.lower;
        verdict.upper = range.upper;
        // A mean is a difference of the derivative before, which moves on as quickly as that does.
        const int o = static_cast<int>(order);
        verdict.critical = findCritical(motion, motion.calcArc(o), order == 0 ? error : 0.5 * error);
        if (order > 0) verdict.criticalMean = findCritical(motion, motion.calcArc(o - 1), 0.5 * error);
        const std::vector<std::size_t> judged = listJudged(walk, order, verdict);
        findBreaks(motion, walk, order, options.excessDuration_s, verdict);
        if (!range.isFinite()) {
            verdict.visibleExcess = kInfinity;
            continue;
        }
        verdict.visibleExcess = findVisibleExcess(motion, walk, judged, order, verdict, options.excessDuration_s);
        if (verdict.finding == Finding::Broken) continue;
        constexpr double kLeastJudged = 0.5;
        verdict.hiding_s = findHiding(motion, order, verdict);
        const bool tells = verdict.visibleExcess <= options.excess * calcExcessScale(order, range.lower, range.upper) &&
                           std::isnan(verdict.hiding_s) && verdict.judged >= kLeastJudged;
        verdict.finding = tells ? Finding::Held : Finding::CannotTell;
    }
    if (options.hasCurves) drawCurves(all, motion, joint);
}

}  // namespace

double calcExcessScale(std::size_t order, double lower, double upper) {
    if (order == 0 && std::isfinite(lower) && std::isfinite(upper)) return 0.5 * (upper - lower);
    return calcLimitScale(lower, upper);
}

const char* getName(Finding finding) {
    return detail::enumName<Finding::CannotTell>(finding, {"no_limit", "held", "broken", "cannot_tell"}, "");
}

Finding RecordVerdict::overall() const {
    const auto has = [&](Finding which) {
        return std::any_of(joints.begin(), joints.end(), [&](const JointVerdict& joint) {
            return std::any_of(joint.limits.begin(), joint.limits.end(),
                               [&](const LimitVerdict& limit) { return limit.finding == which; });
        });
    };
    for (const Finding which : {Finding::Broken, Finding::CannotTell, Finding::Held})
        if (has(which)) return which;
    return Finding::NoLimit;
}

void Extremes::add(std::size_t i, double x) {
    if (std::isnan(x)) return;
    least[i] = std::min(least[i], x);
    largest[i] = std::max(largest[i], x);
}

RecordVerdict checkRecord(const MotionRecord& record, const std::vector<AxisLimits>& limits,
                          const JudgeOptions& options) {
    VIABLE_CHECK(limits.size() == record.joints.size(), "limits for each joint");
    if (!(options.confidence >= 0.5 && options.confidence < 1.0))
        throw badInput("--confidence", "it must lie in [0.5, 1)", "0.99 is 99 %.");
    if (!(options.excess > 0.0 && std::isfinite(options.excess)))
        throw badInput("--excess", "it must be a number above 0", "0.1 is 10 % of a limit.");
    if (!(options.excessDuration_s > 0.0 && std::isfinite(options.excessDuration_s)))
        throw badInput("--excess-duration", "it must be a number above 0", "0.05 is 50 ms.");
    RecordVerdict all;
    all.options = options;
    all.source = record.source;
    all.begin_s = record.times_s.front();
    all.end_s = record.times_s.back();
    all.samples = record.times_s.size();
    all.joints.resize(record.joints.size());
    const auto judge = [&](std::size_t i) {
        JointVerdict& joint = all.joints[i];
        joint.name = record.joints[i].name;
        joint.isPrismatic = record.joints[i].isPrismatic;
        const std::array<Range, kMotionOrders> ranges = getRanges(limits[i]);
        try {
            checkJoint(record, i, ranges, all, joint);
        } catch (const Error& e) {
            joint.trouble = e.what();
            joint.motion.reset();
            for (std::size_t order = 0; order < kMotionOrders; ++order) {
                LimitVerdict& limit = joint.limits[order];
                limit = {};
                limit.lower = ranges[order].lower;
                limit.upper = ranges[order].upper;
                limit.visibleExcess = kInfinity;
                limit.deviation = limit.lowest = limit.highest = std::numeric_limits<double>::quiet_NaN();
                if (ranges[order].isFinite()) limit.finding = Finding::CannotTell;
            }
        }
    };
    WorkShare::forEachAtOnce("judging", all.joints.size(), judge, countSmoothedAtOnce(all.samples));
    std::string troubles;
    for (const JointVerdict& joint : all.joints)
        if (!joint.trouble.empty()) troubles += (troubles.empty() ? "" : " ") + joint.name + ": " + joint.trouble;
    if (std::none_of(all.joints.begin(), all.joints.end(), [](const JointVerdict& j) { return j.motion.has_value(); }))
        throw badInput(record.source, "no joint can be judged: " + troubles);
    return all;
}

}  // namespace viable
