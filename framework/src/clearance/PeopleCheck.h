#pragma once

#include "clearance/CapsuleSpeeds.h"
#include "clearance/PeopleWatch.h"
#include "qp/RowQp.h"

namespace viable::detail {

struct StopPair;

/** Looks whether people can be touched, by a part of the arm that is faster than it may be then, on a path: the
monitoring of ISO/TS 15066, with the arm's own stop in the place of a worst one. A path is good when for every capsule of the arm, every person and
every time t until the capsule rests

    m(t) = distance(capsule(t), axes seen) - radius - error - maxSpeed (t - since) > 0,

or no point of the capsule is faster at t than the contact speed. Between looks a and b the points of the capsule's segment move by
no more than D altogether, the smaller of: the travel of the joints times levers, and the chord plus twice the sag (MotionBound);
so m >= (d(a) + d(b) - D) / 2 - reach(b). Where that does not suffice the middle is looked at.

A later observation lies in the reach of the one before (PeopleWatch), so what is proven stays proven, for as long as the path is
followed. Real time after construction, bounded work. */
class PeopleCheck {
public:
    /** Looks aim at so much more than must be left between them [m]. */
    static constexpr double kGuard_m = 0.003;
    /** The same for contact speeds, as a share. */
    static constexpr double kSpeedGuard = 0.02;
    /** Poses in a tick, and in one path; beyond them nothing that needs another is proven. */
    static constexpr int kMaxLooks = 300, kMostOfPath = 60;

    /** @param geometry  null: nobody is kept apart from
        @param people    how many there may be */
    PeopleCheck(const RobotDescription& robot, const ArmGeometry* geometry, int people, double tick_s);

    bool isAny() const { return people_ > 0 && speeds_.size() > 0; }
    void beginTick() { left_ = kMaxLooks; }
    /** Whom the next paths are about. @param time_s  of the run, when they begin */
    void setKnown(const PeopleWatch& watch, double time_s);

    /** What m may come to at looks [m]; below `ahead` it is steered. */
    struct Demand {
        double least = kGuard_m, ahead = kGuard_m;
    };
    struct Result {
        bool isKept = true;  ///< proven
        /** Least m at looks but the begin, or a lower bound where that is far enough [m]. */
        double seen = std::numeric_limits<double>::infinity();
        double proven = std::numeric_limits<double>::infinity();  ///< no m is less at any time [m]
        int link = -1, person = -1;                               ///< of that
    };
    /** @param extremes    of the path
        @param mustBeGood  the first look that is too near ends it */
    void examine(const ArmPath& path, const ArmPath::Extremes& extremes, const Demand& demand, bool mustBeGood,
                 Result& result);
    /** Of what the last examine() saw below `ahead` after the begin: rows that bring it back there, to first order, the nearest
    first. See SteeringRows; a stop that ends earlier is met by a smaller reach, which the row knows, too. */
    void addRows(const StopPair& stops, const Demand& demand, RowQp::Rows& rows);

private:
    static constexpr int kDepth = 8;  ///< halvings of a path
    static constexpr int kMostRows = 8;

    /** A capsule of the arm and a person. */
    struct Pair {
        int capsule = 0, person = 0;
        double least = 0.0, time_s = 0.0, lastFast_s = 0.0;  // m at the worst look after the begin; last look when fast
    };
    struct Look {
        double time_s = 0.0;
        JointVector travel;
        std::vector<CapsuleMotion::Segment> segments;  // of each capsule
        std::vector<double> speeds;
        std::vector<double> distances;  // of each pair
    };
    /** A capsule on the path that is looked at. */
    struct Capsule {
        double rest_s = 0.0, bend = 0.0, bendRate = 0.0;
        int lastJoint = -1;  ///< that rests last
    };

    double calcReach(int person, double t) const { return growth_[person] + speed_[person] * t; }
    double calcDistance(const Pair& pair, const CapsuleMotion::Segment& segment, double radius, double rest_s) const;
    bool sample(double time_s, bool isBegin, const std::vector<int>& open, Look& look);
    bool prove(const Look& from, const Look& to, int depth, const std::vector<int>& open);
    void settle(const Pair& pair, double bound);

    int n_, people_;
    double tick_s_;
    CapsuleSpeeds speeds_;
    std::vector<Capsule> parts_;
    std::vector<Pair> pairs_;
    const PeopleWatch* watch_ = nullptr;
    std::vector<double> growth_, speed_;  ///< of each person at the path's begin [m], and how fast it grows
    Look begin_, first_, end_;
    std::array<Look, kDepth> middle_;
    std::array<std::vector<int>, kDepth + 2> open_;  ///< pairs in question
    std::vector<int> inQuestion_;
    JointVector position_, row_;
    int left_ = kMaxLooks, leftOfPath_ = kMostOfPath;

    // Of the path that is looked at
    const ArmPath* path_ = nullptr;
    ArmPath::Extremes extremes_;
    Demand demand_;
    bool mustBeGood_ = false;
    Result* result_ = nullptr;
};

}  // namespace viable::detail
