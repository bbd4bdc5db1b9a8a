#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

FilterStatus IntervalChoice::choose(const JointMatrix& M, const JointVector& desired,
                                    const std::array<JointInterval, kMaxJoints>& intervals, JointVector& chosen,
                                    std::array<JointIntervention, kMaxJoints>& joints) {
    const int n = static_cast<int>(desired.size());
    lower_.resize(n);
    upper_.resize(n);
    for (int i = 0; i < n; ++i) {
        lower_[i] = intervals[i].lower;
        upper_[i] = intervals[i].upper;
    }
    target_ = desired.cwiseMax(reach_.lower).cwiseMin(reach_.upper);
    qp_.solve(M, target_, lower_, upper_, chosen);
    for (int i = 0; i < n; ++i) {
        joints[i] = {};
        if (chosen[i] >= upper_[i] && desired[i] > upper_[i])
            joints[i] = {intervals[i].upperLimit, LimitSide::Upper};
        else if (chosen[i] <= lower_[i] && desired[i] < lower_[i])
            joints[i] = {intervals[i].lowerLimit, LimitSide::Lower};
    }
    return chosen == desired ? FilterStatus::Passed : FilterStatus::Modified;
}

}  // namespace viable
