#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "viable/braking/GridStop.h"
#include "viable/core/FilterStatus.h"
#include "viable/plugin/Plugin.h"

namespace viable {

/** How the nominal plant moves during the coming tick. */
enum class HeldQuantity : unsigned char {
    Jerk,          ///< acceleration is continuous (triple integrator)
    Acceleration,  ///< acceleration jumps from tick to tick (double integrator)
};

/** The place where the arm, on its way through a tick and the stop after it, comes nearest to what it must not touch.
*/
struct Clearance {
    bool isKnown = false;                                       ///< false: nobody has looked
    double distance = std::numeric_limits<double>::infinity();  ///< [m]; negative: inside
    int link = -1;                                              ///< index into ArmGeometry::links
    int obstacle = -1;   ///< index into the Surroundings; -1: the arm itself, see otherLink
    int otherLink = -1;  ///< of the arm itself
    Eigen::Vector3d onArm = Eigen::Vector3d::Zero();  ///< nearest points, base frame [m]
    Eigen::Vector3d onObstacle = Eigen::Vector3d::Zero();
};

/** The speed of the arm's points that uses the largest share of its limit, on the way through a tick and the stop after it. */
struct ArmSpeed {
    bool isKnown = false;                                    ///< false: nobody has looked
    double speed = 0.0;                                      ///< no point of that part is faster at any time [m/s]
    double limit = std::numeric_limits<double>::infinity();  ///< of it there [m/s]
    int link = -1;                                           ///< index into ArmGeometry::links; -1: the tool frame
};

/** What was wrong with what was seen of people, so far; each is answered by braking, as far as it matters. */
struct PeopleFaults {
    std::int64_t appeared = 0;  ///< people who were not known of before
    std::int64_t faster = 0;    ///< observations farther away from the one before than the person can have come
    std::int64_t lost = 0;      ///< times that someone who was seen was not any more
    std::int64_t refused = 0;   ///< observations that could not be used
    int last = -1;              ///< whose fault was the last one: index into PeopleFeed::people()
};

/** How far the arm, on the way through a tick and the stop after it, keeps from where people may be by then. */
struct Separation {
    bool isKnown = false;  ///< false: nobody has looked
    /** Nobody can be touched by what is too fast for it. False: people came nearer than they could have, and the arm
    brakes. */
    bool isKept = true;
    double margin = std::numeric_limits<double>::infinity();  ///< lower bound, when the stop was chosen [m]
    int link = -1, person = -1;  ///< of it: index into ArmGeometry::links, PeopleFeed::people()
    double age_s = 0.0;          ///< of the oldest observation that counts
    PeopleFaults faults;
};

/** What a filter is given in a tick. The host sees to it that all of it is finite and of the right size. */
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

/** The acceleration that a filter which holds accelerations should reach by the end of the tick: M^-1 (tau_d - b), and
what it changes by in a tick where that is known. False where M is not positive definite. No allocation. */
bool calcDesiredAcceleration(const FilterInput& input, double tick_s, JointVector& qdd);

/** A filter's answer: one quantity, held over the coming tick. What torque, mean acceleration and jerk that makes is for
the host to compute (see calcHeldMotion). */
struct FilterDecision {
    HeldQuantity held = HeldQuantity::Jerk;
    JointVector value;  ///< of the held quantity, one entry per joint [rad/s^3 or rad/s^2]
    std::array<JointIntervention, kMaxJoints> joints{};
    /** A stop of every joint from the state that this decision leads to: the proof that limits can be kept. A
    filter that holds jerks and guarantees limits gives it; without it (hasStops false) the host looks for one. */
    std::array<GridStop, kMaxJoints> stops{};
    bool hasStops = false;
    Clearance clearance;    ///< of a filter that keeps one
    double mapAge_s = 0.0;  ///< age of the surroundings that the filter went by
    ArmSpeed speed;         ///< of a filter that keeps speed limits
    Separation separation;  ///< of a filter that keeps apart from people

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

/** What a decision makes of a tick; vectors have one entry per joint. */
struct HeldMotion {
    JointVector jerk;          ///< the one held, or (acceleration - qdd) / dt [rad/s^3]
    JointVector acceleration;  ///< x_c: the one held, or its mean qdd + jerk dt / 2 [rad/s^2]
    JointVector torque;        ///< tau_c = M x_c + b [Nm]
};

/** The motion that the value of `decision` gives. Where an acceleration is held, `status` is Passed and the torque is
tau_d but for rounding, it is tau_d to the last bit. No allocation, no throw. */
void calcHeldMotion(const FilterInput& input, FilterStatus status, const FilterDecision& decision, double tick_s,
                    HeldMotion& motion);

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

    /** True when that guarantee includes RobotDescription::speedLimits for the nominal arm. Valid after configure(). */
    virtual bool guaranteesSpeed() const;

    /** True when that guarantee includes that nobody of RunSetup::people is touched by a point of the nominal arm that is
    faster than the person's contact speed, as long as observations are what Person says of them. Valid after configure(). */
    virtual bool guaranteesSeparation() const;

    /** True when configure() accepted to recover from a start outside the limits, or inside but
    without a stop that stays there; the host refuses such a start otherwise. Valid after configure(). */
    virtual bool recovers() const;

    /** New limits from the next filter() on; where ticks were missed, after skipTicks(). Complete and usable at the tick
    (see areUsable). True when the filter works by them from now on, approaching as fast as jerk allows what it cannot
    meet at once; false when it cannot change its limits, and the host then stops the arm. Real time, like filter(). */
    virtual bool changeLimits(const JointLimits& limits);

    /** Ticks passed without a call of filter(): the arm has followed the stops of the last decision (or, where
    it had none, the host's) for so many ticks; a tick in which filter() wrote no decision counts too.
    The next call continues from there. Real time. */
    virtual void skipTicks(std::int64_t ticks);

    /** One tick. See FilterStatus for what the host does with `decision`. */
    virtual FilterStatus filter(const FilterInput& input, FilterDecision& decision) = 0;
};

}  // namespace viable
