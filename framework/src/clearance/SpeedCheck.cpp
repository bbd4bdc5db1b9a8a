#include "clearance/SpeedCheck.h"

#include <cmath>

#include "clearance/SteeringRows.h"

namespace viable::detail {

namespace {

/** Speeds below this share of their limits need not be told apart. */
constexpr double kSlow = 0.5;

/** Whether the segment is in the box, made larger by `margin` on every side: the segment's share within each pair of planes. */
bool isInBox(const CapsuleMotion::Segment& segment, const SpeedLimits::Region& region, double margin) {
    double begin = 0.0, end = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        const double lower = region.lower[axis] - margin, upper = region.upper[axis] + margin;
        const double from = segment.a[axis], way = segment.b[axis] - from;
        if (way == 0.0) {
            if (from < lower || from > upper) return false;
            continue;
        }
        const double s = (lower - from) / way, t = (upper - from) / way;
        begin = std::max(begin, std::min(s, t));
        end = std::min(end, std::max(s, t));
    }
    return begin <= end;
}

}  // namespace

std::vector<LinkCapsule> SpeedCheck::listCapsules(const RobotDescription& robot, const ArmGeometry* geometry) {
    std::vector<LinkCapsule> capsules;
    if (geometry && robot.speedLimits.needsCapsules()) capsules = listMoved(*geometry);
    if (robot.speedLimits.tool < kInfinity)
        capsules.push_back(
            {-1, robot.toolParent, robot.toolPlacement.translation(), robot.toolPlacement.translation(), 0.0});
    return capsules;
}

SpeedCheck::SpeedCheck(const RobotDescription& robot, const ArmGeometry* geometry, double tick_s)
    : n_(robot.size()),
      tick_s_(tick_s),
      limits_(robot.speedLimits),
      speeds_(robot, listCapsules(robot, geometry)),
      otherPosition_(JointVector::Zero(n_)) {
    for (std::size_t k = 0; k < speeds_.size(); ++k) {
        const LinkCapsule& capsule = speeds_.capsule(k);
        const bool isCapsule = capsule.link >= 0;
        parts_.push_back(
            {capsule.radius, isCapsule ? limits_.arm : limits_.tool, capsule.carrier, capsule.link, isCapsule});
    }
    const auto prepare = [this](Look& look) {
        look.speeds.assign(parts_.size(), 0.0);
        look.segments.resize(parts_.size());
    };
    for (Look* look : {&begin_, &first_, &end_}) prepare(*look);
    for (Look& look : middle_) prepare(look);
}

double SpeedCheck::findLimit(const Part& part, const CapsuleMotion::Segment& segment, double margin) const {
    double limit = part.limit;
    if (part.isCapsule)
        for (const SpeedLimits::Region& region : limits_.regions)
            if (region.speed < limit && isInBox(segment, region, part.radius + margin)) limit = region.speed;
    return limit;
}

/** False: it is over, as a look was too fast. */
bool SpeedCheck::sample(double time_s, bool isBegin, Look& look) {
    --left_;
    --leftOfPath_;
    look.time_s = time_s;
    speeds_.sample(*path_, time_s);
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        Part& part = parts_[k];
        look.segments[k] = speeds_.pose().segments[k];
        look.speeds[k] = speeds_.calcFastest(k).speed;
        const double limit = findLimit(part, look.segments[k], 0.0);
        const double use = look.speeds[k] / limit;
        result_->seen = std::max(result_->seen, use);
        if (isBegin) continue;  // no jerk changes that
        if (!(use <= part.use)) {
            part.use = use;
            part.time_s = time_s;
            part.limitThere = limit;
        }
        result_->seenLater = std::max(result_->seenLater, use);
        if (!(use <= demand_.looks + kRounding)) result_->isKept = false;
    }
    return result_->isKept || !mustBeGood_;
}

/** False: it is over. */
bool SpeedCheck::prove(const Look& from, const Look& to, int depth) {
    const double h = to.time_s - from.time_s;
    double most = -1.0;
    LimitReport fastest;
    fastest.isKnown = true;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        const Part& part = parts_[k];
        const double bound = std::max(from.speeds[k], to.speeds[k]) + h * h / 8.0 * part.bendRate;
        const double margin = bound * h / 2.0;
        const double limit =
            std::min(findLimit(part, from.segments[k], margin), findLimit(part, to.segments[k], margin));
        const double use = bound / limit;
        if (use < most || (use == most && bound <= fastest.value)) continue;
        most = use;
        fastest.value = bound;
        fastest.limit = limit;
        fastest.link = part.link;
    }
    const auto settle = [&] {
        const bool isFirst = !result_->fastest.isKnown;
        if (isFirst || most > result_->proven || (most == result_->proven && fastest.value > result_->fastest.value)) {
            result_->proven = most;
            result_->fastest = fastest;
        }
        return result_->isKept || !mustBeGood_;
    };
    double enough = std::max(result_->seen, kSlow) + kGuard / 2.0;
    if (result_->seen <= 1.0) enough = std::min(enough, 1.0);  // whether the limits are kept must come out
    if (most <= std::min(demand_.bound, enough)) return settle();
    if (depth == kDepth || left_ <= 0 || leftOfPath_ <= 0) {
        if (!(most <= demand_.bound + kRounding)) result_->isKept = false;
        return settle();
    }
    // A path that is too fast is not looked at to the last: where it is fastest is known well enough.
    if (!result_->isKept && most <= result_->seen + kGuard) return settle();
    Look& middle = middle_[depth];
    return sample((from.time_s + to.time_s) / 2.0, false, middle) && prove(from, middle, depth + 1) &&
           prove(middle, to, depth + 1);
}

void SpeedCheck::examine(const ArmPath& path, const ArmPath::Extremes& extremes, const Demand& demand, bool mustBeGood,
                         Result& result) {
    result = {};
    if (parts_.empty()) return;
    path_ = &path;
    demand_ = demand;
    mustBeGood_ = mustBeGood;
    result_ = &result;
    leftOfPath_ = kMostOfPath;
    for (Part& part : parts_) part.use = 0.0;
    sample(0.0, true, begin_);
    speeds_.setPath(extremes);
    for (std::size_t k = 0; k < parts_.size(); ++k)
        parts_[k].bendRate = speeds_.motion().calcBendRate(static_cast<int>(k));
    // The end of the tick is where the next path begins.
    if (sample(tick_s_, false, first_) && prove(begin_, first_, 0) && path.duration() > tick_s_ &&
        sample(path.duration(), false, end_))
        prove(first_, end_, 0);
}

void SpeedCheck::addRows(const StopPair& stops, const Demand& demand, RowQp::Rows& rows) {
    JointVector there, row(n_);
    const auto calcKey = [&](std::size_t k) { return parts_[k].use > demand.ahead ? -parts_[k].use : kInfinity; };
    forLeast(parts_.size(), static_cast<int>(parts_.size()), calcKey, [&](std::size_t k) {
        const Part& part = parts_[k];
        stops.other.calcMotion(std::min(part.time_s, stops.other.duration()), otherPosition_, there);
        speeds_.sample(stops.path, part.time_s);
        const CapsuleSpeeds::Fastest fastest = speeds_.calcFastest(k);
        if (!(fastest.speed > 0.0)) return;
        const Eigen::Vector3d direction = fastest.velocity / fastest.speed;
        const ArmRecursion::Frames& frames = speeds_.pose().frames;
        for (int i = 0; i < n_; ++i) {
            row[i] = 0.0;
            if (!speeds_.arm().moves(i, part.carrier)) continue;
            const Eigen::Vector3d& axis = frames.axis[i];
            const double slope = (speeds_.velocity()[i] - there[i]) / (stops.jerk[i] - stops.otherJerk[i]);
            row[i] =
                -direction.dot(speeds_.arm().isPrismatic(i) ? axis : axis.cross(fastest.point - frames.origin[i])) *
                (std::isfinite(slope) ? std::max(slope, 0.0) : tick_s_ * tick_s_);
        }
        addRow(row, fastest.speed - demand.ahead * part.limitThere + row.dot(stops.jerk), rows);
    });
}

}  // namespace viable::detail
