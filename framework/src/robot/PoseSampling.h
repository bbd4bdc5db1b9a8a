#pragma once

#include <random>

#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** An even share of [0, 1). The standard's own distributions differ between libraries; this one does not. */
inline double drawShare(std::mt19937_64& random) {
    return static_cast<double>(random() >> 11) * 0x1p-53;
}
/** An even share of [0, 1], likewise. */
inline double drawShare(std::mt19937& random) {
    return static_cast<double>(random()) / 4294967295.0;
}

/** A pose, each joint drawn evenly from its finite range. */
template <class Random>
JointVector drawPose(const JointBounds& range, Random& random) {
    JointVector q(range.lower.size());
    for (int i = 0; i < q.size(); ++i) q[i] = range.lower[i] + drawShare(random) * (range.upper[i] - range.lower[i]);
    return q;
}

/** How far a joint without limits may turn or slide to either side: half a turn, or a metre. */
inline double getFreeReach(JointType type) {
    return type == JointType::Prismatic ? 1.0 : kPi;
}

/** The position limits; for an infinite one, what is 2 `reach` [rad, m] from the other, or `reach` from zero. */
JointBounds makeFinite(JointBounds position, const JointVector& reach);

/** Poses within position limits: at the ends, at zero, in the middle and anywhere between, in every mixture (a singular
pose often needs several joints at exactly zero). The same for the same arguments. Of a joint without limits a whole
turn. */
std::vector<JointVector> samplePoses(const JointLimits& limits, int count);

struct PoseInertia {
    JointVector q;
    JointMatrix M;  ///< positive definite [kg m^2]
};

/** At a fixed sample of poses within the position limits; without those at which M cannot be used. */
std::vector<PoseInertia> sampleInertia(const RobotDescription& robot, const JointLimits& limits, int count);

}  // namespace viable::detail
