#pragma once

#include "braking/CertifiedBraking.h"
#include "viable/braking/DesiredJerk.h"
#include "viable/filter/CertifiedBrakingFilter.h"

namespace viable::detail {

/** What CertifiedBrakingFilter and WholeArmBrakingFilter have in common: gains and their checks, the desired jerk
(paper, eq. 14), the certified stop of each joint. Real time after configure(). */
class JointBraking {
public:
    /** As CertifiedBrakingFilter's. @param parameters  where `options` were written */
    void configure(const RunSetup& setup, const CertifiedBrakingOptions& options, const Parameters& parameters);
    void configure(const RunSetup& setup, const CertifiedBrakingOptions& options, const std::string& owner);

    void reset(const MotionState& start);
    bool recovers() const { return recovery_; }
    bool changeLimits(const JointLimits& limits);
    void skipTicks(std::int64_t ticks);

    CertifiedBraking& braking() { return braking_; }

    /** Before anything is chosen in a tick: Passed, and desired() is known; else what filter() answers. */
    FilterStatus findDesired(const FilterInput& input);
    const JointVector& desired() const { return desired_; }  ///< [rad/s^3]
    /** What the change of the desired jerk is measured in; null: on the path. */
    const JointMatrix* findMetric(const Dynamics& dynamics);
    /** The decision to hold a jerk that was committed. */
    void decide(const JointVector& jerk, FilterDecision& decision) const;

private:
    struct Wording;
    void configure(const RunSetup& setup, const CertifiedBrakingOptions& options, const Wording& wording);
    void checkStart(const RunSetup& setup, const Wording& wording) const;

    int n_ = 0;
    double tick_s_ = 0.0;
    bool recovery_ = false;
    Objective objective_ = Objective::Torque;
    double leverArm_m_ = 1.0;
    JointMatrix metric_;
    DesiredJerk desiredJerk_;
    CertifiedBraking braking_;
    JointVector desiredAcceleration_, desired_;
};

}  // namespace viable::detail
