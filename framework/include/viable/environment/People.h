#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <optional>

#include "viable/config/ConfigNode.h"

namespace viable {

/** A place on a path that is known: straight and at constant speed to the next. */
struct Waypoint {
    double time_s = 0.0;                                 ///< rising
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< base frame [m]

    template <class V>
    void describe(V& v) {
        v(time_s, "time_s", "s", "Of the run; rising.").atLeast(0).upTo(1e6).required();
        v(position, "xyz", "m", "The place then, base frame.").atLeast(-1000).upTo(1000).required();
    }
};

/** The place on a path at time t [s] of the run. Before the first waypoint it is at rest there. After the last it is
at rest or, where the path repeats, on its way again. @param path  at least one */
Eigen::Vector3d calcPlaceOnPath(const std::vector<Waypoint>& path, bool repeats, double t);

/** Parts of a person that an arm may touch in passing. Head, face and neck are not among them: here nothing that
moves may touch them. */
enum class BodyPart : unsigned char { Back, Chest, Abdomen, Pelvis, UpperArm, Forearm, Hand, Thigh, LowerLeg };

/** As in experiment files, in the order of BodyPart. */
inline constexpr char kBodyPartWords[] = "back|chest|abdomen|pelvis|upper_arm|forearm|hand|thigh|lower_leg";
const std::vector<std::string>& bodyPartNames();

/** The speed at which an arm may touch a part that can give way: v = F / sqrt(mu k) [m/s]. The arm moves
`movingMass_kg` (> 0, tool and payload included). Here mu is the reduced mass of both. Force F (twice the one for
clamping), stiffness k and mass of the part are those of ISO/TS 15066:2016, tables A.2 and A.3. (Now ISO 10218-2:2025.)

This is the speed of one against the other, for a blunt contact: the person's own speed is not the arm's. The
standard takes half of the arm's mass and the payload. Here all that moves counts, which allows less. As in the
standard, motors behind gears do not count. Nothing here knows edges (the standard limits the pressure, too) or
somebody who cannot give way. */
double calcContactSpeed(BodyPart part, double movingMass_kg);

/** How many people, and capsules of each, an arm can keep apart from. */
inline constexpr int kMaxPeople = 16, kMaxPersonCapsules = 8;
/** Nothing of a person is farther away, or larger [m]. */
inline constexpr double kFarthestPerson_m = 1000.0;
/** Nobody is faster [m/s]: a larger number is a mistake in the unit. */
inline constexpr double kFastestPerson_mps = 20.0;

/** A part of a person: all points within `radius` of the segment from a to b (a ball where they are the same). */
struct PersonCapsule {
    Eigen::Vector3d a = Eigen::Vector3d::Zero(), b = Eigen::Vector3d::Zero();  ///< [m]
    double radius = 0.0;                                                       ///< > 0 [m]

    template <class V>
    void describe(V& v) {
        v(a, "from_m", "m", "One end of its axis, from the person's place.").atLeast(-1000).upTo(1000).required();
        v(b, "to_m", "m", "The other end; without it, it is a ball.").atLeast(-1000).upTo(1000).optional();
        v(radius, "radius_m", "m", "Around the axis.").above(0).upTo(1000).required();
    }
    void check(const ConfigNode& block) {
        if (!block.find("to_m")) b = a;
    }
};

/** A person near the arm, or a part of one that is faster than the rest, such as a hand. It holds what is known
before the person is seen, and for tests the walk. In a file:

    ann:
      capsules: [{from_m: [0, 0, 0], to_m: [0, 0, 1.5], radius_m: 0.25}, {from_m: [0.3, 0, 1.1], radius_m: 0.1}]
      walk: [{time_s: 0, xyz: [2, 0, 0]}, {time_s: 4, xyz: [0.9, 0, 0]}]
      max_speed_mps: 1.6
      latency_s: 0.05
      error_m: 0.02
      contact_speed_mps: 0     # or body_part: hand */
struct Person {
    std::string name;
    double maxSpeed = 1.6;  ///< none of its points is ever faster [m/s]; 1.6 walking, 2 a hand (ISO 13855)
    /** An observation tells where the person was at some time from so much before its stamp up to it [s]. */
    double latency_s = 0.0;
    double error_m = 0.0;  ///< and is wrong by no more than this [m]
    /** Points of the arm may touch the person at this speed [m/s]; 0: what it can touch must rest before. */
    double contactSpeed = 0.0;
    /** The body part that a file names; setContactSpeeds() makes the contact speed of it. */
    std::optional<BodyPart> bodyPart;

    using Waypoint = viable::Waypoint;
    /** Times in which nothing sees the person [s]. */
    struct Absence {
        double from_s = 0.0, to_s = 0.0;

        template <class V>
        void describe(V& v) {
            v(from_s, "from_s", "s", "Nothing sees the person from here on.").atLeast(0).upTo(1e6).required();
            v(to_s, "to_s", "s", "Until here.").atLeast(0).upTo(1e6).required();
        }
        void check(const ConfigNode& block) const;
    };
    std::vector<PersonCapsule> capsules;  ///< a scripted person's, from its place on the walk
    /** Straight and at constant speed from one to the next. At rest before the first and after the last. Empty: not
    scripted, and seen only where somebody else puts it into the PeopleFeed. */
    std::vector<Waypoint> walk;
    bool repeats = false;
    std::vector<Absence> unseen;

    template <class V>
    void describe(V& v) {
        v(capsules, "capsules", "What the person is made of, up to 8.").count(1, kMaxPersonCapsules).required();
        v(walk, "walk",
          "Where it is when: straight and at constant speed from one to the next. The arm does not know it.")
            .required();
        v(repeats, "repeats", "Walk it again and again; it must end where it begins.");
        v(maxSpeed, "max_speed_mps", "m/s", "None of the person's points is faster: 1.6 walking, 2 a hand (ISO 13855).")
            .above(0)
            .upTo(kFastestPerson_mps);
        v(latency_s, "latency_s", "s", "What is seen is up to so much older than it says.").atLeast(0).upTo(10);
        v(error_m, "error_m", "m", "And wrong by no more than this.").atLeast(0).upTo(10);
        v(contactSpeed, "contact_speed_mps", "m/s",
          "Points of the arm may touch the person at this speed; 0: they rest before.")
            .atLeast(0)
            .upTo(kFastestPerson_mps);
        v(bodyPart, "body_part", kBodyPartWords,
          "What all capsules are of, instead of the speed: the one at which this arm may touch somebody there who "
          "stands still, by ISO/TS 15066.");
        v(unseen, "unseen", "When nothing sees the person.").count(1, 0);
    }
    void check(const ConfigNode& block) const;

    Eigen::Vector3d calcPlace(double t) const;  ///< on the walk [m]
    bool isSeen(double t) const;
};

/** Checks what was filled in code. Throws Error (BadInput) that names every person with a number that cannot be.
@param where  for the message */
void checkPeople(const std::vector<Person>& people, const std::string& where);

/** Sets the contact speed of people with a body part (calcContactSpeed) for an arm that moves so much; an arm
without mass has none. A part stands for all capsules of the person. */
void setContactSpeeds(std::vector<Person>& people, double movingMass_kg);

/** The observation of one person. */
struct PersonObservation {
    enum class Kind : unsigned char {
        Unseen,  ///< nothing: the person may have gone anywhere since it was seen last
        Seen,
        Gone,  ///< it is known to be far away at its stamp, and is forgotten until it is seen again; say it until it is
    };
    Kind kind = Kind::Unseen;
    double stamp_s = 0.0;      ///< in the time of the run
    int count = 0;             ///< number of capsules
    std::int64_t refused = 0;  ///< observations of this person that could not be used, so far; the feed counts
    std::array<PersonCapsule, kMaxPersonCapsules> capsules;  ///< base frame
};

/** All that was seen at one time; people by their indices. */
struct PeopleObservation {
    std::array<PersonObservation, kMaxPeople> people;
    std::int64_t version = 0;  ///< 0: nothing has been seen yet; the feed counts
    std::int64_t refused = 0;  ///< observations of persons that could not be used, so far
    int lastRefused = -1;      ///< whose
};

/** The observation of a sensor without error at time t, of the people that have a walk; allocates nothing. */
void observeWalks(const std::vector<Person>& people, double t, PeopleObservation& seen);

/** Hands observations of people from the thread that sees them to the one that moves the arm, without lock or wait
on either side. The newest of several observations counts. One thread each. */
class PeopleFeed {
public:
    /** @param people  who may come, not more than kMaxPeople. Throws Error (BadInput), see checkPeople(). */
    explicit PeopleFeed(std::vector<Person> people);
    ~PeopleFeed();
    PeopleFeed(const PeopleFeed&) = delete;
    PeopleFeed& operator=(const PeopleFeed&) = delete;

    const std::vector<Person>& people() const { return people_; }

    /** For the thread that sees. An unusable person counts as unseen and as refused. Unusable are numbers that are
    not finite or farther away than kFarthestPerson_m, and radii that are not above 0. Unusable are also no capsule
    or more than there is room for, and a person that is not among people(). The arm does not keep apart from that
    person, as nobody knows the speed. Until the first one, an empty one too, the arm rests. Allocates nothing.
    @return  how many persons were refused */
    int put(const PeopleObservation& seen);

    /** Reserves take() for the caller; false when it is reserved already. */
    bool claim() { return !isClaimed_.exchange(true); }
    void release() { isClaimed_ = false; }
    /** The arm's thread: the newest, valid until the next call. Real time. */
    const PeopleObservation& take();

private:
    struct Slots;
    std::vector<Person> people_;
    std::unique_ptr<Slots> slots_;
    std::atomic<bool> isClaimed_{false};
};

}  // namespace viable
