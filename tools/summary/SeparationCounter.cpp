#include "summary/SeparationCounter.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "summary/ArmMotion.h"

namespace viable::detail {

namespace {

/** Joints slower than this stand still [rad/s, m/s]. */
constexpr double kStandsStill = 1e-3;

double calcFromEnd(const Eigen::Vector3d& end, const Eigen::Vector3d& a, const Eigen::Vector3d& way) {
    const double square = way.dot(way);
    if (square == 0.0) return (end - a).norm();
    const double share = std::min(1.0, std::max(0.0, way.dot(end - a) / square));
    return (end - a - share * way).norm();
}

/** Two segments are nearest at an end of one of them, or where the common normal of their lines meets both inside. */
double calcGap(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, const Eigen::Vector3d& d) {
    const Eigen::Vector3d u = b - a, v = d - c;
    double gap = std::min({calcFromEnd(a, c, v), calcFromEnd(b, c, v), calcFromEnd(c, a, u), calcFromEnd(d, a, u)});
    const Eigen::Vector3d normal = u.cross(v);
    const double square = normal.squaredNorm();
    if (square > 0.0) {
        const Eigen::Vector3d between = c - a;
        const double s = between.cross(v).dot(normal) / square, t = between.cross(u).dot(normal) / square;
        if (s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0)
            gap = std::min(gap, std::abs(between.dot(normal)) / std::sqrt(square));
    }
    return gap;
}

constexpr double kLeastTick_s = 1e-9;

/** So long after somebody broke the word that was given for him, or was seen for the first time, an arm may still be about to
stop [s]. */
constexpr double kGrace_s = 2.0;

/** When somebody is seen next, from a time on [s]. */
double findNextSeen(const Person& person, double t) {
    for (bool isLater = true; isLater && !person.isSeen(t);) {
        isLater = false;
        for (const Person::Absence& absence : person.unseen)
            if (t >= absence.from_s && t < absence.to_s) {
                t = absence.to_s;
                isLater = true;
            }
    }
    return t;
}

/** When the arm could not know: somebody is faster than stated, or was and has not been seen since, or only just; or has never been
seen before, or only just. */
bool isExcused(const Person& person, double t) {
    if (person.walk.empty()) return false;
    const double grace_s = kGrace_s + person.latency_s;
    if (const double seen_s = findNextSeen(person, 0.0); seen_s > 0.0 && t < seen_s + grace_s) return true;
    const double begin_s = person.walk.front().time_s, period_s = person.walk.back().time_s - begin_s;
    const bool laps = person.repeats && period_s > 0.0 && t > begin_s;
    const double lap = laps ? std::floor((t - begin_s) / period_s) : 0.0;
    for (std::size_t i = 1; i < person.walk.size(); ++i) {
        const Person::Waypoint &from = person.walk[i - 1], &to = person.walk[i];
        const double speed = (to.position - from.position).norm() / (to.time_s - from.time_s);
        if (!(speed > person.maxSpeed * (1.0 + kSpeedRounding))) continue;
        for (const double k : {lap, lap - 1.0}) {  // those of the lap before may not be seen yet
            const double from_s = from.time_s + k * period_s, to_s = to.time_s + k * period_s;
            if (k >= 0.0 && t >= from_s && t < findNextSeen(person, to_s) + grace_s) return true;
        }
    }
    return false;
}

}  // namespace

SeparationCounter::SeparationCounter(RobotDescription robot, const ArmGeometry& geometry, std::vector<Person> people,
                                     bool hasRealArm)
    : robot_(std::move(robot)), people_(std::move(people)) {
    std::size_t longest = 0;  // names are taken over in ticks, without memory of their own
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) continue;
        capsules_.push_back(capsule);
        names_.push_back(geometry.links[static_cast<std::size_t>(capsule.link)]);
        longest = std::max(longest, names_.back().size());
    }
    for (const Person& person : people_) {
        isExcused_.push_back(0);
        longest = std::max(longest, person.name.size());
        if (person.contactSpeed > 0.0) separations_.contactSpeeds.emplace_back(person.name, person.contactSpeed);
    }
    if (hasRealArm) separations_.real.emplace();
    nominal_.rest = kNominalRest;
    real_.rest = kRealArmRest;
    for (std::string* name : {&separations_.nominal.part, &separations_.nominal.person, &separations_.lastFault})
        name->reserve(longest);
    if (separations_.real) {
        separations_.real->part.reserve(longest);
        separations_.real->person.reserve(longest);
    }
}

SeparationCounter::Found SeparationCounter::find(const JointVector& q, const JointVector& qd,
                                                 const PeopleObservation& places, double rest) const {
    const ArmMotion arm(robot_, q, qd);
    Found found;
    for (std::size_t k = 0; k < capsules_.size(); ++k) {
        const LinkCapsule& capsule = capsules_[k];
        const auto [a, b, speed] = arm.place(capsule);
        const double half = (b - a).norm() / 2.0 + capsule.radius;
        const Eigen::Vector3d middle = (a + b) / 2.0;
        for (std::size_t p = 0; p < people_.size(); ++p) {
            const PersonObservation& person = places.people[p];
            if (person.kind != PersonObservation::Kind::Seen) continue;
            const bool isFast = speed > std::max(rest, people_[p].contactSpeed * (1.0 + kSpeedRounding));
            for (int j = 0; j < person.count; ++j) {
                const PersonCapsule& body = person.capsules[static_cast<std::size_t>(j)];
                const double roughly =
                    (middle - (body.a + body.b) / 2.0).norm() - half - body.radius - (body.b - body.a).norm() / 2.0;
                if (roughly > 0.0 && (!isFast || roughly >= found.protective)) continue;
                const double gap = calcGap(a, b, body.a, body.b) - capsule.radius - body.radius;
                if (gap <= 0.0) {
                    found.touches = true;
                    found.fastestTouch = std::max(found.fastestTouch, speed);
                }
                if (!isFast) continue;
                const bool isTooFast = gap <= 0.0;
                if (isTooFast && !found.isTooFast) found.part = -1;
                found.isTooFast |= isTooFast;
                found.isGuilty |= isTooFast && !isExcused_[p];
                if (gap >= found.protective && found.part >= 0) continue;
                found.protective = std::min(found.protective, gap);
                found.part = static_cast<int>(k);
                found.person = static_cast<int>(p);
            }
        }
    }
    return found;
}

void SeparationCounter::judge(Way& way, SeparationRecord& record, const JointVector& q, const JointVector& qd,
                              double time_s) {
    for (std::size_t p = 0; p < people_.size(); ++p) {  // where they are, seen or not
        const Person& person = people_[p];
        PersonObservation& place = places_.people[p];
        isExcused_[p] = isExcused(person, time_s);
        if (person.walk.empty()) continue;
        place.kind = PersonObservation::Kind::Seen;
        place.count = static_cast<int>(person.capsules.size());
        const Eigen::Vector3d at = person.calcPlace(time_s);
        for (std::size_t j = 0; j < person.capsules.size(); ++j)
            place.capsules[j] = {at + person.capsules[j].a, at + person.capsules[j].b, person.capsules[j].radius};
    }
    const Found found = find(q, qd, places_, way.rest);
    way.touches |= found.touches;
    way.isTooFast |= found.isTooFast;
    way.isGuilty |= found.isGuilty;
    record.fastestTouch = std::max(record.fastestTouch, found.fastestTouch);
    if (found.part < 0) return;
    if (found.isTooFast ? record.firstTooFast_s.has_value() && found.protective >= record.protective
                        : found.protective >= record.protective)
        return;
    if (found.isTooFast && !record.firstTooFast_s) record.firstTooFast_s = time_s;
    record.protective = std::min(record.protective, found.protective);
    record.protective_s = time_s;
    record.part = names_[static_cast<std::size_t>(found.part)];
    record.person = people_[static_cast<std::size_t>(found.person)].name;
}

void SeparationCounter::follow(Way& way, SeparationRecord& record, const JointState& state, double time_s) {
    if (way.hasBegun && !way.hasGap) {  // between rows that are far apart nobody knows
        const double h = std::max(time_s - way.time_s, kLeastTick_s);
        const JointState middle = calcHalfWay(way.last, state, h);
        judge(way, record, middle.q, middle.qd, way.time_s + h / 2.0);
    }
    judge(way, record, state.q, state.qd, time_s);
    if (way.hasBegun) {
        ++record.ticks;
        record.touchedTicks += way.touches;
        record.tooFastTicks += way.isTooFast;
        record.guiltyTicks += way.isGuilty;
        way.touches = way.isTooFast = way.isGuilty = false;
    }
    way.last = state;
    way.time_s = time_s;
    way.hasBegun = true;
    way.hasGap = false;
}

void SeparationCounter::add(const TickRecord& record) {
    follow(nominal_, separations_.nominal, {record.nominal.q, record.nominal.qd}, record.time_s);
    bool isHeld = record.separation.isKnown && !record.separation.isKept;
    for (Eigen::Index i = 0; i < record.nominal.q.size(); ++i)
        isHeld |= record.joints[static_cast<std::size_t>(i)].limit == LimitKind::Separation;
    const double h = record.time_s - lastTime_s_;
    lastTime_s_ = record.time_s;
    if (isHeld && record.nominal.qd.cwiseAbs().maxCoeff() < kStandsStill) separations_.resting_s += h;
    if (record.separation.isKnown) separations_.faults = record.separation.faults;
    if (const int last = separations_.faults.last; last >= 0 && last < static_cast<int>(people_.size()))
        separations_.lastFault = people_[static_cast<std::size_t>(last)].name;
    if (!separations_.real) return;
    if (record.hasReading)
        follow(real_, *separations_.real, record.actual, record.time_s);
    else
        real_.hasGap = true;
}

void SeparationCounter::addEnd(const MotionState& nominal, double time_s) {
    follow(nominal_, separations_.nominal, {nominal.q, nominal.qd}, time_s);
}

}  // namespace viable::detail
