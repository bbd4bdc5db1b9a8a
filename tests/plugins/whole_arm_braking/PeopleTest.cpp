#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "Paths.h"
#include "filter/WholeArmBrakingFilter.h"
#include "viable/environment/People.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

/** An arm that is asked to swing, beside whoever a feed tells of. */
class SwingingArm {
public:
    SwingingArm() {
        state_ = {robot_.home, JointVector::Zero(6), JointVector::Zero(6)};
        model_.calcDynamics(state_.q, state_.qd, dynamics_);
        RunSetup setup{robot_, robot_.limits, kTick_s, 10.0, state_, dynamics_.tool, &geometry_};
        setup.people = &feed;
        filter_.configure(setup, WholeArmBrakingOptions());
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
            model_.calcDynamics(state_.q, state_.qd, dynamics_);
            const JointVector wanted = JointVector::Constant(6, 2.0 * std::sin(0.004 * tick_));
            const JointVector torque = dynamics_.M * wanted + dynamics_.b;
            filter_.filter({state_, torque, dynamics_}, decision);
            advanceNominal(decision, kTick_s, state_);
            fastest = std::max(fastest, state_.qd.cwiseAbs().maxCoeff());
        }
        return fastest;
    }

    PeopleFeed feed{std::vector<Person>(2)};
    FilterDecision decision;

private:
    static constexpr double kTick_s = 1e-3;
    const RobotDescription robot_ = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry geometry_ = loadArmGeometry(robot_);
    RobotModel model_{robot_};
    WholeArmBrakingFilter filter_;
    MotionState state_;
    Dynamics dynamics_;
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
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
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
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
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
