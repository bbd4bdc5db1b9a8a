#include "viable/environment/People.h"

#include <algorithm>

#include "core/ErrorList.h"
#include "core/Text.h"
#include "environment/WaypointPath.h"

namespace viable {

Eigen::Vector3d Person::calcPlace(double t) const {
    return calcPlaceOnPath(walk, repeats, t);
}

bool Person::isSeen(double t) const {
    return !walk.empty() && std::none_of(unseen.begin(), unseen.end(), [t](const Absence& absence) {
        return t >= absence.from_s && t < absence.to_s;
    });
}

void Person::Absence::check(const ConfigNode& block) const {
    if (!(to_s > from_s))
        throw badInput(block.find("to_s")->place(), "a time that ends before it begins", "Let `to_s` be later.");
}

void Person::check(const ConfigNode& block) const {
    if (bodyPart && block.find("contact_speed_mps"))
        throw badInput(block.find("body_part")->place(), "`body_part` and `contact_speed_mps` exclude each other",
                       "Remove one: the speed follows from the part.");
    detail::checkWaypoints(walk, *block.find("walk"), repeats, "person", "walk");
}

void checkPeople(const std::vector<Person>& people, const std::string& where) {
    std::vector<std::string> wrong;
    if (people.size() > static_cast<std::size_t>(kMaxPeople))
        wrong.push_back(std::to_string(people.size()) + " people; up to " + std::to_string(kMaxPeople) +
                        " can be kept apart from");
    for (const Person& person : people) {
        const auto complain = [&](const std::string& what) { wrong.push_back("'" + person.name + "' " + what); };
        const auto isIn = [](double x, double most) { return x >= 0.0 && x <= most; };
        if (!(person.maxSpeed > 0.0 && person.maxSpeed <= kFastestPerson_mps))
            complain("has a largest speed that is not in (0, " + detail::formatNumber(kFastestPerson_mps) + "] m/s");
        if (!isIn(person.latency_s, 10.0)) complain("has a latency that is not in [0, 10] s");
        if (!isIn(person.error_m, 10.0)) complain("has a measurement error that is not in [0, 10] m");
        if (!isIn(person.contactSpeed, kFastestPerson_mps))
            complain("has a contact speed that is not in [0, " + detail::formatNumber(kFastestPerson_mps) + "] m/s");
        if (person.capsules.size() > static_cast<std::size_t>(kMaxPersonCapsules))
            complain("has more than " + std::to_string(kMaxPersonCapsules) + " capsules");
        for (const PersonCapsule& capsule : person.capsules)
            if (!(capsule.a.allFinite() && capsule.b.allFinite() && capsule.radius > 0.0 &&
                  capsule.radius <= kFarthestPerson_m)) {
                complain("has a capsule that is not finite, or without a radius above 0 m");
                break;
            }
        if (!person.walk.empty() && person.capsules.empty()) complain("walks without a capsule");
        if (!detail::isUsable(person.walk))
            complain("has a waypoint that is not finite, or not later than the one before");
    }
    if (!wrong.empty())
        throw badInput(where, detail::join(wrong, "; "), "Give every person numbers within these ranges.");
}

void setContactSpeeds(std::vector<Person>& people, double movingMass_kg) {
    for (Person& person : people)
        if (person.bodyPart)
            person.contactSpeed = movingMass_kg > 0.0
                                      ? std::min(kFastestPerson_mps, calcContactSpeed(*person.bodyPart, movingMass_kg))
                                      : 0.0;
}

void observeWalks(const std::vector<Person>& people, double t, PeopleObservation& seen) {
    for (std::size_t i = 0; i < people.size() && i < seen.people.size(); ++i) {
        const Person& person = people[i];
        PersonObservation& one = seen.people[i];
        one.kind = person.isSeen(t) ? PersonObservation::Kind::Seen : PersonObservation::Kind::Unseen;
        if (one.kind != PersonObservation::Kind::Seen) continue;
        one.stamp_s = t;
        one.count = static_cast<int>(person.capsules.size());
        const Eigen::Vector3d place = person.calcPlace(t - person.latency_s);
        for (std::size_t k = 0; k < person.capsules.size(); ++k) {
            const PersonCapsule& capsule = person.capsules[k];
            one.capsules[k] = {place + capsule.a, place + capsule.b, capsule.radius};
        }
    }
}

}  // namespace viable
