#pragma once

#include "viable/braking/DesiredJerk.h"
#include "viable/plugin/SafetyFilter.h"
#include "viable/qp/BoxQp.h"

namespace viable {

/** The choices of one joint in a tick (a jerk or an acceleration), and the limit that put each end there. */
struct JointInterval {
    double lower, upper;
    LimitKind lowerLimit, upperLimit;

    void restrictLower(double bound, LimitKind limit) {
        if (bound > lower) lower = bound, lowerLimit = limit;
    }
    void restrictUpper(double bound, LimitKind limit) {
        if (bound < upper) upper = bound, upperLimit = limit;
    }
    bool isEmpty() const { return lower > upper; }
    /** Leaves the single choice `value`. */
    void collapse(double value) { lower = upper = value; }
};

/** The last step of every limit law that gives an interval per joint. It takes the admissible choice nearest to the
desired one in torque (paper, eq. 13; see BoxQp), and reports which limit acted.

Assumes: no interval is empty (the law's own braking choice stands where one was); M as in Dynamics.
Guarantees: every choice lies in its interval; a desired choice inside all intervals is taken bit for bit.
Real time: no allocation, lock or throw. */
class IntervalChoice {
public:
    /** @param reach  bounds beyond which no desired choice is followed, usually the limits of the chosen quantity.
    It could not be met, and through M it would drag the other joints along */
    void configure(const JointBounds& reach) { reach_ = reach; }
    void reset() { qp_.reset(); }

    /** @param intervals  one per joint
        @param chosen     the choice
        @param joints     limit and side that held each joint back
        @return Passed when `chosen` is `desired`, else Modified */
    FilterStatus choose(const JointMatrix& M, const JointVector& desired,
                        const std::array<JointInterval, kMaxJoints>& intervals, JointVector& chosen,
                        std::array<JointIntervention, kMaxJoints>& joints);

private:
    JointBounds reach_;
    BoxQp qp_;
    JointVector target_, lower_, upper_;
};

/** The options of every law that builds on JerkIntervalFilter. */
struct JerkIntervalOptions {
    double gamma = 20.0;

    template <class V>
    void describe(V& v) {
        v(gamma, "gamma", "1/s", "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
            .above(0);
    }
};

/** The tick of a limit law that leaves each joint an interval of jerks and guarantees nothing. A law adds its
intervals.

Method: the desired jerk u_d follows (14) with the difference quotient of Remark 1. The filter takes the jerk nearest to
it in torque, min |M (j - u_d)|^2 (13), that lies in every joint's interval. If a joint's rows have no common solution,
the tick is Infeasible. The joint then takes the one jerk that its law names for that case.
Real time: no allocation, lock or throw after configure(). */
class JerkIntervalFilter : public SafetyFilter {
public:
    /** Reads JerkIntervalOptions, which a law's own options include; needs a finite jerk limit on every joint. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    FilterTraits traits() const override { return {}; }
    /** The difference quotient of (14) does not reach across missed ticks. */
    void skipTicks(std::int64_t ticks) override;
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

protected:
    /** The admissible jerks of one joint in one tick. */
    struct Rows {
        JointInterval jerk;  ///< a single one where the rows had no solution
        bool empty;          ///< they had none
    };

    /** @param name  the plugin's, for messages; must outlive the filter */
    explicit JerkIntervalFilter(const char* name) : name_(name) {}

    /** Throws Error (BadInput) where `k_alpha` [1/s] exceeds 1 / tick_s. A law that may use up more than all that is left
    in one tick is none. */
    static void checkKAlpha(double kAlpha, const RunSetup& setup, const Parameters& parameters);

    /** The interval that jerk and acceleration limits leave: -J <= j <= J and -A <= a + j dt <= A (in place of 22). */
    JointInterval calcHardLimits(const AxisState& state, const AxisLimits& limits) const;

    /** The law's answer from its interval; where that is empty, `braking` as far as acceleration and, before it, jerk
    limits let it. */
    Rows finishRows(const JointInterval& jerk, double braking, const AxisState& state, const AxisLimits& limits) const;

    /** Chooses `jerk` for all joints and says what acted. `desired` is u_d. Infeasible when any rows were empty. */
    virtual FilterStatus chooseJerk(const MotionState& nominal, const Dynamics& dynamics, const JointVector& desired,
                                    JointVector& jerk, std::array<JointIntervention, kMaxJoints>& joints);

    double tick_s() const { return tick_s_; }
    const JointLimits& limits() const { return limits_; }

private:
    /** The law: one joint's rows, at the beginning of a tick. */
    virtual Rows calcRows(const AxisState& state, const AxisLimits& limits) const = 0;

    const char* name_;
    int n_ = 0;
    double tick_s_ = 0.0;
    JointLimits limits_;
    DesiredJerk desiredJerk_;
    IntervalChoice choice_;
    JointVector desiredAcceleration_, desired_, jerk_;
};

}  // namespace viable
