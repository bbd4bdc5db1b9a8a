#include "loop/SensorCheck.h"

#include <algorithm>
#include <cmath>

namespace viable {

JointVector calcLargestChange(const RunSetup& setup, const JointLimits& limits, const TrackingBound* bound,
                              const detail::Authority& authority) {
    JointVector largest(setup.size());
    for (int i = 0; i < setup.size(); ++i) {
        const double speed =
            std::max({-limits.velocity.lower[i], limits.velocity.upper[i], std::abs(setup.start.qd[i])});
        const bool slides = setup.robot.joints[static_cast<std::size_t>(i)].type == JointType::Prismatic;
        const double explained =
            bound ? (speed + bound->velocity[i]) * setup.tick_s + 2.0 * (bound->measured[i] - bound->position[i])
            : authority.limits(i) ? 0.0
            : slides              ? kLeastJump_m
                                  : kLeastJumpTurns * 2.0 * kPi;
        largest[i] = std::max(kJumpSpeeds * speed * setup.tick_s + kJumpCounts * setup.robot.encoderStep(i), explained);
    }
    return largest;
}

void SensorCheck::setMotion(const RunSetup& setup, Policy& policy) {
    policy.count.resize(setup.size());
    policy.moving.resize(setup.size());
    for (int i = 0; i < setup.size(); ++i) {
        const double count = setup.robot.encoderStep(i);
        policy.count[i] = count > 0.0 ? count : kUnknownCount;
        const double fastest = std::max(-setup.limits.velocity.lower[i], setup.limits.velocity.upper[i]);
        policy.moving[i] = std::max(kMovingCounts * policy.count[i], kMovingShare * fastest * setup.tick_s);
    }
}

void SensorCheck::begin(const Policy& policy, const JointVector& start) {
    policy_ = policy;
    last_ = start;
    for (JointVector* v : {&deviation_, &changedDeviation_, &goal_, &step_, &swing_}) v->setZero(start.size());
    still_.fill(0);
    moving_.fill(0);
    elapsed_ = 1;
}

double SensorCheck::calcChange(int joint, const JointState& reading, const MotionState& nominal) const {
    return std::abs(policy_.reference == Reference::LastReading
                        ? reading.q[joint] - last_[joint]
                        : reading.q[joint] - nominal.q[joint] - deviation_[joint]);
}

bool SensorCheck::isPlausible(int joint, const JointState& reading, const MotionState& nominal) const {
    return !(std::abs(reading.qd[joint]) > policy_.largestSpeed[joint]) &&
           !(calcChange(joint, reading, nominal) >
             policy_.largestChange[joint] * static_cast<double>(elapsed_) + kGrowth * swing_[joint]);
}

void SensorCheck::take(int joint, const JointState& reading, const MotionState& nominal) {
    const double step = std::abs(reading.q[joint] - last_[joint]);
    const bool stands = step == 0.0;
    last_[joint] = reading.q[joint];
    const double deviation = reading.q[joint] - nominal.q[joint];
    if (policy_.reference == Reference::LastReading) swing_[joint] = std::abs(deviation - deviation_[joint]);
    goal_[joint] = deviation_[joint] = deviation;
    std::int64_t& still = still_[static_cast<std::size_t>(joint)];
    std::int64_t& moving = moving_[static_cast<std::size_t>(joint)];
    if (!stands) moving = still == 0 && step >= policy_.moving[joint] ? moving + 1 : 0;
    still = stands ? still + 1 : 0;
    if (!stands) changedDeviation_[joint] = deviation_[joint];
    elapsed_ = 1;
}

void SensorCheck::standIn(int joint, const MotionState& nominal, JointState& reading) {
    const double rest = goal_[joint] - deviation_[joint];
    deviation_[joint] += std::clamp(rest, -step_[joint], step_[joint]);
    const double largest = policy_.largestDeviation[joint];
    reading.q[joint] = nominal.q[joint] + std::clamp(deviation_[joint], -largest, largest);
    reading.qd[joint] = nominal.qd[joint];
}

bool SensorCheck::isSuspect(int joint) const {
    return isStill(joint) && moving_[static_cast<std::size_t>(joint)] >= kStillTicks &&
           std::abs(deviation_[joint] - changedDeviation_[joint]) > kJumpCounts * policy_.count[joint];
}

double SensorCheck::findStillTravel(int joint) const {
    return still_[static_cast<std::size_t>(joint)] < kStillTicks
               ? 0.0
               : std::abs(deviation_[joint] - changedDeviation_[joint]);
}

void SensorCheck::disownStill(int joint, int ticks) {
    goal_[joint] = changedDeviation_[joint];
    step_[joint] = std::abs(goal_[joint] - deviation_[joint]) / ticks;
}

}  // namespace viable
