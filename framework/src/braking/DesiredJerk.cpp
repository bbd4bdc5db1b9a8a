#include "viable/braking/DesiredJerk.h"

namespace viable {

void DesiredJerk::configure(double gamma, double tick_s) {
    gamma_ = gamma;
    tick_s_ = tick_s;
    reset();
}

void DesiredJerk::calc(const JointVector& qdd, const JointVector& desired, const JointVector* rate, JointVector& jerk) {
    if (!hasLast_) last_ = desired;
    hasLast_ = true;
    if (rate)
        jerk = *rate - gamma_ * (qdd - desired);
    else
        jerk = (desired - last_) / tick_s_ - gamma_ * (qdd - desired);
    last_ = desired;
}

}  // namespace viable
