#include "clearance/PeopleWatch.h"

#include "robot/Segments.h"

namespace viable::detail {

namespace {

/** Of places [m] and of times [s]. */
constexpr double kPlaceRounding_m = 1e-9, kClockRounding_s = 1e-9;
/** From one observation to the next latency and error hide any speed: where somebody was once or twice so long ago is looked
at, too [s]. */
constexpr double kAnchor_s = 0.25;

}  // namespace

PeopleWatch::PeopleWatch(std::vector<Person> people)
    : people_(std::move(people)),
      known_(people_.size()),
      anchors_(people_.size()),
      refused_(people_.size(), 0),
      blindSince_s_(people_.size(), kInfinity) {}

bool PeopleWatch::isBlind() const {
    return version_ == 0 ||
           std::any_of(blindSince_s_.begin(), blindSince_s_.end(), [](double t) { return t < kInfinity; });
}

double PeopleWatch::age_s(double time_s) const {
    double age_s = 0.0;
    for (const Known& known : known_)
        if (known.isKnown) age_s = std::max(age_s, time_s - known.stamp_s);
    return age_s;
}

void PeopleWatch::reset() {
    std::fill(known_.begin(), known_.end(), Known());
    std::fill(anchors_.begin(), anchors_.end(), std::array<Known, 2>());
    for (double& since_s : blindSince_s_)
        if (since_s < kInfinity) since_s = -kInfinity;  // in another time
    faults_ = {};
    refusedBefore_ = feedRefused_;
    ownRefused_ = 0;
    version_ = 0;
    hasBegun_ = false;
}

/** Every ball of the new observation lies where the person may be by the old one: distances of points of a segment from a
segment are largest at its ends. */
bool PeopleWatch::isExpected(const Known& before, const Person& person, const PersonObservation& seen) const {
    const double most = before.speed * (seen.stamp_s - before.since_s) + person.error_m + kPlaceRounding_m;
    for (int k = 0; k < seen.count; ++k) {
        const PersonCapsule& is = seen.capsules[k];
        bool isIn = false;
        for (int j = 0; j < before.count && !isIn; ++j) {
            const Body& was = before.bodies[j];
            const double moved = std::max(calcPointDistance(is.a, was.a, was.b), calcPointDistance(is.b, was.a, was.b));
            isIn = moved + is.radius - was.radius <= most;  // was.radius has its error already
        }
        if (!isIn) return false;
    }
    return true;
}

void PeopleWatch::set(const Person& person, const PersonObservation& seen, Known& known) {
    known.isKnown = true;
    known.isLost = false;
    known.stamp_s = seen.stamp_s;
    known.since_s = seen.stamp_s - person.latency_s;
    known.speed = person.maxSpeed;
    known.contactSpeed = person.contactSpeed;
    known.count = seen.count;
    Eigen::Vector3d lower = Eigen::Vector3d::Constant(kInfinity), upper = -lower;
    for (int k = 0; k < seen.count; ++k) {
        const PersonCapsule& capsule = seen.capsules[k];
        known.bodies[k] = {capsule.a, capsule.b, capsule.radius + person.error_m};
        lower = lower.cwiseMin(capsule.a).cwiseMin(capsule.b);
        upper = upper.cwiseMax(capsule.a).cwiseMax(capsule.b);
    }
    known.centre = (lower + upper) / 2.0;
    known.size_m = 0.0;
    for (int k = 0; k < known.count; ++k) {
        const Body& body = known.bodies[k];
        const double far = std::max((body.a - known.centre).norm(), (body.b - known.centre).norm());
        known.size_m = std::max(known.size_m, far + body.radius);
    }
}

/** False: it is not where the last observation, or an older one, let expect the person. */
bool PeopleWatch::follow(std::size_t p, const PersonObservation& seen) {
    const Person& person = people_[p];
    auto& [older, newer] = anchors_[p];
    const bool areExpected = isExpected(known_[p], person, seen) && isExpected(older, person, seen);
    set(person, seen, known_[p]);
    if (!areExpected) {
        anchors_[p].fill(known_[p]);
    } else if (seen.stamp_s - newer.stamp_s >= kAnchor_s) {
        older = newer;
        newer = known_[p];
    }
    return areExpected;
}

bool PeopleWatch::take(const PeopleObservation& seen, double time_s) {
    if (hasBegun_ && seen.version == version_) return true;
    const bool isFirst = !hasBegun_;
    version_ = seen.version;
    hasBegun_ = true;
    bool areExpected = true;
    for (std::size_t p = 0; p < known_.size(); ++p) {
        Known& known = known_[p];
        const PersonObservation& one = seen.people[p];
        const auto blame = [&](std::int64_t& count) {
            ++count;
            faults_.last = static_cast<int>(p);
        };
        const auto lose = [&] {
            if (!known.isKnown) blindSince_s_[p] = std::min(blindSince_s_[p], time_s);
        };
        if (one.refused > refused_[p]) {
            refused_[p] = one.refused;
            faults_.last = static_cast<int>(p);
            lose();
        }
        if (one.kind == PersonObservation::Kind::Gone) {
            const double since_s = known.isKnown ? known.stamp_s : blindSince_s_[p];
            const bool isNew = one.stamp_s >= since_s && one.stamp_s <= time_s + kClockRounding_s;
            if ((known.isKnown || since_s < kInfinity) && !isNew) {
                blame(ownRefused_);  // from before the last observation, or no time at all
            } else {
                known = Known();
                anchors_[p] = {};
                blindSince_s_[p] = kInfinity;
            }
        } else if (one.kind == PersonObservation::Kind::Unseen) {
            if (known.isKnown && !known.isLost) {
                known.isLost = true;
                blame(faults_.lost);
            }
        } else if (one.stamp_s > time_s + kClockRounding_s) {
            blame(ownRefused_);  // from a clock that is ahead of the run's
            lose();
        } else if (!known.isKnown) {
            set(people_[p], one, known);
            anchors_[p].fill(known);
            blindSince_s_[p] = kInfinity;
            areExpected = false;
            if (!isFirst) blame(faults_.appeared);
        } else if (one.stamp_s > known.stamp_s) {
            if (!follow(p, one)) {
                areExpected = false;
                blame(faults_.faster);
            }
        } else {
            known.isLost = false;
        }
    }
    feedRefused_ = seen.refused;
    faults_.refused = feedRefused_ - refusedBefore_ + ownRefused_;
    return areExpected;
}

}  // namespace viable::detail
