#pragma once

#include <algorithm>

#include "viable/core/JointTypes.h"

namespace viable {

/** The linear error loop under Nric around a pose (MATH.md, tracking bound), as this adversary needs it. */
struct LinearLoop {
    JointMatrix M;        ///< of the real arm [kg m^2]
    JointVector damping;  ///< [Nms/rad]
    JointVector kr, kp, ki;
    double tick_s = 0.0;
    int delayTicks = 0;
};

/** What moves one output at a tick, e or de of one joint, by how long before it acts. Column k belongs to the tick that
ends k ticks before; rows are joints. */
struct ErrorResponse {
    Eigen::MatrixXd begin, end;  ///< of an impulse of torque just after the beginning of that tick, just before its end
    Eigen::MatrixXd reading;     ///< of an error of the reading at the beginning of that tick

    int ticks() const { return static_cast<int>(begin.cols()); }
    int column(int age) const { return std::min(age, ticks() - 1); }
    /** Integral of the absolute response over that tick, linear in between. [1/Nm of the output] */
    double calcSize(int joint, int age, double tick_s) const;
    double calcAt(int joint, int age, double share) const {
        return begin(joint, age) + share * (end(joint, age) - begin(joint, age));
    }
    double calcMean(int joint, int age) const { return calcAt(joint, age, 0.5); }
};

/** By the adjoint loop, backwards in time, and the exponential of a tick: another route than the bound's. */
ErrorResponse calcResponse(const LinearLoop& loop, int joint, bool isVelocity, int ticks);

}  // namespace viable
