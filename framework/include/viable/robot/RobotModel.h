#pragma once

#include <memory>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** Rigid-body dynamics of an arm, by Simbody.

Assumes: a tree of revolute, continuous and prismatic joints on a fixed base; rotor inertias enter M
as a diagonal, n^2 I_rotor (gyroscopic effects of the spinning rotors neglected).
Real time: calcDynamics allocates, locks and throws nothing; about 6 us for six joints.
Thread: one caller at a time; one RobotModel per thread (each owns its Simbody system). */
class RobotModel {
public:
    explicit RobotModel(const RobotDescription& robot);
    ~RobotModel();
    RobotModel(RobotModel&&) noexcept;
    RobotModel& operator=(RobotModel&&) noexcept;

    int size() const;

    /** All of Dynamics at (q, qd), each of length size(). Where q or qd holds a number that is not
    finite, all of `out` is NaN. */
    void calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out);

    /** Potential plus kinetic energy [J] (rotor inertia included; potential zero at the base
     * origin). */
    double calcEnergy(const JointVector& q, const JointVector& qd);

    /** Simbody's own forward dynamics of the links: qdd from tau, WITHOUT rotor inertia. An independent
    result for tests; allocates, so never call it in a tick. */
    JointVector calcLinkForwardDynamics(const JointVector& q, const JointVector& qd, const JointVector& tau);

private:
    struct Simulation;
    std::unique_ptr<Simulation> simulation_;
};

}  // namespace viable
