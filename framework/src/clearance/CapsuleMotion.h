#pragma once

#include "clearance/ArmPath.h"
#include "robot/ArmRecursion.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** How far the points of an arm's capsules can move along a path: bounds that hold at every time of it. Real time after
construction. */
class CapsuleMotion {
public:
    /** A capsule's segment, base frame [m]. */
    struct Segment {
        Eigen::Vector3d a, b;
    };
    struct Pose {
        ArmRecursion::Frames frames;
        std::vector<Segment> segments;  ///< of each capsule
        std::vector<char> isPlaced;     ///< its segment is that of the frames
    };

    /** @param radii  of what belongs to each capsule, around its segment [m] */
    CapsuleMotion(const RobotDescription& robot, std::vector<LinkCapsule> capsules, std::vector<double> radii);

    Pose makePose() const;
    /** @param pose  from makePose() */
    void calcPose(const JointVector& q, Pose& pose) const;
    /** The same in parts: the frames, then the segments of those capsules that are asked for. */
    void calcFrames(const JointVector& q, Pose& pose) const;
    void place(int capsule, Pose& pose) const;
    /** The outermost joint that carries both capsules; -1: none does. */
    int findCommonCarrier(int first, int second) const;

    /** The path that the rest is about. */
    void setPath(const ArmPath::Extremes& extremes, const Pose& begin);

    /** Farthest that points of the capsule are from each joint's axis; 1 for a sliding joint, 0 for one that does not move
    it [m]. Times the joint's travel: how far it moves them. */
    const JointVector& lever(int capsule) const { return levers_[capsule]; }
    /** Largest acceleration of the capsule's points as seen from what the joint `base` (-1: nothing) carries [m/s^2].
    `base` is -1 or carries the capsule. */
    double calcBend(int capsule, int base) const;
    /** Largest change of the acceleration of the capsule's points, in the base frame [m/s^3]. */
    double calcBendRate(int capsule) const;
    /** Farthest that a point of the capsule's segment is at b from where it was at a, as seen from `base` [m]. Between the
    two times, h apart, no point is off the straight line between its two places by more than h^2/8 of calcBend(). */
    double calcChord(int capsule, int base, const Pose& a, const Pose& b) const;

private:
    void setLever(int capsule, const Pose& begin);

    int n_;
    ArmRecursion arm_;
    std::vector<LinkCapsule> capsules_;
    std::vector<double> radii_;
    JointVector offsets_;  ///< of each joint's frame from its parent's, not slid [m]
    ArmPath::Extremes extremes_;
    std::vector<JointVector> levers_;
};

}  // namespace viable::detail
