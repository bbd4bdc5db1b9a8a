#pragma once

#include <vector>

#include "summary/Summary.h"
#include "viable/environment/People.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** Judges how a run's arms kept apart from people while it goes on, outside of the ticks: in the rows and half-way between them,
there by the cubic through both rows' positions and velocities; people as they truly walk. Shares no arithmetic with the filters:
the chain of transforms of the robot's description, speeds at both ends of a capsule, and of two segments the distance that is
least of their ends' and of their lines'. */
class SeparationCounter {
public:
    SeparationCounter(RobotDescription robot, const ArmGeometry& geometry, std::vector<Person> people, bool hasRealArm);

    /** Allocates nothing. */
    void add(const TickRecord& record);
    /** The state that the last tick led to; of the real arm no record holds it. */
    void addEnd(const MotionState& nominal, double time_s);

    const Separations& separations() const { return separations_; }

    /** What an arm in one state does to people in one place each. */
    struct Found {
        bool touches = false, isTooFast = false, isGuilty = false;
        double fastestTouch = 0.0;
        double protective = std::numeric_limits<double>::infinity();
        int part = -1, person = -1;  ///< of the contact that is too fast, or else of `protective`
    };
    /** @param places  of each person's capsules, base frame; Unseen ones are nowhere
        @param rest    slower points rest [m/s] */
    Found find(const JointVector& q, const JointVector& qd, const PeopleObservation& places, double rest) const;

private:
    struct Way {
        JointState last;
        double time_s = 0.0, rest = 0.0;
        bool hasBegun = false, hasGap = false;
        bool touches = false, isTooFast = false, isGuilty = false;  // since the last row
    };

    void follow(Way& way, SeparationRecord& record, const JointState& state, double time_s);
    void judge(Way& way, SeparationRecord& record, const JointVector& q, const JointVector& qd, double time_s);

    RobotDescription robot_;
    std::vector<LinkCapsule> capsules_;
    std::vector<std::string> names_;  ///< of the capsules' links
    std::vector<Person> people_;
    std::vector<char> isExcused_;  ///< at the time that is looked at: what happens then is not the arm's fault
    PeopleObservation places_;
    Separations separations_;
    Way nominal_, real_;
    double lastTime_s_ = 0.0;
};

}  // namespace viable::detail
