#pragma once

#include "TestArm.h"
#include "filter/WholeArmBrakingFilter.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

inline JointVector turned(const JointVector& q, int joint, double angle) {
    JointVector other = q;
    other[joint] += angle;
    return other;
}

/** The nominal arm under the whole arm's filter, which who uses it configures. */
class FilteredWholeArm {
public:
    static constexpr double kTick_s = 1e-3;

    explicit FilteredWholeArm(RobotDescription description)
        : robot(std::move(description)), geometry(loadArmGeometry(robot)), model_(robot) {
        state = {robot.home, JointVector::Zero(robot.size()), JointVector::Zero(robot.size())};
        calcDynamics();
    }

    void calcDynamics() { model_.calcDynamics(state.q, state.qd, dynamics); }
    /** A tick with desired accelerations. */
    FilterStatus push(const JointVector& qdd) {
        JointVector torque;
        calcInverseDynamics(dynamics, qdd, torque);
        const FilterStatus status = filter.filter({state, torque, dynamics}, decision);
        if (status > FilterStatus::Infeasible) return status;
        calcHeldMotion({state, torque, dynamics}, status, decision, kTick_s, motion);
        advanceNominal(decision, kTick_s, state);
        calcDynamics();
        t += kTick_s;
        return status;
    }
    /** The same, towards a pose; `stiffness` 1/s^2. */
    FilterStatus goTo(const JointVector& goal, double stiffness = 100.0) {
        return push(stiffness * (goal - state.q) - 2.0 * std::sqrt(stiffness) * state.qd);
    }

    RobotDescription robot;
    ArmGeometry geometry;
    WholeArmBrakingFilter filter;
    MotionState state;
    Dynamics dynamics;
    FilterDecision decision;
    HeldMotion motion;  ///< of the last decision
    double t = 0.0;

private:
    RobotModel model_;
};

}  // namespace viable
