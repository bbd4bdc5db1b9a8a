#include "clearance/ArmStopCheck.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "robot/Segments.h"

namespace viable::detail {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/** Distance of neighbouring balls over their capsule's radius: the balls are then 3 % larger than the capsule. Long thin
capsules have kMaxGaps and fatter balls. */
constexpr double kBallSpacing = 0.5;
constexpr int kMaxGaps = 15;
/** A clearance that differs by less is the same: rounding of poses [m]. */
constexpr double kRounding_m = 1e-9;
/** The same for torques, as a share of their limit. */
constexpr double kTorqueRounding = 1e-9;
/** How far a joint is with the tick's jerk at a later time, where two stops of it do not tell, in tick^3: by the shortest
stops from rest. */
constexpr double kLeastSlope = 2.0;
/** Rows of one look at a path. */
constexpr int kMostClearanceRows = 12;

}  // namespace

ArmStopCheck::ArmStopCheck(const RobotDescription& robot, const ArmGeometry* geometry, const TorqueLimits& limits,
                           double tick_s)
    : n_(robot.size()),
      limits_(limits),
      tick_s_(tick_s),
      arm_(robot),
      torqueRate_(robot),
      limitsTorque_(!limits.torque.array().isInf().all()),
      limitsTorqueRate_(!limits.rate.array().isInf().all()),
      capsules_(geometry ? geometry->capsules : std::vector<LinkCapsule>{}),
      covers_(makeCovers(capsules_)),
      motion_(robot, capsules_, getRadii(covers_)),
      samples_(kDivisions + 1) {
    for (std::size_t i = 0; i < capsules_.size(); ++i)
        if (capsules_[i].carrier >= 0) elements_.push_back({static_cast<int>(i), -1, -1, {}, {}});
    if (geometry)
        for (const auto& [first, second] : geometry->pairs)
            elements_.push_back({first, second, motion_.findCommonCarrier(first, second), {}, {}});
    for (Sample& sample : samples_) sample.pose = motion_.makePose();
    places_.resize(elements_.size());
    rough_.resize(elements_.size());
    seen_.resize(elements_.size());
    proven_.resize(elements_.size());
    order_.resize(elements_.size());
    for (JointVector* v : {&position_, &velocity_, &acceleration_, &torque_, &torqueBefore_, &rate_}) v->setZero(n_);
    beginTick();
}

std::vector<ArmStopCheck::Cover> ArmStopCheck::makeCovers(const std::vector<LinkCapsule>& capsules) {
    std::vector<Cover> covers;
    for (const LinkCapsule& capsule : capsules) {
        Cover cover;
        const double length = (capsule.b - capsule.a).norm();
        const double wanted = std::ceil(length / (kBallSpacing * capsule.radius));
        cover.gaps = static_cast<int>(std::min<double>(wanted, kMaxGaps));
        cover.spacing = cover.gaps > 0 ? length / cover.gaps : 0.0;
        cover.radius = std::hypot(capsule.radius, cover.spacing / 2.0);
        cover.reach = length / 2.0 + cover.radius;
        covers.push_back(cover);
    }
    return covers;
}

std::vector<double> ArmStopCheck::getRadii(const std::vector<Cover>& covers) {
    std::vector<double> radii;
    for (const Cover& cover : covers) radii.push_back(cover.radius);
    return radii;
}

void ArmStopCheck::setMotion() {
    motion_.setPath(extremes_, getSample(0).pose);
    for (Element& element : elements_) {
        element.lever = motion_.lever(element.first);
        element.bend[0] = motion_.calcBend(element.first, element.base);
        if (element.second < 0) continue;
        element.bend[1] = motion_.calcBend(element.second, element.base);
        const JointVector& other = motion_.lever(element.second);
        for (int i = 0; i < n_; ++i)  // what moves both moves neither against the other
            element.lever[i] = element.lever[i] > 0.0 && other[i] > 0.0 ? 0.0 : element.lever[i] + other[i];
    }
}

/** The D of the class between two looks. */
double ArmStopCheck::calcReach(const Element& element, const Look& from, const Look& to) {
    const double byJoints = std::max(0.0, to.moved - from.moved);
    const double h = calcTime(to.sample) - calcTime(from.sample);
    if (h * h / 4.0 * (element.bend[0] + element.bend[1]) >= byJoints) return byJoints;
    const CapsuleMotion::Pose& a = samples_[static_cast<std::size_t>(from.sample)].pose;
    const CapsuleMotion::Pose& b = samples_[static_cast<std::size_t>(to.sample)].pose;
    double byEnds = motion_.calcReach(element.first, element.base, element.bend[0], a, b, h);
    if (element.second >= 0) byEnds += motion_.calcReach(element.second, element.base, element.bend[1], a, b, h);
    return std::min(byJoints, byEnds);
}

ArmStopCheck::Result ArmStopCheck::makeResult() const {
    Result result;
    result.seen.assign(elements_.size(), kInfinity);
    result.proven = result.seen;
    return result;
}

void ArmStopCheck::beginTick() {
    distances_ = kMaxDistances;
    torques_ = kMaxTorques;
    std::iota(order_.begin(), order_.end(), std::size_t{0});
}

const ArmStopCheck::Sample& ArmStopCheck::getSample(int at) {
    Sample& sample = samples_[static_cast<std::size_t>(at)];
    if (sample.isKnown) return sample;
    sample.isKnown = true;
    const double t = calcTime(at);
    path_->calcPositions(t, position_, sample.travel);
    motion_.calcPose(position_, sample.pose);
    return sample;
}

ArmStopCheck::Look ArmStopCheck::lookRoughly(int e, int at) {
    const Element& element = elements_[static_cast<std::size_t>(e)];
    const Cover& first = covers_[static_cast<std::size_t>(element.first)];
    const Sample& sample = getSample(at);
    const CapsuleMotion::Segment& segment = sample.pose.segments[static_cast<std::size_t>(element.first)];
    const Eigen::Vector3d middle = (segment.a + segment.b) / 2.0;
    --distances_;
    Look look;
    look.sample = at;
    for (int i = 0; i < n_; ++i) look.moved += element.lever[i] * sample.travel[i];
    if (element.second < 0) {
        look.ofMiddle = surroundings_->calcDistance(middle, time_s_);
        look.clearance = look.ofMiddle - first.reach;
    } else {
        const Cover& second = covers_[static_cast<std::size_t>(element.second)];
        const CapsuleMotion::Segment& other = sample.pose.segments[static_cast<std::size_t>(element.second)];
        look.clearance = (middle - (other.a + other.b) / 2.0).norm() - first.reach - second.reach;
    }
    return look;
}

void ArmStopCheck::look(int e, Look& look) {
    if (!look.isRough) return;
    look.isRough = false;
    const Element& element = elements_[static_cast<std::size_t>(e)];
    const Sample& sample = getSample(look.sample);
    const CapsuleMotion::Segment& segment = sample.pose.segments[static_cast<std::size_t>(element.first)];
    Place& nearest = places_[static_cast<std::size_t>(e)];
    if (element.second < 0) {
        const Cover& cover = covers_[static_cast<std::size_t>(element.first)];
        const int last = cover.gaps;
        const Eigen::Vector3d along =
            last > 0 ? Eigen::Vector3d((segment.b - segment.a) / last) : Eigen::Vector3d::Zero();
        double least = kInfinity;
        Eigen::Vector3d where = Eigen::Vector3d::Zero();
        const auto ask = [&](int k) {
            const Eigen::Vector3d p = segment.a + k * along;
            const double distance = surroundings_->calcDistance(p, time_s_);
            --distances_;
            if (!(distance >= least)) {
                least = distance;
                where = p;
            }
            return distance;
        };
        // From the nearer end to the other: no point is nearer than another's distance less the way between them.
        const double ofFirst = ask(0), ofLast = last > 0 ? ask(last) : ofFirst;
        const int step = ofFirst <= ofLast ? 1 : -1;
        double known = std::min(ofFirst, ofLast);
        for (int k = step > 0 ? 1 : last - 1, at = k - step; k > 0 && k < last; k += step) {
            const double bound = std::max({known - std::abs(k - at) * cover.spacing,
                                           look.ofMiddle - std::abs(k - 0.5 * last) * cover.spacing,
                                           std::max(ofFirst, ofLast) - (step > 0 ? last - k : k) * cover.spacing});
            if (bound >= least) continue;
            known = ask(k);
            at = k;
        }
        look.clearance = least - cover.radius;
        if (!(look.clearance < nearest.distance)) return;
        const Surroundings::Nearest found = surroundings_->findNearest(where, time_s_);
        nearest = {look.clearance, look.sample, found.obstacle, found.gradient, where - cover.radius * found.gradient,
                   where};
        if (std::isfinite(found.distance)) nearest.onSecond -= found.distance * found.gradient;
        return;
    }
    const LinkCapsule& a = capsules_[static_cast<std::size_t>(element.first)];
    const LinkCapsule& b = capsules_[static_cast<std::size_t>(element.second)];
    --distances_;
    Eigen::Vector3d onA, onB;
    const CapsuleMotion::Segment& other = sample.pose.segments[static_cast<std::size_t>(element.second)];
    findNearestPoints(segment.a, segment.b, other.a, other.b, onA, onB);
    const Eigen::Vector3d apart = onA - onB;
    const double distance = apart.norm();
    look.clearance = distance - a.radius - b.radius;
    if (!(look.clearance < nearest.distance)) return;
    const Eigen::Vector3d direction = distance > 0.0 ? Eigen::Vector3d(apart / distance) : Eigen::Vector3d::Zero();
    nearest = {look.clearance, look.sample, -1, direction, onA - a.radius * direction, onB + b.radius * direction};
}

/** Between these two looks no more is looked at. */
void ArmStopCheck::settle(const Question& q, double bound, const Look& from, const Look& to) {
    const auto e = static_cast<std::size_t>(q.element);
    proven_[e] = std::min(proven_[e], bound);
    seen_[e] = std::min({seen_[e], from.clearance, to.clearance});
    for (const Look* look : {&from, &to})
        if (look->isRough && look->clearance < rough_[e].clearance) rough_[e] = *look;
}

/** Between two looks: see the class. */
void ArmStopCheck::prove(const Question& q, Look& from, Look& to) {
    const double reach = calcReach(elements_[static_cast<std::size_t>(q.element)], from, to);
    const double enough = q.ahead + reach / 2.0;
    if (distances_ > 0 && !(from.clearance >= enough)) look(q.element, from);
    if (distances_ > 0 && !(to.clearance >= enough)) look(q.element, to);
    // A look is a lower bound; so is its neighbour's, less what can have changed.
    from.clearance = std::max(from.clearance, to.clearance - reach);
    to.clearance = std::max(to.clearance, from.clearance - reach);
    const double bound = (from.clearance + to.clearance - reach) / 2.0;
    if (bound >= q.ahead) return settle(q, bound, from, to);
    const double lowest = std::min(from.clearance, to.clearance);
    const bool keepsLeast = lowest >= q.least - kRounding_m;
    if (keepsLeast && bound >= q.floor - kRounding_m && reach <= 2.0 * kGuard_m) return settle(q, bound, from, to);
    const int middle = (from.sample + to.sample) / 2;
    // What is not kept need not be known to the last look: a place to steer away from is enough.
    const bool isTold = !keepsLeast && bound >= lowest - kGuard_m;
    if (isTold || middle == from.sample || distances_ <= 0 || !(lowest > -kInfinity)) {
        if (!keepsLeast || !(bound >= q.floor - kRounding_m)) isProven_ = false;
        return settle(q, bound, from, to);
    }
    Look between = lookRoughly(q.element, middle);
    prove(q, from, between);
    prove(q, between, to);
}

void ArmStopCheck::examine(const ArmPath& path, double time_s, const Demands& demands, const JointVector& lastTorque,
                           bool mustBeGood, Result& result) {
    path_ = &path;
    time_s_ = time_s;
    path.calcExtremes(extremes_);
    for (Sample& sample : samples_) sample.isKnown = false;
    if (!elements_.empty()) setMotion();
    isProven_ = true;
    result.isAhead = true;
    for (std::size_t k = 0; k < elements_.size(); ++k) {
        const std::size_t e = order_[k];
        places_[e] = {};
        rough_[e] = {};
        seen_[e] = proven_[e] = kInfinity;
        if (elements_[e].second < 0 && !surroundings_) continue;
        const int index = static_cast<int>(e);
        Look begin = lookRoughly(index, 0);
        Look end = lookRoughly(index, kDivisions);
        Question question{index, demands.floor[e], demands.least[e], demands.ahead[e]};
        if (!(begin.clearance >= question.least)) {
            if (distances_ > 0) look(index, begin);
            if (demands.beginsAbove) begin.clearance = std::max(begin.clearance, question.floor);
            question.least = std::min(question.least, begin.clearance);  // where the arm is it is
        }
        prove(question, begin, end);
        if (seen_[e] < demands.ahead[e]) result.isAhead = false;
        if (isProven_ || !mustBeGood) continue;
        std::rotate(order_.begin(), order_.begin() + static_cast<std::ptrdiff_t>(k),
                    order_.begin() + static_cast<std::ptrdiff_t>(k) + 1);
        result.isClear = result.isAhead = result.bearsTorque = false;
        return;
    }
    result.isClear = isProven_;
    result.seen = seen_;
    result.proven = proven_;
    findNearest(result);
    examineTorque(demands.torqueUse, lastTorque, result);
}

/** Of what was only seen roughly the lowest is looked at until none that is left is lower (of each element one is known). */
void ArmStopCheck::findNearest(Result& result) {
    result.nearest = {};
    if (elements_.empty()) return;
    for (;;) {
        std::size_t nearest = 0;
        double least = kInfinity;
        bool isRough = false;
        for (std::size_t e = 0; e < elements_.size(); ++e) {
            const double now = std::min(places_[e].distance, rough_[e].clearance);
            if (now >= least) continue;
            least = now;
            nearest = e;
            isRough = rough_[e].clearance < places_[e].distance;
        }
        if (!(least < kInfinity)) return;
        if (!isRough || distances_ <= 0) {
            if (!isRough) result.nearest = getNearest(static_cast<int>(nearest));
            return;
        }
        look(static_cast<int>(nearest), rough_[nearest]);
        rough_[nearest] = {};
    }
}

Clearance ArmStopCheck::getNearest(int e) const {
    const Element& element = elements_[static_cast<std::size_t>(e)];
    const Place& place = places_[static_cast<std::size_t>(e)];
    const auto getLink = [&](int capsule) {
        return capsule < 0 ? -1 : capsules_[static_cast<std::size_t>(capsule)].link;
    };
    return {place.isSeen(),          place.distance, getLink(element.first), place.obstacle,
            getLink(element.second), place.onFirst,  place.onSecond};
}

void ArmStopCheck::calcTorque(const ArmPath& path, std::int64_t tick, JointVector& torque) {
    path.calcTick(tick, position_, velocity_, acceleration_);
    arm_.calcTorque(position_, velocity_, acceleration_, torque);
}

void ArmStopCheck::examineTorque(double torqueUse, const JointVector& lastTorque, Result& result) {
    result.torqueUse = 0.0;
    result.bearsTorque = true;
    torqueFaultCount_ = 0;
    if (!limitsTorque_ && !limitsTorqueRate_) return;
    torqueRate_.calcBound(extremes_, rate_);
    // Where the torque cannot change faster than allowed nobody need look at its changes.
    const bool looksAtChanges = limitsTorqueRate_ && !(rate_.array() <= limits_.rate.array()).all();
    const bool measures = std::isinf(torqueUse);
    torqueBefore_ = lastTorque;
    const std::int64_t last = path_->ticks();
    for (std::int64_t tick = 0;;) {
        if (--torques_ < 0) {
            result.bearsTorque = false;
            return;
        }
        calcTorque(*path_, tick, torque_);
        const double most = (measures ? std::max(1.0, result.torqueUse) : torqueUse) + kTorqueRounding;
        double free = static_cast<double>(last);
        for (int i = 0; i < n_; ++i) {
            const double limit = limits_.torque[i];
            const double use = std::abs(torque_[i]) / limit;
            const double change = looksAtChanges || tick == 0
                                      ? std::abs(torque_[i] - torqueBefore_[i]) / (limits_.rate[i] * tick_s_)
                                      : 0.0;
            result.torqueUse = std::max({result.torqueUse, use, change});
            free = std::min(free, (most * limit - std::abs(torque_[i])) / (rate_[i] * tick_s_));
            if (measures || (use <= most && change <= most)) continue;
            result.bearsTorque = false;
            if (use > most && torqueFaultCount_ < static_cast<int>(torqueFaults_.size()))
                torqueFaults_[static_cast<std::size_t>(torqueFaultCount_++)] = {tick, i, torque_[i]};
        }
        if (!result.bearsTorque || tick >= last) return;
        torqueBefore_ = torque_;
        const bool maySkip = !looksAtChanges && free >= 1.0;
        tick = std::min(last, tick + (maySkip ? static_cast<std::int64_t>(free) : 1));
    }
}

void ArmStopCheck::addRows(const JointVector& jerk, const ArmPath& other, const JointVector& otherJerk,
                           const Demands& demands, RowQp::Rows& rows) const {
    // The nearest first, should there be no room for all.
    double above = -kInfinity;
    for (int k = 0; k < kMostClearanceRows; ++k) {
        std::size_t next = elements_.size();
        double missing = kInfinity;
        for (std::size_t e = 0; e < elements_.size(); ++e) {
            const double room = places_[e].distance - demands.ahead[e];
            if (room < 0.0 && room > above && room < missing) {
                missing = room;
                next = e;
            }
        }
        if (next == elements_.size()) break;
        above = missing;
        addClearanceRow(places_[next], elements_[next], demands.ahead[next], jerk, other, otherJerk, rows);
    }
    for (int k = 0; k < torqueFaultCount_; ++k)
        addTorqueRow(torqueFaults_[static_cast<std::size_t>(k)], demands.torqueUse, jerk, other, otherJerk, rows);
}

/** c + sum_i gradient . (dp/dq_i) (dq_i/du_i) (u_i - jerk_i) >= bound, all at the nearest place; dq_i/du_i by the
difference of the two paths there. */
void ArmStopCheck::addClearanceRow(const Place& place, const Element& element, double bound, const JointVector& jerk,
                                   const ArmPath& other, const JointVector& otherJerk, RowQp::Rows& rows) const {
    const ArmRecursion::Frames& frames = samples_[static_cast<std::size_t>(place.sample)].pose.frames;
    const double t = calcTime(place.sample);
    JointVector here, there;
    path_->calcPositions(t, here);
    other.calcPositions(std::min(t, other.duration()), there);
    const int first = capsules_[static_cast<std::size_t>(element.first)].carrier;
    const int second = element.second < 0 ? -1 : capsules_[static_cast<std::size_t>(element.second)].carrier;
    JointVector row = JointVector::Zero(n_);
    for (int i = 0; i < n_; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const auto calcMotion = [&](int carrier, const Eigen::Vector3d& p) -> double {
            if (carrier < 0 || !arm_.moves(i, carrier)) return 0.0;
            const Eigen::Vector3d& axis = frames.axis[at];
            return place.gradient.dot(arm_.isPrismatic(i) ? axis : axis.cross(p - frames.origin[at]));
        };
        const double motion = calcMotion(first, place.onFirst) - calcMotion(second, place.onSecond);
        const double slope = (here[i] - there[i]) / (jerk[i] - otherJerk[i]);
        row[i] = motion * (std::isfinite(slope) && slope > 0.0 ? slope : kLeastSlope * tick_s_ * tick_s_ * tick_s_);
    }
    const double size = row.norm();
    if (!(size > 0.0)) return;  // nothing that the arm does now changes it
    rows.add(row / size, (bound - place.distance + row.dot(jerk)) / size);
}

/** The torque at a tick of the stop, by its accelerations. */
void ArmStopCheck::addTorqueRow(const TorqueFault& fault, double torqueUse, const JointVector& jerk,
                                const ArmPath& other, const JointVector& otherJerk, RowQp::Rows& rows) const {
    const double t = static_cast<double>(fault.tick) * tick_s_;
    const double middle = t + tick_s_ / 2.0;  // the torque of a tick is that of its mean acceleration
    JointVector q;
    path_->calcPositions(t, q);
    JointMatrix M;
    arm_.calcInertia(q, M);
    JointVector row = JointVector::Zero(n_);
    for (int i = 0; i < n_; ++i) {
        const double here = path_->calcAcceleration(i, middle);
        const double there = other.calcAcceleration(i, middle);
        const double slope = (here - there) / (jerk[i] - otherJerk[i]);
        row[i] = M(fault.joint, i) * (std::isfinite(slope) ? slope : tick_s_ / 2.0);
    }
    if (fault.torque > 0.0) row = -row;
    const double size = row.norm();
    if (!(size > 0.0)) return;
    const double missing = std::abs(fault.torque) - torqueUse * limits_.torque[fault.joint];
    rows.add(row / size, (missing + row.dot(jerk)) / size);
}

void ArmStopCheck::addTickRows(const Dynamics& dynamics, const JointVector& qdd, double torqueUse,
                               const JointVector& lastTorque, RowQp::Rows& rows) const {
    for (int i = 0; i < n_; ++i) {
        const double change = torqueUse * limits_.rate[i] * tick_s_;
        const double upper = std::min(torqueUse * limits_.torque[i], lastTorque[i] + change);
        const double lower = std::max(-torqueUse * limits_.torque[i], lastTorque[i] - change);
        const JointVector row = dynamics.M.row(i).transpose() * (tick_s_ / 2.0);
        const double size = row.norm();
        const double rest = dynamics.M.row(i).dot(qdd) + dynamics.b[i];
        if (std::isfinite(lower)) rows.add(row / size, (lower - rest) / size);
        if (std::isfinite(upper)) rows.add(-row / size, (rest - upper) / size);
    }
}

}  // namespace viable::detail
