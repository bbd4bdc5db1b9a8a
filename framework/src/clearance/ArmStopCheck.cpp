#include "clearance/ArmStopCheck.h"

#include <numeric>

namespace viable::detail {

namespace {

/** Jerks whose part across what bars them is no more than this lead along it. */
constexpr double kAlong = 0.1;

/** Rows of one look at a path. */
constexpr int kMostClearanceRows = 12;
/** A clearance counts as known while the paths since it was looked at have moved by no more than this share of what is left of
it: what is asked of the next path, StopDemands::raise, follows from what is known. */
constexpr double kLargestLoss = 0.1;
/** Rounding of times [s]. */
constexpr double kSameTime_s = 1e-9;

}  // namespace

ArmStopCheck::ArmStopCheck(const RobotDescription& robot, const ArmGeometry* geometry, const TorqueScan::Limits& limits,
                           double tick_s, const ArmGeometry* limited, int people)
    : n_(robot.size()),
      capsules_(geometry ? geometry->capsules : std::vector<LinkCapsule>{}),
      elements_(geometry ? makeElements(*geometry) : std::vector<ArmElement>{}),
      distance_(capsules_),
      motion_(robot, capsules_, distance_.getRadii(), elements_),
      torque_(robot, limits, tick_s),
      speed_(robot, limited, tick_s),
      people_(robot, limited, people, tick_s),
      rows_(robot, capsules_, limits, tick_s),
      tick_s_(tick_s),
      isLooked_(elements_.size()),
      places_(elements_.size()),
      found_(elements_.size()),
      order_(elements_.size()),
      failedAt_(elements_.size()),
      profile_(elements_.size()),
      near_(elements_.size()) {
    beginTick();
}

ArmStopCheck::Result ArmStopCheck::makeResult() const {
    Result result;
    result.seen.assign(elements_.size(), kInfinity);
    result.proven = result.seen;
    result.profile.resize(elements_.size());
    result.near.resize(elements_.size());
    result.torque.proven = JointVector::Constant(n_, kInfinity);
    return result;
}

void ArmStopCheck::beginTick() {
    distances_ = kMaxDistances;
    torque_.beginTick();
    speed_.beginTick();
    people_.beginTick();
    std::fill(failedAt_.begin(), failedAt_.end(), -1);
    std::iota(order_.begin(), order_.end(), std::size_t{0});
}

bisection::Bounds ArmStopCheck::Profile::find(double from_s, double to_s, double apart) const {
    bisection::Bounds least;
    const auto getPart = [&](double t_s) {
        const double part = (t_s - begin_s) / duration_s * bisection::Result::kParts;
        return static_cast<std::size_t>(std::clamp(part, 0.0, bisection::Result::kParts - 1.0));
    };
    const std::size_t last = getPart(to_s + kSameTime_s);
    for (std::size_t k = getPart(from_s - kSameTime_s); k <= last; ++k) least.include(parts[k]);
    return {least.seen - lost - apart, least.proven - lost - apart};
}

class ArmStopCheck::Subject {
public:
    Subject(ArmStopCheck& check, std::size_t e)
        : check_(check),
          element_(check.elements_[e]),
          place_(check.places_[e]),
          index_(static_cast<int>(e)),
          radius_(check.distance_.getRadius(element_)) {}

    bool hasBudget() const { return check_.hasBudget(); }
    double radius() const { return radius_; }
    bisection::Bounds findKnown(int from, int to) const {
        if (!check_.source_) return {-kInfinity, -kInfinity};
        const double begin_s = static_cast<double>(check_.source_->begin) * check_.tick_s_;
        return check_.source_->result.profile[index_].find(begin_s + check_.motion_.calcTime(from),
                                                           begin_s + check_.motion_.calcTime(to), check_.apart_m_);
    }
    bisection::Travel calcTravel(const bisection::Look& from, const bisection::Look& to) {
        return check_.motion_.calcTravel(index_, from.sample, to.sample);
    }
    bisection::Look calcRough(int sample) {
        --check_.distances_;
        const ElementDistance::Rough rough =
            check_.distance_.calcRough(element_, check_.motion_.getPose(index_, sample));
        return {sample, rough.clearance, rough.ofMiddle, true};
    }
    void refine(bisection::Look& look) {
        if (!look.isRough) return;
        look.isRough = false;
        look.clearance = check_.distance_.calc(element_, check_.motion_.getPose(index_, look.sample), look.ofMiddle,
                                               look.sample, place_, check_.distances_);
    }

private:
    ArmStopCheck& check_;
    const ArmElement& element_;
    ElementDistance::Place& place_;
    int index_;
    double radius_;
};

/** Sets what is known, and extremes of the path, of all that are known, and of every motion between them. */
void ArmStopCheck::setKnown(const ArmPath& path, const KnownPaths& known) {
    known_ = known;
    path.calcExtremes(extremes_);
    own_ = extremes_;
    JointVector position = JointVector::Zero(n_), velocity = position, acceleration = position;
    for (std::size_t k = 0; k < static_cast<std::size_t>(known.count); ++k) {
        path.calcDifference(known.paths[k]->path, known.paths[k]->begin, apart_[k]);
        position = position.cwiseMax(apart_[k].position);
        velocity = velocity.cwiseMax(apart_[k].velocity);
        acceleration = acceleration.cwiseMax(apart_[k].acceleration);
    }
    extremes_.position += position;
    extremes_.travel += position;
    extremes_.velocity += velocity;
    extremes_.acceleration += acceleration;
}

void ArmStopCheck::chooseKnown(std::size_t e) {
    source_ = nullptr;
    double most = 0.0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(known_.count); ++k) {
        const double apart = motion_.calcApart(static_cast<int>(e), apart_[k].position);
        const double seen = known_.paths[k]->result.seen[e] - apart;
        if (source_ && !(seen > most)) continue;
        source_ = known_.paths[k];
        apart_m_ = apart;
        most = seen;
    }
}

/** Whether what is known of source_ leaves no doubt about element e. */
bool ArmStopCheck::isKnown(std::size_t e, const Demands& demands) {
    if (!source_) return false;
    const bisection::Bounds bounds{source_->result.seen[e] - apart_m_, source_->result.proven[e] - apart_m_};
    const Profile& profile = source_->result.profile[e];
    const double lost = profile.lost + apart_m_;
    const bool isFar = bounds.areFar({demands.floor[e], demands.least[e], demands.ahead[e], demands.far[e]});
    const bool isAhead = bounds.seen >= demands.ahead[e] && bounds.proven >= demands.floor[e];
    if (!isFar && !(isAhead && lost <= kLargestLoss * (bounds.seen + lost - demands.least[e]))) return false;
    found_[e].all = bounds;
    profile_[e] = profile;
    const double begin_s = static_cast<double>(source_->begin) * tick_s_;
    profile_[e].begin_s -= begin_s;
    profile_[e].lost = lost;
    near_[e] = source_->result.near[e];
    near_[e].time_s -= begin_s;
    near_[e].place.distance -= apart_m_;
    return true;
}

/** True when element e keeps what is demanded.
@param mustBeGood  else where it is nearest need not be known */
bool ArmStopCheck::checkElement(std::size_t e, const Demands& demands, bool mustBeGood) {
    places_[e] = {};
    found_[e] = {};
    isLooked_[e] = 1;
    if (!elements_[e].isPair() && !distance_.hasSurroundings()) return true;
    Subject subject(*this, e);
    bisection::Demand demand{demands.floor[e], demands.least[e], demands.ahead[e], demands.far[e]};
    // What is known to be farther than the nearest place of this path can be is not the nearest place.
    if (source_)
        demand.far = std::clamp(source_->result.seen[e] + 2.0 * source_->result.profile[e].lost + apart_m_,
                                demand.ahead, std::max(demand.ahead, demand.far));
    constexpr int kParts = bisection::Result::kParts, kSamples = bisection::kDivisions / kParts;
    std::array<bool, kParts> isOpen{};
    int nearest = 0;  // the open part that was nearest
    double least = kInfinity;
    for (int part = 0; part < kParts; ++part) {
        const int from = part * kSamples, to = from + kSamples;
        const bisection::Bounds known = subject.findKnown(from, to);
        isOpen[part] = !known.areFar(demand);
        if (known.areFar(demand)) {
            found_[e].settle(from, to, known);
        } else if (known.seen < least) {
            least = known.seen;
            nearest = part;
        }
    }
    bisection::Look begin;
    if (isOpen[0]) begin = subject.calcRough(0);
    if (isOpen[0] && !(begin.clearance >= demand.least)) {
        if (hasBudget()) subject.refine(begin);
        if (demands.beginsAbove) begin.clearance = std::max(begin.clearance, demand.floor);
        const bool hasStayed = begin.clearance >= demands.reached[e] - bisection::kRounding_m;
        const double kept = hasStayed ? std::max(begin.clearance, demands.reached[e]) : begin.clearance;
        demand.least = std::min(demand.least, kept);  // where the arm is it is
    }
    // Where another path of this tick came too near this one probably does, too.
    if (mustBeGood && failedAt_[e] >= 0) {
        bisection::Look again = subject.calcRough(failedAt_[e]);
        if (hasBudget() && again.clearance < demand.least) subject.refine(again);
        if (!again.isRough && again.clearance < demand.least - bisection::kRounding_m) return false;
    }
    const auto proveFrom = [&](int part) {  // all that is open around it
        int last = part;
        const auto isOpenAt = [&](int k) { return isOpen[k]; };
        while (part > 0 && isOpenAt(part - 1)) --part;
        while (last + 1 < kParts && isOpenAt(last + 1)) ++last;
        for (int k = part; k <= last; ++k) isOpen[k] = false;
        bisection::Look from = part == 0 ? begin : subject.calcRough(part * kSamples);
        bisection::Look to = subject.calcRough((last + 1) * kSamples);
        bisection::prove(demand, subject, from, to, found_[e]);
    };
    if (isOpen[nearest]) proveFrom(nearest);
    for (int part = 0; part < kParts; ++part)
        if (isOpen[part]) proveFrom(part);
    return found_[e].isKept;
}

void ArmStopCheck::examine(const ArmPath& path, double time_s, const Demands& demands, const JointVector& lastTorque,
                           const KnownPaths& known, bool mustBeGood, Result& result) {
    examineWith(path, time_s, demands, lastTorque, known, mustBeGood, result);
    known_ = {};  // not to be used beyond this call
    source_ = nullptr;
}

void ArmStopCheck::examineWith(const ArmPath& path, double time_s, const Demands& demands,
                               const JointVector& lastTorque, const KnownPaths& known, bool mustBeGood,
                               Result& result) {
    path_ = &path;
    setKnown(path, known);
    result.isClear = true;
    speed_.examine(path, extremes_, demands.speed, mustBeGood, result.speed);
    result.isAhead = result.speed.seenLater <= demands.speed.ahead;
    result.people = {};
    if (!(mustBeGood && !result.speed.isKept)) people_.examine(path, own_, demands.people, mustBeGood, result.people);
    result.isAhead &= result.people.seen >= demands.people.ahead;
    if (mustBeGood && !(result.speed.isKept && result.people.isKept)) {
        result.isClear = result.isAhead = result.torque.bearsTorque = false;
        return;
    }
    distance_.setTime(time_s);
    motion_.setPath(path, extremes_);
    for (std::size_t k = 0; k < elements_.size(); ++k) {
        const std::size_t e = order_[k];
        places_[e] = {};
        isLooked_[e] = 0;
        chooseKnown(e);
        if (isKnown(e, demands)) continue;
        const bool isKept = checkElement(e, demands, mustBeGood);
        if (found_[e].all.seen < demands.ahead[e]) result.isAhead = false;
        if (isKept) continue;
        result.isClear = false;
        if (places_[e].isSeen()) failedAt_[e] = places_[e].sample;
        if (!mustBeGood) continue;
        std::rotate(order_.begin(), order_.begin() + static_cast<std::ptrdiff_t>(k),
                    order_.begin() + static_cast<std::ptrdiff_t>(k) + 1);
        result.isAhead = result.torque.bearsTorque = false;
        return;
    }
    std::array<TorqueScan::Neighbour, KnownPaths::kMost> neighbours{};
    for (std::size_t k = 0; k < static_cast<std::size_t>(known.count); ++k)
        neighbours[k] = {&known.paths[k]->result.torque.proven, &apart_[k]};
    torque_.scan(path, extremes_, demands.torqueUse, lastTorque, neighbours.data(), known.count, result.torque);
    result.nearest = {};
    if (known.count == 0 || result.isGood()) findNearest(demands, result);
    for (std::size_t e = 0; e < elements_.size(); ++e) {
        result.seen[e] = found_[e].all.seen;
        result.proven[e] = found_[e].all.proven;
        if (result.nearest.isKnown) result.nearest.margin = std::min(result.nearest.margin, result.proven[e]);
        if (isLooked_[e]) {
            result.profile[e] = {found_[e].parts, 0.0, path.duration(), 0.0};
            result.near[e] = {places_[e], motion_.calcTime(places_[e].sample)};
        } else {
            result.profile[e] = profile_[e];
            result.near[e] = near_[e];
        }
    }
}

/** What was only seen roughly, or was known, is looked at where it is lowest, until none that is left is lower (of each
element one is known). */
void ArmStopCheck::findNearest(const Demands& demands, Result& result) {
    for (;;) {
        std::size_t nearest = 0;
        double least = kInfinity;
        for (std::size_t e = 0; e < elements_.size(); ++e) {
            const double open = isLooked_[e] ? found_[e].rough.clearance : found_[e].all.seen;
            const double now = std::min(places_[e].distance, open);
            if (now >= least) continue;
            least = now;
            nearest = e;
        }
        if (!(least < kInfinity)) return;
        if (!(least < places_[nearest].distance)) {
            result.nearest = getNearest(static_cast<int>(nearest));
            return;
        }
        if (!hasBudget()) return;
        if (isLooked_[nearest]) {
            Subject(*this, nearest).refine(found_[nearest].rough);
            found_[nearest].rough = {};
            continue;
        }
        source_ = nullptr;                      // all of it
        checkElement(nearest, demands, false);  // that it is kept is known
    }
}

LimitReport ArmStopCheck::getNearest(int e) const {
    const ArmElement& element = elements_[e];
    const ElementDistance::Place& place = places_[e];
    const auto getLink = [&](int capsule) { return capsule < 0 ? -1 : capsules_[capsule].link; };
    LimitReport report;
    report.isKnown = place.isSeen();
    report.margin = place.distance;
    report.link = getLink(element.first);
    report.other = place.obstacle;
    report.otherLink = getLink(element.second);
    report.onArm = place.onFirst;
    report.onOther = place.onSecond;
    return report;
}

void ArmStopCheck::addRows(const JointVector& jerk, const ArmPath& other, const JointVector& otherJerk,
                           const Demands& demands, RowQp::Rows& rows) {
    const StopPair stops{*path_, jerk, other, otherJerk};
    forLeast(
        elements_.size(), kMostClearanceRows,
        [&](std::size_t e) {
            const double room = places_[e].distance - demands.ahead[e];
            return room < 0.0 ? room : kInfinity;
        },
        [&](std::size_t e) {
            const int sample = places_[e].sample;
            rows_.addClearance(places_[e], elements_[e], motion_.getFrames(sample), motion_.calcTime(sample),
                               demands.ahead[e], stops, rows);
        });
    for (int k = 0; k < torque_.faultCount(); ++k) rows_.addTorque(torque_.fault(k), stops, rows);
    addMotionRows(stops, demands, rows);
}

void ArmStopCheck::addMotionRows(const StopPair& stops, const Demands& demands, RowQp::Rows& rows) {
    speed_.addRows(stops, demands.speed, rows);
    people_.addRows(stops, demands.people, rows);
}

bool ArmStopCheck::addForeseenRows(const Result& found, double since_s, const StopPair& stops, const Demands& demands,
                                   RowQp::Rows& rows) {
    bool isAnyBroken = false;
    forLeast(
        elements_.size(), kMostClearanceRows,
        [&](std::size_t e) {
            const Near& near = found.near[e];
            const bool isAhead = near.place.isSeen() && near.time_s > since_s && near.place.distance < demands.far[e];
            return isAhead ? near.place.distance - demands.ahead[e] : kInfinity;
        },
        [&](std::size_t e) {
            const Near& near = found.near[e];
            isAnyBroken |=
                !rows_.addForeseen(near.place, elements_[e], near.time_s - since_s, demands.ahead[e], stops, rows);
        });
    return isAnyBroken;
}

void ArmStopCheck::measurePeople(const ArmPath& path, PeopleCheck::Result& result) {
    path.calcExtremes(own_);
    people_.examine(path, own_, {0.0, PeopleCheck::kGuard_m}, false, result);
}

ArmStopCheck::Worst ArmStopCheck::findWorstJoint(const Result& found, const JointVector& jerk, const ArmPath& other,
                                                 const JointVector& otherJerk, const Demands& demands) {
    const StopPair stops{*path_, jerk, other, otherJerk};
    Worst worst;
    RowQp::Rows rows;
    if (!found.speed.isKept) {
        speed_.addRows(stops, demands.speed, rows);
    } else if (!found.people.isKept) {
        people_.addRows(stops, demands.people, rows);
    } else if (!found.isClear) {
        const std::size_t e = order_.front();
        const ElementDistance::Place& place = places_[e];
        if (place.isSeen()) {
            const ArmRecursion::Frames& frames = motion_.getFrames(place.sample);
            const double t_s = motion_.calcTime(place.sample);
            rows_.addClearance(place, elements_[e], frames, t_s, demands.ahead[e], stops, rows);
            worst.isAlong = rows_.calcSteepness(place, elements_[e], frames, t_s, stops) <= kAlong;
        }
    } else if (torque_.failsByRate()) {
        worst.joint = torque_.findWorstJoint(*path_, jerk, other, otherJerk);
    } else if (torque_.faultCount() > 0) {
        rows_.addTorque(torque_.fault(0), stops, rows);
    }
    if (rows.count == 0) return worst;
    Eigen::Index joint = 0;
    if (rows.normal[0].cwiseProduct(otherJerk - jerk).maxCoeff(&joint) > 0.0) worst.joint = static_cast<int>(joint);
    return worst;
}

}  // namespace viable::detail
