#include <cmath>

#include "core/Memo.h"
#include "core/Text.h"
#include "experiment/CaseChecks.h"
#include "experiment/ExperimentKeys.h"
#include "experiment/ResolvedNodes.h"
#include "tracking/InertiaSample.h"
#include "viable/core/Error.h"
#include "viable/tracking/LoopStability.h"

namespace viable::detail {

namespace {

/** Margins that are remembered at a time; the runs of a sweep mostly share them. */
constexpr std::size_t kMostKnownMargins = 64;

/** Its margins, remembered. */
LoopMargins findMargins(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks) {
    const ConfigNode inputs = makeMap(
        {{"robot", makeScalar(std::filesystem::canonical(plan.robot.folder), true)},
         {"tick_s", makeNumber(plan.tick_s)},
         {"delay_ticks", makeNumber(delayTicks)},
         {"inertia_rate", makeNumber(loop.inertiaRate)},
         {"position", detail::makeBounds(plan.limits.position)},
         {"gains", makeMap({{"k_r", makeList(loop.kr)}, {"k_p", makeList(loop.kp)}, {"k_i", makeList(loop.ki)}})},
         {"payload", plan.payload ? plan.payload->resolved() : ConfigNode()}});
    static Memo<LoopMargins> known(kMostKnownMargins);
    return known.get(writeConfig(inputs),
                     [&] { return calcMargins(plan.robot, plan.limits, plan.tick_s, delayTicks, loop); });
}

/** Which of the gains makes it unstable. */
std::string findCause(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks) {
    const auto getName = [&](Eigen::Index joint) { return plan.robot.joints[static_cast<std::size_t>(joint)].name; };
    const JointVector largest = findLargestGains(plan.robot, plan.limits, plan.tick_s, delayTicks);
    const bool isConstant = std::isinf(loop.inertiaRate);
    Eigen::Index joint = -1;
    // The gain that is farthest beyond `most`; a gain of 0 is beyond nothing.
    const auto findBeyond = [&](const JointVector& gains, const JointVector& most) {
        for (Eigen::Index i = 0; i < gains.size(); ++i)
            if (gains[i] > 0.0 && gains[i] >= most[i] && (joint < 0 || gains[i] * most[joint] > gains[joint] * most[i]))
                joint = i;
        return joint >= 0;
    };
    if (isConstant && findBeyond(loop.kr, largest))
        return "k_r of " + getName(joint) + " is " + formatNumber(loop.kr[joint]) +
               ", and those with which it just becomes unstable, together, are about " + formatList(largest);
    // At low frequencies, in the pose where the joint moves most, k_i must stay below k_p k_r / M.
    const std::vector<PoseInertia> samples = sampleInertia(plan.robot, plan.limits, kMarginPoses);
    if (!samples.empty()) {
        const JointVector greatest = findInertiaRange(samples).greatest;
        JointVector most = loop.kr.cwiseQuotient(greatest);
        if (!isConstant)
            for (double& rate : most) rate = 1.0 / (1.0 / rate + 1.0 / loop.inertiaRate);
        most = most.cwiseProduct(loop.kp);
        if (findBeyond(loop.ki, most))
            return "k_i of " + getName(joint) + " is " + formatNumber(loop.ki[joint]) +
                   ", and with its k_r and k_p it just becomes unstable at about " + format("%.3g", most[joint]);
    }
    loop.kp.maxCoeff(&joint);
    return "k_p is too large for such a k_r, largest at " + getName(joint) + ": " + formatNumber(loop.kp[joint]);
}

}  // namespace

LoopMargins checkStability(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks) {
    LoopMargins margins = findMargins(plan, loop, delayTicks);
    if (margins.isStable || plan.robustLoop->acceptsUnstable) return margins;
    throw badInput(plan.robustLoop->parameters.resolved().place(),
                   "the robust loop is unstable on this arm at a tick of " + formatNumber(plan.tick_s) + " s" +
                       (delayTicks > 0 ? " and a delay of " + std::to_string(delayTicks) + " ticks" : "") + ": " +
                       findCause(plan, loop, delayTicks),
                   "Nric: leave the gains out (`auto`)" +
                       (delayTicks > 0 ? std::string()
                                       : ", or take constant ones such as " +
                                             formatGains(scaleConstantGains(plan.robot, plan.limits, plan.tick_s))) +
                       ". To run it all the same: `" + std::string(makeAcceptUnstable().name) +
                       ": true` in this block.");
}

}  // namespace viable::detail
