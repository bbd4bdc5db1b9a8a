#include "viable/simulation/ArmHardware.h"

#include "robot/ArmRecursion.h"

namespace viable {

void MotorRate::configure(const RunSetup& setup, const MotorRateOptions& options, double torqueLimitFactor) {
    rate_ = options.rate.expand(setup.size());
    torqueLimit_ = setup.robot.actuation.torqueLimit * torqueLimitFactor;
    largestStep_ = rate_ * setup.tick_s;
    arm_.reset();
    if (!largestStep_.array().isInf().all()) arm_ = std::make_shared<const ArmRecursion>(setup.robot);
    reset(setup.start.q);
}

void MotorRate::reset(const JointVector& q) {
    last_.setZero(q.size());
    if (!arm_) return;
    const JointVector still = last_;
    arm_->calcTorque(q, still, still, last_);
    last_ = last_.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
}

void MotorRate::limit(JointVector& torque) const {
    if (arm_) torque = torque.cwiseMax(last_ - largestStep_).cwiseMin(last_ + largestStep_);
}

}  // namespace viable
