#pragma once

#include "environment/CollisionJudge.h"
#include "summary/Summary.h"

namespace viable::detail {

/** Judges the poses of a run's arms while it goes on, outside of the ticks: those of the rows and those half-way between
them. The latter are the middle of the cubic through both rows' positions and velocities: exact for the nominal arm,
whose motion in a tick is one. */
class CollisionCounter {
public:
    /** Throws Error (BadInput) for a map that cannot be read. @param geometry  must outlive this object */
    CollisionCounter(const RobotDescription& robot, const ArmGeometry& geometry, const Environment& environment,
                     bool hasRealArm);

    void add(const TickRecord& record);
    /** The state that the last tick led to; of the real arm no record holds it. */
    void addEnd(const MotionState& nominal, double time_s);

    const Collisions& collisions() const { return collisions_; }

private:
    /** One arm on its way through the run. */
    struct Way {
        JointState last;
        double time_s = 0.0;
        bool hasBegun = false;
        bool touches = false, isNear = false;  // since the last row
    };

    void follow(Way& way, CollisionRecord& record, const JointState& state, double time_s);
    void judge(Way& way, CollisionRecord& record, const JointVector& q, double time_s);

    const ArmGeometry& geometry_;
    std::vector<std::string> obstacles_;
    CollisionJudge judge_;
    Collisions collisions_;
    Way nominal_, real_;
};

}  // namespace viable::detail
