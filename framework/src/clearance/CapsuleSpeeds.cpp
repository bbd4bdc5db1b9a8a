#include "clearance/CapsuleSpeeds.h"

namespace viable::detail {

namespace {

std::vector<double> getRadii(const std::vector<LinkCapsule>& capsules) {
    std::vector<double> radii;
    for (const LinkCapsule& capsule : capsules) radii.push_back(capsule.radius);
    return radii;
}

}  // namespace

CapsuleSpeeds::CapsuleSpeeds(const RobotDescription& robot, std::vector<LinkCapsule> capsules)
    : n_(robot.size()),
      arm_(robot),
      capsules_(std::move(capsules)),
      motion_(robot, capsules_, getRadii(capsules_)),
      pose_(motion_.makePose()),
      position_(JointVector::Zero(n_)),
      velocity_(JointVector::Zero(n_)) {}

void CapsuleSpeeds::sample(const ArmPath& path, double time_s) {
    path.calcMotion(time_s, position_, velocity_);
    motion_.calcPose(position_, pose_);
    const ArmRecursion::Frames& frames = pose_.frames;
    for (int i = 0; i < n_; ++i) {
        Eigen::Vector3d turning = Eigen::Vector3d::Zero(), moving = turning;
        if (const int parent = arm_.parent(i); parent >= 0) {
            turning = turning_[parent];
            moving = moving_[parent] + turning.cross(frames.origin[i] - frames.origin[parent]);
        }
        (arm_.isPrismatic(i) ? moving : turning) += velocity_[i] * frames.axis[i];
        turning_[i] = turning;
        moving_[i] = moving;
    }
}

CapsuleSpeeds::Fastest CapsuleSpeeds::calcFastest(std::size_t k) const {
    const auto carrier = static_cast<std::size_t>(capsules_[k].carrier);
    const double radius = capsules_[k].radius;
    const Eigen::Vector3d& turning = turning_[carrier];
    const double rate = turning.norm();
    const Eigen::Vector3d axis = rate > 0.0 ? Eigen::Vector3d(turning / rate) : Eigen::Vector3d::UnitZ();
    Fastest fastest;
    fastest.speed = -1.0;
    for (const Eigen::Vector3d& centre : {pose_.segments[k].a, pose_.segments[k].b}) {
        const Eigen::Vector3d velocity = moving_[carrier] + turning.cross(centre - pose_.frames.origin[carrier]);
        const Eigen::Vector3d along = velocity.dot(axis) * axis, across = velocity - along;
        const double size = across.norm();
        const Eigen::Vector3d direction = size > 0.0 ? Eigen::Vector3d(across / size) : axis.unitOrthogonal();
        const Eigen::Vector3d ofPoint = along + (size + rate * radius) * direction;
        const double speed = ofPoint.norm();
        if (!(speed <= fastest.speed)) fastest = {speed, centre + radius * direction.cross(axis), ofPoint};
    }
    return fastest;
}

}  // namespace viable::detail
