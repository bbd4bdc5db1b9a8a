#pragma once

#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** In what the change of the desired jerk is kept small (framework/MATH.md, section 8). */
enum class Objective : unsigned char {
    Torque,  ///< (13): the paper's
    Tool,    ///< jerk of the tool: spare joints take over from one that is held back
    Joint,   ///< jerk of the joints
    Path,    ///< all joints are held back alike, on the way from the backup stop's jerks to the desired ones
};

/** The gains of CertifiedBrakingFilter. */
struct CertifiedBrakingOptions {
    /** How fast a limit may be approached [1/s]: in (0, 1 / tick_s]; infinite: as fast as the limits allow. */
    double kAlpha = std::numeric_limits<double>::infinity();
    /** How fast the acceleration follows the desired one [1/s]: in (0, 2 / tick_s). */
    double gamma = 20.0;
    /** Accept a start outside the limits, or one that must leave them, and return within the limits. */
    bool recovery = false;
    Objective objective = Objective::Torque;

    template <class V>
    void describe(V& v) {
        v(kAlpha, "k_alpha", "1/s",
          "How fast a limit may be approached, and an obstacle before the arm steers away from it; k_alpha * tick_s "
          "must not "
          "exceed 1. Infinite: as fast as the limits allow.")
            .above(0)
            .orInfinite();
        v(gamma, "gamma", "1/s", "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
            .above(0);
        v(objective, "objective", "torque|tool|joint|path",
          "What is kept small of the change: torque (13), the tool's jerk, or the joints' jerks. With path, all joints "
          "are "
          "held back alike on the way to the desired jerks: one joint pressed against its limit then holds all.");
        v(recovery, "recovery",
          "Accept a start outside the limits, one that must leave them, or, before obstacles, one too near, and "
          "return within the limits.");
    }
};

/** Keeps position, velocity, acceleration and jerk limits in sampled time, always. It takes a jerk only if a stop
within the limits exists on the time grid after it. Otherwise the arm follows the backup stop. The law is
CertifiedBraking. This class has its parameters and the desired jerk (paper, eq. 14).

Guarantees: every limit, at every tick and between, for any input and any missed ticks. A desired jerk that is
admissible is taken bit for bit. With `recovery` also from starts that break a limit: nothing gets worse then, and the
limits hold from the moment they are met.
Real time: no allocation, lock or throw after configure(). */
class CertifiedBrakingFilter : public SafetyFilter {
public:
    CertifiedBrakingFilter();
    ~CertifiedBrakingFilter() override;

    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** The same without an experiment file. Throws Error (BadInput) for gains that the tick cannot carry or that are
    NaN, and for a jerk limit that is not finite. Without `recovery` it throws for a start that has no stop within the
    limits.
    @param owner  of the options, for messages */
    void configure(const RunSetup& setup, const CertifiedBrakingOptions& options,
                   const std::string& owner = "CertifiedBrakingOptions");

    void reset(const MotionState& start) override;
    FilterTraits traits() const override;
    bool changeLimits(const JointLimits& limits) override;
    void skipTicks(std::int64_t ticks) override;
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
