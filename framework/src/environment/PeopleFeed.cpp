#include <cmath>

#include "core/LatestValue.h"
#include "viable/environment/People.h"

namespace viable {

static bool isUsable(const PersonObservation& seen) {
    if (!std::isfinite(seen.stamp_s) || seen.count < 1 || seen.count > kMaxPersonCapsules) return false;
    for (int k = 0; k < seen.count; ++k) {
        const PersonCapsule& capsule = seen.capsules[k];
        const bool isNear = capsule.a.cwiseAbs().maxCoeff() <= kFarthestPerson_m &&
                            capsule.b.cwiseAbs().maxCoeff() <= kFarthestPerson_m;
        if (!(capsule.a.allFinite() && capsule.b.allFinite() && isNear)) return false;
        if (!(capsule.radius > 0.0 && capsule.radius <= kFarthestPerson_m)) return false;
    }
    return true;
}

struct PeopleFeed::Slots {
    LatestValue<PeopleObservation> latest;
    PeopleObservation next;  ///< the putting thread's
};

PeopleFeed::PeopleFeed(std::vector<Person> people) : people_(std::move(people)), slots_(std::make_unique<Slots>()) {
    checkPeople(people_, "PeopleFeed");
}

PeopleFeed::~PeopleFeed() = default;

int PeopleFeed::put(const PeopleObservation& seen) {
    PeopleObservation& next = slots_->next;
    int refused = 0;
    for (std::size_t i = 0; i < next.people.size(); ++i) {
        PersonObservation& one = next.people[i];
        const std::int64_t before = one.refused;
        one = seen.people[i];
        one.refused = before;
        if (one.kind == PersonObservation::Kind::Unseen) continue;
        const bool isKnown = i < people_.size();
        if (isKnown && (one.kind == PersonObservation::Kind::Gone ? std::isfinite(one.stamp_s) : isUsable(one)))
            continue;
        one.kind = PersonObservation::Kind::Unseen;
        ++one.refused;
        next.lastRefused = isKnown ? static_cast<int>(i) : -1;
        ++refused;
    }
    next.refused += refused;
    ++next.version;
    slots_->latest.write(next);
    return refused;
}

const PeopleObservation& PeopleFeed::take() {
    return slots_->latest.read();
}

}  // namespace viable
