#include <cstdio>

#include "ArmProperty.h"
#include "loop/StopMonitor.h"

namespace viable {

namespace {

/** A jerk is spoilt by this share of its limit. */
constexpr double kSpoilt = 1e-6;
constexpr std::size_t kMostClasses = 12;

const char* getName(StopMonitor::Fault fault) {
    static const char* const names[] = {"none", "limit", "stays", "moving", "malformed"};
    return names[static_cast<int>(fault)];
}

const char* countSides(double lower, double upper) {
    static const char* const counts[] = {"none", "one", "both"};
    return counts[std::isfinite(lower) + std::isfinite(upper)];
}

bool isFar(double position) {
    return std::isfinite(position) && std::abs(position) > 50.0;
}

/** What may go on in an arm's life. */
struct Story {
    bool startsAnywhere, changesLimits, missesTicks;

    explicit Story(Random& random)
        : startsAnywhere(random.chance(0.4)), changesLimits(random.chance(0.4)), missesTicks(random.chance(0.6)) {}
};

/** "position both at zero, velocity one, acceleration none" */
std::string describe(const AxisLimits& l) {
    const char* place = l.positionLower == 0.0 || l.positionUpper == 0.0   ? " at zero"
                        : isFar(l.positionLower) || isFar(l.positionUpper) ? " far from zero"
                                                                           : "";
    return std::string("position ") + countSides(l.positionLower, l.positionUpper) + place + ", velocity " +
           countSides(l.velocityLower, l.velocityUpper) + ", acceleration " +
           countSides(l.accelerationLower, l.accelerationUpper);
}

class MonitorProperty : public ArmProperty {
public:
    explicit MonitorProperty(const Options& options) : ArmProperty("monitor", options) {}

private:
    void followArm() override {
        Random random(run_.seed(), run_.arm());
        Arm arm(random);
        const Story story(random);
        arm_ = &arm;
        story_ = &story;
        accused_ = wasSafe_ = false;
        if (story.startsAnywhere) arm.startAnywhere(random);
        dynamics_.M = arm.M;
        dynamics_.b.setZero(arm.n);
        dynamics_.gravity.setZero(arm.n);
        monitor_.reset(arm.state, arm.limits, arm.tick_s, true, story.startsAnywhere);
        const int ticks = random.integer(300, 3000);
        int left = random.integer(20, 500), k = 0;
        for (; k < ticks && !accused_; ++k) {
            if (k > 0 && story.missesTicks && random.chance(0.003)) followStop(random.integer(1, 1000));
            if (story.changesLimits && --left == 0) {
                arm.changeLimits(random);
                monitor_.changeLimits(arm.limits, arm.state);
                wasSafe_ = false;
                left = static_cast<int>(random.logUniform(20, 2000));
            }
            if (!accused_) runTick(random, k);
        }
        run_.addSteps(std::int64_t(k) * arm.n);
    }

    /** The host goes on without the filter. */
    void followStop(int ticks) {
        Arm& arm = *arm_;
        for (int m = 0; m < ticks && !accused_; ++m) {
            judge(monitor_.followStop(arm.state, decision_));
            arm.chosen = decision_.value;
            arm.move();
        }
        arm.braking.skipTicks(ticks);
        missed_ += ticks;
    }

    void runTick(Random& random, int k) {
        Arm& arm = *arm_;
        arm.choose(k);
        decision_.holdJerk(arm.chosen);
        decision_.hasStops = true;
        for (int i = 0; i < arm.n; ++i) decision_.stops[i] = arm.braking.stop(i);
        const StopMonitor::Violation& violation = monitor_.examine(arm.state, decision_);
        const bool isSafe = violation.verdict == StopVerdict::Safe;
        judge(violation);
        // After a change of limits, or on the way back, the stop before counts in place of a limit.
        if (isSafe && wasSafe_ && random.chance(0.02)) {
            spoil(random.integer(0, arm.n - 1), random.chance(0.5));
            monitor_.examine(arm.state, decision_);
        }
        wasSafe_ = isSafe;
        monitor_.accept();
        arm.move();
    }

    /** The same decision with a jerk beyond its limit, or with a stop that ends one tick too early. */
    void spoil(int i, bool spoilsJerk) {
        Arm& arm = *arm_;
        const AxisLimits l = arm.limits.axis(i);
        FilterDecision spoilt = decision_;
        if (spoilsJerk) {
            const bool upwards = arm.chosen[i] > 0.0;
            JointVector jerk = arm.chosen;
            jerk[i] = (upwards ? l.jerkUpper : l.jerkLower) * (1.0 + kSpoilt);
            spoilt.holdJerk(jerk);
        } else if (!cutShort(spoilt.stops[i], l)) {
            return;
        }
        ++spoilt_;
        if (monitor_.examine(arm.state, spoilt).verdict == StopVerdict::NoStop) return;
        fail(spoilsJerk ? "the monitor lets a jerk beyond its limit pass (share)"
                        : "the monitor lets a stop pass that does not end at rest",
             kSpoilt, i);
    }

    /** False where the last tick of the stop does next to nothing. */
    static bool cutShort(GridStop& stop, const AxisLimits& l) {
        std::array<GridStop::Segment, GridStop::kSegments> segments;
        for (int k = 0; k < GridStop::kSegments; ++k) segments[k] = stop.remaining(k);
        for (int k = GridStop::kSegments - 1; k >= 0; --k) {
            if (segments[k].ticks == 0) continue;
            --segments[k].ticks;
            stop.set(segments);
            return std::abs(segments[k].jerk) > 0.1 * std::min(-l.jerkLower, l.jerkUpper);
        }
        return false;
    }

    void judge(const StopMonitor::Violation& violation) {
        ++verdicts_[static_cast<int>(violation.verdict)];
        if (violation.verdict != StopVerdict::NoStop) return;
        accused_ = true;
        const int i = violation.joint;
        const AxisLimits l = arm_->limits.axis(i);
        char what[512];
        RobotDescription named;
        named.joints.resize(static_cast<std::size_t>(i) + 1);
        named.joints.back().name = "the joint";
        monitor_.describe(violation, named, what, sizeof what);
        fail((std::string("the monitor accuses the law: ") + what).c_str(), violation.excess, i);
        Accusations& accusations =
            accusations_[std::string(getName(violation.fault)) + " " +
                         viable::getName(violation.limit, LimitSide::Neither) + "; limits: " + describe(l)];
        if (accusations.arms++ == 0) accusations.firstArm = run_.arm();
        accusations.worst = std::max(accusations.worst, violation.excess);
        accusations.startedAnywhere += story_->startsAnywhere;
        accusations.changed += story_->changesLimits;
        accusations.missed += story_->missesTicks;
    }

    void report() override {
        std::printf("  ticks found safe %lld, recovering %lld, without a stop %lld; missed %lld\n",
                    static_cast<long long>(verdicts_[0]), static_cast<long long>(verdicts_[1]),
                    static_cast<long long>(verdicts_[2]), static_cast<long long>(missed_));
        std::printf("  spoilt decisions %lld\n", static_cast<long long>(spoilt_));
        std::vector<std::pair<std::string, Accusations>> classes(accusations_.begin(), accusations_.end());
        std::stable_sort(classes.begin(), classes.end(),
                         [](const auto& a, const auto& b) { return a.second.arms > b.second.arms; });
        if (classes.size() > kMostClasses) {
            std::printf("  classes of accusations %d, the most frequent:\n", static_cast<int>(classes.size()));
            classes.resize(kMostClasses);
        }
        for (const auto& [name, c] : classes)
            std::printf(
                "  accused: %s\n    arms %d (started anywhere %d, limits changed %d, ticks missed "
                "%d), worst %.3g, first arm %lld\n",
                name.c_str(), c.arms, c.startedAnywhere, c.changed, c.missed, c.worst,
                static_cast<long long>(c.firstArm));
    }

    /** Of one class. */
    struct Accusations {
        int arms = 0, startedAnywhere = 0, changed = 0, missed = 0;
        std::int64_t firstArm = 0;
        double worst = 0.0;  ///< in the limit's unit
    };

    const Story* story_ = nullptr;
    StopMonitor monitor_;
    Dynamics dynamics_;
    FilterDecision decision_;
    bool accused_ = false, wasSafe_ = false;
    std::int64_t verdicts_[3] = {}, missed_ = 0, spoilt_ = 0;
    std::map<std::string, Accusations> accusations_;
};

}  // namespace

bool checkMonitor(const Options& options) {
    return MonitorProperty(options).check();
}

}  // namespace viable
