#include "clearance/SpeedCheck.h"

#include <algorithm>
#include <cmath>

#include "clearance/SteeringRows.h"
#include "viable/core/Numbers.h"

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

std::vector<double> getRadii(const std::vector<LinkCapsule>& capsules) {
    std::vector<double> radii;
    for (const LinkCapsule& capsule : capsules) radii.push_back(capsule.radius);
    return radii;
}

}  // namespace

std::vector<LinkCapsule> SpeedCheck::listCapsules(const RobotDescription& robot, const ArmGeometry* geometry) {
    std::vector<LinkCapsule> capsules;
    if (geometry && robot.speedLimits.needsCapsules())
        for (const LinkCapsule& capsule : geometry->capsules)
            if (capsule.carrier >= 0) capsules.push_back(capsule);
    if (robot.speedLimits.tool < kInfinity)
        capsules.push_back(
            {-1, robot.toolParent, robot.toolPlacement.translation(), robot.toolPlacement.translation(), 0.0});
    return capsules;
}

SpeedCheck::SpeedCheck(const RobotDescription& robot, const ArmGeometry* geometry, double tick_s)
    : n_(robot.size()),
      tick_s_(tick_s),
      limits_(robot.speedLimits),
      arm_(robot),
      capsules_(listCapsules(robot, geometry)),
      motion_(robot, capsules_, getRadii(capsules_)),
      pose_(motion_.makePose()),
      position_(JointVector::Zero(n_)),
      velocity_(JointVector::Zero(n_)) {
    for (const LinkCapsule& capsule : capsules_) {
        const bool isCapsule = capsule.link >= 0;
        Part part;
        part.radius = capsule.radius;
        part.limit = isCapsule ? limits_.arm : limits_.tool;
        part.carrier = capsule.carrier;
        part.link = capsule.link;
        part.isCapsule = isCapsule;
        parts_.push_back(part);
    }
    const auto prepare = [this](Look& look) {
        look.speeds.assign(parts_.size(), 0.0);
        look.segments.resize(parts_.size());
    };
    for (Look* look : {&begin_, &first_, &end_}) prepare(*look);
    for (Look& look : middle_) prepare(look);
}

void SpeedCheck::calcTwists(double time_s) {
    path_->calcMotion(time_s, position_, velocity_);
    motion_.calcPose(position_, pose_);
    const ArmRecursion::Frames& frames = pose_.frames;
    for (int i = 0; i < n_; ++i) {
        const auto at = static_cast<std::size_t>(i);
        Eigen::Vector3d turning = Eigen::Vector3d::Zero(), moving = turning;
        if (const int parent = arm_.parent(i); parent >= 0) {
            const auto before = static_cast<std::size_t>(parent);
            turning = twists_.turning[before];
            moving = twists_.moving[before] + turning.cross(frames.origin[at] - frames.origin[before]);
        }
        (arm_.isPrismatic(i) ? moving : turning) += velocity_[i] * frames.axis[at];
        twists_.turning[at] = turning;
        twists_.moving[at] = moving;
    }
}

SpeedCheck::Fastest SpeedCheck::calcFastest(std::size_t k) const {
    const auto carrier = static_cast<std::size_t>(parts_[k].carrier);
    const double radius = parts_[k].radius;
    const Eigen::Vector3d& turning = twists_.turning[carrier];
    const double rate = turning.norm();
    const Eigen::Vector3d axis = rate > 0.0 ? Eigen::Vector3d(turning / rate) : Eigen::Vector3d::UnitZ();
    Fastest fastest;
    fastest.speed = -1.0;
    for (const Eigen::Vector3d& centre : {pose_.segments[k].a, pose_.segments[k].b}) {
        const Eigen::Vector3d velocity = twists_.moving[carrier] + turning.cross(centre - pose_.frames.origin[carrier]);
        const Eigen::Vector3d along = velocity.dot(axis) * axis, across = velocity - along;
        const double size = across.norm();
        const Eigen::Vector3d direction = size > 0.0 ? Eigen::Vector3d(across / size) : axis.unitOrthogonal();
        const Eigen::Vector3d ofPoint = along + (size + rate * radius) * direction;
        const double speed = ofPoint.norm();
        if (!(speed <= fastest.speed)) fastest = {speed, centre + radius * direction.cross(axis), ofPoint};
    }
    return fastest;
}

double SpeedCheck::findLimit(const Part& part, const CapsuleMotion::Segment& segment, double margin) const {
    double limit = part.limit;
    if (part.isCapsule)
        for (const SpeedLimits::Region& region : limits_.regions)
            if (region.speed < limit && isInBox(segment, region, part.radius + margin)) limit = region.speed;
    return limit;
}

/** False: it is over, as a look was too fast. */
bool SpeedCheck::look(double time_s, bool isBegin, Look& look) {
    --left_;
    --leftOfPath_;
    look.time_s = time_s;
    calcTwists(time_s);
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        Part& part = parts_[k];
        look.segments[k] = pose_.segments[k];
        look.speeds[k] = calcFastest(k).speed;
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
    ArmSpeed fastest;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        const Part& part = parts_[k];
        const double bound = std::max(from.speeds[k], to.speeds[k]) + h * h / 8.0 * part.bendRate;
        const double margin = bound * h / 2.0;
        const double limit =
            std::min(findLimit(part, from.segments[k], margin), findLimit(part, to.segments[k], margin));
        const double use = bound / limit;
        if (use < most || (use == most && bound <= fastest.speed)) continue;
        most = use;
        fastest = {true, bound, limit, part.link};
    }
    const auto settle = [&] {
        const bool isFirst = !result_->fastest.isKnown;
        if (isFirst || most > result_->proven || (most == result_->proven && fastest.speed > result_->fastest.speed)) {
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
    Look& middle = middle_[static_cast<std::size_t>(depth)];
    return look((from.time_s + to.time_s) / 2.0, false, middle) && prove(from, middle, depth + 1) &&
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
    look(0.0, true, begin_);
    motion_.setPath(extremes, pose_);
    for (std::size_t k = 0; k < parts_.size(); ++k) parts_[k].bendRate = motion_.calcBendRate(static_cast<int>(k));
    // The end of the tick is where the next path begins.
    if (look(tick_s_, false, first_) && prove(begin_, first_, 0) && path.duration() > tick_s_ &&
        look(path.duration(), false, end_))
        prove(first_, end_, 0);
}

void SpeedCheck::addRows(const StopPair& stops, const Demand& demand, RowQp::Rows& rows) {
    JointVector there, row(n_);
    double last = kInfinity;
    for (std::size_t before = parts_.size();;) {
        std::size_t k = parts_.size();
        for (std::size_t next = 0; next < parts_.size(); ++next) {
            const bool isLeft = parts_[next].use < last || (parts_[next].use == last && next > before);
            if (isLeft && (k == parts_.size() || parts_[next].use > parts_[k].use)) k = next;
        }
        if (k == parts_.size() || !(parts_[k].use > demand.ahead)) return;
        const Part& part = parts_[k];
        last = part.use;
        before = k;
        stops.other.calcMotion(std::min(part.time_s, stops.other.duration()), position_, there);
        path_ = &stops.path;
        calcTwists(part.time_s);
        const Fastest fastest = calcFastest(k);
        if (!(fastest.speed > 0.0)) continue;
        const Eigen::Vector3d direction = fastest.velocity / fastest.speed;
        for (int i = 0; i < n_; ++i) {
            const auto at = static_cast<std::size_t>(i);
            row[i] = 0.0;
            if (!arm_.moves(i, part.carrier)) continue;
            const Eigen::Vector3d& axis = pose_.frames.axis[at];
            const double slope = (velocity_[i] - there[i]) / (stops.jerk[i] - stops.otherJerk[i]);
            row[i] = -direction.dot(arm_.isPrismatic(i) ? axis : axis.cross(fastest.point - pose_.frames.origin[at])) *
                     (std::isfinite(slope) ? std::max(slope, 0.0) : tick_s_ * tick_s_);
        }
        const double size = row.norm();
        const double bound = fastest.speed - demand.ahead * part.limitThere + row.dot(stops.jerk);
        if (size > 0.0) rows.add(row / size, bound / size);
    }
}

}  // namespace viable::detail
