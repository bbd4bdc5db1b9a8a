#pragma once

#include "clearance/CapsuleSpeeds.h"
#include "qp/RowQp.h"
#include "viable/plugin/SafetyFilter.h"

namespace viable::detail {

struct StopPair;

/** Looks whether the points of an arm keep RobotDescription::speedLimits along a path.

The velocity v of a point of the arm, with its velocities at two looks a and b, h apart, differs from the straight line
between them by no more than h^2/8 of the largest |d2v/dt2|; a straight line is nowhere longer than at its ends, so

    |v(t)| <= max(|v(a)|, |v(b)|) + h^2/8 max |d2v/dt2|,

with CapsuleMotion::calcBendRate() for the last factor. The same holds for the largest speed of all points of a capsule, which at
a look is known exactly (CapsuleSpeeds). A capsule that is outside of a region at both looks is outside between them, when it is so
by more than its points can move in h/2. Where that does not suffice the middle is looked at.

Real time after construction, bounded work. */
class SpeedCheck {
public:
    /** Speeds below are shares of their limits. Looks aim at so much less than may be reached between them. */
    static constexpr double kGuard = 0.02;
    /** Steering aims at so much less than looks may reach, as it is right to first order only. */
    static constexpr double kSteering = 0.005;
    static constexpr double kRounding = 1e-10;
    /** Poses in a tick, and in one path; beyond them nothing that needs another is proven. */
    static constexpr int kMaxLooks = 400, kMostOfPath = 120;

    /** @param geometry  whose capsules are limited; may be null where limits.needsCapsules() is false */
    SpeedCheck(const RobotDescription& robot, const ArmGeometry* geometry, double tick_s);

    bool isAny() const { return !parts_.empty(); }
    void beginTick() { left_ = kMaxLooks; }

    /** What speeds may come to, as shares of their limits. */
    struct Demand {
        double bound = 1.0;           ///< at every time
        double looks = 1.0 - kGuard;  ///< at looks, but for the path's begin
        double ahead = 0.0;           ///< <= looks: below it nothing need be steered
    };
    struct Result {
        bool isKept = true;      ///< proven
        double seen = 0.0;       ///< largest share at looks, the begin included
        double seenLater = 0.0;  ///< without it: what a jerk may change
        double proven = 0.0;     ///< no share is larger at any time
        LimitReport fastest;     ///< that share; of equal ones the faster point
    };
    /** @param extremes    of the path
        @param mustBeGood  the first look that is too fast ends it */
    void examine(const ArmPath& path, const ArmPath::Extremes& extremes, const Demand& demand, bool mustBeGood,
                 Result& result);
    /** Of what the last examine() saw above `ahead` after the begin: rows that bring it back there, to first order (see
    SteeringRows), that of the largest share first. */
    void addRows(const StopPair& stops, const Demand& demand, RowQp::Rows& rows);

private:
    /** What has one limit: a capsule, or the tool's origin. */
    struct Part {
        double radius = 0.0;  ///< [m]
        double limit = 0.0;   ///< [m/s]
        int carrier = -1;
        int link = -1;
        bool isCapsule = false;  ///< regions count
        double bendRate = 0.0;   ///< on the path [m/s^3]
        // Of the fastest look of the path after its begin, as a share of the limit there:
        double use = 0.0, time_s = 0.0, limitThere = 0.0;
    };
    struct Look {
        double time_s = 0.0;
        std::vector<double> speeds;
        std::vector<CapsuleMotion::Segment> segments;
    };
    static constexpr int kDepth = 9;  ///< halvings of a path

    static std::vector<LinkCapsule> listCapsules(const RobotDescription& robot, const ArmGeometry* geometry);
    double findLimit(const Part& part, const CapsuleMotion::Segment& segment, double margin) const;
    bool sample(double time_s, bool isBegin, Look& look);
    bool prove(const Look& from, const Look& to, int depth);

    int n_;
    double tick_s_;
    SpeedLimits limits_;
    CapsuleSpeeds speeds_;
    std::vector<Part> parts_;  ///< one for each of speeds_
    JointVector otherPosition_;
    Look begin_, first_, end_;
    std::array<Look, kDepth> middle_;
    int left_ = kMaxLooks, leftOfPath_ = kMostOfPath;

    // Of the path that is looked at
    const ArmPath* path_ = nullptr;
    Demand demand_;
    bool mustBeGood_ = false;
    Result* result_ = nullptr;
};

}  // namespace viable::detail
