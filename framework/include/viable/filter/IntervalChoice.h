#pragma once

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

}  // namespace viable
