#include "clearance/PeopleCheck.h"

#include <cmath>

#include "clearance/SteeringRows.h"
#include "robot/Segments.h"

namespace viable::detail {

namespace {

/** Pairs that keep so much more than is asked for are not told apart [m]. */
constexpr double kFarFromPeople_m = 0.3;
/** How much later a joint rests with the tick's jerk, in ticks over the jerk of its stop: between these. */
constexpr double kLeastLater = 1.0, kMostLater = 8.0;

}  // namespace

PeopleCheck::PeopleCheck(const RobotDescription& robot, const ArmGeometry* geometry, int people, double tick_s)
    : n_(robot.size()),
      people_(people),
      tick_s_(tick_s),
      speeds_(robot, geometry && people > 0 ? listMoved(*geometry) : std::vector<LinkCapsule>()),
      parts_(speeds_.size()),
      growth_(static_cast<std::size_t>(people)),
      speed_(static_cast<std::size_t>(people)) {
    for (std::size_t k = 0; k < speeds_.size(); ++k)
        for (int p = 0; p < people; ++p) pairs_.push_back({static_cast<int>(k), p, 0.0, 0.0, 0.0});
    const auto prepare = [this](Look& look) {
        look.travel = JointVector::Zero(n_);
        look.segments.resize(speeds_.size());
        look.speeds.assign(speeds_.size(), 0.0);
        look.distances.assign(pairs_.size(), 0.0);
    };
    for (Look* look : {&begin_, &first_, &end_}) prepare(*look);
    for (Look& look : middle_) prepare(look);
    for (std::vector<int>& open : open_) open.reserve(pairs_.size());
    inQuestion_.reserve(pairs_.size());
}

void PeopleCheck::setKnown(const PeopleWatch& watch, double time_s) {
    watch_ = &watch;
    for (std::size_t p = 0; p < growth_.size(); ++p) {
        const PeopleWatch::Known& known = watch.known()[p];
        growth_[p] = known.calcGrowth(time_s);
        speed_[p] = known.speed;
    }
}

/** Of the capsule from the person's bodies, or a lower bound where that is far enough [m]. */
double PeopleCheck::calcDistance(const Pair& pair, const CapsuleMotion::Segment& segment, double radius,
                                 double rest_s) const {
    const PeopleWatch::Known& known = watch_->known()[pair.person];
    const double roughly = calcPointDistance(known.centre, segment.a, segment.b) - known.size_m - radius;
    if (roughly - calcReach(pair.person, rest_s) > demand_.ahead + kFarFromPeople_m) return roughly;
    double least = kInfinity;
    for (int k = 0; k < known.count; ++k) {
        const PeopleWatch::Body& body = known.bodies[k];
        least = std::min(least, calcSegmentDistance(segment.a, segment.b, body.a, body.b) - body.radius);
    }
    return least - radius;
}

void PeopleCheck::settle(const Pair& pair, double bound) {
    if (bound >= result_->proven) return;
    result_->proven = bound;
    result_->person = pair.person;
    result_->link = speeds_.capsule(static_cast<std::size_t>(pair.capsule)).link;
}

/** False: it is over, as a look was too near. */
bool PeopleCheck::sample(double time_s, bool isBegin, const std::vector<int>& open, Look& look) {
    --left_;
    --leftOfPath_;
    look.time_s = time_s;
    speeds_.sample(*path_, time_s);
    path_->calcPositions(time_s, position_, look.travel);
    for (std::size_t k = 0; k < speeds_.size(); ++k) {
        look.segments[k] = speeds_.pose().segments[k];
        look.speeds[k] = speeds_.calcFastest(k).speed;
    }
    for (const int index : open) {
        Pair& pair = pairs_[index];
        const auto k = static_cast<std::size_t>(pair.capsule);
        const double rest_s = parts_[k].rest_s;
        const double distance = calcDistance(pair, look.segments[k], speeds_.capsule(k).radius, rest_s);
        look.distances[index] = distance;
        if (isBegin) continue;  // no jerk changes that
        const double contactSpeed = watch_->known()[pair.person].contactSpeed;
        // At its end a capsule is as near as it was when it came to rest.
        const double then = std::min(time_s, rest_s);
        if (contactSpeed > 0.0 && look.speeds[k] <= contactSpeed * (1.0 - kSpeedGuard)) continue;
        const double m = distance - calcReach(pair.person, then);
        pair.lastFast_s = std::max(pair.lastFast_s, then);
        if (m < pair.least) {
            pair.least = m;
            pair.time_s = then;
        }
        result_->seen = std::min(result_->seen, m);
        if (m >= demand_.least) continue;
        result_->isKept = false;
        settle(pair, m);
    }
    return result_->isKept || !mustBeGood_;
}

/** False: it is over. */
bool PeopleCheck::prove(const Look& from, const Look& to, int depth, const std::vector<int>& open) {
    const double h = to.time_s - from.time_s;
    std::vector<int>& left = open_[depth];
    left.clear();
    const bool isLast = depth > kDepth - 1 || left_ <= 0 || leftOfPath_ <= 0;
    for (const int index : open) {
        const Pair& pair = pairs_[index];
        const auto k = static_cast<std::size_t>(pair.capsule), at = static_cast<std::size_t>(index);
        const Capsule& part = parts_[k];
        if (from.time_s >= part.rest_s) continue;
        const double contactSpeed = watch_->known()[pair.person].contactSpeed;
        if (contactSpeed > 0.0 && std::max(from.speeds[k], to.speeds[k]) + h * h / 8.0 * part.bendRate <= contactSpeed)
            continue;
        const CapsuleMotion::Segment &was = from.segments[k], &is = to.segments[k];
        const double chord = std::sqrt(std::max((is.a - was.a).squaredNorm(), (is.b - was.b).squaredNorm()));
        const double levers = speeds_.motion().lever(pair.capsule).dot(to.travel - from.travel);
        const double way = std::min(levers, chord + h * h / 4.0 * part.bend);
        const double reach = calcReach(pair.person, std::min(to.time_s, part.rest_s));
        const double bound = (from.distances[at] + to.distances[at] - way) / 2.0 - reach;
        const bool isFar = bound > 0.0 && (bound >= demand_.ahead || bound >= pair.least / 2.0);
        // A path that is too near is not looked at to the last: where it is nearest is known well enough.
        const bool isTold = !result_->isKept && bound >= result_->seen - kGuard_m;
        if (!isFar && !isTold && !isLast) {
            left.push_back(index);
            continue;
        }
        if (!(bound > 0.0)) result_->isKept = false;
        settle(pair, bound);
    }
    if (!result_->isKept && mustBeGood_) return false;
    if (left.empty()) return true;
    Look& middle = middle_[depth];
    // The list of this depth lives until both halves are done: they use those of the next ones.
    return sample((from.time_s + to.time_s) / 2.0, false, left, middle) && prove(from, middle, depth + 1, left) &&
           prove(middle, to, depth + 1, left);
}

void PeopleCheck::examine(const ArmPath& path, const ArmPath::Extremes& extremes, const Demand& demand, bool mustBeGood,
                          Result& result) {
    result = {};
    if (!isAny() || !watch_) return;
    path_ = &path;
    extremes_ = extremes;
    demand_ = demand;
    mustBeGood_ = mustBeGood;
    result_ = &result;
    leftOfPath_ = kMostOfPath;
    for (std::size_t k = 0; k < speeds_.size(); ++k) {
        Capsule& part = parts_[k];
        part.rest_s = 0.0;
        part.lastJoint = -1;
        for (int i = 0; i < n_; ++i) {
            if (!speeds_.arm().moves(i, speeds_.capsule(k).carrier)) continue;
            const double rest_s = path.calcRestTime(i);
            if (!(rest_s > part.rest_s)) continue;
            part.rest_s = rest_s;
            part.lastJoint = i;
        }
    }
    std::vector<int>& all = open_.back();
    all.clear();
    for (std::size_t index = 0; index < pairs_.size(); ++index) {
        Pair& pair = pairs_[index];
        pair.least = kInfinity;
        pair.time_s = pair.lastFast_s = 0.0;
        const bool moves = parts_[pair.capsule].rest_s > 0.0;
        if (moves && watch_->known()[pair.person].isKnown) all.push_back(static_cast<int>(index));
    }
    if (all.empty()) return;
    sample(0.0, true, all, begin_);
    speeds_.setPath(extremes);
    for (std::size_t k = 0; k < speeds_.size(); ++k) {
        parts_[k].bend = speeds_.motion().calcBend(static_cast<int>(k), -1);
        parts_[k].bendRate = speeds_.motion().calcBendRate(static_cast<int>(k));
    }
    // What cannot come near on all of the path is not looked at again.
    inQuestion_.clear();
    for (const int index : all) {
        const Pair& pair = pairs_[index];
        const double rest_s = parts_[pair.capsule].rest_s;
        const double bound = begin_.distances[index] - speeds_.motion().lever(pair.capsule).dot(extremes.travel) -
                             calcReach(pair.person, rest_s);
        if (bound > demand.ahead) {
            result.seen = std::min(result.seen, bound);
            settle(pair, bound);
        } else {
            inQuestion_.push_back(index);
        }
    }
    if (inQuestion_.empty()) return;
    // The end of the tick is where the next path begins. Where the path ends people have come nearest.
    if (path.duration() > tick_s_ && !sample(path.duration(), false, inQuestion_, end_)) return;
    if (sample(tick_s_, false, inQuestion_, first_) && prove(begin_, first_, 0, inQuestion_) &&
        path.duration() > tick_s_)
        prove(first_, end_, 0, inQuestion_);
}

void PeopleCheck::addRows(const StopPair& stops, const Demand& demand, RowQp::Rows& rows) {
    if (!isAny() || !watch_) return;
    const auto calcKey = [&](std::size_t at) {
        const double least = pairs_[inQuestion_[at]].least;
        return least < demand.ahead ? least : kInfinity;
    };
    forLeast(inQuestion_.size(), kMostRows, calcKey, [&](std::size_t at) {
        const Pair& pair = pairs_[inQuestion_[at]];
        const PeopleWatch::Known& known = watch_->known()[pair.person];
        speeds_.sample(stops.path, pair.time_s);
        const CapsuleMotion::Segment& segment = speeds_.pose().segments[pair.capsule];
        ElementDistance::Place place;
        for (int j = 0; j < known.count; ++j) {
            const PeopleWatch::Body& body = known.bodies[j];
            Eigen::Vector3d onArm, onBody;
            findNearestPoints(segment.a, segment.b, body.a, body.b, onArm, onBody);
            const Eigen::Vector3d apart = onArm - onBody;
            const double distance = apart.norm();
            if (!(distance - body.radius < place.distance)) continue;
            place.distance = distance - body.radius;
            place.gradient = distance > 0.0 ? Eigen::Vector3d(apart / distance) : Eigen::Vector3d::Zero();
            place.onFirst = onArm;
        }
        calcDistanceGradient(place, {pair.capsule, -1}, speeds_.capsules(), speeds_.arm(), speeds_.pose().frames, row_);
        multiplyPlaceSlopes(stops, pair.time_s, tick_s_, row_);
        // Where it is met last, it is met later by what the last of its joints rests later.
        if (const int last = parts_[pair.capsule].lastJoint; last >= 0 && pair.time_s >= pair.lastFast_s) {
            const double unit = tick_s_ / std::max(extremes_.jerk[last], 1e-9);
            const double change = stops.jerk[last] - stops.otherJerk[last];
            const double later = (stops.path.calcRestTime(last) - stops.other.calcRestTime(last)) / std::abs(change);
            // It rests later the more the jerk points along its way.
            const double size = std::isfinite(later)
                                    ? std::clamp(std::abs(later), kLeastLater * unit, kMostLater * unit)
                                    : kLeastLater * unit;
            const double way = stops.path.calcPosition(last, pair.time_s) - stops.path.calcPosition(last, 0.0);
            row_[last] -= std::copysign(known.speed * size, way);
        }
        addRow(row_, demand.ahead - pair.least + row_.dot(stops.jerk), rows);
    });
}

}  // namespace viable::detail
