#pragma once

#include "viable/core/JointTypes.h"

namespace viable {

/** Turns the controller's desired acceleration into the jerk that leads to it:

    u_d = d qdd_d / dt - gamma (qdd - qdd_d)      (paper, eq. 14)

with (qdd_d - last qdd_d) / dt for the derivative where it is not known (Remark 1). With that jerk qdd approaches qdd_d
exponentially (Prop. 1); sampled, this needs gamma dt < 2. If the set-point jumps, the quotient is very large:
IntervalChoice clamps it near the jerk limits.
Real time: no allocation, lock or throw. */
class DesiredJerk {
public:
    /** @param gamma  [1/s], 0 < gamma dt < 2 */
    void configure(double gamma, double tick_s);

    /** Clears the last desired acceleration: the next quotient is zero. */
    void reset() { hasLast_ = false; }

    /** The desired jerk [rad/s^3]; all vectors of one size. @param rate  d qdd_d / dt [rad/s^3]; null: not known */
    void calc(const JointVector& qdd, const JointVector& desired, const JointVector* rate, JointVector& jerk);

private:
    double gamma_ = 0.0;
    double tick_s_ = 0.0;
    JointVector last_;
    bool hasLast_ = false;
};

}  // namespace viable
