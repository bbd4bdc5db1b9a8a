#include "clearance/MotionBound.h"

namespace viable::detail {

namespace {

/** So many samples apart the joints' travels can tell more than the chord. */
constexpr int kLong = bisection::kDivisions / 8;

}  // namespace

MotionBound::MotionBound(const RobotDescription& robot, const std::vector<LinkCapsule>& capsules,
                         std::vector<double> radii, const std::vector<ArmElement>& elements)
    : n_(robot.size()),
      motion_(robot, capsules, std::move(radii)),
      samples_(bisection::kDivisions + 1),
      position_(JointVector::Zero(n_)) {
    for (const ArmElement& element : elements)
        parts_.push_back(
            {element, element.isPair() ? motion_.findCommonCarrier(element.first, element.second) : -1, {}, -1.0});
    for (Sample& sample : samples_) sample.pose = motion_.makePose();
}

void MotionBound::setPath(const ArmPath& path, const ArmPath::Extremes& extremes) {
    path_ = &path;
    for (Sample& sample : samples_) sample.isKnown = sample.isTravelKnown = false;
    if (parts_.empty()) return;
    CapsuleMotion::Pose& begin = getSample(0).pose;
    for (int k = 0; k < static_cast<int>(begin.segments.size()); ++k) motion_.place(k, begin);
    motion_.setPath(extremes, begin);
    for (Part& part : parts_) {
        part.lever = motion_.lever(part.element.first);
        part.bend = -1.0;
        if (!part.element.isPair()) continue;
        const JointVector& other = motion_.lever(part.element.second);
        for (int i = 0; i < n_; ++i)  // what moves both moves neither against the other
            part.lever[i] = part.lever[i] > 0.0 && other[i] > 0.0 ? 0.0 : part.lever[i] + other[i];
    }
}

MotionBound::Sample& MotionBound::getSample(int at) {
    Sample& sample = samples_[at];
    if (sample.isKnown) return sample;
    sample.isKnown = true;
    path_->calcPositions(calcTime(at), position_);
    motion_.calcFrames(position_, sample.pose);
    return sample;
}

const CapsuleMotion::Pose& MotionBound::getPose(int e, int at) {
    const ArmElement& element = parts_[e].element;
    CapsuleMotion::Pose& pose = getSample(at).pose;
    motion_.place(element.first, pose);
    if (element.isPair()) motion_.place(element.second, pose);
    return pose;
}

const JointVector& MotionBound::getTravel(int at) {
    Sample& sample = samples_[at];
    if (!sample.isTravelKnown) path_->calcPositions(calcTime(at), position_, sample.travel);
    sample.isTravelKnown = true;
    return sample.travel;
}

bisection::Travel MotionBound::calcTravel(int e, int from, int to) {
    Part& part = parts_[e];
    if (part.bend < 0.0) {
        part.bend = motion_.calcBend(part.element.first, part.base);
        if (part.element.isPair()) part.bend += motion_.calcBend(part.element.second, part.base);
    }
    const double h = calcTime(to) - calcTime(from);
    const double sag = h * h / 8.0 * part.bend;
    double byJoints = kInfinity;
    if (to - from >= kLong) {
        byJoints = part.lever.dot(getTravel(to) - getTravel(from));
        if (2.0 * sag >= byJoints) return {byJoints, kInfinity, sag};
    }
    const CapsuleMotion::Pose &a = getPose(e, from), &b = getPose(e, to);
    double chord = motion_.calcChord(part.element.first, part.base, a, b);
    if (part.element.isPair()) chord += motion_.calcChord(part.element.second, part.base, a, b);
    return {std::min(byJoints, chord + 2.0 * sag), chord, sag};
}

}  // namespace viable::detail
