#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "clearance/ArmPath.h"
#include "clearance/CapsuleMotion.h"
#include "clearance/TorqueRate.h"
#include "robot/ArmRecursion.h"
#include "viable/environment/Surroundings.h"
#include "viable/plugin/SafetyFilter.h"
#include "viable/qp/RowQp.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** Looks whether an arm, on its way through a tick and the stop after it, keeps clear of obstacles and of itself and needs no
more torque than its motors have.

Clearance. An element is a capsule with the surroundings, or a pair of capsules. Its clearance c(t) cannot change faster than
its points move: between two looks at a and b, where no point of it moves by more than D,

    c(t) >= max(c(a) - D(a, t), c(b) - D(t, b)) >= (c(a) + c(b) - D) / 2,

so that nothing between two looks can be missed, however thin. For D there are two bounds, of which the lower counts. Joint
by joint: the travel of the joint times the farthest that a point of the element can be from its axis. And: how far the
segments' ends have come from a to b, h apart (for a pair: as seen from what carries both), with h^2/4 times the largest
acceleration of their points, since these leave the straight way between two places by no more than h^2/8 of it, which
enters twice: from a, and to b. Where the bound does not suffice, the middle is looked at, down to 1/kDivisions of the
path's time; what is not proven then counts as not kept. A look itself may be lower than the truth (see DistanceField) and
counts for no less than its neighbour's less D.

Torque. Looked at in ticks; how many may be left out follows from TorqueRate and from what is missing to the limit.

Real time after construction, bounded work. */
class ArmStopCheck {
public:
    struct TorqueLimits {
        JointVector torque;  ///< [Nm]; infinite: none
        JointVector rate;    ///< [Nm/s]; infinite: none
    };
    /** Looks aim at so much more than must be kept; what is left between two of them may use it up [m]. */
    static constexpr double kGuard_m = 0.005;

    /** @param geometry  may be null: no clearance is kept */
    ArmStopCheck(const RobotDescription& robot, const ArmGeometry* geometry, const TorqueLimits& limits, double tick_s);

    /** Null: nothing stands around. */
    void setSurroundings(const Surroundings* surroundings) { surroundings_ = surroundings; }

    int elements() const { return static_cast<int>(elements_.size()); }

    /** What every element must keep [m]. */
    struct Demands {
        std::vector<double> floor;  ///< at every time
        std::vector<double> least;  ///< at looks, >= floor, or as much as the path begins with
        std::vector<double> ahead;  ///< >= least: below it a place to steer away from is kept
        /** The pose that paths begin with is known to keep the floor. */
        bool beginsAbove = false;
        /** The most that torque may use of its limits, >= 1; infinite: it is only measured. */
        double torqueUse = 1.0;
    };
    /** What came of a look at a path. */
    struct Result {
        bool isClear = false;      ///< every element proven to keep its floor, and its least at looks
        bool isAhead = false;      ///< and nowhere nearer than `ahead`
        bool bearsTorque = false;  ///< when it is only measured: all of it was
        /** Of each element the least clearance seen, or a lower bound where that is far enough, and a lower bound for
        all times [m]. */
        std::vector<double> seen, proven;
        double torqueUse = 0.0;  ///< largest |tau| / limit or |change| / limit seen
        Clearance nearest;
    };
    /** @param lastTorque  of the tick before the path's first
        @param mustBeGood  the first clearance that is not kept ends it: then only isClear and bearsTorque, both false, are
                           told, and there are no rows
        `result` must come from makeResult(). */
    void examine(const ArmPath& path, double time_s, const Demands& demands, const JointVector& lastTorque,
                 bool mustBeGood, Result& result);
    Result makeResult() const;
    /** Where element e was nearest in the last examine(). */
    Clearance getNearest(int e) const;

    /** Rows for the jerk u of the tick that belong to what the last examine() found, to first order: clearances below
    `ahead`, nearest first, and torques beyond their limits along the stop.
    @param jerk   of the path that was examined
    @param other  another path from the same state, with `otherJerk`: how the stops move with the jerk is their difference */
    void addRows(const JointVector& jerk, const ArmPath& other, const JointVector& otherJerk, const Demands& demands,
                 RowQp::Rows& rows) const;
    /** Rows that keep the torque of the tick itself, M (qdd + u dt / 2) + b, within its limits; exact. */
    void addTickRows(const Dynamics& dynamics, const JointVector& qdd, double torqueUse, const JointVector& lastTorque,
                     RowQp::Rows& rows) const;

    /** The torque of a tick of a path. */
    void calcTorque(const ArmPath& path, std::int64_t tick, JointVector& torque);

    /** What may be looked at from now on until the next call: a tick's work. */
    void beginTick();

    /** In a tick: distances of points from the surroundings or of capsules from each other, and torques; what comes
    on top, two rough distances per element and path and the rest of a capsule's, is little. Beyond them nothing that needs another is proven. */
    static constexpr int kMaxDistances = 8000, kMaxTorques = 1500;

private:
    static constexpr int kDivisions = 128;  ///< of a path's time

    /** A capsule as balls that cover it, their centres evenly along its segment. */
    struct Cover {
        int gaps = 0;                        ///< one less than balls
        double radius = 0.0, spacing = 0.0;  ///< of each ball, of their centres [m]
        double reach = 0.0;                  ///< radius of one ball around them all [m]
    };
    struct Element {
        int first = 0, second = -1;  ///< capsules; second -1: the surroundings
        int base = -1;               ///< outermost joint that carries both of a pair; -1: none
        JointVector lever;  ///< along the path: farthest of its points from each joint's axis; 0: not moved [m]
        std::array<double, 2> bend{};  ///< along the path: calcBend() of its capsules as seen from `base`
    };
    /** Where an element was nearest. */
    struct Place {
        double distance = std::numeric_limits<double>::infinity();
        int sample = 0;
        int obstacle = -1;
        Eigen::Vector3d gradient = Eigen::Vector3d::Zero();  ///< unit, from the obstacle to the first capsule
        Eigen::Vector3d onFirst = Eigen::Vector3d::Zero(), onSecond = Eigen::Vector3d::Zero();
        bool isSeen() const { return distance < std::numeric_limits<double>::infinity(); }
    };
    /** The arm at a time of the path. */
    struct Sample {
        bool isKnown = false;
        CapsuleMotion::Pose pose;
        JointVector travel;  ///< of each joint up to here [rad]
    };
    /** A clearance at a sample: first that of one ball around all, which is less. */
    struct Look {
        int sample = 0;
        double clearance = std::numeric_limits<double>::infinity();
        double moved = 0.0;     ///< farthest that any of its points can have moved since the path's begin [m]
        double ofMiddle = 0.0;  ///< distance of a capsule's middle from the surroundings [m]
        bool isRough = true;
    };
    struct TorqueFault {
        std::int64_t tick = 0;
        int joint = 0;
        double torque = 0.0;  ///< beyond the limit of its sign [Nm]
    };
    /** What prove() is about. */
    struct Question {
        int element;
        double floor, least, ahead;
    };

    static std::vector<Cover> makeCovers(const std::vector<LinkCapsule>& capsules);
    static std::vector<double> getRadii(const std::vector<Cover>& covers);
    void setMotion();
    double calcReach(const Element& element, const Look& from, const Look& to);
    const Sample& getSample(int sample);
    Look lookRoughly(int e, int sample);
    void look(int e, Look& look);
    void prove(const Question& question, Look& from, Look& to);
    void settle(const Question& question, double bound, const Look& from, const Look& to);
    void findNearest(Result& result);
    void examineTorque(double torqueUse, const JointVector& lastTorque, Result& result);
    void addClearanceRow(const Place& place, const Element& element, double bound, const JointVector& jerk,
                         const ArmPath& other, const JointVector& otherJerk, RowQp::Rows& rows) const;
    void addTorqueRow(const TorqueFault& fault, double torqueUse, const JointVector& jerk, const ArmPath& other,
                      const JointVector& otherJerk, RowQp::Rows& rows) const;
    double calcTime(int sample) const { return path_->duration() * sample / kDivisions; }

    int n_;
    TorqueLimits limits_;
    double tick_s_;
    ArmRecursion arm_;
    TorqueRate torqueRate_;
    bool limitsTorque_, limitsTorqueRate_;
    std::vector<LinkCapsule> capsules_;
    std::vector<Cover> covers_;
    CapsuleMotion motion_;
    std::vector<Element> elements_;
    const Surroundings* surroundings_ = nullptr;
    int distances_ = 0, torques_ = 0;  ///< left in this tick

    // Of the path that is looked at
    const ArmPath* path_ = nullptr;
    ArmPath::Extremes extremes_;
    double time_s_ = 0.0;
    std::vector<Sample> samples_;
    std::vector<Place> places_;  ///< the nearest of each element
    std::vector<Look> rough_;    ///< of each element the lowest that was not looked at exactly
    std::vector<double> seen_, proven_;
    std::vector<std::size_t> order_;  ///< of the elements: what failed in this tick first
    bool isProven_ = false;
    JointVector position_, velocity_, acceleration_, torque_, torqueBefore_, rate_;
    std::array<TorqueFault, 4> torqueFaults_;
    int torqueFaultCount_ = 0;
};

}  // namespace viable::detail
