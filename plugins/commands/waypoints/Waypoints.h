#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

struct WaypointsOptions {
    enum class Interpolation { Hold, Linear, Smooth };

    std::vector<std::vector<double>> points;
    Interpolation interpolation = Interpolation::Smooth;
    double repeat_s = 0.0;
    bool isRelative = false;

    template <class V>
    void describe(V& v) {
        v(points, "points", "s, rad",
          "One row per point: its time, then one position per joint; times increase, the first is 0 or later.")
            .count(2, kMaxJoints + 1)
            .required();
        v(interpolation, "interpolation", "hold|linear|smooth",
          "Between points: jump at the next point, run straight, or a quintic at rest at every point.");
        v(repeat_s, "repeat_s", "s", "The sequence starts again after this time; 0: it runs once.").atLeast(0);
        v(isRelative, "relative_to_start", "Positions are added to the arm's joint positions at the start.");
    }
};

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
    void reset(const MotionState& start) override {
        offset_ = options_.isRelative ? start.q : JointVector(JointVector::Zero(n_));
    }
    CommandTraits traits() const override { return {MotionCommand::Space::Joint}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    int n_ = 0;
    std::vector<double> times_;  // [s]
    std::vector<JointVector> points_;
    WaypointsOptions options_;
    JointVector offset_;  // added to every point
};

}  // namespace viable
