#pragma once

#include "viable/plugin/SafetyFilter.h"
#include "viable/qp/BoxQp.h"

namespace viable {

/** What one joint may choose in a tick (a jerk or an acceleration) and which limit put each end
 * there. */
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

/** The last step of every limit law that gives an interval per joint: of the admissible choices,
take the one nearest to the desired one in torque (paper, eq. 13; see BoxQp), and say what acted.

Assumes: no interval is empty (the law's own braking choice stands where one was); M as in Dynamics.
Guarantees: every choice lies in its interval; a desired choice inside all intervals is taken bit
for bit.
Real time: no allocation, lock or throw. */
class IntervalChoice {
public:
    /** @param reach  no desired choice is followed beyond these bounds: it could not be met, and
       through M it would drag the other joints along; usually the limits of the chosen quantity
       themselves */
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
