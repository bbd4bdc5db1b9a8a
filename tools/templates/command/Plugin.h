#pragma once

#include "viable/plugin/CommandSource.h"

/** Swings every joint about its start by a sine: the starting point for a command source of your own.

Method: q(t) = q_start + A (1 - cos(2 pi f t)) / 2; qd is its exact derivative. It may ask for more than the limits allow. */
class @CLASS@ : public viable::CommandSource {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override;
    void reset(const viable::MotionState& start) override;
    viable::CommandTraits traits() const override { return {viable::MotionCommand::Space::Joint}; }
    viable::TickStatus sample(double t, viable::MotionCommand& out) override;

private:
    viable::JointVector amplitude_;  // [rad]
    double angularFrequency_ = 0.0;  // [rad/s]
    viable::JointVector start_;
};
