#pragma once

#include "loop/ToolTouch.h"
#include "viable/braking/Servo.h"
#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/plugin/NominalController.h"

namespace viable::detail {

/** The arm as its command would lead it if nothing held the real one (MATH 13). While something does, the controller moves
this arm, within the limits of the joints, and the nominal arm follows it as far as the surface lets its tool. So the nominal
arm does not run ahead of the real one, whatever the controller, and comes away as soon as the command does.

The nominal tool is led to the free one's place, or to the nearest one on the surface, and to its orientation (calcJointStep,
a step per tick). On the surface the motion along the normal is led by itself, so that the tool that came too deep goes back
straight. Off it the joints follow as fast as the limits allow (Servo). Once the nominal arm is where the free one is the two are one again.
Real time: no allocation, lock or throw after construction. */
class FreeArm {
public:
    /** The two arms are one when no joint is farther apart [rad, m; rad/s, m/s]. */
    static constexpr double kSame = 1e-4;

    /** Throws Error (BadInput) where a jerk is not limited. */
    explicit FreeArm(const RunSetup& setup);

    bool isOn() const { return isOn_; }
    /** @param surface   what holds the tool; each tick anew
    @param dynamics  of the nominal arm */
    void wait(const ToolSurface& surface, const MotionState& nominal, const Dynamics& dynamics);
    void end() { isOn_ = false; }
    /** For a tick without a controller: it rests where it is. */
    void pause();
    void changeLimits(const JointLimits& limits);

    const MotionState& state() const { return state_; }
    /** Of this tick. @return where the tool is */
    const Dynamics& updateDynamics();
    const Eigen::Vector3d& tool() const { return dynamics_.tool.position; }
    /** Moves through the tick with the controller's torque. False: it cannot. */
    bool move(const ControllerOutput& output);
    /** The jerk that leads the nominal arm after it [rad/s^3]; ends where they are one. */
    void lead(const MotionState& nominal, const Dynamics& dynamics, JointVector& jerk);

private:
    /** Share of the limits for the motion along the normal; the other one has the rest. */
    static constexpr double kShare = 0.8;
    /** How fast both follow where the free arm is held [1/s]. */
    static constexpr double kFollow = 10.0;
    void findTarget(double beneath);
    void followSurface(const MotionState& nominal, const Dynamics& dynamics, JointVector& jerk);
    JointVector calcJerk(const MotionState& error, double part) const;

    JointLimits limits_;
    double tick_s_ = 0.0;
    RobotModel model_;
    CertifiedBrakingFilter filter_;
    Servo servo_;
    bool isOn_ = false, isServed_ = false;  // the servo leads the nominal arm
    ToolSurface surface_;
    MotionState state_, target_;
    JointVector targetJerk_;
    Dynamics dynamics_, ofTarget_;
    FilterDecision decision_;
};

}  // namespace viable::detail
