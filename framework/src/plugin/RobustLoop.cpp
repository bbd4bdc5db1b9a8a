#include "viable/plugin/RobustLoop.h"

#include <algorithm>
#include <cmath>

namespace viable {

double FrictionFeed::calc(int joint, double v) const {
    const double dry = figures.coulomb[joint] * std::clamp(v / speed[joint], -1.0, 1.0);
    return dry + std::copysign(figures.calcViscous(joint, std::abs(v)), v);
}

JointVector FrictionFeed::calc(const JointVector& qd) const {
    JointVector torque(qd.size());
    for (Eigen::Index i = 0; i < qd.size(); ++i) torque[i] = calc(static_cast<int>(i), qd[i]);
    return torque;
}

}  // namespace viable
