#include <algorithm>
#include <cmath>

#include "BrokenPlugin.h"
#include "viable/loop/NominalPlant.h"

namespace {

using viable::kMaxJoints;

struct GuaranteeingOptions {
    std::string lie = "none";
    broken::LateOptions late;
    bool hasWitness = true, changes = true, recovers = false;
    std::int64_t clearanceTicks = 0;

    template <class V>
    void describe(V& v) {
        v(lie, "lie", "none|jerk|creep|moving|outside|stop_jerk|nan|negative|endless|limit|side|status",
          "What is wrong after `after_ticks`: the decision, or the witness handed over.");
        late.describe(v);
        v(hasWitness, "witness", "Hands over its stops.");
        v(changes, "changes", "Takes new limits, and brakes from then on.");
        v(recovers, "recovers", "Accepts any start.");
        v(clearanceTicks, "clearance_ticks", "Tells of a clearance in so many ticks.").atLeast(0);
    }
};

/** Moves every joint smoothly to and fro about its start, far from all limits, whatever the controller wants, and
guarantees all limits; honest but for `lie`. */
class Guaranteeing : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        limits_ = setup.limits;
        options_ = parameters.get<GuaranteeingOptions>();
    }
    void reset(const viable::MotionState& start) override {
        Filter::reset(start);
        middle_ = start.q;
        expected_ = start;
        brakes_ = false;
        for (int i = 0; i < start.q.size(); ++i) stops_[i].plan(start.qd[i], start.qdd[i], limits_.axis(i), tick_s_);
    }
    viable::FilterTraits traits() const override {
        viable::FilterTraits traits{viable::LimitSet::joints(), options_.recovers};
        traits.guarantees.set(viable::LimitKind::Clearance, options_.clearanceTicks > 0);
        return traits;
    }
    bool changeLimits(const viable::JointLimits& limits) override {
        limits_ = limits;
        brakes_ = true;
        return options_.changes;
    }
    void skipTicks(std::int64_t ticks) override {
        ticks_ += ticks;
        for (std::int64_t k = 0; k < ticks; ++k) follow(expected_);
    }
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override {
        ++ticks_;
        const viable::MotionState& nominal = input.nominal;
        // Whoever tells the filter of missed ticks must have followed its stops in them.
        if (options_.hasWitness && (nominal.q - expected_.q).lpNorm<Eigen::Infinity>() > 1e-9)
            return viable::FilterStatus::Faulted;
        const int n = static_cast<int>(nominal.q.size());
        const bool lies = options_.lie != "none" && ticks_ > options_.late.afterTicks;
        viable::JointVector jerk(n);
        for (int i = 0; i < n; ++i) jerk[i] = brakes_ ? stops_[i].popJerk() : calcJerk(nominal, i, lies);
        decision.holdJerk(jerk);
        expected_ = nominal;
        viable::advanceNominal(decision, tick_s_, expected_);
        for (int i = 0; i < n; ++i) {
            if (!brakes_) stops_[i].plan(expected_.qd[i], expected_.qdd[i], limits_.axis(i), tick_s_);
            decision.stops[i] = stops_[i];
        }
        if (lies) spoil(decision.stops[n - 1], expected_.qd[n - 1], expected_.qdd[n - 1], n - 1);
        decision.hasStops = options_.hasWitness;
        if (ticks_ <= options_.clearanceTicks) {  // later it leaves the decision as it comes
            viable::LimitReport& nearest = decision.reports[viable::LimitKind::Clearance];
            nearest.isKnown = true;
            nearest.margin = 0.25;
            nearest.link = nearest.other = 0;
            nearest.onArm = {1.0, 2.0, 3.0};
            nearest.onOther = {4.0, 5.0, 6.0};
            nearest.age_s = 0.125;
        }
        if (lies && options_.lie == "limit") decision.joints[n - 1].limit = static_cast<viable::LimitKind>(200);
        if (lies && options_.lie == "side") decision.joints[n - 1].side = static_cast<viable::LimitSide>(-7);
        if (lies && options_.lie == "status") return static_cast<viable::FilterStatus>(250);
        return brakes_ ? viable::FilterStatus::Recovering : viable::FilterStatus::Modified;
    }

private:
    double calcJerk(const viable::MotionState& s, int i, bool lies) const {
        const viable::AxisLimits axis = limits_.axis(i);
        if (lies && options_.lie == "jerk") return ticks_ % 2 ? 1e6 : -1e6;
        double jerk;
        if (lies && options_.lie == "creep") {
            jerk = -12.0 * (s.qd[i] - 0.4) - 7.0 * s.qdd[i];
        } else {
            const double aim = middle_[i] + (std::fmod(ticks_ * tick_s_, 2.0) < 1.0 ? 0.1 : -0.1);
            jerk = 8.0 * (aim - s.q[i]) - 12.0 * s.qd[i] - 6.0 * s.qdd[i];  // three poles at -2
        }
        return std::clamp(jerk, axis.jerkLower / 2.0, axis.jerkUpper / 2.0);
    }
    void spoil(viable::GridStop& stop, double v, double a, int i) const {
        viable::AxisLimits axis = limits_.axis(i);
        if (options_.lie == "moving") {
            stop.set({});
        } else if (options_.lie == "outside") {
            // Acceleration to zero, on for ten minutes, and to rest: nothing but positions are beyond.
            constexpr std::int64_t kRamp = 1000;
            const double ramp_s = kRamp * tick_s_, cruise = v + a * ramp_s / 2.0;
            const double jerk = cruise / (ramp_s * ramp_s);
            stop.set({{{kRamp, -a / ramp_s}, {600 * kRamp, 0.0}, {kRamp, -jerk}, {kRamp, jerk}}});
        } else if (options_.lie == "stop_jerk") {
            axis.jerkLower *= 100.0;
            axis.jerkUpper *= 100.0;
            stop.plan(v, a, axis, tick_s_);
        } else if (options_.lie == "nan") {
            stop.set({{{10, std::numeric_limits<double>::quiet_NaN()}, {}, {}, {}}});
        } else if (options_.lie == "negative") {
            stop.set({{{-5, axis.jerkLower}, {}, {}, {}}});
        } else if (options_.lie == "endless") {
            constexpr std::int64_t kLong = std::int64_t{1} << 62;
            stop.set({{{kLong, 0.0}, {kLong, 0.0}}});
        }
    }
    void follow(viable::MotionState& state) {
        viable::FilterDecision decision;
        decision.value.resize(state.q.size());
        for (int i = 0; i < state.q.size(); ++i) decision.value[i] = stops_[i].popJerk();
        viable::advanceNominal(decision, tick_s_, state);
    }

    viable::JointLimits limits_;
    GuaranteeingOptions options_;
    bool brakes_ = false;
    viable::JointVector middle_;
    viable::MotionState expected_;
    std::array<viable::GridStop, kMaxJoints> stops_;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Guaranteeing, "guaranteeing",
              "Guarantees every limit and keeps them, but for one lie.", GuaranteeingOptions)
