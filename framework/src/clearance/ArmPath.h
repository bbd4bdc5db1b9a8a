#pragma once

#include "viable/braking/GridStop.h"

namespace viable::detail {

/** The way of all joints together through a tick and the stops after it, for looks at any time. Time 0 is the beginning of
the tick; after its own stop a joint rests. Real time. */
class ArmPath {
public:
    /** @param stops  of every joint, from the end of the tick on */
    void set(const MotionState& start, const JointVector& jerk, const std::array<GridStop, kMaxJoints>& stops,
             double tick_s);

    double duration() const { return duration_; }  ///< until the last joint rests [s]
    std::int64_t ticks() const { return ticks_; }  ///< the same, the first tick included

    /** From when on a joint rests [s]. */
    double calcRestTime(int joint) const;

    /** Time in [0, duration()]. */
    double calcPosition(int joint, double t) const { return calcState(joint, t).p; }
    void calcPositions(double t, JointVector& q) const;
    double calcAcceleration(int joint, double t) const { return calcState(joint, t).a; }  ///< [rad/s^2]
    /** Positions and velocities. */
    void calcMotion(double t, JointVector& q, JointVector& qd) const;

    /** State at the beginning of a tick, and the mean acceleration in it: what the torque of that tick is made of.
    @param tick  in [0, ticks()]; from ticks() on all joints rest */
    void calcTick(std::int64_t tick, JointVector& q, JointVector& qd, JointVector& meanQdd) const;

    /** Positions, and how far each joint has moved until then, to and fro added up [rad]: the integral of |qd|. */
    void calcPositions(double t, JointVector& q, JointVector& travel) const;

    /** Largest |position|, |qd|, |qdd| and |jerk| along the path, and all its travel. */
    struct Extremes {
        JointVector position, velocity, acceleration, jerk, travel;
    };
    void calcExtremes(Extremes& extremes) const;

    /** How far apart two paths are: per joint, the largest difference at one time, of positions, of qd and of qdd. */
    struct Difference {
        JointVector position, velocity, acceleration;
    };
    /** Upper bounds from the beginning of this path on, hardly larger than the differences.
    @param other  of the same arm and tick; what was before its tick `begin` does not count */
    void calcDifference(const ArmPath& other, std::int64_t begin, Difference& difference) const;

private:
    /** A segment, with the state and the travel that it begins with. */
    struct Piece {
        double begin_s = 0.0, jerk = 0.0, travel = 0.0;
        std::int64_t beginTick = 0;
        AxisState state;
    };
    /** A joint's segments: the tick, its stop, and rest. */
    struct Joint {
        int count = 0;
        std::array<Piece, GridStop::kSegments + 2> pieces;
        const Piece& find(double t) const;
        int findTick(std::int64_t tick) const;
    };
    AxisState calcState(int joint, double t) const;
    static double calcPieceTravel(const AxisState& s, double jerk, double t, const AxisState& end);

    int n_ = 0;
    double tick_s_ = 0.0, duration_ = 0.0;
    std::int64_t ticks_ = 0;
    std::array<Joint, kMaxJoints> joints_;
};

}  // namespace viable::detail
