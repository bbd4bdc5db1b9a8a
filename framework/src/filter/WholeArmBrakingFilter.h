#pragma once

#include "viable/filter/CertifiedBrakingFilter.h"

namespace viable {

/** What WholeArmBrakingFilter keeps besides the joint limits. */
struct WholeArmBrakingOptions {
    CertifiedBrakingOptions joints;
    /** Share of the motors' torque limits (RobotDescription::actuation) that the nominal torque may use; infinite:
    torque is
    not limited. What is left is for the robust loop. */
    double torqueShare = std::numeric_limits<double>::infinity();
    /** Largest change of the torque [Nm/s]; infinite: not limited. Where the jerk limits could ask for more in some pose,
    joints keep to lower jerks, worked out from the arm's inertia: a stop that needs more would never be taken. */
    PerJoint torqueRate = std::numeric_limits<double>::infinity();
    /** Look for jerks that lead around an obstacle or along a torque limit. False: only brake before it. */
    bool steers = true;
    /** Older surroundings are not used: the arm follows its stop until newer ones come [s]. */
    double maxAge_s = std::numeric_limits<double>::infinity();

    template <class V>
    void describe(V& v) {
        joints.describe(v);
        v(torqueShare, "torque_share", "",
          "Share of the motors' torque limits that the nominal torque, as it is held over each tick, may use, now and "
          "along the "
          "stop. Infinite: torque is not limited.")
            .above(0)
            .upTo(1)
            .orInfinite();
        v(torqueRate, "torque_rate_Nmps", "Nm/s",
          "Largest change of the nominal torque, now and along the stop. Jerks stay as low as it demands.")
            .above(0)
            .orInfinite();
        v(steers, "steers",
          "Look for jerks that lead around an obstacle or along a torque limit; false: only brake before it.");
        v(maxAge_s, "max_age_s", "s",
          "Older surroundings are not used: the arm stops until newer ones come. Those of an experiment file were seen "
          "at its "
          "start.")
            .above(0)
            .orInfinite();
    }
};

/** Certified braking of the whole arm: a jerk is taken only if the stops that all joints have after it, run together,
keep
the joint limits, the safety distance from what stands around (RunSetup::surroundings) and of the links from each other
(RunSetup::geometry), and the motors' torques. Otherwise the stop that was checked a tick before goes on, which does. So
there is always a choice, for any surroundings.

Where the nearest admissible jerks are wanted, obstacles and torques along the stop become rows of a small QP, to first
order; its solution is checked like any other and drawn back towards the backup stop where it fails.
Surroundings that change during the run may lie in the way of the backup stop. Then nothing may come nearer than that
stop
does, by more than 5 mm and as measured by the balls that cover the capsules: the arm brakes, and moving away stays
possible.
Where a new map has no information the arm follows the backup stop.

Guarantees: as CertifiedBrakingFilter for joint limits. In surroundings that do not change but for moving spheres on
their
known paths: the safety distance at every tick, between ticks and along every backup stop; torque limits in every tick
of
the run and of every backup stop, for the torque that a tick holds: M times its mean acceleration plus b. At the ends of a tick
M qdd + b is away from that by up to M jerk dt / 2 and what M and b change in the tick. A chain of filters that changes what this one decided takes these guarantees on
itself.
Real time: bounded work (ArmStopCheck::kMaxDistances and TorqueScan::kMaxTorques); no allocation, lock or throw after
configure(). */
class WholeArmBrakingFilter : public SafetyFilter {
public:
    WholeArmBrakingFilter();
    ~WholeArmBrakingFilter() override;

    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** The same without an experiment file. Throws Error (BadInput) as CertifiedBrakingFilter does, and without
    `recovery`
    for a start too near to something or with a stop that needs more torque than there is. */
    void configure(const RunSetup& setup, const WholeArmBrakingOptions& options,
                   const std::string& owner = "WholeArmBrakingOptions");

    void reset(const MotionState& start) override;
    FilterTraits traits() const override;
    bool changeLimits(const JointLimits& limits) override;
    void skipTicks(std::int64_t ticks) override;
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    void prepare(const RunSetup& setup, const WholeArmBrakingOptions& options, const std::string& place);
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
