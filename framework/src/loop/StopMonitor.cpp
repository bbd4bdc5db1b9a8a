#include "loop/StopMonitor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "braking/BrakingCertificate.h"
#include "loop/PathExtent.h"
#include "viable/loop/NominalPlant.h"

namespace viable {

/** A stop of more ticks has no end. */
constexpr double kMaxStopTicks = 1e12;
/** A joint slower than this has come to rest, where a stop holds accelerations. [rad/s] */
constexpr double kRest = 1e-12;
/** The extremes of a path are found to this share of the tolerance; inside the limits, where they are the margin in
the log and nothing more, positions to this multiple. */
constexpr double kResolution = 1.0 / 16.0;
constexpr double kMarginResolution = 1e4;
/** A recovering joint that comes no nearer for so long will not return. [s] */
constexpr double kPatience_s = 1.0;

/** For a path that goes far beyond its limits rounding grows with it. */
static double widenTolerance(double tolerance, double extreme) {
    return std::max(tolerance, kMonitorShare * std::abs(extreme));
}

constexpr double AxisLimits::*kLowerBounds[] = {&AxisLimits::positionLower, &AxisLimits::velocityLower,
                                                &AxisLimits::accelerationLower, &AxisLimits::jerkLower};
constexpr double AxisLimits::*kUpperBounds[] = {&AxisLimits::positionUpper, &AxisLimits::velocityUpper,
                                                &AxisLimits::accelerationUpper, &AxisLimits::jerkUpper};
constexpr LimitKind kKinds[] = {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk};
constexpr AxisLimits kUnbounded{-kInfinity, kInfinity, -kInfinity, kInfinity,
                                -kInfinity, kInfinity, -kInfinity, kInfinity};

static double popJerk(std::array<GridStop::Segment, GridStop::kSegments>& segments) {
    for (GridStop::Segment& segment : segments) {
        if (segment.ticks == 0) continue;
        --segment.ticks;
        return segment.jerk;
    }
    return 0.0;
}

/** The acceleration to hold in the next tick on the way to v = 0. */
static double calcBrakingAcceleration(double v, const AxisLimits& limits, double tick_s) {
    return std::clamp(-v / tick_s, limits.accelerationLower, limits.accelerationUpper);
}

/** One joint's way through a tick and its stop. */
struct StopMonitor::Path {
    detail::PathExtent extent;
    detail::PathExtent::Range jerk;
    double stop_s = 0.0;

    void follow(double j, double seconds) {
        jerk.include(j);
        extent.follow(j, seconds);
    }
    /** By Quantity. */
    const detail::PathExtent::Range& extremes(int k) const {
        const detail::PathExtent::Range* const all[] = {&extent.position, &extent.velocity, &extent.acceleration,
                                                        &jerk};
        return *all[k];
    }
};

void StopMonitor::updateLimits(const JointLimits& limits) {
    hasJerkLimits_ = limits.hasJerkLimits();
    for (int i = 0; i < n_; ++i) {
        const AxisLimits& axis = limits_[i] = limits.axis(i);
        for (int k = 0; k < kQuantities; ++k)
            tolerances_[i][k] = kMonitorShare * calcLimitScale(axis.*kLowerBounds[k], axis.*kUpperBounds[k]);
    }
}

void StopMonitor::reset(const MotionState& start, const JointLimits& limits, double tick_s, bool guaranteed,
                        bool recovers) {
    n_ = limits.size();
    tick_s_ = tick_s;
    guaranteed_ = guaranteed;
    updateLimits(limits);
    examined_.held = getStopKind(HeldQuantity::Jerk);
    for (int i = 0; i < n_; ++i) planCarefully(start, i);
    ready_ = examined_;
    reports_ = {};
    for (int i = 0; i < n_; ++i) {
        bounds_[i] = limits_[i];
        isLoose_[i] = false;
        if (recovers) loosenBounds(start, i, kUnbounded);
    }
}

void StopMonitor::changeLimits(const JointLimits& limits, const MotionState& nominal) {
    std::array<AxisLimits, kMaxJoints> before = bounds_;
    const std::array<AxisLimits, kMaxJoints> old = limits_;
    const std::array<Tolerances, kMaxJoints> rounding = tolerances_;
    updateLimits(limits);
    for (int i = 0; i < n_; ++i) {
        // What counted as rounding at a limit counts still where the limit has moved; only there, or handing over the
        // same limits again and again would let a joint creep out.
        for (int k = 0; k < kQuantities; ++k) {
            double AxisLimits::*lower = kLowerBounds[k], AxisLimits::*upper = kUpperBounds[k];
            if (limits_[i].*lower != old[i].*lower) before[i].*lower -= rounding[i][k];
            if (limits_[i].*upper != old[i].*upper) before[i].*upper += rounding[i][k];
        }
        loosenBounds(nominal, i, before[i]);
    }
}

/** Bounds of a joint: its limits or, where the backup stop passes them, that stop's extremes, but no wider than
`before`. */
void StopMonitor::loosenBounds(const MotionState& nominal, int i, const AxisLimits& before) {
    const AxisLimits reached = calcBounds(nominal, i);
    const AxisLimits& limit = limits_[i];
    isLoose_[i] = false;
    for (double AxisLimits::*lower : kLowerBounds) {
        bounds_[i].*lower = std::min(limit.*lower, std::max(before.*lower, reached.*lower));
        isLoose_[i] |= bounds_[i].*lower < limit.*lower;
    }
    for (double AxisLimits::*upper : kUpperBounds) {
        bounds_[i].*upper = std::max(limit.*upper, std::min(before.*upper, reached.*upper));
        isLoose_[i] |= bounds_[i].*upper > limit.*upper;
    }
    returns_[i] = {};
}

HeldQuantity StopMonitor::getStopKind(HeldQuantity held) const {
    const bool heldByGuarantee = held == HeldQuantity::Jerk || guaranteed_;
    return heldByGuarantee && hasJerkLimits_ ? HeldQuantity::Jerk : HeldQuantity::Acceleration;
}

void StopMonitor::planStop(const MotionState& from, HeldQuantity held) {
    examined_.held = getStopKind(held);
    for (int i = 0; i < n_ && examined_.held == HeldQuantity::Jerk; ++i) {
        GridStop stop;
        stop.plan(from.qd[i], from.qdd[i], limits_[i], tick_s_);
        for (int k = 0; k < GridStop::kSegments; ++k) examined_.joints[i][k] = stop.remaining(k);
    }
}

/** With regard to the joint's position and velocity limits, too, and slower. */
void StopMonitor::planCarefully(const MotionState& from, int i) {
    if (examined_.held != HeldQuantity::Jerk) return;
    BrakingCertificate certificate;
    certificate.configure(limits_[i], tick_s_, 1.0);
    certificate.reset({from.q[i], from.qd[i], from.qdd[i]});
    for (int k = 0; k < GridStop::kSegments; ++k) examined_.joints[i][k] = certificate.stop().remaining(k);
}

void StopMonitor::readSuppliedStops(const FilterDecision& decision) {
    examined_.held = HeldQuantity::Jerk;
    for (int i = 0; i < n_; ++i)
        for (int k = 0; k < GridStop::kSegments; ++k) examined_.joints[i][k] = decision.stops[i].remaining(k);
}

StopMonitor::Path StopMonitor::beginPath(double p, double v, double a, int joint) const {
    const Tolerances& t = tolerances_[joint];
    const AxisLimits& l = limits_[joint];
    return {{p,
             v,
             a,
             {l.positionLower, l.positionUpper, kMarginResolution * t[Position], kResolution * t[Position]},
             {l.velocityLower, l.velocityUpper, kInfinity, kResolution * t[Velocity]}},
            {kInfinity, -kInfinity}};
}

bool StopMonitor::followPlan(const Plan& plan, int joint, Path& path) const {
    if (plan.held == HeldQuantity::Acceleration) {
        // Whole ticks at the limit, then one that takes what is left.
        const double a = calcBrakingAcceleration(path.extent.v(), limits_[joint], tick_s_);
        const double whole = a == 0.0 ? 0.0 : std::floor(-path.extent.v() / (a * tick_s_));
        path.extent.setAcceleration(a);
        path.extent.follow(0.0, whole * tick_s_);
        path.extent.setAcceleration(-path.extent.v() / tick_s_);
        path.extent.follow(0.0, tick_s_);
        path.stop_s = (whole + (path.extent.a() != 0.0 ? 1.0 : 0.0)) * tick_s_;
        return path.extent.isFinite();
    }
    double ticks = 0.0;
    for (const GridStop::Segment& segment : plan.joints[joint]) {
        if (segment.ticks == 0) continue;
        ticks += static_cast<double>(segment.ticks);
        path.follow(segment.jerk, static_cast<double>(segment.ticks) * tick_s_);
    }
    path.stop_s = ticks * tick_s_;
    return ticks <= kMaxStopTicks && path.extent.isFinite();
}

void StopMonitor::keepViolation(Fault fault, int joint, LimitKind limit, LimitSide side, double excess,
                                double tolerance) {
    const StopVerdict verdict = fault == Fault::None ? StopVerdict::Recovering : StopVerdict::NoStop;
    fails_[joint] |= verdict == StopVerdict::NoStop;
    const double weight = excess / tolerance;
    if (verdict < violation_.verdict || (verdict == violation_.verdict && !(weight > worst_))) return;
    violation_ = {verdict, fault, joint, limit, side, excess};
    worst_ = weight;
}

/** A jerk beyond its limit is the cause of all that follows from it: nothing else outweighs it. */
void StopMonitor::checkTickJerk(int i, double jerk) {
    const double below = bounds_[i].jerkLower - jerk, above = jerk - bounds_[i].jerkUpper;
    const LimitSide side = above > below ? LimitSide::Upper : LimitSide::Lower;
    const double excess = std::max(below, above);
    if (excess > tolerances_[i][Jerk]) keepViolation(Fault::Limit, i, LimitKind::Jerk, side, excess, 0.0);
}

void StopMonitor::checkJoint(int i, const Path& path, bool checksRates, bool checksRest) {
    const AxisLimits &limit = limits_[i], &bound = bounds_[i];
    const Tolerances& tolerance = tolerances_[i];
    const auto checkSide = [&](LimitKind kind, LimitSide side, double beyondBound, double beyondLimit, double allowed) {
        if (beyondLimit > allowed) {
            isRecovering_[i] = true;
            const bool stays = returns_[i].idle_s > kPatience_s;
            keepViolation(stays ? Fault::Stays : Fault::None, i, kind, side, beyondLimit, allowed);
        }
        if (beyondBound > allowed) keepViolation(Fault::Limit, i, kind, side, beyondBound, allowed);
    };
    for (int k = 0; k < (checksRates ? kQuantities : Acceleration); ++k) {
        const detail::PathExtent::Range& x = path.extremes(k);
        double AxisLimits::*lower = kLowerBounds[k], AxisLimits::*upper = kUpperBounds[k];
        checkSide(kKinds[k], LimitSide::Lower, bound.*lower - x.lower, limit.*lower - x.lower,
                  widenTolerance(tolerance[k], x.lower));
        checkSide(kKinds[k], LimitSide::Upper, x.upper - bound.*upper, x.upper - limit.*upper,
                  widenTolerance(tolerance[k], x.upper));
    }
    if (!checksRest) return;
    const auto checkRest = [&](LimitKind kind, double x, const detail::PathExtent::Range& range, double allowed) {
        allowed = widenTolerance(widenTolerance(allowed, range.lower), range.upper);
        if (std::abs(x) > allowed)
            keepViolation(Fault::Moving, i, kind, x > 0.0 ? LimitSide::Upper : LimitSide::Lower, std::abs(x), allowed);
    };
    checkRest(LimitKind::Velocity, path.extent.v(), path.extent.velocity, tolerance[Velocity]);
    checkRest(LimitKind::Acceleration, path.extent.a(), path.extent.acceleration, tolerance[Acceleration]);
}

void StopMonitor::checkDecision(const MotionState& nominal, const FilterDecision& decision, const Plan& plan) {
    violation_ = {};
    worst_ = 0.0;
    isRecovering_.fill(false);
    fails_.fill(false);
    const bool holdsJerk = decision.held == HeldQuantity::Jerk;
    for (int i = 0; i < n_; ++i) {
        const double value = decision.value[i];
        const double jerk = holdsJerk ? value : (value - nominal.qdd[i]) / tick_s_;
        Path path = beginPath(nominal.q[i], nominal.qd[i], holdsJerk ? nominal.qdd[i] : value, i);
        path.extent.follow(holdsJerk ? jerk : 0.0, tick_s_);
        path.jerk.include(jerk);
        const bool checksRates = holdsJerk || guaranteed_;
        if (checksRates) checkTickJerk(i, jerk);
        if (!followPlan(plan, i, path)) {
            keepViolation(Fault::Malformed, i, LimitKind::None, LimitSide::Neither, kInfinity, 1.0);
            reports_[i] = {-kInfinity, kInfinity, kNan};
            continue;
        }
        checkJoint(i, path, checksRates, plan.held == HeldQuantity::Jerk);
        reports_[i] = {std::min(limits_[i].positionUpper - path.extent.position.upper,
                                path.extent.position.lower - limits_[i].positionLower),
                       path.stop_s, path.extent.p()};
    }
}

const StopMonitor::Violation& StopMonitor::examine(const MotionState& nominal, const FilterDecision& decision) {
    next_ = nominal;
    advanceNominal(decision, tick_s_, next_);
    const bool hasSuppliedStops = decision.hasStops && (decision.held == HeldQuantity::Jerk || guaranteed_);
    if (hasSuppliedStops)
        readSuppliedStops(decision);
    else
        planStop(next_, decision.held);
    checkDecision(nominal, decision, examined_);
    bool isOwn = !hasSuppliedStops;
    if (violation_.verdict == StopVerdict::NoStop && hasSuppliedStops && !guaranteed_) {
        planStop(next_, decision.held);
        checkDecision(nominal, decision, examined_);
        isOwn = true;
    }
    if (violation_.verdict == StopVerdict::NoStop && isOwn) {
        for (int i = 0; i < n_; ++i)
            if (fails_[i]) planCarefully(next_, i);
        checkDecision(nominal, decision, examined_);
    }
    return violation_;
}

AxisLimits StopMonitor::calcBounds(const MotionState& from, int i) const {
    AxisLimits bounds = limits_[i];
    Path path = beginPath(from.q[i], from.qd[i], from.qdd[i], i);
    if (!followPlan(ready_, i, path)) return bounds;
    for (int k = 0; k < kQuantities; ++k) {
        double &lower = bounds.*kLowerBounds[k], &upper = bounds.*kUpperBounds[k];
        lower = std::min(lower, path.extremes(k).lower);
        upper = std::max(upper, path.extremes(k).upper);
    }
    return bounds;
}

void StopMonitor::tightenBounds() {
    if (violation_.verdict == StopVerdict::NoStop) return;
    for (int i = 0; i < n_; ++i) {
        if (!isLoose_[i]) continue;
        isLoose_[i] = isRecovering_[i];
        if (!isLoose_[i]) {
            bounds_[i] = limits_[i];
            continue;
        }
        const AxisLimits b = calcBounds(next_, i);
        for (double AxisLimits::*lower : kLowerBounds) bounds_[i].*lower = std::max(bounds_[i].*lower, b.*lower);
        for (double AxisLimits::*upper : kUpperBounds) bounds_[i].*upper = std::min(bounds_[i].*upper, b.*upper);
    }
}

/** A joint comes nearer when its extremes move inwards or else its stop becomes shorter. */
void StopMonitor::watchReturn() {
    if (violation_.verdict == StopVerdict::NoStop) return;
    for (int i = 0; i < n_; ++i) {
        if (!isLoose_[i]) continue;
        double excess = 0.0;
        const auto see = [&](double distance, double tolerance) {
            if (std::isfinite(distance)) excess += distance / tolerance;  // else: no limit
        };
        for (int k = 0; k < kQuantities; ++k) {
            see(limits_[i].*kLowerBounds[k] - bounds_[i].*kLowerBounds[k], tolerances_[i][k]);
            see(bounds_[i].*kUpperBounds[k] - limits_[i].*kUpperBounds[k], tolerances_[i][k]);
        }
        ReturnState& back = returns_[i];
        if (excess < back.excess - 1.0)
            back = {excess, reports_[i].duration_s, 0.0};
        else if (reports_[i].duration_s < back.stop_s - tick_s_ / 2.0)
            back = {back.excess, reports_[i].duration_s, 0.0};
        else
            back.idle_s += tick_s_;
    }
}

void StopMonitor::accept() {
    ready_.held = examined_.held;
    std::copy_n(examined_.joints.begin(), n_, ready_.joints.begin());
    tightenBounds();
    watchReturn();
}

const StopMonitor::Violation& StopMonitor::followStop(const MotionState& nominal, FilterDecision& decision) {
    decision.held = ready_.held;
    decision.value.resize(n_);
    for (int i = 0; i < n_; ++i)
        decision.value[i] = ready_.held == HeldQuantity::Jerk
                                ? popJerk(ready_.joints[i])
                                : calcBrakingAcceleration(nominal.qd[i], limits_[i], tick_s_);
    decision.joints.fill({});
    decision.hasStops = false;
    next_ = nominal;
    advanceNominal(decision, tick_s_, next_);
    checkDecision(nominal, decision, ready_);
    tightenBounds();
    return violation_;
}

void StopMonitor::calcStop(const MotionState& nominal, double after_s, MotionState& state) const {
    state = nominal;
    for (int i = 0; i < n_; ++i) {
        AxisState x{nominal.q[i], nominal.qd[i], nominal.qdd[i]};
        double left = after_s;
        for (const GridStop::Segment& segment : ready_.joints[i]) {
            const double time = std::min(left, static_cast<double>(segment.ticks) * tick_s_);
            x = advance(x, segment.jerk, time);
            left -= time;
        }
        state.q[i] = x.p;
        state.qd[i] = left > 0.0 ? 0.0 : x.v;  // what rounding has left of the motion
        state.qdd[i] = left > 0.0 ? 0.0 : x.a;
    }
}

bool StopMonitor::atRest(const MotionState& nominal) const {
    if (ready_.held == HeldQuantity::Acceleration) return nominal.qd.lpNorm<Eigen::Infinity>() <= kRest;
    for (int i = 0; i < n_; ++i)
        for (const GridStop::Segment& segment : ready_.joints[i])
            if (segment.ticks > 0) return false;
    return true;
}

void StopMonitor::describe(const Violation& violation, const RobotDescription& robot, char* text,
                           std::size_t size) const {
    const char* const jointName = robot.joints[violation.joint].name.c_str();
    const char* const unit = getUnit(violation.limit, robot.slides(violation.joint));
    const char* side = getName(violation.side);
    const char* quantity = getName(violation.limit, LimitSide::Neither);
    switch (violation.fault) {
        case Fault::None:
            std::snprintf(text, size, "%s is safe", jointName);
            break;
        case Fault::Limit:
            std::snprintf(text, size, "%s would pass its %s %s limit by %.3g %s in this tick or the stop after it%s",
                          jointName, side, quantity, violation.excess, unit,
                          isLoose_[violation.joint] ? " (compared with the stop before)" : "");
            break;
        case Fault::Stays:
            std::snprintf(text, size, "%s is %.3g %s beyond its %s %s limit and comes no nearer", jointName,
                          violation.excess, unit, side, quantity);
            break;
        case Fault::Moving:
            std::snprintf(text, size, "%s would not be at rest at the end of its stop (%s %.3g %s)", jointName,
                          quantity, violation.excess, unit);
            break;
        case Fault::Malformed:
            std::snprintf(text, size, "the stop of %s is none: a jerk that is not finite, or no end", jointName);
            break;
    }
}

}  // namespace viable
