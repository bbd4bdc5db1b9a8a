#pragma once

#include "clearance/MotionBound.h"
#include "clearance/PeopleCheck.h"
#include "clearance/SpeedCheck.h"
#include "clearance/SteeringRows.h"

namespace viable::detail {

/** Looks whether an arm, on its way through a tick and the stop after it, keeps clear of obstacles and of itself, needs no
more torque than its motors have and is nowhere faster than it may be. Its parts: MotionBound (how far points move), ElementDistance
(clearances at a pose), bisection::prove (clearances at all times), TorqueScan, SpeedCheck, and SteeringRows for what to do about it.

Most of what was proven of the path that was taken a tick ago is good for the next one: a clearance, less how far the points
are apart on the two paths, is still a lower bound, and a torque, plus how far the torques are apart, still an upper one.
Only what that leaves open is looked at.

Real time after construction, bounded work. */
class ArmStopCheck {
public:
    /** @param geometry  may be null: no clearance is kept
        @param limited   whose capsules' speeds are limited, see SpeedCheck
        @param people    see PeopleCheck, for which `limited` counts, too */
    ArmStopCheck(const RobotDescription& robot, const ArmGeometry* geometry, const TorqueScan::Limits& limits,
                 double tick_s, const ArmGeometry* limited = nullptr, int people = 0);

    /** Null: nothing stands around. */
    void setSurroundings(const Surroundings* surroundings) { distance_.setSurroundings(surroundings); }

    bool keepsSpeeds() const { return speed_.isAny(); }
    /** Whom paths are to keep apart from. @param time_s  of the run, when they begin */
    void setPeople(const PeopleWatch& watch, double time_s) { people_.setKnown(watch, time_s); }
    /** A look at a path for people alone: what it keeps. */
    void measurePeople(const ArmPath& path, PeopleCheck::Result& result);
    int elements() const { return static_cast<int>(elements_.size()); }

    /** What every element must keep [m], see bisection::Demand; a path that begins with less than `least` keeps what it begins
    with, or `reached`, if that is more by rounding only: else each tick could use up rounding anew. */
    struct Demands {
        std::vector<double> floor, least, ahead, reached;
        /** >= ahead: clearances that are known to be larger are not measured again [m]. */
        std::vector<double> far;
        /** The pose that paths begin with is known to keep the floor. */
        bool beginsAbove = false;
        /** The most that torque may use of its limits, >= 1; infinite: it is only measured. */
        double torqueUse = 1.0;
        SpeedCheck::Demand speed;
        PeopleCheck::Demand people;
    };
    /** What a path keeps of an element, by shares of the time of the path that was looked at last. */
    struct Profile {
        std::array<bisection::Bounds, bisection::Result::kParts> parts;
        double begin_s = 0.0;     ///< of that path, in the time of this one
        double duration_s = 1.0;  ///< of that path
        double lost = 0.0;  ///< how far this path can be from it [m]; what is known of all the path is less by that

        /** Between two times, for a path from which the element is no farther than `apart`. */
        bisection::Bounds find(double from_s, double to_s, double apart) const;
    };
    /** Where an element was nearest when it was looked at last; a path that was not looked at there can be a little off. */
    struct Near {
        ElementDistance::Place place;
        double time_s = 0.0;  ///< in that of the path, < 0: it is over
    };
    /** What came of a look at a path. */
    struct Result {
        bool isClear = false;  ///< every element proven to keep its floor, and its least at looks
        bool isAhead = false;  ///< and nowhere nearer than `ahead`
        TorqueScan::Result torque;
        SpeedCheck::Result speed;
        PeopleCheck::Result people;
        bool isGood() const { return isClear && torque.bearsTorque && speed.isKept && people.isKept; }
        /** Of each element the least clearance seen, or a lower bound where that is far enough, and a lower bound for
        all times [m]. */
        std::vector<double> seen, proven;
        std::vector<Profile> profile;
        std::vector<Near> near;
        /** Only of a path that is good: where it was seen nearest; the distance is a lower bound for all of the path. */
        LimitReport nearest;
    };
    /** A path that was examined in the same surroundings, and what came of it. */
    struct Known {
        const ArmPath& path;
        std::int64_t begin;  ///< tick of it with which the path to be examined begins
        const Result& result;
    };
    /** The paths that may be known when one is examined. */
    struct KnownPaths {
        static constexpr int kMost = 2;
        int count = 0;
        std::array<const Known*, kMost> paths{};
    };
    /** @param lastTorque  of the tick before the path's first
        @param known       of the same tick's surroundings; of each element the one that tells most counts
        @param mustBeGood  the first speed, person or clearance that is not kept ends it: then only isClear and bearsTorque, both
                           false, speed.isKept and people.isKept are told, and there are no rows
        `result` must come from makeResult(); `path` must live until addRows(). */
    void examine(const ArmPath& path, double time_s, const Demands& demands, const JointVector& lastTorque,
                 const KnownPaths& known, bool mustBeGood, Result& result);
    Result makeResult() const;
    /** Where element e was nearest in the last examine(). */
    LimitReport getNearest(int e) const;

    /** Rows for the jerk u of the tick that belong to what the last examine() found, to first order: clearances below
    `ahead`, nearest first, torques beyond their limits along the stop,
    speeds, and people.
    @param jerk   of the path that was examined
    @param other  another path from the same state, with `otherJerk`: how the stops move with the jerk is their difference */
    void addRows(const JointVector& jerk, const ArmPath& other, const JointVector& otherJerk, const Demands& demands,
                 RowQp::Rows& rows);
    /** Of these only the rows for speeds and people, which a look that ended there has found.
    @param stops  the path that was examined first */
    void addMotionRows(const StopPair& stops, const Demands& demands, RowQp::Rows& rows);
    /** Rows for clearances as addRows(), of what was found of a path before it is examined again: for all elements that are near.
    @param found     of a path of which `stops.path` is left, `since_s` later
    @param stops     from the state now, with the jerk of that path, and another one
    @return          whether the other one breaks any of them */
    bool addForeseenRows(const Result& found, double since_s, const StopPair& stops, const Demands& demands,
                         RowQp::Rows& rows);
    /** Whether in the last examine(), which found this, nothing but a rate of torque was not kept, or could not be looked at. */
    bool failsByRate(const Result& found) const {
        return found.isClear && found.speed.isKept && found.people.isKept && torque_.failsByRate();
    }
    struct Worst {
        int joint = -1;        ///< -1: none
        bool isAlong = false;  ///< of a clearance: the jerks lead along it more than towards it
    };
    /** Of what the last examine() found not to be good, with mustBeGood: the joint that, with the jerk of the other path, would
    mend most of it, to first order. */
    Worst findWorstJoint(const Result& found, const JointVector& jerk, const ArmPath& other,
                         const JointVector& otherJerk, const Demands& demands);
    /** See SteeringRows::addTick. */
    void addTickRows(const Dynamics& dynamics, const JointVector& qdd, double torqueUse, const JointVector& lastTorque,
                     RowQp::Rows& rows) const {
        rows_.addTick(dynamics, qdd, torqueUse, lastTorque, rows);
    }

    /** The torque of a tick of a path. */
    void calcTorque(const ArmPath& path, std::int64_t tick, JointVector& torque) {
        torque_.calcTorque(path, tick, torque);
    }

    /** What may be looked at from now on until the next call: a tick's work. */
    void beginTick();
    /** The next tick is the first of a run. */
    void reset() { torque_.forget(); }

    /** In a tick: distances of points from the surroundings or of capsules from each other. Beyond them nothing that needs
    another is proven. On top come, of each element and path, the rough distances that are measured in any case: 2 where nothing
    is known, up to 17 where every other part of the path is (two for each of 8 open parts, and one where it failed before); and
    the rest of a capsule's. */
    static constexpr int kMaxDistances = 8000;

private:
    class Subject;  ///< an element, as bisection::prove asks about it

    /** examine(), but for what it must not leave behind. */
    void examineWith(const ArmPath& path, double time_s, const Demands& demands, const JointVector& lastTorque,
                     const KnownPaths& known, bool mustBeGood, Result& result);
    void setKnown(const ArmPath& path, const KnownPaths& known);
    void chooseKnown(std::size_t e);
    bool isKnown(std::size_t e, const Demands& demands);
    bool checkElement(std::size_t e, const Demands& demands, bool mustBeGood);
    bool hasBudget() const { return distances_ > 0; }
    void findNearest(const Demands& demands, Result& result);

    int n_;
    std::vector<LinkCapsule> capsules_;
    std::vector<ArmElement> elements_;
    ElementDistance distance_;
    MotionBound motion_;
    TorqueScan torque_;
    SpeedCheck speed_;
    PeopleCheck people_;
    SteeringRows rows_;
    double tick_s_;
    int distances_ = kMaxDistances;  ///< left in this tick

    // Of the path that is looked at
    const ArmPath* path_ = nullptr;
    KnownPaths known_;                                          ///< during examine(), as source_
    ArmPath::Extremes own_;                                     ///< of the path
    ArmPath::Extremes extremes_;                                ///< of the path and of all that are known
    std::array<ArmPath::Difference, KnownPaths::kMost> apart_;  ///< from each known path
    /** Of the element in question: the known path that tells most of it (null: none is known), and how far it is from that. */
    const Known* source_ = nullptr;
    double apart_m_ = 0.0;
    std::vector<char> isLooked_;                  ///< of each element; else found_ is what was known
    std::vector<ElementDistance::Place> places_;  ///< the nearest of each element
    std::vector<bisection::Result> found_;        ///< of each element
    std::vector<std::size_t> order_;              ///< of the elements: what failed in this tick first
    std::vector<int> failedAt_;     ///< of each element the sample of its last failure in this tick; -1: none
    std::vector<Profile> profile_;  ///< of each element that is not looked at
    std::vector<Near> near_;        ///< the same
};

}  // namespace viable::detail
