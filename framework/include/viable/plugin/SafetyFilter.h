#pragma once

#include <array>
#include <limits>

#include "viable/braking/GridStop.h"
#include "viable/plugin/Plugin.h"

namespace viable {

/** What a filter did to the desired torque. */
enum class FilterStatus : unsigned char {
    Passed,         ///< what the controller wants is admissible and is done as it is; apply
    Modified,       ///< changed to keep the limits; apply
    StoppedByPlan,  ///< a stored stop is being followed; apply
    Recovering,     ///< a limit cannot be met yet (recovery, or limits that have shrunk): it is approached as
                    ///< fast as jerk allows and nothing gets worse on the way; apply
    Infeasible,     ///< no admissible choice existed; the braking fallback is in the decision; apply
    InvalidInput,   ///< input of wrong size or not finite; decision not written, do not apply
    Faulted,        ///< the filter cannot go on; decision not written, do not apply
    /** The filter has no admissible choice left and ends the case here, as its user asked it to; decision not written, do not
    apply. The arm is braked; a result and no failure, unless the filter guarantees limits. */
    Ended,
};

/** "passed", "modified", ... as in logs. */
const char* getName(FilterStatus status);

/** Which limit holds one joint back. */
struct JointIntervention {
    LimitKind limit = LimitKind::None;
    LimitSide side = LimitSide::Neither;
};

/** How the nominal plant moves during the coming tick. */
enum class HeldQuantity : unsigned char {
    Jerk,          ///< `jerk` is held: acceleration is continuous (triple integrator)
    Acceleration,  ///< `acceleration` is held: acceleration jumps from tick to tick (double
                   ///< integrator)
};

/** The place where the arm, on its way through a tick and the stop after it, comes nearest to what it must not touch. */
struct Clearance {
    bool isKnown = false;                                       ///< false: nobody has looked
    double distance = std::numeric_limits<double>::infinity();  ///< [m]; negative: inside
    int link = -1;                                              ///< index into ArmGeometry::links
    int obstacle = -1;   ///< index into the Surroundings; -1: the arm itself, see otherLink
    int otherLink = -1;  ///< of the arm itself
    Eigen::Vector3d onArm = Eigen::Vector3d::Zero();  ///< nearest points, base frame [m]
    Eigen::Vector3d onObstacle = Eigen::Vector3d::Zero();
};

/** A filter's answer; vectors have one entry per joint. Fill it with holdJerk() or
 * holdAcceleration(). */
struct FilterDecision {
    HeldQuantity held = HeldQuantity::Jerk;
    JointVector torque;        ///< tau_c = M x_c + b, or tau_d itself where nothing was changed [Nm]
    JointVector acceleration;  ///< x_c: mean nominal acceleration over the tick [rad/s^2]
    JointVector jerk;          ///< nominal jerk over the tick [rad/s^3]
    std::array<JointIntervention, kMaxJoints> joints{};
    /** A stop of every joint from the state that this decision leads to: the proof that limits can be kept. A
    filter that holds jerks and guarantees limits gives it; without it (hasStops false) the host looks for one. */
    std::array<GridStop, kMaxJoints> stops{};
    bool hasStops = false;
    Clearance clearance;    ///< of a filter that keeps one
    double mapAge_s = 0.0;  ///< age of the surroundings that the filter went by
};

/** The decision to hold `jerk` for one tick: x_c = qdd + jerk dt / 2 and tau_c = M x_c + b.
Interventions are left as they are. */
void holdJerk(const MotionState& nominal, const Dynamics& dynamics, const JointVector& jerk, double tick_s,
              FilterDecision& decision);

/** The decision to hold `acceleration` for one tick: tau_c = M x_c + b; the jerk is the difference
quotient (acceleration - qdd) / dt. */
void holdAcceleration(const MotionState& nominal, const Dynamics& dynamics, const JointVector& acceleration,
                      double tick_s, FilterDecision& decision);

/** Changes the desired torque so that limits of the nominal arm hold. */
class SafetyFilter : public Plugin {
public:
    /** True when the filter guarantees every limit in every tick, from every start that configure()
    and reset() accepted. The host holds it to that word: a limit broken under a guarantee ends the
    run with exit code 3: a state from which no stop within the limits exists, or a limit passed. False for laws
    that merely try. */
    virtual bool guaranteesLimits() const = 0;

    /** True when that guarantee includes that the nominal arm touches nothing of RunSetup::surroundings, as long as they
    stay as they are but for known paths, nor itself. Valid after configure(). */
    virtual bool guaranteesClearance() const;

    /** True when configure() accepted to lead the arm back from a start outside the limits, or inside but
    without a stop that stays there; the host refuses such a start otherwise. Valid after configure(). */
    virtual bool recovers() const;

    /** New limits from the next filter() on; where ticks were missed, after skipTicks(). Complete and usable at the tick (see areUsable). True when the filter
    works by them from now on, approaching as fast as jerk allows what it cannot meet at once; false when it
    cannot change its limits, and the host then stops the arm. Real time, like filter(). */
    virtual bool changeLimits(const JointLimits& limits);

    /** Ticks passed without a call of filter(): the arm has followed the stops of the last decision (or, where
    it had none, the host's) for so many ticks; a tick in which filter() wrote no decision counts too.
    The next call continues from there. Real time. */
    virtual void skipTicks(std::int64_t ticks);

    /** One tick. `nominal` is the nominal arm's state and `dynamics` belongs to it; `torque` is
    tau_d, finite and of the right size. See FilterStatus for what the host does with `decision`. */
    virtual FilterStatus filter(const MotionState& nominal, const JointVector& torque, const Dynamics& dynamics,
                                FilterDecision& decision) = 0;
};

}  // namespace viable
