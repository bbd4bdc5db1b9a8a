#include "limits/PointSpeedLimit.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "limits/ArmMotion.h"
#include "limits/LimitRows.h"

namespace viable::detail {

/** True when the segment has a point in the box made larger by `margin`. */
static bool meets(Eigen::Vector3d a, Eigen::Vector3d b, const SpeedLimits::Region& region, double margin) {
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

PointSpeedLimit::PointSpeedLimit(RobotDescription robot, const ArmGeometry* geometry) : robot_(std::move(robot)) {
    const SpeedLimits& limits = robot_.speedLimits;
    if (geometry && limits.needsCapsules())
        for (const LinkCapsule& capsule : geometry->capsules)
            if (capsule.carrier >= 0) parts_.push_back({geometry->links[capsule.link], capsule, limits.arm, true});
    if (std::isfinite(limits.tool)) {
        const Eigen::Vector3d origin = robot_.toolPlacement.translation();
        parts_.push_back({"tool", {-1, robot_.toolParent, origin, origin, 0.0}, limits.tool, false});
    }
}

PointSpeedLimit::Fastest PointSpeedLimit::find(const JointVector& q, const JointVector& qd) const {
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

LimitSample PointSpeedLimit::sample(const ArmSample& arm) {
    const Fastest fastest = find(arm.q, arm.qd);
    LimitSample found;
    if (fastest.part < 0) return found;
    found.value = fastest.use;
    found.isBroken = fastest.use > 1.0 + kSpeedRounding;
    found.isNear = fastest.use > kAtSpeedLimit;
    found.largest = fastest.speed;
    found.part = partName(fastest.part).c_str();
    return found;
}

/** "link6 used 99.6 % of its limit at 1.234 s" */
static std::string tellFastest(const ArmLimitRecord& r) {
    if (r.part.empty()) return r.largest > 0.0 ? "nothing moved where a limit counts" : "nothing moved";
    return format("%s used %.1f %% of its limit at %.3f s", r.part, 100.0 * r.worst, r.worst_s);
}

static std::string tellSpeed(const LimitAccount&, const ArmLimitRecord& r) {
    std::string text = format("up to %.4g m/s, ", r.largest) + tellFastest(r) +
                       format(", above %.0f %% of it in %lld ticks, too fast in %lld", 100.0 * kAtSpeedLimit,
                              r.nearTicks, r.brokenTicks);
    if (r.firstBroken_s) text += format(" (first at %.3f s)", *r.firstBroken_s);
    return text;
}

LimitRow makePointSpeedRow() {
    LimitRow row;
    row.exists = [](const LimitScene& scene) { return scene.robot.speedLimits.isAny(); };
    row.make = [](const LimitScene& scene) -> std::unique_ptr<ArmLimit> {
        return std::make_unique<PointSpeedLimit>(scene.robot, scene.geometry);
    };
    row.label = "point speeds";
    row.limitWord = "point speed";
    row.kept = "speed limits kept";
    row.guarantee = "speeds of points";
    row.broken = "points of the arm were too fast";
    row.verdict = row.breach = "points of the %s arm were too fast: ";
    row.heading = "-";
    row.tellWorst = tellFastest;
    row.tellArm = tellSpeed;
    // The names of links are in the metadata.
    using R = LimitReport;
    row.columns = {{"known", &R::isKnown}, {"largest_mps", &R::value}, {"limit_mps", &R::limit}, {"link", &R::link}};
    row.block = "speeds";
    row.columnBlock = "speed";
    using A = ArmLimitRecord;
    row.figures = {{"largest_mps", &A::largest, "largest_mps", "m/s", "Largest speed of a point"},
                   {"worst_use", &A::worst, "worst_use", "", "Largest share of a speed limit"},
                   {"ticks_too_fast", &A::brokenTicks, "ticks_too_fast", "", "Ticks too fast"},
                   {"worst_use_s", &A::worst_s},
                   {"part", &A::part},
                   {"ticks_at_limit", &A::nearTicks},
                   {"first_too_fast_s", &A::firstBroken_s}};
    return row;
}

}  // namespace viable::detail
