#include "viable/environment/People.h"

#include <algorithm>
#include <cmath>

#include "config/ConfigText.h"
#include "core/Complaints.h"
#include "core/Text.h"
#include "environment/WaypointPath.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** Nobody is faster [m/s]: a larger number is a mistake in the unit. */
constexpr double kFastest = 20.0;

constexpr NumberRange kPersonPlace{-kFarthestPerson_m, kFarthestPerson_m};
constexpr NumberRange kWalkTime{0.0, 1e6};

Eigen::Vector3d toPlace(const ConfigNode& node) {
    const std::vector<double> x = toNumbers(node, 3, 3, kPersonPlace);
    return {x[0], x[1], x[2]};
}

void requireList(const ConfigNode& node, const char* what, const char* remedy) {
    if (node.kind != ConfigNode::Kind::List || node.items.empty()) throw badInput(node.place(), what, remedy);
}

void readCapsules(const ConfigNode& node, Person& person) {
    requireList(node, "capsules are a list", "Write a list of {from_m, to_m, radius_m}; without `to_m` it is a ball.");
    if (node.items.size() > static_cast<std::size_t>(kMaxPersonCapsules))
        throw badInput(node.place(), "a person of " + std::to_string(node.items.size()) + " capsules",
                       "A person has up to " + std::to_string(kMaxPersonCapsules) +
                           "; cover it with fewer, larger ones, or make it two persons.");
    for (const ConfigNode& item : node.items) {
        ConfigMap map(item);
        PersonCapsule capsule;
        capsule.a = capsule.b = toPlace(map.require("from_m"));
        if (const ConfigNode* to = map.find("to_m")) capsule.b = toPlace(*to);
        capsule.radius = toNumber(map.require("radius_m"), {0.0, kFarthestPerson_m, true});
        map.finish();
        person.capsules.push_back(capsule);
    }
}

Person readPerson(const std::string& name, const ConfigNode& node) {
    ConfigMap map(node);
    Person person;
    person.name = name;
    if (const ConfigNode* speed = map.find("max_speed_mps")) person.maxSpeed = toNumber(*speed, {0.0, kFastest, true});
    if (const ConfigNode* latency = map.find("latency_s")) person.latency_s = toNumber(*latency, {0.0, 10.0});
    if (const ConfigNode* error = map.find("error_m")) person.error_m = toNumber(*error, {0.0, 10.0});
    if (const ConfigNode* contact = map.find("contact_speed_mps"))
        person.contactSpeed = toNumber(*contact, {0.0, kFastest});
    if (const ConfigNode* part = map.find("body_part")) {
        const std::vector<std::string>& names = bodyPartNames();
        if (map.find("contact_speed_mps"))
            throw badInput(part->place(), "`body_part` and `contact_speed_mps` exclude each other",
                           "Remove one: the speed follows from the part.");
        const std::string what = toText(*part);
        if (what == "head" || what == "face" || what == "neck" || what == "skull")
            throw badInput(part->place(), "`" + what + "` may not be touched by what moves",
                           "Leave `body_part` out: then what it can touch rests before.");
        toChoice(*part, names);
        person.bodyPart = static_cast<BodyPart>(std::find(names.begin(), names.end(), what) - names.begin());
    }
    if (const ConfigNode* repeats = map.find("repeats")) person.repeats = toFlag(*repeats);
    readCapsules(map.require("capsules"), person);
    person.walk = detail::readWaypoints(map.require("walk"), person.repeats, "person", "walk");
    if (const ConfigNode* unseen = map.find("unseen")) {
        requireList(*unseen, "`unseen` is a list of times", "Write a list of {from_s, to_s}.");
        for (const ConfigNode& item : unseen->items) {
            ConfigMap times(item);
            const double from_s = toNumber(times.require("from_s"), kWalkTime);
            const ConfigNode& to = times.require("to_s");
            const double to_s = toNumber(to, kWalkTime);
            times.finish();
            if (!(to_s > from_s))
                throw badInput(to.place(), "a time that ends before it begins", "Let `to_s` be later.");
            person.unseen.push_back({from_s, to_s});
        }
    }
    map.finish();
    return person;
}

}  // namespace

Eigen::Vector3d Person::calcPlace(double t) const {
    return calcPlaceOnPath(walk, repeats, t);
}

bool Person::isSeen(double t) const {
    return !walk.empty() && std::none_of(unseen.begin(), unseen.end(), [t](const Absence& absence) {
        return t >= absence.from_s && t < absence.to_s;
    });
}

void checkPeople(const std::vector<Person>& people, const std::string& where) {
    std::vector<std::string> wrong;
    if (people.size() > static_cast<std::size_t>(kMaxPeople))
        wrong.push_back(std::to_string(people.size()) + " people; up to " + std::to_string(kMaxPeople) +
                        " can be kept apart from");
    for (const Person& person : people) {
        const auto complain = [&](const std::string& what) { wrong.push_back("'" + person.name + "' " + what); };
        const auto isIn = [](double x, double most) { return x >= 0.0 && x <= most; };
        if (!(person.maxSpeed > 0.0 && person.maxSpeed <= kFastest))
            complain("has a largest speed that is not in (0, " + detail::formatNumber(kFastest) + "] m/s");
        if (!isIn(person.latency_s, 10.0)) complain("has a latency that is not in [0, 10] s");
        if (!isIn(person.error_m, 10.0)) complain("has a measurement error that is not in [0, 10] m");
        if (!isIn(person.contactSpeed, kFastest))
            complain("has a contact speed that is not in [0, " + detail::formatNumber(kFastest) + "] m/s");
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

std::vector<Person> readPeople(const ConfigNode& block) {
    if (block.kind != ConfigNode::Kind::Map)
        throw badInput(block.place(), "people are entries with a name each",
                       "Write `people: {ann: {capsules: ..., walk: ...}, ...}`.");
    if (block.entries.size() > static_cast<std::size_t>(kMaxPeople))
        throw badInput(block.place(), std::to_string(block.entries.size()) + " people",
                       "Up to " + std::to_string(kMaxPeople) + " can be kept apart from.");
    std::vector<Person> people;
    detail::Complaints complaints;
    for (const auto& entry : block.entries)
        complaints.gather([&] { people.push_back(readPerson(entry.first, entry.second)); });
    complaints.throwIfAny(block.place());
    return people;
}

void setContactSpeeds(std::vector<Person>& people, double movingMass_kg) {
    for (Person& person : people)
        if (person.bodyPart)
            person.contactSpeed =
                movingMass_kg > 0.0 ? std::min(kFastest, calcContactSpeed(*person.bodyPart, movingMass_kg)) : 0.0;
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
