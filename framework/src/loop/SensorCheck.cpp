#include "loop/SensorCheck.h"

namespace viable {

JointVector calcLargestChange(const RunSetup& setup, const JointLimits& limits, const TrackingBound* bound,
                              const detail::Authority& authority) {
    JointVector largest(setup.size());
    for (int i = 0; i < setup.size(); ++i) {
        const double speed =
            std::max({-limits.velocity.lower[i], limits.velocity.upper[i], std::abs(setup.start.qd[i])});
        const double explained =
            bound ? (speed + bound->velocity[i]) * setup.tick_s + 2.0 * (bound->measured[i] - bound->position[i])
            : authority.limits(i) ? 0.0
                                  : calcLeastJump(setup.robot, i);
        largest[i] = std::max(kJumpSpeeds * speed * setup.tick_s + calcCounts(setup.robot, i), explained);
    }
    return largest;
}

double calcCounts(const RobotDescription& robot, int joint) {
    const double count = robot.encoderStep(joint);
    return count > 0.0 ? kJumpCounts * count : kUnknownJump;
}

double calcLeastJump(const RobotDescription& robot, int joint) {
    return robot.slides(joint) ? kLeastJump_m : kLeastJumpTurns * 2.0 * kPi;
}

void SensorCheck::setMotion(const RunSetup& setup, Policy& policy) {
    policy.count.resize(setup.size());
    policy.moving.resize(setup.size());
    policy.largestGrowth.setZero(setup.size());
    for (int i = 0; i < setup.size(); ++i) {
        const double count = setup.robot.encoderStep(i);
        policy.count[i] = count > 0.0 ? count : kUnknownCount;
        const double fastest = std::max(-setup.limits.velocity.lower[i], setup.limits.velocity.upper[i]);
        const double hardest = std::max(-setup.limits.acceleration.lower[i], setup.limits.acceleration.upper[i]);
        policy.moving[i] = std::max(kMovingCounts * policy.count[i], kMovingShare * fastest * setup.tick_s);
        if (std::isfinite(hardest))
            policy.moving[i] = std::max(policy.moving[i], hardest * setup.tick_s * setup.tick_s);
    }
}

void SensorCheck::begin(const Policy& policy, const JointVector& start) {
    policy_ = policy;
    last_ = start;
    for (JointVector* v : {&deviation_, &changedDeviation_, &goal_, &step_, &swing_, &way_}) v->setZero(start.size());
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
           !(calcChange(joint, reading, nominal) > largestChange(joint));
}

double SensorCheck::largestChange(int joint) const {
    return policy_.largestChange[joint] * static_cast<double>(elapsed_) +
           std::min(kGrowth * swing_[joint], policy_.largestGrowth[joint]);
}

void SensorCheck::take(int joint, const JointState& reading, const MotionState& nominal) {
    const auto elapsed = static_cast<double>(elapsed_);
    const double step = (reading.q[joint] - last_[joint]) / elapsed;
    const bool stands = step == 0.0;
    last_[joint] = reading.q[joint];
    const double deviation = reading.q[joint] - nominal.q[joint];
    swing_[joint] = std::abs(deviation - deviation_[joint]) / elapsed;
    goal_[joint] = deviation_[joint] = deviation;
    std::int64_t& still = still_[joint];
    std::int64_t& moving = moving_[joint];
    if (!stands) {
        moving = still == 0 && std::abs(step) >= policy_.moving[joint] ? moving + 1 : 0;
        changedDeviation_[joint] = deviation;
        way_[joint] = step;
    }
    still = stands ? still + 1 : 0;
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
    const double on = std::copysign(1.0, way_[joint]) * (changedDeviation_[joint] - deviation_[joint]);
    return isStill(joint) && moving_[joint] >= kStillTicks && on > kJumpCounts * policy_.count[joint];
}

double SensorCheck::findStillTravel(int joint) const {
    return still_[joint] < kStillTicks ? 0.0 : std::abs(deviation_[joint] - changedDeviation_[joint]);
}

void SensorCheck::disownStill(int joint, int ticks) {
    goal_[joint] = changedDeviation_[joint];
    step_[joint] = std::abs(goal_[joint] - deviation_[joint]) / ticks;
}

}  // namespace viable
