#pragma once

#include "viable/environment/People.h"
#include "viable/limits/ArmLimit.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** That nobody is touched by a point of the arm that is too fast for it; people as they truly walk. Shares no arithmetic
with the filters: the chain of transforms of the robot's description, speeds at both ends of a capsule, and of two segments
the distance that is least of their ends' and of their lines'. */
class SeparationLimit : public ArmLimit {
public:
    SeparationLimit(RobotDescription robot, const ArmGeometry& geometry, std::vector<Person> people);

    LimitSample sample(const ArmSample& arm) override;
    /** Whom the arm may touch while it moves, and at which speed [m/s]. */
    std::vector<std::pair<std::string, double>> allowances() const override;
    const char* otherName(int index) const override;

    /** What an arm in one state does to people in one place each. */
    struct Sample {
        bool touches = false, isTooFast = false, isViolation = false;
        double fastestTouch = 0.0;
        double protective = std::numeric_limits<double>::infinity();
        int part = -1, person = -1;  ///< of the contact that is too fast, or else of `protective`
    };
    /** @param places  of each person's capsules, base frame; Unseen ones are nowhere
        @param rest    slower points rest [m/s] */
    Sample find(const JointVector& q, const JointVector& qd, const PeopleObservation& places, double rest) const;

private:
    RobotDescription robot_;
    std::vector<LinkCapsule> capsules_;
    std::vector<std::string> names_;  ///< of the capsules' links
    std::vector<Person> people_;
    std::vector<char> isExcused_;  ///< at the time that is looked at: what happens then is not the arm's fault
    PeopleObservation places_;
};

}  // namespace viable::detail
