#pragma once

#include "braking/CertifiedBraking.h"
#include "clearance/StopDemands.h"
#include "filter/WholeArmBrakingFilter.h"

namespace viable::detail {

/** Chooses the jerk of a tick for the arm as a whole, on top of what its joints admit each: the stops after it, run together,
must pass ArmStopCheck. Else it steers (see SteeringRows), beside whose rows the objective `torque` weighs each joint by its own
inertia; or it draws back towards the backup stop, which did pass: all joints alike, then those that are in the way alone.

Real time after construction. */
class WholeArmChoice {
public:
    /** @param braking  of the joints, configured; must outlive this
        @param limited  see SpeedCheck and PeopleCheck; must outlive this
    Takes setup.surroundings and setup.people, which its maker has claimed, until its end. */
    WholeArmChoice(const RunSetup& setup, const WholeArmBrakingOptions& options, const TorqueScan::Limits& limits,
                   CertifiedBraking& braking, const ArmGeometry* limited);
    ~WholeArmChoice();
    WholeArmChoice(const WholeArmChoice&) = delete;
    WholeArmChoice& operator=(const WholeArmChoice&) = delete;

    /** The braking was reset to the same state; it has begun a tick then. */
    void reset(const MotionState& start);
    void skipTicks(std::int64_t ticks);

    /** What is chosen in a tick: admitted by every joint, and committed.
    @param metric   what the change is measured in; null: on the path from the backup stops' jerks
    @param desired  [rad/s^3]
    @param jerk     to be held
    @param joints   what holds each joint back */
    FilterStatus choose(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
                        const JointVector& desired, JointVector& jerk,
                        std::array<JointIntervention, kMaxJoints>& joints);
    /** After choose(). @param decision  to hold its jerk */
    void endTick(const FilterInput& input, const FilterDecision& decision);

    /** Of the limits of the whole arm. */
    LimitSet guarantees() const;
    /** What the stop that was chosen keeps. */
    void report(FilterDecision& decision) const;

    /** Throws Error (BadInput) where the stop from the start, just reset to, comes too near to something (all of it in one
    list) or needs more torque than there is (with joint, share and pose). */
    void checkStart(const RunSetup& setup, const std::string& place) const;

private:
    using Stops = std::array<GridStop, kMaxJoints>;

    double time() const { return static_cast<double>(tick_) * tick_s_; }
    bool isStale() const { return feed_ && !(time() - view_.stamp_s <= options_.maxAge_s); }
    void updateSurroundings();
    bool updatePeople();
    void tellPeople(const PeopleCheck::Result& found);
    void tellStored();
    void findStops(const JointVector& jerk);
    void setStoredPath(const MotionState& state);
    void examineStored(const MotionState& state);
    std::pair<std::string, std::string> nameNearest(int element, const ArmGeometry& geometry) const;
    std::string listTooNear(const ArmGeometry& geometry) const;
    std::string describeExactly(const RunSetup& setup) const;
    void setPath(const MotionState& state, const JointVector& jerk);
    bool isPathGood(bool wantsRows);
    bool isGood(const MotionState& state, const JointVector& jerk, bool wantsRows);
    void keepBest(const JointVector& jerk);
    const JointMatrix* chooseMetric(const Dynamics& dynamics, const JointMatrix* metric);
    bool foresee(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
                 const JointVector& desired);
    void updateEasing(const MotionState& nominal);
    void goOneByOne(const MotionState& nominal, const JointVector& desired);
    void steer(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
               const JointVector& desired, bool hasRows);

    const WholeArmBrakingOptions options_;
    const double tick_s_;
    SurroundingsFeed* const feed_;
    PeopleFeed* const people_;
    PeopleWatch watch_;
    CertifiedBraking& braking_;
    ArmStopCheck check_;
    SurroundingsFeed::View view_;
    bool isNew_ = true;  ///< the backup stop has not been looked at, or not in these surroundings
    std::int64_t tick_ = 0;

    StopDemands demands_;
    const JointMatrix identity_;
    JointMatrix ownInertia_;  ///< diagonal
    ArmStopCheck::Result stored_, best_, trial_, other_;
    ArmPath path_, storedPath_;
    /** The path that the arm is on since it was chosen or examined anew, and how far; stored_ is of it. */
    ArmPath keptPath_;
    std::int64_t ticksOnPath_ = 0;
    /** What was tried first in this tick, where all of it is known. */
    ArmPath otherPath_;
    bool hasOther_ = false;
    Stops stops_, bestStops_;
    RowQp::Rows rows_;
    JointVector lastTorque_, storedJerk_, proposed_, steered_, bestJerk_;
    bool hasBest_ = false;
    JointVector still_radps_;            ///< below, a joint is still
    std::int64_t still_ = 0, wait_ = 0;  ///< ticks
    bool isEasing_ = false;              ///< see StopDemands::ease
    LimitReports reports_;
    LimitReport& ofPeople_;  ///< of them
    const ArmGeometry* const limited_;
};

}  // namespace viable::detail
