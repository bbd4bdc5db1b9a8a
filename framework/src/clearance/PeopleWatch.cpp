#include "clearance/PeopleWatch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "robot/Segments.h"
#include "viable/core/Numbers.h"

namespace viable::detail {

namespace {

/** Of places [m] and of times [s]. */
constexpr double kPlaceRounding_m = 1e-9, kClockRounding_s = 1e-9;

}  // namespace

PeopleWatch::PeopleWatch(std::vector<Person> people) : people_(std::move(people)), known_(people_.size()) {}

double PeopleWatch::age_s(double time_s) const {
    double age_s = 0.0;
    for (const Known& known : known_)
        if (known.isKnown) age_s = std::max(age_s, time_s - known.stamp_s);
    return age_s;
}

void PeopleWatch::reset() {
    std::fill(known_.begin(), known_.end(), Known());
    faults_ = {};
    ownRefused_ = 0;
    version_ = 0;
    hasBegun_ = false;
}

/** Every ball of the new observation lies where the person may be by the old one: distances of points of a segment from a
segment are largest at its ends. */
bool PeopleWatch::isExpected(const Known& before, const Person& person, const PersonObservation& seen) const {
    const double most = before.speed * (seen.stamp_s - before.since_s) + person.error_m + kPlaceRounding_m;
    for (int k = 0; k < seen.count; ++k) {
        const PersonCapsule& is = seen.capsules[static_cast<std::size_t>(k)];
        bool isIn = false;
        for (int j = 0; j < before.count && !isIn; ++j) {
            const Body& was = before.bodies[static_cast<std::size_t>(j)];
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
        const PersonCapsule& capsule = seen.capsules[static_cast<std::size_t>(k)];
        known.bodies[static_cast<std::size_t>(k)] = {capsule.a, capsule.b, capsule.radius + person.error_m};
        lower = lower.cwiseMin(capsule.a).cwiseMin(capsule.b);
        upper = upper.cwiseMax(capsule.a).cwiseMax(capsule.b);
    }
    known.centre = (lower + upper) / 2.0;
    known.size_m = 0.0;
    for (int k = 0; k < known.count; ++k) {
        const Body& body = known.bodies[static_cast<std::size_t>(k)];
        const double far = std::max((body.a - known.centre).norm(), (body.b - known.centre).norm());
        known.size_m = std::max(known.size_m, far + body.radius);
    }
}

bool PeopleWatch::take(const PeopleObservation& seen, double time_s) {
    if (hasBegun_ && seen.version == version_) return true;
    const bool isFirst = !hasBegun_;
    version_ = seen.version;
    hasBegun_ = true;
    bool areExpected = true;
    if (seen.refused + ownRefused_ > faults_.refused && seen.lastRefused >= 0) faults_.last = seen.lastRefused;
    for (std::size_t p = 0; p < known_.size(); ++p) {
        Known& known = known_[p];
        const PersonObservation& one = seen.people[p];
        const auto blame = [&](std::int64_t& count) {
            ++count;
            faults_.last = static_cast<int>(p);
        };
        if (one.kind == PersonObservation::Kind::Gone) {
            known = Known();
        } else if (one.kind == PersonObservation::Kind::Unseen) {
            if (known.isKnown && !known.isLost) {
                known.isLost = true;
                blame(faults_.lost);
            }
        } else if (one.stamp_s > time_s + kClockRounding_s) {
            blame(ownRefused_);  // from a clock that is ahead of the run's
        } else if (!known.isKnown) {
            set(people_[p], one, known);
            areExpected = false;
            if (!isFirst) blame(faults_.appeared);
        } else if (one.stamp_s > known.stamp_s) {
            if (!isExpected(known, people_[p], one)) {
                areExpected = false;
                blame(faults_.faster);
            }
            set(people_[p], one, known);
        } else {
            known.isLost = false;
        }
    }
    faults_.refused = seen.refused + ownRefused_;
    return areExpected;
}

}  // namespace viable::detail
