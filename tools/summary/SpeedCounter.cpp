#include "summary/SpeedCounter.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "summary/ArmMotion.h"
#include "viable/core/Numbers.h"

namespace viable::detail {

namespace {

/** True when the segment has a point in the box made larger by `margin`. */
bool meets(Eigen::Vector3d a, Eigen::Vector3d b, const SpeedLimits::Region& region, double margin) {
    // Cut to what lies between each pair of planes in turn.
    for (int axis = 0; axis < 3; ++axis) {
        for (const double side : {-1.0, 1.0}) {
            const double plane = (side < 0.0 ? region.lower[axis] : region.upper[axis]) + side * margin;
            const double overA = side * (a[axis] - plane), overB = side * (b[axis] - plane);
            if (overA > 0.0 && overB > 0.0) return false;
            if (overA > 0.0) a += overA / (overA - overB) * (b - a);
            if (overB > 0.0) b += overB / (overB - overA) * (a - b);
        }
    }
    return true;
}

}  // namespace

SpeedCounter::SpeedCounter(RobotDescription robot, const ArmGeometry* geometry, bool hasRealArm)
    : robot_(std::move(robot)) {
    const SpeedLimits& limits = robot_.speedLimits;
    if (geometry && limits.needsCapsules())
        for (const LinkCapsule& capsule : geometry->capsules)
            if (capsule.carrier >= 0)
                parts_.push_back({geometry->links[static_cast<std::size_t>(capsule.link)], capsule, limits.arm, true});
    if (std::isfinite(limits.tool)) {
        const Eigen::Vector3d origin = robot_.toolPlacement.translation();
        parts_.push_back({"tool", {-1, robot_.toolParent, origin, origin, 0.0}, limits.tool, false});
    }
    if (hasRealArm) speeds_.real.emplace();
    std::size_t longest = 0;  // names are taken over in ticks, without memory of their own
    for (const Part& part : parts_) longest = std::max(longest, part.name.size());
    speeds_.nominal.part.reserve(longest);
    if (speeds_.real) speeds_.real->part.reserve(longest);
}

SpeedCounter::Fastest SpeedCounter::find(const JointVector& q, const JointVector& qd) const {
    const ArmMotion arm(robot_, q, qd);
    Fastest fastest;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        const Part& part = parts_[k];
        const ArmMotion::Part moved = arm.place(part.capsule);
        double limit = part.limit;
        if (part.hasRegions)
            for (const SpeedLimits::Region& region : robot_.speedLimits.regions)
                if (meets(moved.a, moved.b, region, part.capsule.radius)) limit = std::min(limit, region.speed);
        fastest.speed = std::max(fastest.speed, moved.speed);
        if (fastest.part >= 0 && moved.speed / limit <= fastest.use) continue;
        fastest.use = moved.speed / limit;
        fastest.part = static_cast<int>(k);
    }
    return fastest;
}

void SpeedCounter::judge(Way& way, SpeedRecord& record, const JointVector& q, const JointVector& qd, double time_s) {
    const Fastest found = find(q, qd);
    if (found.part < 0) return;
    way.use = std::max(way.use, found.use);
    if (found.use > 1.0 + kSpeedRounding && !record.firstTooFast_s) record.firstTooFast_s = time_s;
    record.largest = std::max(record.largest, found.speed);
    if (found.use <= record.use) return;
    record.use = found.use;
    record.use_s = time_s;
    record.part = partName(found.part);
}

void SpeedCounter::finishTick(Way& way, SpeedRecord& record) {
    ++record.ticks;
    record.ticksAtLimit += way.use > kAtSpeedLimit;
    record.ticksTooFast += way.use > 1.0 + kSpeedRounding;
    way.use = 0.0;
}

void SpeedCounter::follow(Way& way, SpeedRecord& record, const JointState& state, double time_s) {
    if (way.hasBegun && !way.hasGap) {  // between rows that are far apart nobody knows
        const double h = time_s - way.time_s;
        const JointState middle = calcHalfWay(way.last, state, h);
        judge(way, record, middle.q, middle.qd, way.time_s + h / 2.0);
    }
    judge(way, record, state.q, state.qd, time_s);
    if (way.hasBegun) finishTick(way, record);
    way.last = state;
    way.time_s = time_s;
    way.hasBegun = true;
    way.hasGap = false;
}

void SpeedCounter::add(const TickRecord& record) {
    follow(nominal_, speeds_.nominal, {record.nominal.q, record.nominal.qd}, record.time_s);
    if (!speeds_.real) return;
    if (record.hasReading)
        follow(real_, *speeds_.real, record.actual, record.time_s);
    else
        real_.hasGap = true;
}

void SpeedCounter::addEnd(const MotionState& nominal, double time_s) {
    follow(nominal_, speeds_.nominal, {nominal.q, nominal.qd}, time_s);
}

}  // namespace viable::detail
