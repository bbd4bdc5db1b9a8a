#pragma once

#include "viable/environment/People.h"
#include "viable/plugin/SafetyFilter.h"

namespace viable::detail {

/** What is known of the people near an arm at a tick. A person who was seen at time s, by latency and error of what saw it, is at
any later time t within radius + error + maxSpeed (t - s + latency) of the axes that were seen: its reach. An observation in the
reach of the one before tells nothing new about stops that keep out of that; any other is counted and told. Real time after
construction. */
class PeopleWatch {
public:
    /** The axis of a capsule and what may be around it at once. */
    struct Body {
        Eigen::Vector3d a, b;
        double radius;  ///< with the measurement error [m]
    };
    struct Known {
        bool isKnown = false, isLost = false;
        double stamp_s = 0.0, since_s = 0.0;  ///< since: when its reach began to grow
        double speed = 0.0, contactSpeed = 0.0;
        int count = 0;
        std::array<Body, kMaxPersonCapsules> bodies;
        /** A ball around all of it. */
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        double size_m = 0.0;

        double calcGrowth(double t) const { return speed * std::max(0.0, t - since_s); }  ///< [m]
    };

    explicit PeopleWatch(std::vector<Person> people);

    const std::vector<Known>& known() const { return known_; }
    int size() const { return static_cast<int>(known_.size()); }
    const PeopleFaults& faults() const { return faults_; }
    double age_s(double time_s) const;  ///< of the oldest observation

    /** Forgets everybody, and begins to count anew. */
    void reset();
    /** Nobody has told of people yet, or somebody of whom nothing is known was told of in a way that is of no use: until that is
    mended, they may be anywhere. */
    bool isBlind() const;
    /** False: somebody is where nothing known before let expect a person, and what was proven before is not any more. */
    bool take(const PeopleObservation& seen, double time_s);

private:
    bool isExpected(const Known& before, const Person& person, const PersonObservation& seen) const;
    static void set(const Person& person, const PersonObservation& seen, Known& known);
    bool follow(std::size_t p, const PersonObservation& seen);

    std::vector<Person> people_;
    std::vector<Known> known_;
    /** What was known some time ago, see kAnchor_s: two, the older one is looked at. */
    std::vector<std::array<Known, 2>> anchors_;
    /** Of each person: what of it was refused by the feed, and since when nobody knows where it is (infinite: it is known, or was never
    told of). They outlive a reset(): the feed's counts and what it could not tell do, too. */
    std::vector<std::int64_t> refused_;
    std::vector<double> blindSince_s_;
    PeopleFaults faults_;
    std::int64_t feedRefused_ = 0, refusedBefore_ = 0, ownRefused_ = 0, version_ = 0;
    bool hasBegun_ = false;
};

}  // namespace viable::detail
