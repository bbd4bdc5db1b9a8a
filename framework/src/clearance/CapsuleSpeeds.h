#pragma once

#include "clearance/CapsuleMotion.h"

namespace viable::detail {

/** The capsules that a joint moves. */
inline std::vector<LinkCapsule> listMoved(const ArmGeometry& geometry) {
    std::vector<LinkCapsule> capsules;
    for (const LinkCapsule& capsule : geometry.capsules)
        if (capsule.carrier >= 0) capsules.push_back(capsule);
    return capsules;
}

/** The speeds of an arm's capsules at looks at a path.

A capsule is the balls around the points of its segment, speed is convex, so the fastest ball is at an end; and with w the angular
velocity, p' the velocity of the ball's centre and r its radius, the fastest point of the ball has |w x p'| part (|p'_across| + |w| r)
across w and |p'_along| along it. Between two looks, h apart, no point is faster than at them by more than h^2/8 of
CapsuleMotion::calcBendRate().

Real time after construction. */
class CapsuleSpeeds {
public:
    /** @param capsules  that a joint moves; may have radius 0: a point or a segment */
    CapsuleSpeeds(const RobotDescription& robot, std::vector<LinkCapsule> capsules);

    std::size_t size() const { return capsules_.size(); }
    const std::vector<LinkCapsule>& capsules() const { return capsules_; }
    const LinkCapsule& capsule(std::size_t k) const { return capsules_[k]; }
    const ArmRecursion& arm() const { return arm_; }

    /** To a time of a path. */
    void sample(const ArmPath& path, double time_s);
    /** Of the last look: */
    const CapsuleMotion::Pose& pose() const { return pose_; }
    const JointVector& velocity() const { return velocity_; }  ///< of the joints

    /** The fastest point of a capsule. */
    struct Fastest {
        double speed = 0.0;
        Eigen::Vector3d point, velocity;
    };
    Fastest calcFastest(std::size_t k) const;

    /** For bounds of a path of which the last look was at the begin. */
    void setPath(const ArmPath::Extremes& extremes) { motion_.setPath(extremes, pose_); }
    const CapsuleMotion& motion() const { return motion_; }

private:
    int n_;
    ArmRecursion arm_;
    std::vector<LinkCapsule> capsules_;
    CapsuleMotion motion_;
    CapsuleMotion::Pose pose_;
    std::array<Eigen::Vector3d, kMaxJoints> turning_, moving_;  ///< velocities of the joints' frames
    JointVector position_, velocity_;
};

}  // namespace viable::detail
