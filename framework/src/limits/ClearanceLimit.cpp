#include <algorithm>

#include "core/Text.h"
#include "environment/CollisionChecker.h"
#include "limits/LimitRows.h"

namespace viable::detail {

namespace {

/** That an arm touches nothing: neither what stands around it nor itself. */
class ClearanceLimit : public ArmLimit {
public:
    /** Throws Error (BadInput) for a map that cannot be read. */
    explicit ClearanceLimit(const LimitScene& scene)
        : links_(scene.geometry->links),
          obstacles_(scene.environment->obstacleNames()),
          safetyDistance_m_(scene.environment->safetyDistance_m),
          checker_(scene.robot, *scene.geometry, *scene.environment) {}

    LimitSample sample(const ArmSample& arm) override;
    std::optional<double> limit() const override { return safetyDistance_m_; }

private:
    std::vector<std::string> links_, obstacles_;
    double safetyDistance_m_;
    CollisionChecker checker_;
};

LimitSample ClearanceLimit::sample(const ArmSample& arm) {
    // What is farther than the nearest so far and than the safety distance changes no figure.
    static_assert(kClearanceHorizon_m <= CollisionChecker::kMostHorizon_m);
    const double horizon = std::min(std::max(safetyDistance_m_, arm.worst), kClearanceHorizon_m);
    const CollisionChecker::Contact contact = checker_.findContact(arm.q, arm.time_s, horizon);
    LimitSample found;
    found.value = kInfinity;
    if (contact.distance >= horizon) return found;
    const auto name = [](const std::vector<std::string>& names, int index) {
        return index < 0 ? "" : names[index].c_str();
    };
    found.value = contact.distance;
    found.isBroken = contact.distance < -kClearanceRounding_m;
    found.isNear = contact.distance < safetyDistance_m_ - kClearanceRounding_m;
    found.part = name(links_, contact.link);
    found.other = name(obstacles_, contact.obstacle);
    if (contact.obstacle < 0) found.otherLink = name(links_, contact.otherLink);
    return found;
}

/** "link4 12.3 mm deep in table (at 1.234 s)", "nearest 3.4 mm (link4 to link1 at 2.000 s)", "nothing within 1 m". */
std::string tellNearest(const ArmLimitRecord& r) {
    if (r.worst == -kInfinity) return "a pose that is NaN";
    if (r.worst == kInfinity) return format("nothing within %g m", kClearanceHorizon_m);
    const std::string& other = r.other.empty() ? r.otherLink : r.other;
    if (r.brokenTicks > 0)
        return format("%s %s mm deep in %s (at %.3f s)", r.part, formatPlain(1e3 * r.depth()), other, r.worst_s);
    return format("nearest %s mm (%s to %s at %.3f s)", formatPlain(1e3 * r.worst), r.part, other, r.worst_s);
}

std::string tellClearance(const LimitAccount& account, const ArmLimitRecord& r) {
    std::string text = format("in collision in %lld ticks", r.brokenTicks);
    if (r.firstBroken_s) text += format(" (first at %.3f s)", *r.firstBroken_s);
    return text + ", " + tellNearest(r) +
           format(", within the safety distance of %s mm in %lld ticks", formatPlain(1e3 * account.limit.value_or(0.0)),
                  r.nearTicks);
}

}  // namespace

LimitRow makeClearanceRow() {
    LimitRow row;
    row.exists = [](const LimitScene& scene) { return scene.environment != nullptr; };
    row.make = [](const LimitScene& scene) -> std::unique_ptr<ArmLimit> {
        return std::make_unique<ClearanceLimit>(scene);
    };
    row.side = LimitSide::Lower;
    row.lessIsWorse = row.bridgesGaps = row.isSlow = true;
    row.horizon = kClearanceHorizon_m;
    row.label = "clearance";
    row.kept = "no collision";
    row.guarantee = "clearances";
    row.broken = "the arm collided";
    row.verdict = row.breach = "the %s arm collided: ";
    row.remedy =
        " (command a way around what is near, steering is local; a smaller safety_distance_m; max_age_s stops it, too)";
    row.ranked = row.rankedBy = "in collision";
    row.heading = "least clearance[mm]";
    row.headingScale = 1e3;
    row.headingLegend =
        "clearance: smallest distance of an arm from the obstacles and from itself in the whole run; negative: that "
        "deep inside.\n";
    row.tellWorst = tellNearest;
    row.tellArm = tellClearance;
    // The names of links and obstacles are in the metadata.
    using R = LimitReport;
    row.columns = {{"known", &R::isKnown},       {"distance_m", &R::margin},    {"link", &R::link},
                   {"obstacle", &R::other},      {"other_link", &R::otherLink}, {"on_arm", &R::onArm},
                   {"on_obstacle", &R::onOther}, {"map_age_s", &R::age_s}};
    row.block = "collisions";
    row.columnBlock = "collision";
    row.limitKey = "safety_distance_m";
    using A = ArmLimitRecord;
    row.figures = {{"least_clearance_m", &A::worst, "least_clearance_m", "m", "Least clearance"},
                   {"ticks_in_collision", &A::brokenTicks, "ticks", "", "Ticks in collision"},
                   {"ticks_too_near", &A::nearTicks, "ticks_too_near", "", "Ticks within the safety distance"},
                   {"least_clearance_s", &A::worst_s},
                   {"penetration_m", &A::depth},
                   {"first_collision_s", &A::firstBroken_s},
                   {"link", &A::part},
                   {"obstacle", &A::other},
                   {"other_link", &A::otherLink}};
    return row;
}

}  // namespace viable::detail
