#pragma once

#include "clearance/ArmPath.h"
#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** Bounds how fast the torque of an arm can change on a path, from nothing but the path's extremes and the arm's
dimensions: triangle inequalities along the Newton-Euler recursion, so it holds for every pose. Several times larger than
what is seen; it tells for how many ticks a look at the torque is good. Immutable. */
class TorqueRate {
public:
    explicit TorqueRate(const RobotDescription& robot);

    /** An upper bound of |d tau_i / dt| of the torque for the motion [Nm/s]; also of the change of the tick's torque (state at
    its beginning, mean acceleration) from one tick to the next, divided by the tick. Real time. */
    void calcBound(const ArmPath::Extremes& path, JointVector& bound) const;

private:
    struct Body {
        int parent;
        bool isPrismatic;
        double offset;   ///< of the joint frame from the parent's [m]
        double com;      ///< of the centre of mass from the joint frame [m]
        double mass;     ///< [kg]
        double inertia;  ///< largest principal one about the centre of mass [kg m^2]
        double rotor;    ///< reflected [kg m^2]
    };
    int n_ = 0;
    double gravity_ = 0.0;
    std::array<Body, kMaxJoints> bodies_{};
};

}  // namespace viable::detail
