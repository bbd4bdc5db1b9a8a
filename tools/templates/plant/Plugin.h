#pragma once

#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotModel.h"

/** The robot's own rigid-body model with viscous friction: the starting point for a plant of your own, be it another
engine or the driver of a real arm.

Method: qdd = M^-1 (tau - b - d qd), velocity first, then position (semi-implicit Euler), one step per tick.
Assumes: ideal motors within the robot's torque limits, ideal sensors. */
class @CLASS@ : public viable::RealPlant {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override;
    void reset(const viable::MotionState& start) override;
    const viable::JointState& measured() const override { return state_; }
    const viable::JointState& actual() const override { return state_; }
    /** What measured() tells is the truth. Remove this where readings are counts of an encoder. */
    viable::PlantTraits traits() const override { return {viable::Encoder::Exact}; }
    viable::TickStatus advance(const viable::JointVector& torque, viable::JointVector& applied) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    viable::JointVector friction_;     // [Nm s/rad]
    viable::JointVector torqueLimit_;  // [Nm]
    std::unique_ptr<viable::RobotModel> model_;
    viable::JointState state_;
    viable::Dynamics dynamics_;
};
