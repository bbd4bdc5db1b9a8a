#pragma once

#include "clearance/ArmElement.h"
#include "clearance/Bisection.h"
#include "clearance/CapsuleMotion.h"

namespace viable::detail {

/** Bounds how far the points of an element move between two sampled times of a path: the motion bound of adaptive
collision checking (Schwarzer, Saha and Latombe, Adaptive dynamic collision checking for single and multiple articulated
robots in complex environments, IEEE Trans. Robotics 21, 2005). The poses at the samples are computed when they are first
asked for.

For all times t from sample a to sample b, h apart, and all points of the element |p(t) - p(a)| + |p(b) - p(t)| is at most D,
the smaller of two bounds. Joint by joint: the travel of the joint times the largest distance of the element's points from
its axis (the bound of that paper). And: how far the segments' ends have come from a to b (for a pair: seen from what carries
both), the chord, plus twice the sag, h^2/8 times the largest acceleration of their points, by which these can be off the
chord.

Real time after construction. */
class MotionBound {
public:
    /** @param radii  of what belongs to each capsule, around its segment [m] */
    MotionBound(const RobotDescription& robot, const std::vector<LinkCapsule>& capsules, std::vector<double> radii,
                const std::vector<ArmElement>& elements);

    /** The path that the rest is about; it must live as long as it is asked for. */
    void setPath(const ArmPath& path, const ArmPath::Extremes& extremes);

    double calcTime(int sample) const { return path_->duration() * sample / bisection::kDivisions; }  ///< [s]
    const ArmRecursion::Frames& getFrames(int sample) { return getSample(sample).pose.frames; }
    /** Of its segments only those of element e are known. */
    const CapsuleMotion::Pose& getPose(int e, int sample);
    /** From sample `from` to a later one. */
    bisection::Travel calcTravel(int e, int from, int to);
    /** How far apart the points of element e are on two paths whose positions differ by no more than `apart`, and for both of
    which the extremes hold [m]. */
    double calcApart(int e, const JointVector& apart) const { return parts_[e].lever.dot(apart); }

private:
    struct Part {
        ArmElement element;
        int base = -1;       ///< outermost joint that carries both of a pair; -1: none
        JointVector lever;   ///< farthest of its points from each joint's axis; 0: not moved by it [m]
        double bend = -1.0;  ///< calcBend() of its capsules as seen from `base`; < 0: not known yet
    };
    /** The arm at a time of the path. */
    struct Sample {
        bool isKnown = false, isTravelKnown = false;
        CapsuleMotion::Pose pose;
        JointVector travel;  ///< of each joint up to here [rad]
    };
    Sample& getSample(int sample);
    const JointVector& getTravel(int sample);

    int n_;
    CapsuleMotion motion_;
    std::vector<Part> parts_;
    const ArmPath* path_ = nullptr;
    std::vector<Sample> samples_;
    JointVector position_;
};

}  // namespace viable::detail
