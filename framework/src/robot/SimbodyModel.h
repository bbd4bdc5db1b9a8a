#pragma once

#include <memory>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** Rigid-body dynamics of an arm by Simbody: the authority that ArmRecursion is compared with.

Assumes: as RobotModel.
Real time: calcDynamics allocates, locks and throws nothing where q and qd are finite; about 5 us for six joints. Construction
costs as much as a hundred calls.
Thread: one caller at a time; one SimbodyModel per thread. */
class SimbodyModel {
public:
    explicit SimbodyModel(const RobotDescription& robot);
    ~SimbodyModel();

    /** All of Dynamics at (q, qd), both finite: Simbody throws on an orientation that is NaN. */
    void calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out);

    /** As of RobotModel. */
    double calcEnergy(const JointVector& q, const JointVector& qd);
    JointVector calcLinkForwardDynamics(const JointVector& q, const JointVector& qd, const JointVector& tau);

private:
    struct Simulation;
    std::unique_ptr<Simulation> simulation_;
};

}  // namespace viable
