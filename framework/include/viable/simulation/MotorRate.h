#pragma once

#include <memory>

#include "viable/plugin/Plugin.h"

namespace viable {

class ArmRecursion;

struct MotorRateOptions {
    PerJoint rate = kInfinity;

    template <class V>
    void describe(V& v) {
        v(rate, "motor_rate_Nmps", "Nm/s",
          "Fastest change of a motor's torque, from what holds the nominal arm at the start.")
            .above(0)
            .orInfinite();
    }
};

/** How fast the motors of a simulated arm can change their torque: as robots do that cut faster changes off
(TorqueConvention::torqueRate). A plant has MotorRateOptions beside ArmHardwareOptions, and per tick
cuts what ArmHardware::calcApplied() gave, then endTick() where the tick succeeded. It tells the host (PlantTraits::motorRate):
the robust loop learns it, and the summary counts the ticks in which it acted.
Real time: no allocation, lock or throw after configure(). */
class MotorRate {
public:
    /** @param torqueLimitFactor  as ArmHardwareOptions has it */
    void configure(const RunSetup& setup, const MotorRateOptions& options, double torqueLimitFactor);
    /** [Nm/s] */
    const JointVector& rate() const { return rate_; }
    /** The motors hold the nominal arm at rest at q, as far as their limits let them. */
    void reset(const JointVector& q);

    /** @param torque  within the motors' limits [Nm]; then what they reach in the coming tick, within them, too */
    void limit(JointVector& torque) const;
    void endTick(const JointVector& torque) { last_ = torque; }

private:
    std::shared_ptr<const ArmRecursion> arm_;  // null: any change
    JointVector rate_;                         // [Nm/s]
    JointVector largestStep_, last_;           // [Nm]
    JointVector torqueLimit_;                  // as ArmHardware has it [Nm]
};

}  // namespace viable
