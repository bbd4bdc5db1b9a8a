#include "Arms.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace viable {

namespace {

/** Makes limits usable at this tick (see areUsable) by widening acceleration and position. */
void widen(AxisLimits& l, double tick_s) {
    const double ramp = std::max(-l.jerkLower, l.jerkUpper) * tick_s;
    l.accelerationLower = std::min(l.accelerationLower, -ramp);
    l.accelerationUpper = std::max(l.accelerationUpper, ramp);
    // A hair more: far from zero the difference of the two is rounded.
    const double size = std::max(std::abs(l.positionLower), std::abs(l.positionUpper));
    const double range = 8.0 * ramp * tick_s * tick_s + 1e-15 * size;
    l.positionUpper = std::max(l.positionUpper, l.positionLower + range);
}

/** Takes away both sides of some limits and one side of others. */
void open(Random& random, double none, double oneSided, double& lower, double& upper) {
    if (random.chance(none))
        lower = -kInfinity, upper = kInfinity;
    else if (random.chance(oneSided))
        (random.chance(0.5) ? lower = -kInfinity : upper = kInfinity);
}

AxisLimits openSome(Random& random, AxisLimits l) {
    open(random, 0.12, 0.25, l.positionLower, l.positionUpper);
    open(random, 0.12, 0.15, l.velocityLower, l.velocityUpper);
    open(random, 0.12, 0.15, l.accelerationLower, l.accelerationUpper);
    return l;
}

/** M with M'M of a condition number up to 1e8. */
JointMatrix drawInertia(Random& random, int n, bool isCoupled) {
    JointMatrix M = JointMatrix::Identity(n, n);
    for (int i = 0; i < n && isCoupled; ++i)
        for (int k = 0; k < i; ++k) M(i, k) = random.uniform(-0.7, 0.7);
    JointMatrix scale = JointMatrix::Zero(n, n);
    for (int i = 0; i < n; ++i) scale(i, i) = random.logUniform(0.03, 3.0);
    return scale * (M * M.transpose()) * scale;
}

}  // namespace

double drawTick(Random& random) {
    const double ticks[] = {1e-4, 1e-3, 4e-3, 1e-2};
    return ticks[random.integer(0, 3)];
}

DrawnLimits drawLimits(Random& random, double tick_s) {
    const auto setSides = [&](double size, double& lower, double& upper) {
        const double smaller = random.chance(0.3) ? size : size / random.logUniform(1.0, 10.0);
        const bool isUpper = random.chance(0.5);
        lower = -(isUpper ? smaller : size);
        upper = isUpper ? size : smaller;
    };
    const double J = random.logUniform(1.0, 300.0);
    const double A = J * std::max(random.logUniform(0.02, 1.0), 2.0 * tick_s);
    const double V = A * A / J * random.logUniform(0.1, 10.0);
    AxisLimits l{};
    setSides(J, l.jerkLower, l.jerkUpper);
    setSides(A, l.accelerationLower, l.accelerationUpper);
    setSides(V, l.velocityLower, l.velocityUpper);
    const double range = (V * V / A + V * A / J) * random.logUniform(0.05, 5.0);
    if (random.chance(0.12)) {
        l.positionLower = random.chance(0.5) ? 0.0 : -range;
        l.positionUpper = l.positionLower + range;
    } else {
        const double center = !random.chance(0.15) ? random.uniform(-3.0, 3.0)
                              : random.chance(0.5) ? random.logUniform(100.0, 1e4)
                                                   : -random.logUniform(100.0, 1e4);
        setSides(range, l.positionLower, l.positionUpper);
        l.positionLower += center;
        l.positionUpper += center;
    }
    widen(l, tick_s);
    return {openSome(random, l), l};
}

DrawnLimits drawChange(Random& random, const DrawnLimits& before, double tick_s) {
    AxisLimits l = before.finite;
    const double v = random.logUniform(0.3, 3.0), a = random.logUniform(0.3, 3.0), j = random.logUniform(0.5, 2.0);
    l.velocityLower *= v, l.velocityUpper *= v;
    l.accelerationLower *= a, l.accelerationUpper *= a;
    l.jerkLower *= j, l.jerkUpper *= j;
    const double range = l.positionUpper - l.positionLower, most = random.chance(0.1) ? 3.0 : 0.3;
    const double one = l.positionLower + random.uniform(-most, most) * range,
                 other = l.positionUpper + random.uniform(-most, most) * range;
    l.positionLower = std::min(one, other);
    l.positionUpper = std::max(one, other);
    widen(l, tick_s);
    DrawnLimits changed{l, l};
    if (random.chance(0.1)) {
        changed.limits = openSome(random, l);
        return changed;
    }
    for (double AxisLimits::*side :
         {&AxisLimits::positionLower, &AxisLimits::positionUpper, &AxisLimits::velocityLower,
          &AxisLimits::velocityUpper, &AxisLimits::accelerationLower, &AxisLimits::accelerationUpper})
        if (std::isinf(before.limits.*side)) changed.limits.*side = before.limits.*side;
    return changed;
}

Adversary::Adversary(Random& random, const AxisLimits& limits)
    : random_(random), limits_(limits), kind_(static_cast<Kind>(random.integer(0, kKinds - 1))) {
    period_ = random.integer(2, 600);
    phase_ = random.uniform(0.0, 6.3);
}

double Adversary::want(std::int64_t tick, double last, double stored) {
    if (kind_ == TwoTickBang) return tick / 2 % 2 ? 1e9 : -1e9;
    if (kind_ == Greedy) return tick / 2000 % 2 ? -1e300 : 1e300;
    if (kind_ == SineAtLimit) return scale(2.0 * std::sin(6.283185307 * static_cast<double>(tick) / period_ + phase_));
    if (kind_ == AtTheCorner)  // what was granted, a hair more; or the stop, a hair less
        return random_.chance(0.5) ? std::nextafter(last, value_ * INFINITY)
                                   : std::nextafter(stored, -value_ * INFINITY);
    if (kind_ == Noise) return scale(random_.uniform(-3.0, 3.0) + value_);
    if (--left_ <= 0) {
        left_ = random_.integer(1, kind_ == HeldRandom ? 500 : 800);
        value_ = kind_ == HeldRandom ? random_.uniform(-1.5, 1.5) : -value_;
    }
    return scale(value_);
}

Arm::Arm(Random& random)
    : n(random.integer(1, 7)),
      tick_s(drawTick(random)),
      approach(random.chance(0.7) ? 1.0 : random.logUniform(0.01, 1.0)),
      isCoupled(n > 1 && random.chance(0.7)),
      limits(JointLimits::unlimited(n)),
      M(drawInertia(random, n, isCoupled)) {
    for (JointVector* v : {&state.q, &state.qd, &state.qdd, &wanted, &chosen}) v->setZero(n);
    now.resize(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i) {
        setLimits(i, drawLimits(random, tick_s));
        const AxisLimits& l = now[i].limits;
        adversaries.emplace_back(random, l);
        const bool atUpper = random.chance(0.2), atLower = random.chance(0.2);
        state.q[i] = random.uniform(now[i].finite.positionLower, now[i].finite.positionUpper);
        if (atUpper && std::isfinite(l.positionUpper))
            state.q[i] = l.positionUpper;
        else if (atLower && std::isfinite(l.positionLower))
            state.q[i] = l.positionLower;
    }
    drawn = now;
    VIABLE_CHECK(areUsable(limits, n, tick_s), "drawn limits must be usable");
    braking.configure(limits, tick_s, approach);
    braking.reset(state);
}

void Arm::setLimits(int i, const DrawnLimits& drawnLimits) {
    now[i] = drawnLimits;
    const AxisLimits& l = drawnLimits.limits;
    limits.position.lower[i] = l.positionLower;
    limits.position.upper[i] = l.positionUpper;
    limits.velocity.lower[i] = l.velocityLower;
    limits.velocity.upper[i] = l.velocityUpper;
    limits.acceleration.lower[i] = l.accelerationLower;
    limits.acceleration.upper[i] = l.accelerationUpper;
    limits.jerk.lower[i] = l.jerkLower;
    limits.jerk.upper[i] = l.jerkUpper;
}

void Arm::startAnywhere(Random& random) {
    for (int i = 0; i < n; ++i) {
        const AxisLimits& l = now[i].finite;
        const double range = l.positionUpper - l.positionLower;
        const double far = random.chance(0.8) ? 1.0 : random.logUniform(1.0, 100.0);
        const double fast = random.chance(0.7) ? 2.0 : random.logUniform(0.01, 2.0);
        const double strong = random.chance(0.7) ? 2.0 : random.logUniform(0.01, 2.0);
        state.q[i] = random.uniform(l.positionLower - far * range, l.positionUpper + far * range);
        state.qd[i] = fast * random.uniform(l.velocityLower, l.velocityUpper);
        state.qdd[i] = strong * random.uniform(l.accelerationLower, l.accelerationUpper);
    }
    braking.reset(state);
}

void Arm::changeLimits(Random& random) {
    for (int i = 0; i < n; ++i) setLimits(i, drawChange(random, drawn[i], tick_s));
    VIABLE_CHECK(areUsable(limits, n, tick_s), "changed limits must be usable");
    braking.changeLimits(limits);
}

FilterStatus Arm::choose(std::int64_t tick) {
    for (int i = 0; i < n; ++i)
        wanted[i] = std::clamp(adversaries[i].want(tick, chosen[i], braking.stop(i).nextJerk()), -1e300, 1e300);
    return choose();
}

FilterStatus Arm::choose() {
    const JointMatrix metric = objective == Objective::Joint ? JointMatrix(JointMatrix::Identity(n, n))
                               : objective == Objective::Tool
                                   ? JointMatrix(M.llt().matrixU())  // some triangular factor
                                   : M;
    return braking.choose(state, objective == Objective::Path ? nullptr : &metric, wanted, chosen, acting);
}

void Arm::move() {
    for (int i = 0; i < n; ++i) {
        const AxisState next = advance(at(i), chosen[i], tick_s);
        state.q[i] = next.p, state.qd[i] = next.v, state.qdd[i] = next.a;
    }
}

}  // namespace viable
