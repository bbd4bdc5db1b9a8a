#pragma once

#include <random>

#include "viable/robot/RobotDescription.h"

namespace viable {

/** States of an arm drawn evenly from its position and velocity limits; without a limit from +-pi and +-2 pi per second. */
class RandomStates {
public:
    RandomStates(const RobotDescription& robot, std::uint64_t seed) : limits_(robot.limits), random_(seed) {}

    JointState draw() {
        const int n = static_cast<int>(limits_.position.lower.size());
        JointState state;
        state.q.resize(n);
        state.qd.resize(n);
        for (int i = 0; i < n; ++i) {
            state.q[i] = drawBetween(limits_.position.lower[i], limits_.position.upper[i], EIGEN_PI);
            state.qd[i] = drawBetween(limits_.velocity.lower[i], limits_.velocity.upper[i], 2.0 * EIGEN_PI);
        }
        return state;
    }

private:
    double drawBetween(double lower, double upper, double unlimited) {
        return std::uniform_real_distribution<double>(std::isfinite(lower) ? lower : -unlimited,
                                                      std::isfinite(upper) ? upper : unlimited)(random_);
    }

    JointLimits limits_;
    std::mt19937_64 random_;
};

}  // namespace viable
