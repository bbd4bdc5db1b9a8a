#pragma once

#include "viable/braking/GridStop.h"
#include "viable/core/FilterStatus.h"
#include "viable/limits/ArmLimit.h"
#include "viable/plugin/Plugin.h"

namespace viable {

/** How the nominal plant moves during the coming tick. */
enum class HeldQuantity : unsigned char {
    Jerk,          ///< acceleration is continuous (triple integrator)
    Acceleration,  ///< acceleration jumps from tick to tick (double integrator)
};

/** Input of a filter in a tick. The host sees to it that all of it is finite and of the right size. */
struct FilterInput {
    const MotionState& nominal;  ///< the nominal arm's state
    const JointVector& torque;   ///< tau_d [Nm]
    const Dynamics& dynamics;    ///< there
    /** d/dt of the desired acceleration M^-1 (tau_d - b) [rad/s^3], for (14); null: not known, and a difference
    quotient takes its place. */
    const JointVector* accelerationRate = nullptr;
};

/** True when every part is finite and sized for n joints. */
bool isFinite(const FilterInput& input, int n);

/** The acceleration that a filter which holds accelerations should reach by the end of the tick. It is M^-1 (tau_d -
b), plus its change in a tick where that is known. False where M is not positive definite. No allocation. */
bool calcDesiredAcceleration(const FilterInput& input, double tick_s, JointVector& qdd);

/** A filter's answer: one quantity, held over the coming tick. The host computes torque, mean acceleration and jerk
from it (see calcHeldMotion). */
struct FilterDecision {
    HeldQuantity held = HeldQuantity::Jerk;
    JointVector value;  ///< the held quantity, one entry per joint [rad/s^3 or rad/s^2]
    std::array<JointIntervention, kMaxJoints> joints{};
    /** A stop of every joint from the state that this decision leads to: the proof that limits can be kept. A
    filter that holds jerks and guarantees limits gives it; without it (hasStops false) the host looks for one. */
    std::array<GridStop, kMaxJoints> stops{};
    bool hasStops = false;
    LimitReports reports;       ///< on the limits of the whole arm that the filter keeps
    PeopleFaults peopleFaults;  ///< counted by a filter that keeps apart from people

    /** Clears all that a filter need not write in every tick. */
    void clearReports() {
        hasStops = false;
        reports = {};
        peopleFaults = {};
    }
    // All else is left as it is.
    void holdJerk(const JointVector& jerk) {
        held = HeldQuantity::Jerk;
        value = jerk;
    }
    void holdAcceleration(const JointVector& acceleration) {
        held = HeldQuantity::Acceleration;
        value = acceleration;
    }
};

/** The motion of a tick under a decision; vectors have one entry per joint. */
struct HeldMotion {
    JointVector jerk;          ///< the one held, or (acceleration - qdd) / dt [rad/s^3]
    JointVector acceleration;  ///< x_c: the one held, or its mean qdd + jerk dt / 2 [rad/s^2]
    JointVector torque;        ///< tau_c = M x_c + b [Nm]
};

/** The motion that the value of `decision` gives. If an acceleration is held, `status` is Passed and the torque is
tau_d but for rounding, it is tau_d to the last bit. No allocation, no throw. */
void calcHeldMotion(const FilterInput& input, FilterStatus status, const FilterDecision& decision, double tick_s,
                    HeldMotion& motion);

/** The host asks a filter for these once, after configure(). */
struct FilterTraits {
    /** The limits that the nominal arm keeps in every tick, from every start that configure() and reset() accepted. The
    host holds the filter to that word: a limit broken under a guarantee ends the run with exit code 3. So does a state
    from which no stop within the limits exists. The limits of the joints come together (LimitSet::joints()). An empty
    set is that of a law that merely tries. Clearance holds for surroundings that stay as they are but for known paths,
    and for the arm itself. Limits from people hold as long as observations are what Person says of them. */
    LimitSet guarantees;
    /** configure() accepted to recover from a start outside the limits, or inside but without a stop that stays there.
    The host refuses such a start otherwise. */
    bool recovers = false;
};

/** Changes the desired torque so that limits of the nominal arm hold. */
class SafetyFilter : public Plugin {
public:
    using Traits = FilterTraits;
    virtual FilterTraits traits() const = 0;

    /** New limits from the next filter() on; where ticks were missed, after skipTicks(). Complete and usable at the
    tick (see areUsable). True when the filter uses them from now on. It approaches limits that it cannot meet at
    once as fast as jerk allows. False when it cannot change its limits; the host then stops the arm. Real time, like
    filter(). */
    virtual bool changeLimits(const JointLimits& limits);

    /** Ticks passed without a call of filter(). The arm has followed the stops of the last decision for so many
    ticks, or the host's if it had none. A tick in which filter() wrote no decision counts too. The next call
    continues from there. Real time. */
    virtual void skipTicks(std::int64_t ticks);

    /** One tick. See FilterStatus for what the host does with `decision`. */
    virtual FilterStatus filter(const FilterInput& input, FilterDecision& decision) = 0;
};

}  // namespace viable
