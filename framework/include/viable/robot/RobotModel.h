#pragma once

#include <memory>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The engine that computes M, b, gravity, tool pose and Jacobian. */
enum class DynamicsEngine : unsigned char {
    Recursion,  ///< one recursive pass (composite rigid bodies and Newton-Euler): about 0.6 us for six joints
    Simbody     ///< the independent one that every robot's recursion is compared with: about 5 us
};

/** Rigid-body dynamics of an arm.

Assumes: a tree of revolute, continuous and prismatic joints on a fixed base. Rotor inertias enter M as a diagonal, n^2
I_rotor (gyroscopic effects of the spinning rotors neglected).
Guarantees: both engines agree to rounding; loadRobot compares them for each robot that it reads.
Real time: calcDynamics allocates, locks and throws nothing; time at DynamicsEngine.
Thread: one caller at a time; one RobotModel per thread (each may own a Simbody system). */
class RobotModel {
public:
    /** By the recursion. */
    explicit RobotModel(const RobotDescription& robot);
    RobotModel(const RobotDescription& robot, DynamicsEngine engine);
    ~RobotModel();
    RobotModel(RobotModel&&) noexcept;
    RobotModel& operator=(RobotModel&&) noexcept;

    int size() const;

    /** All of Dynamics at (q, qd), each of length size(). If q or qd holds a number that is not finite, all of `out`
    is NaN. */
    void calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out);

    /** By Simbody: potential plus kinetic energy [J] (rotor inertia included; potential zero at the base origin).
    The first call may allocate. */
    double calcEnergy(const JointVector& q, const JointVector& qd);

    /** Simbody's own forward dynamics of the links: qdd from tau, WITHOUT rotor inertia. An independent
    result for tests; allocates, so never call it in a tick. */
    JointVector calcLinkForwardDynamics(const JointVector& q, const JointVector& qd, const JointVector& tau);

private:
    struct Engines;
    std::unique_ptr<Engines> engines_;
};

}  // namespace viable
