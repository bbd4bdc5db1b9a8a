#include "Walkers.h"

#include <algorithm>

namespace viable {

Walkers::Walkers(Random& random, const Habits& habits, double tick_s)
    : random_(random), habits_(habits), tick_s_(tick_s) {
    const int count = random.integer(habits.least, habits.most);
    for (int p = 0; p < count; ++p) {
        Person person;
        person.name = "person" + std::to_string(p);
        person.maxSpeed = random.logUniform(habits.slowestOf, habits.fastest);
        person.latency_s = random.chance(0.5) ? random.logUniform(0.001, 0.1) : 0.0;
        person.error_m = random.chance(0.5) ? random.logUniform(0.001, 0.05) : 0.0;
        if (random.chance(habits.contactChance)) person.contactSpeed = random.logUniform(0.02, 1.0);
        const int capsules = random.integer(1, 4);
        for (int k = 0; k < capsules; ++k) {
            PersonCapsule capsule;
            capsule.a = random.uniform(0.0, 0.5) * random.direction();
            capsule.b = random.chance(0.3) ? capsule.a
                                           : Eigen::Vector3d(capsule.a + random.uniform(0.1, 1.2) * random.direction());
            capsule.radius = random.logUniform(0.03, 0.25);
            person.capsules.push_back(capsule);
        }
        people_.push_back(person);
        Walker walker;
        walker.place = random.uniform(0.8, habits.farthest_m) * random.direction();
        walker.velocity.setZero();
        walker.past.assign(static_cast<std::size_t>(std::ceil(person.latency_s / tick_s)) + 1, walker.place);
        walker.isAfterArm = random.chance(habits.targetChance);
        walker.period_s = random.chance(0.5) ? 0.0 : random.logUniform(0.005, 0.1);
        walkers_.push_back(walker);
    }
}

void Walkers::observe(PeopleObservation& seen) {
    const double now_s = time_s();
    unseenJump_ = false;
    for (std::size_t p = 0; p < walkers_.size(); ++p) {
        Walker& walker = walkers_[p];
        const Person& person = people_[p];
        if (walker.lost_s > 0.0) {
            walker.seen.kind = PersonObservation::Kind::Unseen;
        } else if (walker.seen.kind == PersonObservation::Kind::Unseen || now_s >= walker.next_s) {
            walker.next_s = now_s + walker.period_s;
            // Of any time within the latency, and wrong by anything within the error.
            const int most = static_cast<int>(walker.past.size()) - 1;
            const int late = std::min(random_.integer(0, most), static_cast<int>(person.latency_s / tick_s_));
            const Eigen::Vector3d error = person.error_m * random_.uniform(0.0, 1.0) * random_.direction();
            const Eigen::Vector3d place = walker.past[static_cast<std::size_t>(most - late)] + error;
            walker.seen.kind = PersonObservation::Kind::Seen;
            walker.seen.stamp_s = now_s;
            walker.seen.count = static_cast<int>(person.capsules.size());
            for (std::size_t k = 0; k < person.capsules.size(); ++k)
                walker.seen.capsules[k] = {place + person.capsules[k].a, place + person.capsules[k].b,
                                           person.capsules[k].radius};
            if (walker.jumped_s >= 0.0 && now_s - late * tick_s_ >= walker.jumped_s) {
                walker.jumped_s = -1.0;
                seenJump_ = true;
            }
        }
        unseenJump_ |= walker.jumped_s >= 0.0;
        seen.people[p] = walker.seen;
    }
}

void Walkers::place(double t_s, PeopleObservation& places) const {
    for (std::size_t p = 0; p < walkers_.size(); ++p) {
        const Eigen::Vector3d at = walkers_[p].place + t_s * walkers_[p].velocity;
        PersonObservation& one = places.people[p];
        one.kind = PersonObservation::Kind::Seen;
        one.count = static_cast<int>(people_[p].capsules.size());
        for (std::size_t k = 0; k < people_[p].capsules.size(); ++k) {
            const PersonCapsule& capsule = people_[p].capsules[k];
            one.capsules[k] = {at + capsule.a, at + capsule.b, capsule.radius};
        }
    }
}

void Walkers::turn(Walker& walker, double speed, const Eigen::Vector3d& target) {
    if (habits_.leaves_s > 0.0) {
        walker.velocity =
            time_s() < habits_.leaves_s ? Eigen::Vector3d::Zero() : Eigen::Vector3d(speed * walker.place.normalized());
        return;
    }
    const Eigen::Vector3d way = target - walker.place;
    const bool goesForArm = walker.isAfterArm && random_.chance(0.7);
    if (goesForArm || walker.place.norm() > habits_.farthest_m)
        walker.velocity = way.norm() > 1e-6 ? Eigen::Vector3d(speed * way.normalized()) : Eigen::Vector3d::Zero();
    else
        walker.velocity = random_.uniform(habits_.slowest, 1.0) * speed * random_.direction();
}

void Walkers::walk(const Eigen::Vector3d& target) {
    for (std::size_t p = 0; p < walkers_.size(); ++p) {
        Walker& walker = walkers_[p];
        walker.place += tick_s_ * walker.velocity;
        if (random_.chance(habits_.jumpChance)) {
            ++jumps;
            walker.place = random_.uniform(0.1, 1.5) * random_.direction();
            walker.jumped_s = static_cast<double>(tick_ + 1) * tick_s_;
            unseenJump_ = true;
            std::fill(walker.past.begin(), walker.past.end(), walker.place);
        }
        walker.past.erase(walker.past.begin());
        walker.past.push_back(walker.place);
        walker.lost_s = std::max(0.0, walker.lost_s - tick_s_);
        if (random_.chance(habits_.loseChance)) {
            ++losses;
            walker.lost_s = random_.logUniform(0.01, 0.5);
        }
        walker.left_s -= tick_s_;
        if (walker.left_s > 0.0) continue;
        walker.left_s = random_.uniform(habits_.shortest_s, habits_.longest_s);
        turn(walker, people_[p].maxSpeed, target);
    }
    ++tick_;
}

void Walkers::run(const Eigen::Vector3d& target) {
    for (std::size_t p = 0; p < walkers_.size(); ++p) {
        Walker& walker = walkers_[p];
        walker.place += tick_s_ * walker.velocity;
        const Eigen::Vector3d way = target - walker.place;
        if (way.norm() > 1e-6) walker.velocity = people_[p].maxSpeed * way.normalized();
    }
}

}  // namespace viable
