#include "clearance/CapsuleMotion.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

namespace {

Eigen::Vector3d calcPlace(const ArmRecursion::Frames& frames, int carrier, const Eigen::Vector3d& p) {
    if (carrier < 0) return p;
    return frames.origin[carrier] + frames.rotation[carrier].lazyProduct(p);
}

}  // namespace

CapsuleMotion::CapsuleMotion(const RobotDescription& robot, std::vector<LinkCapsule> capsules,
                             std::vector<double> radii)
    : n_(robot.size()),
      arm_(robot),
      capsules_(std::move(capsules)),
      radii_(std::move(radii)),
      offsets_(n_),
      levers_(capsules_.size(), JointVector::Zero(n_)) {
    for (int i = 0; i < n_; ++i) offsets_[i] = robot.joints[i].placement.translation().norm();
}

CapsuleMotion::Pose CapsuleMotion::makePose() const {
    Pose pose;
    pose.segments.resize(capsules_.size());
    pose.isPlaced.resize(capsules_.size());
    return pose;
}

void CapsuleMotion::calcPose(const JointVector& q, Pose& pose) const {
    calcFrames(q, pose);
    for (int k = 0; k < static_cast<int>(capsules_.size()); ++k) place(k, pose);
}

void CapsuleMotion::calcFrames(const JointVector& q, Pose& pose) const {
    arm_.calcFrames(q, pose.frames);
    std::fill(pose.isPlaced.begin(), pose.isPlaced.end(), 0);
}

void CapsuleMotion::place(int index, Pose& pose) const {
    if (pose.isPlaced[index]) return;
    const LinkCapsule& capsule = capsules_[index];
    pose.segments[index] = {calcPlace(pose.frames, capsule.carrier, capsule.a),
                            calcPlace(pose.frames, capsule.carrier, capsule.b)};
    pose.isPlaced[index] = 1;
}

int CapsuleMotion::findCommonCarrier(int first, int second) const {
    int carrier = capsules_[first].carrier;
    const int other = capsules_[second].carrier;
    while (carrier >= 0 && !arm_.moves(carrier, other)) carrier = arm_.parent(carrier);
    return carrier;
}

void CapsuleMotion::setPath(const ArmPath::Extremes& extremes, const Pose& begin) {
    extremes_ = extremes;
    for (std::size_t k = 0; k < capsules_.size(); ++k) setLever(static_cast<int>(k), begin);
}

/** Of a joint's axis no point of the capsule is farther than now and what the joints further out add on the way, nor
farther than the arm between them is long. */
void CapsuleMotion::setLever(int index, const Pose& begin) {
    const LinkCapsule& capsule = capsules_[index];
    const Segment& segment = begin.segments[index];
    JointVector& lever = levers_[index];
    double length = std::max(capsule.a.norm(), capsule.b.norm()) + radii_[index], outward = 0.0;
    for (int i = capsule.carrier; i >= 0; i = arm_.parent(i)) {
        if (arm_.isPrismatic(i)) {
            lever[i] = 1.0;
            length += extremes_.position[i];
        } else {
            const Eigen::Vector3d& axis = begin.frames.axis[i];
            const Eigen::Vector3d& origin = begin.frames.origin[i];
            const double now = std::sqrt(
                std::max(axis.cross(segment.a - origin).squaredNorm(), axis.cross(segment.b - origin).squaredNorm()));
            lever[i] = std::min(length, now + radii_[index] + outward);
        }
        outward += lever[i] * extremes_.travel[i];
        length += offsets_[i];
    }
}

/** By d2p/dq_i dq_j = axis_i x (axis_j x (p - origin_j)), j the outer one, axis_i x axis_j where j slides and 0 where i
does. */
double CapsuleMotion::calcBend(int capsule, int base) const {
    const int carrier = capsules_[capsule].carrier;
    const JointVector& lever = levers_[capsule];
    double bend = 0.0, turning = 0.0;  // of the joints further in
    for (int i = carrier; i != base; i = arm_.parent(i))
        if (!arm_.isPrismatic(i)) turning += extremes_.velocity[i];
    for (int j = carrier; j != base; j = arm_.parent(j)) {
        const double own = arm_.isPrismatic(j) ? 0.0 : extremes_.velocity[j];
        turning -= own;
        bend += lever[j] * (extremes_.acceleration[j] + extremes_.velocity[j] * (own + 2.0 * std::max(0.0, turning)));
    }
    return bend;
}

/** The third derivative of a place p is sum p_k qddd_k + 3 sum p_jk qdd_j qd_k + sum p_ijk qd_i qd_j qd_k. No partial derivative of
p is longer than the lever of the outermost of its joints; one that a sliding joint has part in, unless as the outermost and only
once, is 0. s and c: speeds and accelerations of the turning joints further in, added up. */
double CapsuleMotion::calcBendRate(int capsule) const {
    const JointVector& lever = levers_[capsule];
    double s = 0.0, c = 0.0, rate = 0.0;
    for (int k = 0; k < n_; ++k) {  // from the base outwards
        if (!arm_.moves(k, capsules_[capsule].carrier)) continue;
        const double v = extremes_.velocity[k], a = extremes_.acceleration[k];
        const bool slides = arm_.isPrismatic(k);
        const double second = slides ? a * s + v * c : a * (v + s) + v * c;
        const double third = slides ? 3.0 * s * s * v : (s + v) * (s + v) * (s + v) - s * s * s;
        rate += lever[k] * (extremes_.jerk[k] + 3.0 * second + third);
        if (slides) continue;
        s += v;
        c += a;
    }
    return rate;
}

double CapsuleMotion::calcChord(int capsule, int base, const Pose& a, const Pose& b) const {
    if (capsules_[capsule].carrier == base) return 0.0;
    const Segment &was = a.segments[capsule], &is = b.segments[capsule];
    Eigen::Vector3d first = is.a - was.a, second = is.b - was.b;
    if (base >= 0) {
        const auto see = [base](const Pose& pose, const Eigen::Vector3d& p) -> Eigen::Vector3d {
            return pose.frames.rotation[base].transpose().lazyProduct(p - pose.frames.origin[base]);
        };
        first = see(b, is.a) - see(a, was.a);
        second = see(b, is.b) - see(a, was.b);
    }
    return std::sqrt(std::max(first.squaredNorm(), second.squaredNorm()));
}

}  // namespace viable::detail
