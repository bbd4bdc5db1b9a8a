#include "experiment/UnlikelyValues.h"

#include "config/ConfigText.h"
#include "core/Text.h"

namespace viable::detail {

static double getLargest(const JointBounds& bounds, int joint) {
    return std::max(std::abs(bounds.lower[joint]), std::abs(bounds.upper[joint]));
}

/** No place is farther from the base [m]. */
static double calcReach(const RobotDescription& robot) {
    double reach = robot.toolPlacement.translation().norm();
    for (int i = 0; i < robot.size(); ++i)
        reach += robot.joints[i].placement.translation().norm() +
                 (robot.slides(i) ? getLargest(robot.limits.position, i) : 0.0);
    return reach;
}

/** All numbers of a value, lists in lists too; what is no number is left out. */
static std::vector<double> listNumbers(const ConfigNode& node, std::size_t skipped = 0) {
    std::vector<double> numbers;
    for (std::size_t i = skipped; i < node.items.size(); ++i)
        for (const double number : listNumbers(node.items[i])) numbers.push_back(number);
    try {
        if (node.kind == ConfigNode::Kind::Scalar) numbers.push_back(toNumber(node));
    } catch (const Error&) {
    }
    return numbers;
}

/** Adds the first that is unlikely of numbers of the joints, in their order or of any of them. */
static void addJoints(const RobotDescription& robot, const std::string& what, LimitKind kind,
                      const std::vector<double>& values, std::vector<std::string>& found) {
    const JointLimits& limits = robot.limits;
    const JointBounds* const own[] = {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk};
    for (std::size_t k = 0; k < values.size(); ++k) {
        const int i = static_cast<int>(k) % robot.size();
        const double figure = getLargest(*own[static_cast<int>(kind) - 1], i);
        const std::string meaning = explainUnlikely(values[k], figure, robot.slides(i), kind);
        if (meaning.empty()) continue;
        found.push_back(what + " of " + robot.joints[i].name + " is " + formatNumber(values[k]) + " " +
                        getUnit(kind, robot.slides(i)) + ", " + meaning);
        return;
    }
}

std::string explainUnlikely(double value, double own, bool isLength, LimitKind kind) {
    constexpr double kMostPlace = 3.0, kMostShare = 1.25;  // of what the other unit would make of it
    // A jerk limit is free: only one that would be the robot's own in the other unit is a slip of it.
    const bool isPlace = kind == LimitKind::Position, isJerk = kind == LimitKind::Jerk;
    const double least = isJerk ? 1.0 / kMostShare : 0.1;
    const double factor = isLength ? 1e-3 : kDegree, share = std::abs(value) / own;
    if (!(own > 0.0 && std::isfinite(own) && std::isfinite(value))) return "";
    if (!(share > (isPlace ? kMostPlace : least / factor))) return "";
    const std::string text = formatPlain(share) + " times the robot's own " + formatPlain(own) + ": ";
    if (isJerk && share * factor > kMostShare) return "";
    if (share * factor > kMostShare) return text + "check its unit and exponent";
    return text + (isLength ? "perhaps millimetres; write " + formatNumber(1e-3 * value)
                            : "perhaps degrees; write `" + formatNumber(value) + "*pi/180`");
}

std::string findUnlikelyStart(const CasePlan& plan) {
    std::vector<std::string> found;
    for (const auto& [kind, values] :
         {std::pair{LimitKind::Position, plan.start.q}, {LimitKind::Velocity, plan.start.qd}})
        addJoints(plan.robot, std::string("the start ") + getName(kind, LimitSide::Neither), kind,
                  {values.data(), values.data() + values.size()}, found);
    return found.empty() ? "" : found.front();
}

std::vector<std::string> findUnlikelyValues(const CasePlan& plan) {
    std::vector<std::string> found;
    const JointLimits& limits = plan.limits;
    const JointBounds* const bounds[] = {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk};
    for (int k = 0; k < 4; ++k) {
        std::vector<double> values;
        for (int i = 0; i < plan.robot.size(); ++i) values.push_back(getLargest(*bounds[k], i));
        const auto kind = static_cast<LimitKind>(k + 1);
        addJoints(plan.robot, plan.limitsPlace + ": the " + getName(kind, LimitSide::Neither) + " limit", kind, values,
                  found);
    }
    for (const auto& [key, node] : plan.command.parameters.resolved().entries) {
        if (node.line == 0 && node.file != kOverrideFile) continue;  // a default
        const std::string what = "command." + key, unit = key.substr(std::min(key.size(), key.rfind('_')));
        if (key == "points") {
            std::vector<std::string> rows;
            for (std::size_t row = 0; row < node.items.size(); ++row)
                addJoints(plan.robot, what + " row " + std::to_string(row + 1) + ": the position", LimitKind::Position,
                          listNumbers(node.items[row], 1), rows);
            const std::string more = rows.size() > 1 ? "; and " + std::to_string(rows.size() - 1) + " more" : "";
            if (!rows.empty()) found.push_back(rows.front() + more);
        } else if (unit == "_rad" || unit == "_radps") {
            std::vector<double> values = listNumbers(node);
            const auto n = static_cast<std::size_t>(plan.robot.size());
            if (node.kind != ConfigNode::Kind::List || values.size() != n) continue;  // of the tool
            for (std::size_t i = 0; i < n; ++i)
                if (plan.robot.slides(static_cast<int>(i))) values[i] = kNan;  // no angle is compared with metres
            addJoints(plan.robot, what, unit == "_rad" ? LimitKind::Position : LimitKind::Velocity, values, found);
        } else if (unit == "_m")
            for (const double value : listNumbers(node))
                if (const auto meaning = explainUnlikely(value, calcReach(plan.robot), true, LimitKind::Position);
                    !meaning.empty())
                    found.push_back(what + " is " + formatNumber(value) + " m, " + meaning);
    }
    return found;
}

}  // namespace viable::detail
