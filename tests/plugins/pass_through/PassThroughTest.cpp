#include "PassThrough.h"

#include <Eigen/LU>

#include "LawBench.h"

namespace viable {
namespace {

class PassThroughTest : public ::testing::TestWithParam<const char*> {
protected:
    PassThroughTest() : arm_(GetParam()) { arm_.configure(filter_, PluginKind::SafetyFilter, "pass_through"); }

    TestArm arm_;
    PassThrough filter_;
    std::mt19937 random_{1};
};

TEST_P(PassThroughTest, TorqueIsLeftBitForBit) {
    for (int k = 0; k < 200; ++k) {
        const MotionState state = makeRandomState(arm_, 0.8, 2.0, 10.0, random_);
        const Dynamics dynamics = arm_.calcDynamics(state);
        const JointVector torque = makeRandomVector(arm_.size(), 300.0, random_);
        FilterDecision decision;
        ASSERT_EQ(filter_.filter({state, torque, dynamics}, decision), FilterStatus::Passed);
        EXPECT_EQ(calcTorque({state, torque, dynamics}, FilterStatus::Passed, decision), torque);
        EXPECT_EQ(decision.held, HeldQuantity::Acceleration);
        for (int i = 0; i < arm_.size(); ++i) EXPECT_EQ(decision.joints[i].limit, LimitKind::None);
    }
}

TEST_P(PassThroughTest, AccelerationIsThatOfTheTorque) {
    for (int k = 0; k < 200; ++k) {
        const MotionState state = makeRandomState(arm_, 0.8, 2.0, 10.0, random_);
        const Dynamics dynamics = arm_.calcDynamics(state);
        const JointVector torque = makeRandomVector(arm_.size(), 100.0, random_);
        FilterDecision decision;
        ASSERT_EQ(filter_.filter({state, torque, dynamics}, decision), FilterStatus::Passed);
        const Eigen::VectorXd expected =
            Eigen::MatrixXd(dynamics.M).fullPivLu().solve(Eigen::VectorXd(torque - dynamics.b));
        const double size = expected.lpNorm<Eigen::Infinity>();
        EXPECT_LE((decision.value - expected).lpNorm<Eigen::Infinity>(), 1e-10 * size);
        EXPECT_LE((calcJerk(decision, state.qdd, arm_.tick_s) - (expected - state.qdd) / arm_.tick_s)
                      .lpNorm<Eigen::Infinity>(),
                  1e-10 * size / arm_.tick_s);

        // And the nominal arm then moves with it.
        MotionState next = state;
        advanceNominal(decision, arm_.tick_s, next);
        EXPECT_EQ(next.qdd, decision.value);
    }
}

TEST_P(PassThroughTest, AccelerationAgreesWithSimbodysForwardDynamics) {
    arm_.robot.actuation.rotorInertia.setZero();  // Simbody's own route knows no rotors
    arm_.rebuildModel();
    for (int k = 0; k < 50; ++k) {
        const MotionState state = makeRandomState(arm_, 0.8, 2.0, 10.0, random_);
        const JointVector torque = makeRandomVector(arm_.size(), 50.0, random_);
        FilterDecision decision;
        ASSERT_EQ(filter_.filter({state, torque, arm_.calcDynamics(state)}, decision), FilterStatus::Passed);
        const JointVector expected = arm_.model().calcLinkForwardDynamics(state.q, state.qd, torque);
        EXPECT_LE((decision.value - expected).lpNorm<Eigen::Infinity>(),
                  1e-8 * (1.0 + expected.lpNorm<Eigen::Infinity>()));
    }
}

TEST_P(PassThroughTest, RefusesWhatIsNotFiniteOrOfTheWrongSize) {
    expectNoTraceOfBadInput(arm_, [&] { return &filter_; });
}

TEST_P(PassThroughTest, Fault29HugeTorqueNeverBecomesAnInfiniteAcceleration) {
    Dynamics dynamics = arm_.calcDynamics(arm_.start);
    dynamics.M *= 1e-3;
    for (const double size : {1e300, std::numeric_limits<double>::max()}) {
        FilterDecision decision;
        const FilterStatus status =
            filter_.filter({arm_.start, JointVector::Constant(arm_.size(), size), dynamics}, decision);
        EXPECT_EQ(status, FilterStatus::Passed);
        EXPECT_TRUE(decision.value.allFinite());
        EXPECT_LE(decision.value.cwiseAbs().maxCoeff(), kLargestAcceleration);
    }
}

TEST(PassThrough, LoadsAsALibrary) {
    expectSameAsLibrary<PassThrough>("pass_through");
}

INSTANTIATE_TEST_SUITE_P(Robots, PassThroughTest, ::testing::Values("single_joint", "indy7"));

}  // namespace
}  // namespace viable
