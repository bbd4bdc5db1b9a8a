#include "braking/CertifiedBraking.h"

#include "Joints.h"
#include "TestArm.h"

namespace viable::test {
namespace {

using Status = FilterStatus;

constexpr double kTick_s = 1e-3;
/** What counts as rounding beyond a limit, of size 1 to 40 here. */
constexpr double kAllowed = 1e-11;

/** Three joints: V < A^2/J, V > A^2/J, and limits that differ by side. */
JointLimits makeLimits() {
    return {{joints(-1.0, -0.4, -0.3), joints(1.0, 0.4, 0.7)},
            {joints(-2.0, -2.5, -0.8), joints(2.0, 2.5, 1.2)},
            {joints(-12.0, -4.0, -5.0), joints(12.0, 4.0, 9.0)},
            {joints(-38.0, -40.0, -30.0), joints(38.0, 40.0, 20.0)}};
}

JointMatrix makeInertia() {
    JointMatrix M(3, 3);
    M << 3.0, 1.2, 0.3, 1.2, 1.0, 0.2, 0.3, 0.2, 0.1;
    return M;
}

/** An arm of three joints under the law. */
struct Arm {
    JointLimits limits = makeLimits();
    JointMatrix M = makeInertia();
    CertifiedBraking braking;
    MotionState state;
    FilterDecision decision;  ///< the law's choice
    std::array<JointIntervention, kMaxJoints> acting;
    LimitExcess excess;

    explicit Arm(double approach = 1.0) {
        state.q = joints(0.0, 0.1, 0.2);
        state.qd.setZero(3);
        state.qdd.setZero(3);
        decision.value.setZero(3);
        braking.configure(limits, kTick_s, approach);
        braking.reset(state);
    }

    /** One tick, and what it led to at its quarters. */
    Status tick(const JointVector& desired) {
        const Status status = braking.choose(state, &M, desired, decision.value, acting);
        move();
        return status;
    }

    /** The arm follows the law's stops without asking. */
    void miss(int ticks) {
        std::array<GridStop, 3> stops;
        for (int i = 0; i < 3; ++i) stops[i] = braking.stop(i);
        for (int k = 0; k < ticks; ++k) {
            for (int i = 0; i < 3; ++i) decision.value[i] = stops[i].popJerk();
            move();
        }
        braking.skipTicks(ticks);
    }

    double getWorst() const { return std::max({excess.position, excess.velocity, excess.acceleration, excess.jerk}); }

private:
    void move() {
        for (int i = 1; i <= 4; ++i) {
            MotionState within = state;
            advanceNominal(decision, kTick_s * i / 4.0, within);
            excess.observe(decision.value, within, limits);
        }
        advanceNominal(decision, kTick_s, state);
    }
};

TEST(CertifiedBraking, WhatAllJointsAdmitIsTakenBitForBit) {
    Arm arm;
    // Sines of 0.1 rad around the start.
    const JointVector w = joints(3.0, 5.0, 4.0);
    arm.state.qd = 0.1 * w;
    arm.braking.reset(arm.state);
    for (int k = 0; k < 5000; ++k) {
        JointVector desired(3);
        for (int i = 0; i < 3; ++i) desired[i] = -0.1 * std::pow(w[i], 3) * std::cos(w[i] * (k + 0.5) * kTick_s);
        ASSERT_EQ(arm.tick(desired), Status::Passed) << "tick " << k;
        ASSERT_EQ(arm.decision.value, desired);
        for (int i = 0; i < 3; ++i) ASSERT_EQ(arm.acting[i].limit, LimitKind::None);
    }
}

TEST(CertifiedBraking, SaysWhichLimitHoldsEachJointBack) {
    Arm arm;
    ASSERT_EQ(arm.tick(joints(1e4, -1e4, 0.0)), Status::Modified);
    EXPECT_EQ(arm.acting[0].limit, LimitKind::Jerk);
    EXPECT_EQ(arm.acting[0].side, LimitSide::Upper);
    EXPECT_EQ(arm.acting[1].limit, LimitKind::Jerk);
    EXPECT_EQ(arm.acting[1].side, LimitSide::Lower);
    arm.M = JointMatrix::Identity(3, 3);
    for (int k = 0; k < 3000; ++k) arm.tick(joints(1e4, -1e4, 0.0));
    EXPECT_EQ(arm.acting[0].limit, LimitKind::Position);
    EXPECT_EQ(arm.acting[0].side, LimitSide::Upper);
    EXPECT_EQ(arm.acting[1].limit, LimitKind::Position);
    EXPECT_EQ(arm.acting[1].side, LimitSide::Lower);
    EXPECT_EQ(arm.acting[2].limit, LimitKind::None);
}

TEST(Fault25, SkippedTicksRunTheStoredStopsAndThenOperationResumes) {
    const unsigned seed = 25;
    SCOPED_TRACE("seed " + std::to_string(seed));
    for (const int missed : {1, 5, 20, 1000}) {
        std::mt19937 random(seed);
        PushingCommand push(3, 200.0, true, seed);
        Arm arm;
        int gaps = 0, moved = 0;
        for (int k = 0; k < 30000; ++k) {
            if (std::uniform_int_distribution<int>(0, 99)(random) == 0) {
                arm.miss(missed);
                ++gaps;
                if (missed == 1000) ASSERT_LE(arm.state.qd.norm() + arm.state.qdd.norm(), 1e-10);
            }
            ASSERT_NE(arm.tick(push.next()), Status::Recovering) << missed << " missed, tick " << k;
            moved += arm.decision.value.norm() > 1.0;
        }
        EXPECT_LE(arm.getWorst(), kAllowed) << missed << " missed";
        EXPECT_GT(gaps, 200);
        EXPECT_GT(moved, 3000);  // it did go on
    }
}

// What a law does that holds the last jerk instead: the test above must be able to see it.
TEST(Fault25, HoldingTheLastJerkInsteadWouldBreakTheLimits) {
    PushingCommand push(3, 200.0, true, 25);
    Arm arm;
    for (int k = 0; k < 3000; ++k) {
        arm.tick(push.next());
        if (k % 100 == 99)
            for (int i = 0; i < 20; ++i) {
                advanceNominal(arm.decision, kTick_s, arm.state);
                arm.excess.observe(arm.decision.value, arm.state, arm.limits);
            }
    }
    EXPECT_GT(arm.getWorst(), 1e-3);
}

TEST(Fault33, AllJointsOnTheirLimitsByAHairStillChoose) {
    for (const double hair : {-1e-12, 0.0, 1e-12})
        for (const double side : {1.0, -1.0}) {
            Arm arm;
            const JointVector shift = JointVector::Constant(3, hair);
            arm.state.q = (side > 0 ? arm.limits.position.upper : arm.limits.position.lower) + shift;
            arm.state.qd = JointVector::Constant(3, hair);
            arm.state.qdd = -shift;
            arm.braking.reset(arm.state);
            for (int k = 0; k < 2000; ++k) {
                arm.tick(JointVector::Constant(3, side * (k / 500 % 2 ? -1e3 : 1e3)));
                ASSERT_TRUE(arm.decision.value.allFinite());
            }
            EXPECT_LE(arm.getWorst(), kAllowed);
        }
}

/** Inertia that no arm has: nearly singular, singular, zero, of absurd size. */
std::vector<JointMatrix> makeBadInertias() {
    JointMatrix nearlySingular = makeInertia(), singular = makeInertia();
    nearlySingular.row(2) = nearlySingular.row(1) * (1.0 + 1e-13);
    singular.row(2) = singular.row(1);
    return {nearlySingular,          singular,
            JointMatrix::Zero(3, 3), 1e150 * makeInertia(),
            1e-150 * makeInertia(),  JointMatrix::Constant(3, 3, kNan)};
}

TEST(Fault34, AMatrixThatTheSolverCannotUseLeavesACheckedChoice) {
    for (const JointMatrix& bad : makeBadInertias()) {
        Arm arm;
        arm.M = bad;
        PushingCommand push(3, 300.0, false, 34);
        for (int k = 0; k < 5000; ++k) {
            ASSERT_NE(arm.tick(push.next()), Status::Recovering) << bad;
            ASSERT_TRUE(arm.decision.value.allFinite()) << bad;
        }
        EXPECT_LE(arm.getWorst(), kAllowed) << bad;
    }
}

TEST(Fault35, AfterAFailedSolveTheNextTickIsRight) {
    const JointVector push = joints(300.0, -5.0, 4.0);
    for (const JointMatrix& bad : makeBadInertias()) {
        Arm failed, good;
        failed.M = bad;
        failed.tick(-push);
        good.tick(-push);
        failed.M = makeInertia();
        // At another state both plan anew, so that only what the solver remembers differs.
        const MotionState elsewhere{joints(0.3, -0.2, 0.1), joints(0.5, 0.3, -0.1), joints(1.0, -0.5, 0.2)};
        failed.state = good.state = elsewhere;
        EXPECT_EQ(failed.tick(push), Status::Modified);
        good.tick(push);
        for (int i = 0; i < 3; ++i) EXPECT_NEAR(failed.decision.value[i], good.decision.value[i], 1e-9) << bad;
    }
}

}  // namespace
}  // namespace viable::test
