#include "summary/SpeedCounter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

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
    struct Frame {
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        Eigen::Vector3d turning = Eigen::Vector3d::Zero(), moving = Eigen::Vector3d::Zero();
    };
    std::array<Frame, kMaxJoints> frames;
    for (std::size_t i = 0; i < robot_.joints.size(); ++i) {
        const JointDescription& joint = robot_.joints[i];
        const auto at = static_cast<Eigen::Index>(i);
        const Frame base = joint.parent < 0 ? Frame() : frames[static_cast<std::size_t>(joint.parent)];
        Frame& frame = frames[i];
        frame = base;
        frame.pose = base.pose * joint.placement;
        const Eigen::Vector3d axis = frame.pose.linear() * joint.axis;
        if (joint.type == JointType::Prismatic)
            frame.pose = frame.pose * Eigen::Translation3d(q[at] * joint.axis);
        else
            frame.pose = frame.pose * Eigen::AngleAxisd(q[at], joint.axis);
        frame.moving += base.turning.cross(frame.pose.translation() - base.pose.translation());
        (joint.type == JointType::Prismatic ? frame.moving : frame.turning) += qd[at] * axis;
    }
    Fastest fastest;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        const Part& part = parts_[k];
        const Frame& frame = frames[static_cast<std::size_t>(part.capsule.carrier)];
        const Eigen::Vector3d ends[] = {frame.pose * part.capsule.a, frame.pose * part.capsule.b};
        const double rate = frame.turning.norm();
        double speed = 0.0;
        for (const Eigen::Vector3d& end : ends) {
            const Eigen::Vector3d v = frame.moving + frame.turning.cross(end - frame.pose.translation());
            const double along = rate > 0.0 ? frame.turning.dot(v) / rate : v.norm();
            const double across = rate > 0.0 ? frame.turning.cross(v).norm() / rate : 0.0;
            speed = std::max(speed, std::hypot(along, across + rate * part.capsule.radius));
        }
        double limit = part.limit;
        if (part.hasRegions)
            for (const SpeedLimits::Region& region : robot_.speedLimits.regions)
                if (meets(ends[0], ends[1], region, part.capsule.radius)) limit = std::min(limit, region.speed);
        fastest.speed = std::max(fastest.speed, speed);
        if (fastest.part >= 0 && speed / limit <= fastest.use) continue;
        fastest.use = speed / limit;
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
        const JointVector middle = 0.5 * (way.last.q + state.q) + h / 8.0 * (way.last.qd - state.qd);
        const JointVector speed = 1.5 / h * (state.q - way.last.q) - 0.25 * (way.last.qd + state.qd);
        judge(way, record, middle, speed, way.time_s + h / 2.0);
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
