#pragma once

#include "viable/loop/NominalPlant.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The nominal arm in the place of the real one: what a robust loop does to it is its own noise.

Method: the torque of a tick gives the mean acceleration x = M(q)^-1 (tau - b(q, qd)) over it, and the arm then moves
in closed form (advanceNominal), either with the jerk held that has this mean, j = 2 (x - qdd) / dt, or with x itself.
Guarantees: torques of decisions that hold the same quantity move it as the nominal arm to rounding.
Assumes: those torques and no others; with jerk held, a torque that jumps by itself leaves an acceleration that
alternates from tick to tick (the velocities stay right).
Real time: no allocation, lock or throw after configure(). */
class IdealPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return state_; }
    const JointState& actual() const override { return state_; }
    PlantTraits traits() const override { return {Encoder::Exact}; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override;
    const JointVector* externalTorque() const override { return &external_; }

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    std::unique_ptr<RobotModel> model_;
    Dynamics dynamics_;
    FilterDecision decision_;  // what the torque came from
    MotionState motion_;
    JointState state_;
    JointVector external_;  // none
};

}  // namespace viable
