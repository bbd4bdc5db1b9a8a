#pragma once

#include <array>

#include "viable/plugin/CommandSource.h"

namespace viable {

/** The motion of an operator's hand, made from a seed: nothing to download, the same on every
machine.

Method: the hand reaches for random poses around the start pose, one minimum-jerk sub-movement each
(Flash and Hogan 1985; calcMinimumJerk), with pauses; physiological tremor of 8 to 12 Hz is added,
blended in from zero. With d(t) the offset [m] and r(t) the rotation vector [rad], base frame:
    position = start + d(t),   orientation = R(r(t)) start,   twist = (d', J_l(r) r').
Guarantees: at t = 0 exactly the start pose with zero twist; pose and twist are continuous; targets
lie within `reach_m` and `rotation_rad` of the start, tremor adds at most `tremor_m` per axis; the
speed of a reach stays below `top_speed_mps`. A pure function of seed, parameters and t up to the
run's end and kMargin_s beyond it; after that the last target is held.
Real time: no allocation, lock or throw after configure(); O(log movements) per call. */
class GeneratedHandMotion : public CommandSource {
public:
    static constexpr double kMargin_s = 10.0;
    static constexpr double kTremorBlend_s = 1.0;  ///< tremor grows from zero over this time
    static constexpr double kTremorLowest_Hz = 8.0, kTremorHighest_Hz = 12.0;

    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}  // sample() keeps no memory
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    static constexpr int kSinesPerAxis = 3;

    // Offsets are position [m] in 0..2 and rotation vector [rad] in 3..5.
    struct Reach {
        double begin_s, duration_s;
        Vector6 from, way;
    };
    struct Sine {
        double omega, phase;  // [rad/s], [rad]
    };

    Pose start_;
    std::vector<Reach> reaches_;
    Vector6 tremor_ = Vector6::Zero();  // largest offset per axis
    std::array<std::array<Sine, kSinesPerAxis>, 6> sines_{};
};

}  // namespace viable
