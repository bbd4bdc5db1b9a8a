#include "live/LiveStart.h"

#include "core/Text.h"
#include "experiment/ConfiguredCase.h"

namespace viable {

std::string findLiveStart(const CasePlan& plan) {
    if (!plan.realPlant) return {};
    const auto configured = configureTracking(plan);
    RealPlant& plant = *configured->plugins.realPlant;
    if (!plant.traits().hasClock) return {};
    MotionState start = plan.start;
    start.qd.setZero();
    start.qdd.setZero();
    constexpr PluginKind kKind = PluginKind::RealPlant;
    resetPlugin(plant, kKind, configured->plugins.watches[static_cast<std::size_t>(kKind)], start);
    JointVector q = plant.measured().q;
    // At a limit it is measured beyond it now and then; where it is farther, ControlLoop refuses.
    constexpr double kOutside = 1e-4;  // [rad, m]
    const JointBounds& bounds = plan.limits.position;
    for (Eigen::Index i = 0; i < q.size(); ++i) {
        const double inside = std::clamp(q[i], bounds.lower[i], bounds.upper[i]);
        if (std::abs(q[i] - inside) <= kOutside) q[i] = inside;
    }
    std::string text = "{position_rad: [";
    for (Eigen::Index i = 0; i < q.size(); ++i) text += detail::format("%s%.17g", i > 0 ? ", " : "", q[i]);
    return text + "]}";
}

}  // namespace viable
