#include "limits/SeparationLimit.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "limits/ArmMotion.h"
#include "limits/LimitRows.h"
#include "viable/environment/Environment.h"

namespace viable::detail {

namespace {

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
    const double lap = person.repeats && period_s > 0.0 && t > begin_s ? std::floor((t - begin_s) / period_s) : 0.0;
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

SeparationLimit::SeparationLimit(RobotDescription robot, const ArmGeometry& geometry, std::vector<Person> people)
    : robot_(std::move(robot)), people_(std::move(people)) {
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) continue;
        capsules_.push_back(capsule);
        names_.push_back(geometry.links[capsule.link]);
    }
    isExcused_.resize(people_.size(), 0);
}

SeparationLimit::Sample SeparationLimit::find(const JointVector& q, const JointVector& qd,
                                              const PeopleObservation& places, double rest) const {
    const ArmMotion arm(robot_, q, qd);
    Sample found;
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
                const PersonCapsule& body = person.capsules[j];
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
                found.isViolation |= isTooFast && !isExcused_[p];
                if (gap >= found.protective && found.part >= 0) continue;
                found.protective = std::min(found.protective, gap);
                found.part = static_cast<int>(k);
                found.person = static_cast<int>(p);
            }
        }
    }
    return found;
}

LimitSample SeparationLimit::sample(const ArmSample& arm) {
    for (std::size_t p = 0; p < people_.size(); ++p) {  // where they are, seen or not
        const Person& person = people_[p];
        PersonObservation& place = places_.people[p];
        isExcused_[p] = isExcused(person, arm.time_s);
        if (person.walk.empty()) continue;
        place.kind = PersonObservation::Kind::Seen;
        place.count = static_cast<int>(person.capsules.size());
        const Eigen::Vector3d at = person.calcPlace(arm.time_s);
        for (std::size_t j = 0; j < person.capsules.size(); ++j)
            place.capsules[j] = {at + person.capsules[j].a, at + person.capsules[j].b, person.capsules[j].radius};
    }
    const Sample close = find(arm.q, arm.qd, places_, arm.isReal ? kRealArmRest : kNominalRest);
    LimitSample found;
    found.value = close.protective;
    found.isBroken = close.isTooFast;
    found.isExcused = close.isTooFast && !close.isViolation;
    found.isNear = close.touches;
    found.largest = close.fastestTouch;
    if (close.part < 0) return found;
    found.part = names_[close.part].c_str();
    found.other = people_[close.person].name.c_str();
    return found;
}

std::vector<std::pair<std::string, double>> SeparationLimit::allowances() const {
    std::vector<std::pair<std::string, double>> speeds;
    for (const Person& person : people_)
        if (person.contactSpeed > 0.0) speeds.emplace_back(person.name, person.contactSpeed);
    return speeds;
}

const char* SeparationLimit::otherName(int index) const {
    return index < 0 || index >= static_cast<int>(people_.size()) ? "" : people_[index].name.c_str();
}

namespace {

/** "link6 came to 0.312 m from ann at 1.234 s while it was too fast to touch" */
std::string tellClosest(const ArmLimitRecord& r) {
    if (r.part.empty()) return "nobody came near";
    if (r.brokenTicks > 0)
        return format("%s touched %s while it was too fast (first at %.3f s)", r.part, r.other,
                      r.firstBroken_s.value_or(r.worst_s));
    return format("%s came to %.3f m from %s at %.3f s while it was too fast to touch", r.part, r.worst, r.other,
                  r.worst_s);
}

std::string tellSeparation(const LimitAccount&, const ArmLimitRecord& r) {
    std::string text = format("touched too fast in %lld ticks, touched in %lld", r.brokenTicks, r.nearTicks);
    if (r.nearTicks > 0) text += format(" (at up to %.3g m/s)", r.largest);
    return text + "; " + tellClosest(r);
}

std::string tellPeople(const LimitAccount& people) {
    std::string text;
    for (const auto& [name, speed] : people.allowances)
        text += format("                %s may be touched at up to %.3g m/s of the arm\n", name, speed);
    text += format("                at rest because of people for %.2f s", people.resting_s);
    const PeopleFaults& f = people.faults;
    if (f.appeared + f.faster + f.lost + f.refused > 0)
        text += format("; people who appeared: %lld, faster than stated: %lld, lost: %lld, not usable: %lld",
                       f.appeared, f.faster, f.lost, f.refused) +
                (people.lastFault.empty() ? "" : " (last of " + people.lastFault + ")");
    return text + "\n";
}

std::string tellSurprises(const LimitAccount& people) {
    const std::int64_t count = people.faults.appeared + people.faults.faster;
    return count == 0 ? "" : format("; people appeared or were faster than stated in %lld observations", count);
}

}  // namespace

LimitRow makeSeparationRow() {
    LimitRow row;
    row.exists = [](const LimitScene& scene) { return scene.environment && !scene.environment->people.empty(); };
    row.make = [](const LimitScene& scene) -> std::unique_ptr<ArmLimit> {
        return std::make_unique<SeparationLimit>(scene.robot, *scene.geometry, scene.environment->people);
    };
    row.lessIsWorse = row.watchesPeople = true;
    row.label = "people";
    row.limitWord = "separation";
    row.kept = "nobody touched too fast";
    row.guarantee = "separation from people";
    row.broken = "somebody was touched too fast";
    row.verdict = "of the %s arm ";
    row.breach = "the %s arm touched somebody too fast: ";
    row.remedy = " (somebody was, or may have been, within its reach: it goes on when people are seen farther away)";
    row.ranked = "touches somebody too fast";
    row.rankedBy = "that touch somebody too fast";
    row.heading = "-";
    row.tellWorst = tellClosest;
    row.tellArm = tellSeparation;
    row.tellMore = tellPeople;
    row.tellInVerdict = tellSurprises;
    // The names of links and people are in the metadata.
    using R = LimitReport;
    using P = PeopleFaults;
    row.columns = {{"known", &R::isKnown}, {"kept", &R::isKept},     {"margin_m", &R::margin},   {"link", &R::link},
                   {"person", &R::other},  {"age_s", &R::age_s},     {"appeared", &P::appeared}, {"faster", &P::faster},
                   {"lost", &P::lost},     {"refused", &P::refused}, {"last_fault", &P::last}};
    row.block = row.columnBlock = "people";
    using A = ArmLimitRecord;
    row.figures = {{"ticks_too_fast", &A::brokenTicks, "ticks_too_fast", "", "Ticks that touch somebody too fast"},
                   {"protective_m", &A::worst, "protective_m", "m", "Least gap to what was too fast"},
                   {"protective_s", &A::worst_s},
                   {"touched_ticks", &A::nearTicks},
                   {"ticks_at_fault", &A::violatedTicks},
                   {"fastest_touch_mps", &A::largest},
                   {"first_too_fast_s", &A::firstBroken_s},
                   {"part", &A::part},
                   {"person", &A::other}};
    return row;
}

}  // namespace viable::detail
