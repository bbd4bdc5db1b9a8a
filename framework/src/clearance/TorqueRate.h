#pragma once

#include "clearance/ArmPath.h"
#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** Bounds how fast the torque of an arm can change on a path, and how far the torques of two paths can be apart, from nothing
but the paths' extremes and the arm's dimensions: triangle inequalities along the Newton-Euler recursion, so it holds for
every pose. Several times larger than what is seen; it tells for how many ticks a look at the torque is good. Immutable. */
class TorqueRate {
public:
    explicit TorqueRate(const RobotDescription& robot);

    /** An upper bound of |d tau_i / dt| of the torque for the motion [Nm/s]; also of the change of the tick's torque (state at
    its beginning, mean acceleration) from one tick to the next, divided by the tick. Real time. */
    void calcBound(const ArmPath::Extremes& path, JointVector& bound) const {
        calcChange(path, path.velocity, path.acceleration, path.jerk, bound);
    }
    /** An upper bound of the difference of the torques of two motions [Nm], at one time or of one tick.
    @param both  extremes that hold for both */
    void calcDifference(const ArmPath::Extremes& both, const ArmPath::Difference& apart, JointVector& bound) const {
        calcChange(both, apart.position, apart.velocity, apart.acceleration, bound);
    }

private:
    /** @param dq, dqd, dqdd  how far apart two motions are, or how fast one changes */
    void calcChange(const ArmPath::Extremes& motion, const JointVector& dq, const JointVector& dqd,
                    const JointVector& dqdd, JointVector& bound) const;

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
