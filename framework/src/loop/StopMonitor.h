#pragma once

#include "viable/log/TickRecord.h"

namespace viable {

/** Share of a limit's size (see calcLimitScale) by which a path may pass the limit: ten times what rounding adds up to
under a certificate, and a tenth of the threshold for outside (see kOutsideShare), so that nothing the monitor lets pass is
reported as a limit broken. A stop's last velocity and acceleration may differ from zero by as much. Where a path goes far
beyond its limits, the share is of its extremes. */
inline constexpr double kMonitorShare = 1e-10;

/** Follows every decision of a safety filter, whatever filter it is, through its tick and through a stop after it,
and holds a stop ready that can replace the next decision.

The stop is the filter's own (supplied with the decision) where there is one, else the one that GridStop plans from the state
that the decision leads to. Where accelerations are held (without a guarantee), or no jerk limit is there to plan with,
it is: the acceleration limit against the velocity until the joint rests; its accelerations and jerks are not judged.
Its margins inside the limits are right to 1e-6 of the limit's size.
Method: independent of the filters' mathematics; position and velocity are bounded along the whole path by the
control points of their polynomials (see PathExtent).
Never worse: where the backup stop is itself beyond a limit (a recovering start, limits that have shrunk), its own
extreme takes the limit's place, per joint, quantity and side, and moves inwards tick by tick. A joint that stays there
for a second without coming nearer has no stop.
Real time: no allocation, lock or throw. */
class StopMonitor {
public:
    enum class Fault : unsigned char {
        None,
        Limit,      ///< a limit (or the extreme in its place) is passed by `excess`
        Stays,      ///< `excess` beyond a limit, recovering for long, and no nearer
        Moving,     ///< the stop ends with velocity or acceleration `excess`, not at rest
        Malformed,  ///< the stop holds what is NaN, or has no end
    };

    /** What is wrong; of several wrongs the tick's own jerk, else the largest, measured by the limit's range. */
    struct Violation {
        StopVerdict verdict = StopVerdict::Safe;
        Fault fault = Fault::None;
        int joint = 0;
        LimitKind limit = LimitKind::None;
        LimitSide side = LimitSide::Neither;
        double excess = 0.0;  ///< in the limit's unit
    };

    /** From now on with these limits, from this state.
    @param guaranteed  the filter guarantees all limits: acceleration and jerk are judged even where accelerations
                     are held, and a wrong supplied stop is not replaced
    @param recovers  the start may be outside the limits, or have a stop that is */
    void reset(const MotionState& start, const JointLimits& limits, double tick_s, bool guaranteed, bool recovers);

    /** New limits from this state on. */
    void changeLimits(const JointLimits& limits, const MotionState& nominal);

    /** Follows a finite decision of the right size from the state `nominal`. */
    const Violation& examine(const MotionState& nominal, const FilterDecision& decision);
    /** The stop found by the last examine() is now the backup stop. */
    void accept();

    /** Replaces a decision by the next tick of the backup stop. */
    const Violation& followStop(const MotionState& nominal, FilterDecision& decision);
    /** True when the backup stop, followed to here, has come to its end. */
    bool atRest(const MotionState& nominal) const;

    /** Where the backup stop leads from `nominal`, where it begins, within `after_s` >= 0: of stops that hold jerks. */
    void calcStop(const MotionState& nominal, double after_s, MotionState& state) const;

    /** Of the last examine() or followStop(). */
    const TickRecord::Stop& stop(int joint) const { return reports_[joint]; }

    /** "joint2 would pass its upper jerk limit by 3e+05 rad/s^3 ..." */
    void describe(const Violation& violation, const RobotDescription& robot, char* text, std::size_t size) const;

private:
    using Segments = std::array<GridStop::Segment, GridStop::kSegments>;
    /** A stop of every joint. */
    struct Plan {
        HeldQuantity held = HeldQuantity::Jerk;
        std::array<Segments, kMaxJoints> joints{};
    };
    enum Quantity { Position, Velocity, Acceleration, Jerk, kQuantities };
    /** Per quantity: the threshold for rounding. */
    using Tolerances = std::array<double, kQuantities>;
    struct Path;
    /** How near a recovering joint has come, and since when it is not nearer. */
    struct ReturnState {
        double excess = std::numeric_limits<double>::infinity();  ///< of all bounds, in tolerances
        double stop_s = std::numeric_limits<double>::infinity();
        double idle_s = 0.0;
    };

    void updateLimits(const JointLimits& limits);
    HeldQuantity getStopKind(HeldQuantity held) const;
    void planStop(const MotionState& from, HeldQuantity held);
    void planCarefully(const MotionState& from, int joint);
    void readSuppliedStops(const FilterDecision& decision);
    Path beginPath(double p, double v, double a, int joint) const;
    /** Follows a joint's stop; false when it is malformed. */
    bool followPlan(const Plan& plan, int joint, Path& path) const;
    void checkDecision(const MotionState& nominal, const FilterDecision& decision, const Plan& plan);
    void checkTickJerk(int joint, double jerk);
    void checkJoint(int joint, const Path& path, bool checksRates, bool checksRest);
    void keepViolation(Fault fault, int joint, LimitKind limit, LimitSide side, double excess, double tolerance);
    /** The extremes of the backup stop, from `from` on, as bounds where they are beyond the limits. */
    AxisLimits calcBounds(const MotionState& from, int joint) const;
    void loosenBounds(const MotionState& nominal, int joint, const AxisLimits& before);
    void tightenBounds();
    void watchReturn();

    int n_ = 0;
    double tick_s_ = 0.0;
    bool guaranteed_ = false, hasJerkLimits_ = false;
    std::array<AxisLimits, kMaxJoints> limits_{};
    std::array<AxisLimits, kMaxJoints> bounds_{};  // the limits, or the extremes in their place
    std::array<Tolerances, kMaxJoints> tolerances_{};
    Plan ready_, examined_;
    MotionState next_;                                         // where the decision leads to
    std::array<bool, kMaxJoints> isRecovering_{}, isLoose_{};  // loose: bounds_ is not limits_
    std::array<bool, kMaxJoints> fails_{};                     // in the last checkDecision()
    std::array<ReturnState, kMaxJoints> returns_{};
    std::array<TickRecord::Stop, kMaxJoints> reports_{};
    Violation violation_;
    double worst_ = 0.0;  // of violation_, in tolerances
};

}  // namespace viable
