#pragma once

#include "Random.h"
#include "braking/CertifiedBraking.h"
#include "viable/filter/CertifiedBrakingFilter.h"

namespace viable {

/** Limits of one joint, any that core accepts. */
struct DrawnLimits {
    AxisLimits limits;
    AxisLimits finite;  ///< the numbers behind them, also where there is no limit
};

/** Limits on both sides of V = A^2 / J; up to ten times as large on one side as on the other; positions near zero, with
zero as a limit, or far from zero; position, velocity and acceleration limits on both sides, one or none. */
DrawnLimits drawLimits(Random& random, double tick_s);

/** Limits that `before` may change to: every number another, some limits gone, others new. */
DrawnLimits drawChange(Random& random, const DrawnLimits& before, double tick_s);

/** A tick of 0.1 to 10 ms. */
double drawTick(Random& random);

/** Wants of a joint that try to make it leave its limits. */
class Adversary {
public:
    enum Kind { HeldRandom, BangBang, TwoTickBang, Greedy, SineAtLimit, AtTheCorner, Noise, kKinds };

    Adversary(Random& random, const AxisLimits& limits);

    /** @param last    the jerk of the last tick
        @param stored  the next one of the stop */
    double want(std::int64_t tick, double last, double stored);
    Kind kind() const { return kind_; }

private:
    double scale(double x) const { return x > 0.0 ? x * limits_.jerkUpper : -x * limits_.jerkLower; }

    Random& random_;
    AxisLimits limits_;
    Kind kind_;
    int period_, left_ = 0;
    double phase_, value_ = 1.0;
};

/** A random arm at rest within its limits, or exactly on one, under certified braking. */
class Arm {
public:
    explicit Arm(Random& random);

    /** Puts it anywhere: around its limits or far beyond them, and fast. */
    void startAnywhere(Random& random);
    void changeLimits(Random& random);

    /** One choice of the law, as the adversaries want it; the state stays. */
    FilterStatus choose(std::int64_t tick);
    /** The same for `wanted` as it is. */
    FilterStatus choose();
    /** Follows `chosen` for a tick. */
    void move();

    AxisState at(int joint) const { return {state.q[joint], state.qd[joint], state.qdd[joint]}; }

    int n;
    double tick_s, approach;
    bool isCoupled;                  ///< M is not diagonal
    std::vector<DrawnLimits> drawn;  ///< at first
    std::vector<DrawnLimits> now;
    JointLimits limits;  ///< those of `now`
    JointMatrix M;
    Objective objective = Objective::Torque;
    MotionState state;
    CertifiedBraking braking;
    std::vector<Adversary> adversaries;
    JointVector wanted, chosen;
    std::array<JointIntervention, kMaxJoints> acting;

private:
    void setLimits(int joint, const DrawnLimits& drawnLimits);
};

}  // namespace viable
