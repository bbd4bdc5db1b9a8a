
#include "analysis/smoothing/LimitVerdict.h"
#include "core/JsonNumber.h"
#include "core/Text.h"

namespace viable {

namespace {

using detail::format;
using detail::formatPlain;
using nlohmann::json;

constexpr const char* kQuantities[kMotionOrders] = {"position", "velocity", "acceleration", "jerk"};

const char* getUnit(bool isPrismatic, std::size_t order) {
    return viable::getUnit(static_cast<LimitKind>(order + 1), isPrismatic);
}

/** Of an excess, as share of the limit; empty where that means nothing. */
std::string writeShare(double excess, const LimitVerdict& limit, std::size_t order) {
    return " (" + formatPlain(100.0 * excess / calcExcessScale(order, limit.lower, limit.upper)) + " %)";
}

std::string writeVisible(const LimitVerdict& limit, std::size_t order, const std::string& unit) {
    return "an excess from " + formatPlain(limit.visibleExcess) + " " + unit +
           writeShare(limit.visibleExcess, limit, order) + " on would have been seen";
}

std::string writeReason(const LimitVerdict& limit, std::size_t order, const std::string& unit) {
    if (!std::isnan(limit.hiding_s))
        return "readings left out at t = " + format("%.3f", limit.hiding_s) + " s may hide an excess";
    if (std::isinf(limit.visibleExcess))
        return "at this noise and rate no excess that lasts so long is sure to be seen";
    if (limit.judged < 0.5) return "only " + formatPlain(100.0 * limit.judged) + " % of the time can be judged";
    return "only " + writeVisible(limit, order, unit);
}

std::string writeLimit(const LimitVerdict& limit, std::size_t order, const std::string& unit) {
    const std::string seen = formatPlain(limit.lowest) + " .. " + formatPlain(limit.highest) + " " + unit + ", +- " +
                             formatPlain(limit.critical * limit.deviation) +
                             (limit.finding == Finding::NoLimit
                                  ? std::string()
                                  : ", limits " + formatPlain(limit.lower) + " .. " + formatPlain(limit.upper));
    switch (limit.finding) {
        case Finding::NoLimit:
            return "no limit     " + seen;
        case Finding::Held:
            return "held         " + seen + "; " + writeVisible(limit, order, unit);
        case Finding::CannotTell:
            return "cannot tell  " + seen + "; " + writeReason(limit, order, unit);
        case Finding::Broken:
            break;
    }
    const double side = limit.side == LimitSide::Upper ? limit.upper : limit.lower;
    return "BROKEN       at t = " + format("%.3f", limit.first_s) +
           " s; worst at t = " + format("%.3f", limit.worst_s) + " s by " + formatPlain(limit.excess) + " " + unit +
           writeShare(limit.excess, limit, order) + ", at least " + formatPlain(limit.certainExcess) + ", beyond the " +
           (limit.side == LimitSide::Upper ? "upper" : "lower") + " limit " + formatPlain(side) + "; for " +
           formatPlain(limit.duration_s) + " s in all";
}

json toJson(double x) {
    return detail::makeNumberOrNull(x);
}

json describeLimit(const LimitVerdict& limit, bool isPrismatic, std::size_t order) {
    json one = {{"verdict", getName(limit.finding)},
                {"unit", getUnit(isPrismatic, order)},
                {"lower", toJson(limit.lower)},
                {"upper", toJson(limit.upper)},
                {"lowest", toJson(limit.lowest)},
                {"highest", toJson(limit.highest)},
                {"deviation", toJson(limit.deviation)},
                {"band_deviations", limit.critical},
                {"judged", limit.judged},
                {"visible_excess", toJson(limit.visibleExcess)},
                {"broken", nullptr}};
    if (limit.finding == Finding::Broken)
        one["broken"] = {{"side", limit.side == LimitSide::Upper ? "upper" : "lower"},
                         {"first_s", limit.first_s},
                         {"worst_s", limit.worst_s},
                         {"excess", limit.excess},
                         {"certain_excess", limit.certainExcess},
                         {"duration_s", limit.duration_s}};
    return one;
}

json toJson(const std::vector<double>& values) {
    json all = json::array();
    for (const double v : values) all.push_back(std::isfinite(v) ? json(static_cast<float>(v)) : json(nullptr));
    return all;
}

/** Divided differences of the readings, those that are missing left out: what one would compute without more ado. */
std::vector<std::pair<double, double>> differentiate(const MotionRecord& record, std::size_t joint, std::size_t order) {
    std::vector<std::pair<double, double>> points;  // time, value
    for (std::size_t i = 0; i < record.times_s.size(); ++i)
        if (std::isfinite(record.joints[joint].positions[i]))
            points.emplace_back(record.times_s[i], record.joints[joint].positions[i]);
    for (std::size_t k = 0; k < order; ++k) {
        for (std::size_t i = 0; i + 1 < points.size(); ++i) {
            const double step_s = points[i + 1].first - points[i].first;
            points[i] = {points[i].first + 0.5 * step_s, (points[i + 1].second - points[i].second) / step_s};
        }
        points.pop_back();
    }
    return points;
}

json describeCurves(const RecordVerdict& all, const MotionRecord& record, std::size_t joint) {
    json curves = {{"t0", all.begin_s}, {"step_s", all.segment_s()}, {"n", all.segments()}};
    for (std::size_t order = 0; order < kMotionOrders; ++order) {
        Extremes raw(all.segments());
        for (const auto& [time_s, value] : differentiate(record, joint, order)) raw.add(all.findSegment(time_s), value);
        const auto& [mean, band] = all.joints[joint].motion->curves[order];
        curves[kQuantities[order]] = {{"raw_least", toJson(raw.least)},   {"raw_largest", toJson(raw.largest)},
                                      {"mean_least", toJson(mean.least)}, {"mean_largest", toJson(mean.largest)},
                                      {"low", toJson(band.least)},        {"high", toJson(band.largest)}};
    }
    return curves;
}

}  // namespace

std::string writeText(const RecordVerdict& all) {
    std::string text = all.source + ": " + std::to_string(all.samples) + " samples, " +
                       formatPlain(all.end_s - all.begin_s) + " s\nAt " + formatPlain(100.0 * all.options.confidence) +
                       " % for the whole record; looked for: " + formatPlain(100.0 * all.options.excess) +
                       " % beyond a limit for " + formatPlain(1000.0 * all.options.excessDuration_s) + " ms\n";
    std::array<int, 4> counts{};
    for (const JointVerdict& joint : all.joints) {
        text += "\n" + joint.name;
        if (joint.motion) {
            const std::string unit = getUnit(joint.isPrismatic, 0);
            text += ": noise of a reading " + formatPlain(joint.motion->noise) + " " + unit;
            if (joint.motion->quantum > 0.0) text += ", in steps of " + formatPlain(joint.motion->quantum) + " " + unit;
            text += "; motion quicker than " + formatPlain(1000.0 * joint.motion->window_s) + " ms is not resolved";
            if (joint.motion->outliers > 0)
                text += "; " + std::to_string(joint.motion->outliers) + " readings left out as outliers";
            text += "\n";
        } else {
            text += ": " + joint.trouble + "\n";
        }
        for (std::size_t order = 0; order < kMotionOrders; ++order) {
            const LimitVerdict& limit = joint.limits[order];
            ++counts[static_cast<std::size_t>(limit.finding)];
            if (joint.motion)
                text += format("  %-13s", kQuantities[order]) +
                        writeLimit(limit, order, getUnit(joint.isPrismatic, order)) + "\n";
        }
    }
    const auto count = [&](Finding finding) { return std::to_string(counts[static_cast<std::size_t>(finding)]); };
    text += "\n" + count(Finding::Held) + " held, " + count(Finding::Broken) + " broken, " +
            count(Finding::CannotTell) + " cannot be told at this noise";
    if (counts[0] > 0) text += ", " + count(Finding::NoLimit) + " without a limit";
    return text + "\n";
}

std::string writeJson(const RecordVerdict& all, const MotionRecord& record) {
    json joints = json::array();
    for (std::size_t i = 0; i < all.joints.size(); ++i) {
        const JointVerdict& joint = all.joints[i];
        json one = {{"name", joint.name},
                    {"unit", getUnit(joint.isPrismatic, 0)},
                    {"trouble", joint.motion ? json(nullptr) : json(joint.trouble)},
                    {"noise", nullptr},
                    {"quantum", nullptr},
                    {"window_s", nullptr},
                    {"left_out", nullptr},
                    {"curves", nullptr}};
        if (joint.motion) {
            one["noise"] = joint.motion->noise;
            if (joint.motion->quantum > 0.0) one["quantum"] = joint.motion->quantum;
            one["window_s"] = joint.motion->window_s;
            one["left_out"] = joint.motion->outliers;
            one["curves"] = describeCurves(all, record, i);
        }
        for (std::size_t order = 0; order < kMotionOrders; ++order)
            one["limits"][kQuantities[order]] = describeLimit(joint.limits[order], joint.isPrismatic, order);
        joints.push_back(std::move(one));
    }
    const json whole = {{"schema", 1},
                        {"log", all.source},
                        {"signal", record.arm == LoggedArm::Nominal ? "nominal" : "real"},
                        {"verdict", getName(all.overall())},
                        {"confidence", all.options.confidence},
                        {"excess", all.options.excess},
                        {"excess_duration_s", all.options.excessDuration_s},
                        {"begin_s", all.begin_s},
                        {"end_s", all.end_s},
                        {"samples", all.samples},
                        {"joints", joints}};
    return whole.dump(1) + "\n";
}

}  // namespace viable
