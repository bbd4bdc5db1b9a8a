
#include "WholeArm.h"
#include "viable/environment/People.h"

namespace viable {
namespace {

/** An arm that is asked to swing, beside whoever a feed tells of. */
class SwingingArm : public FilteredWholeArm {
public:
    SwingingArm() : FilteredWholeArm(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7")) {
        RunSetup setup{robot, robot.limits, kTick_s, 10.0, state, dynamics.tool, &geometry};
        setup.people = &feed;
        filter.configure(setup, WholeArmBrakingOptions());
    }

    /** Half a second, in each tick of which `seen` is put. @return the fastest that a joint was [rad/s] */
    double swing(const PeopleObservation* seen) {
        double fastest = 0.0;
        for (int k = 0; k < 500; ++k, ++tick_) {
            if (seen) {
                PeopleObservation now = *seen;
                for (PersonObservation& one : now.people) one.stamp_s = kTick_s * tick_;
                feed.put(now);
            }
            EXPECT_LE(push(JointVector::Constant(6, 2.0 * std::sin(0.004 * tick_))), FilterStatus::Infeasible);
            fastest = std::max(fastest, state.qd.cwiseAbs().maxCoeff());
        }
        return fastest;
    }

    PeopleFeed feed{std::vector<Person>(2)};

private:
    int tick_ = 0;
};

PersonObservation seeBall(double x, double radius) {
    PersonObservation seen;
    seen.kind = PersonObservation::Kind::Seen;
    seen.count = 1;
    seen.capsules[0] = {Eigen::Vector3d(x, 0.0, 0.5), Eigen::Vector3d(x, 0.0, 0.5), radius};
    return seen;
}

TEST(Fault89, TheArmRestsUntilSomebodyTellsOfPeople) {
    SwingingArm arm;
    EXPECT_EQ(arm.swing(nullptr), 0.0);
    EXPECT_FALSE(arm.decision.reports[LimitKind::Separation].isKept) << "nobody knows";
    EXPECT_EQ(arm.decision.joints[0].limit, LimitKind::Separation);
    const PeopleObservation nobody;
    EXPECT_GT(arm.swing(&nobody), 0.1);
    EXPECT_TRUE(arm.decision.reports[LimitKind::Separation].isKept);
}

TEST(Fault89, TheArmRestsWhileSomebodyUnknownCannotBeToldOf) {
    for (const bool hasStranger : {false, true}) {
        SwingingArm arm;
        PeopleObservation refused;
        refused.people[0] = seeBall(20.0, kNan);
        refused.people[1] = seeBall(20.0, 0.1);
        if (hasStranger) refused.people[5] = seeBall(20.0, kNan);  // nobody of that index
        EXPECT_EQ(arm.swing(&refused), 0.0) << hasStranger;
        EXPECT_GT(arm.decision.peopleFaults.refused, 400);
        PeopleObservation seen = refused;
        seen.people[0] = seeBall(20.0, 0.1);
        seen.people[5] = {};
        EXPECT_GT(arm.swing(&seen), 0.1) << hasStranger;
        EXPECT_TRUE(arm.decision.reports[LimitKind::Separation].isKept);
    }
}

TEST(Fault89, OfTwoWhoCannotBeToldOfEachCounts) {
    SwingingArm arm;
    PeopleObservation seen;
    seen.people[0] = seen.people[1] = seeBall(20.0, kNan);
    EXPECT_EQ(arm.swing(&seen), 0.0);
    seen.people[1] = seeBall(20.0, 0.1);
    EXPECT_EQ(arm.swing(&seen), 0.0) << "the first one is still nowhere";
    seen.people[0].kind = PersonObservation::Kind::Gone;
    EXPECT_GT(arm.swing(&seen), 0.1);
}

}  // namespace
}  // namespace viable
