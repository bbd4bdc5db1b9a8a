#pragma once

#include <vector>

#include "viable/plugin/CommandSource.h"

namespace viable {

/** Leads every joint through a list of positions at given times.

Method: between two points the set-point holds (and jumps at the next point), runs straight, or runs
as a minimum-jerk quintic with zero velocity and acceleration at every point. Before the first
point: the first point; after the last: the last, or with `repeat_s` the first of the next round,
reached from the last as the interpolation says. `qd` is the exact derivative; at a corner of
`linear` that of the piece to come, and zero for `hold`.
Assumes: nothing about limits; points may lie outside them, which is how a filter is put to the
test.
Real time: no allocation, lock or throw after configure(); O(log points) per call. */
class Waypoints : public CommandSource {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    CommandTraits traits() const override { return {MotionCommand::Space::Joint}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    enum class Interpolation { Hold, Linear, Smooth };

    int n_ = 0;
    std::vector<double> times_;  // [s]
    std::vector<JointVector> points_;
    Interpolation interpolation_ = Interpolation::Hold;
    double repeat_s_ = 0.0;  // 0: once
    bool relative_ = false;
    JointVector offset_;  // added to every point
};

}  // namespace viable
