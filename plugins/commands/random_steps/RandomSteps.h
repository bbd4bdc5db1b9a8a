#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

/** Joint set-points that jump, made from a seed: each joint holds a random position for a random time, then
takes another. Some lie beyond a position limit, where the arm must rest against it.

Method: per joint, independently of the others, times even between `shortest_s` and `longest_s`; a set-point is
beyond a limit with probability `beyond_share`, then by an even share of `beyond_rad` past either limit with equal
chance, else even between the limits. `qd` is zero.
Assumes: position limits on every joint (those of the configuration; changes during a run are not followed).
Guarantees: a pure function of seed, parameters, limits and t up to the run's end and kMargin_s beyond it; the last
set-points are held after that. A joint's sequence is not changed by the number of the others.
Real time: no allocation, lock or throw after configure(); O(joints log steps) per call. */
class RandomSteps : public CommandSource {
public:
    static constexpr double kMargin_s = 10.0;

    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}  // sample() keeps no memory
    CommandTraits traits() const override { return {MotionCommand::Space::Joint}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    struct Step {
        double begin_s;
        double position;  // [rad]
    };

    std::vector<std::vector<Step>> joints_;  // the first of each begins at 0
};

}  // namespace viable
