#include <algorithm>
#include <cmath>

#include "core/Memo.h"
#include "core/Text.h"
#include "experiment/CaseChecks.h"
#include "experiment/ResolvedNodes.h"
#include "robot/RobotKey.h"
#include "tracking/InertiaSample.h"

namespace viable::detail {

namespace {

/** Margins that are remembered at a time; the runs of a sweep mostly share them. */
constexpr std::size_t kMostKnownMargins = 64;

/** Its margins, remembered. */
LoopMargins findMargins(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks) {
    const ConfigNode inputs = makeMap(
        {{"robot", makeScalar(calcRobotKey(plan.robot), true)},
         {"tick_s", makeNumber(plan.tick_s)},
         {"delay_ticks", makeNumber(delayTicks)},
         {"inertia_rate", makeNumber(loop.inertiaRate)},
         {"position", detail::makeBounds(plan.limits.position)},
         {"gains", makeMap({{"k_r", makeList(loop.kr)}, {"k_p", makeList(loop.kp)}, {"k_i", makeList(loop.ki)}})}});
    static Memo<LoopMargins> known(kMostKnownMargins);
    return known.get(writeConfig(inputs),
                     [&] { return calcMargins(plan.robot, plan.limits, plan.tick_s, delayTicks, loop); });
}

/** Which of the gains makes it unstable: tried out in the poses where it is nearest to it. */
class CauseFinder {
public:
    CauseFinder(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks,
                const std::vector<PoseInertia>& samples)
        : plan_(plan),
          loop_(loop),
          delayTicks_(delayTicks),
          poses_(findCriticalPoses(samples, loop, plan.tick_s, delayTicks)) {}

    std::string find() const {
        LinearErrorLoop velocity = loop_;
        velocity.kp.setZero();
        velocity.ki.setZero();
        if (isUnstable(velocity)) return explainKr(velocity);
        LinearErrorLoop position = loop_;
        position.ki.setZero();
        if (isUnstable(position)) return explainKp(position);
        return explainKi();
    }

private:
    double calcRadius(const LinearErrorLoop& loop) const {
        double radius = 0.0;
        for (const PoseInertia* pose : poses_)
            radius = std::max(radius, std::abs(calcOutermostPole(loop, *pose, plan_.tick_s, delayTicks_)));
        return radius;
    }
    bool isUnstable(const LinearErrorLoop& loop) const { return !(calcRadius(loop) < limitRadius(loop)); }

    /** The joint whose gain, halved, helps most. */
    Eigen::Index findJoint(const LinearErrorLoop& loop, JointVector LinearErrorLoop::*gains) const {
        Eigen::Index best = 0;
        double least = kInfinity;
        for (Eigen::Index i = 0; i < (loop.*gains).size(); ++i) {
            LinearErrorLoop tried = loop;
            (tried.*gains)[i] *= 0.5;
            const double radius = calcRadius(tried);
            if (radius >= least) continue;
            least = radius;
            best = i;
        }
        return best;
    }
    std::string name(Eigen::Index joint) const { return plan_.robot.joints[joint].name; }

    std::string explainKr(const LinearErrorLoop& loop) const {
        const Eigen::Index joint = findJoint(loop, &LinearErrorLoop::kr);
        return "k_r of " + name(joint) + " is " + formatNumber(loop.kr[joint]) +
               ", and those with which it just becomes unstable, together, are about " +
               formatList(findLargestGains(plan_.robot, plan_.limits, plan_.tick_s, delayTicks_));
    }
    std::string explainKp(const LinearErrorLoop& loop) const {
        const Eigen::Index joint = findJoint(loop, &LinearErrorLoop::kp);
        return "k_p is too large for such a k_r, above all at " + name(joint) + ": " + formatNumber(loop.kp[joint]);
    }
    std::string explainKi() const {
        const Eigen::Index joint = findJoint(loop_, &LinearErrorLoop::ki);
        const std::string text = "k_i of " + name(joint) + " is " + formatNumber(loop_.ki[joint]) + ", and ";
        LinearErrorLoop tried = loop_;
        tried.ki[joint] = 0.0;
        if (isUnstable(tried)) return text + "that of others is too large for their k_r and k_p as well";
        double stable = 0.0, unstable = loop_.ki[joint];
        for (int i = 0; i < 12; ++i) {
            tried.ki[joint] = 0.5 * (stable + unstable);
            (isUnstable(tried) ? unstable : stable) = tried.ki[joint];
        }
        return text + "with its k_r and k_p it just becomes unstable at about " + format("%.3g", unstable);
    }

    const CasePlan& plan_;
    const LinearErrorLoop& loop_;
    const int delayTicks_;
    std::vector<const PoseInertia*> poses_;
};

}  // namespace

LoopMargins checkStability(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks) {
    LoopMargins margins = findMargins(plan, loop, delayTicks);
    if (margins.isStable || plan.robustLoop->host.acceptsUnstable) return margins;
    const std::vector<PoseInertia> samples = sampleInertia(plan.robot, plan.limits, kMarginPoses);
    if (samples.empty())
        throw badInput(plan.robot.folder.string(), "no pose of the robot has a usable inertia matrix",
                       "`viable check` says what is wrong with the robot.");
    throw badInput(plan.robustLoop->parameters.resolved().place(),
                   "the robust loop is unstable on this arm at a tick of " + formatNumber(plan.tick_s) + " s" +
                       (delayTicks > 0 ? " and a delay of " + std::to_string(delayTicks) + " ticks" : "") + ": " +
                       CauseFinder(plan, loop, delayTicks, samples).find(),
                   "Nric: leave the gains out (`auto`), or take constant ones such as " +
                       formatGains(scaleConstantGains(plan.robot, plan.limits, plan.tick_s, delayTicks)) +
                       ". To run it all the same: `" + settingsOf<RobustLoopSettings>().back().name +
                       ": true` in this block.");
}

}  // namespace viable::detail
