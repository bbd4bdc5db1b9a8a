#include "viable/core/JointLimits.h"

#include "Complaint.h"

namespace viable::test {
namespace {

const std::vector<std::string> kNames = {"shoulder", "elbow", "wrist"};

JointBounds makeBounds(double size) {
    return {JointVector::Constant(3, -size), JointVector::Constant(3, size)};
}

/** The paper's limits (30) for three joints. */
JointLimits makeLimits() {
    return {makeBounds(kPi), makeBounds(2 * kPi / 3), makeBounds(4 * kPi), makeBounds(12 * kPi)};
}

std::string refuse(const JointLimits& limits, double tick_s = 1e-3, bool allowLargeAngles = false) {
    return catchError([&] { checkLimits(limits, tick_s, allowLargeAngles, "f.yaml:3:9: limits", kNames); });
}

struct Group {
    const char* name;
    JointBounds JointLimits::*bounds;
};
const Group kRates[] = {
    {"velocity", &JointLimits::velocity}, {"acceleration", &JointLimits::acceleration}, {"jerk", &JointLimits::jerk}};

TEST(JointLimits, Names) {
    EXPECT_STREQ(getName(LimitKind::None, LimitSide::Neither), "none");
    EXPECT_STREQ(getName(LimitKind::None, LimitSide::Upper), "none");
    EXPECT_STREQ(getName(LimitKind::Position, LimitSide::Lower), "position_lower");
    EXPECT_STREQ(getName(LimitKind::Velocity, LimitSide::Upper), "velocity_upper");
    EXPECT_STREQ(getName(LimitKind::Acceleration, LimitSide::Lower), "acceleration_lower");
    EXPECT_STREQ(getName(LimitKind::Jerk, LimitSide::Upper), "jerk_upper");
    EXPECT_STREQ(getName(LimitKind::Jerk, LimitSide::Neither), "jerk");
}

TEST(JointLimits, AxisTakesBothSidesOfOneJoint) {
    JointLimits limits = JointLimits::unlimited(3);
    double number = 1.0;
    for (JointBounds* bounds : {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk}) {
        bounds->lower[1] = -number++;
        bounds->upper[1] = number++;
    }
    const AxisLimits axis = limits.axis(1);
    EXPECT_EQ(axis.positionLower, -1.0);
    EXPECT_EQ(axis.positionUpper, 2.0);
    EXPECT_EQ(axis.velocityLower, -3.0);
    EXPECT_EQ(axis.velocityUpper, 4.0);
    EXPECT_EQ(axis.accelerationLower, -5.0);
    EXPECT_EQ(axis.accelerationUpper, 6.0);
    EXPECT_EQ(axis.jerkLower, -7.0);
    EXPECT_EQ(axis.jerkUpper, 8.0);
    EXPECT_EQ(limits.axis(0).jerkUpper, kInfinity);
    EXPECT_EQ(limits.axis(2).positionLower, -kInfinity);
    EXPECT_EQ(limits.size(), 3);
    EXPECT_EQ(JointLimits::unlimited(0).size(), 0);
    EXPECT_EQ(JointLimits::unlimited(kMaxJoints).size(), kMaxJoints);
}

TEST(JointLimits, UsableLimitsPass) {
    EXPECT_NO_THROW(checkLimits(makeLimits(), 1e-3, false, "f", kNames));
    EXPECT_NO_THROW(checkLimits(JointLimits::unlimited(3), 1e-3, false, "f", kNames));
    JointLimits limits = makeLimits();
    limits.position.lower[0] = 0.0;  // one-sided ranges are fine
    limits.jerk.upper[1] = kInfinity;
    limits.velocity.lower[2] = -kInfinity;
    limits.acceleration.upper[2] = 20.0;  // each side has its own
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", kNames));
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", {}));
}

TEST(JointLimits, Fault05_SizesMustAgree) {
    JointLimits limits = makeLimits();
    limits.jerk.upper = JointVector::Constant(2, 1.0);
    expectContains(refuse(limits),
                   {"f.yaml:3:9: limits", "jerk_upper has 2 numbers; allowed is 3", "one number per joint"});
    limits = makeLimits();
    limits.position.upper = JointVector::Constant(4, 1.0);
    expectContains(refuse(limits), {"position_upper has 4 numbers; allowed is 3"});
}

TEST(JointLimits, Fault05_DegreesNeedTheFlag) {
    JointLimits limits = makeLimits();
    limits.position.upper[1] = 170.0;
    expectContains(refuse(limits), {"f.yaml:3:9: limits: joint `elbow`: position_upper is 170 rad",
                                    "allowed is [-12.566370614359172, 12.566370614359172]", "`170*pi/180`",
                                    "`allow_large_angles: true`"});
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, true, "f", kNames));
    limits = makeLimits();
    limits.position.lower[2] = -13.0;
    expectContains(refuse(limits), {"joint `wrist`: position_lower is -13 rad"});
    limits.position.lower[2] = -kLargestAngle_rad;
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", kNames));
    limits.position.lower[2] = -kInfinity;  // a continuous joint
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", kNames));
}

TEST(JointLimits, Fault06_EveryRateLimitOfEveryJointAndSide) {
    const double nan = std::nan("");
    const double bad[] = {0.0, -0.0, -1.0, 4.9e-324, 1e-7, 1.1e7, 1e12, nan, -kInfinity};
    for (const Group& group : kRates)
        for (int joint = 0; joint < 3; ++joint)
            for (const double value : bad) {
                SCOPED_TRACE(std::string(group.name) + " " + std::to_string(value));
                const std::string name = "joint `" + kNames[static_cast<std::size_t>(joint)] + "`: " + group.name;
                JointLimits limits = makeLimits();
                (limits.*group.bounds).upper[joint] = value;
                expectContains(refuse(limits), {"f.yaml:3:9: limits: " + name + "_upper is ",
                                                "allowed is [1e-06, 1e+07] or .inf", "positive"});
                limits = makeLimits();
                (limits.*group.bounds).lower[joint] = -value;
                expectContains(refuse(limits), {"f.yaml:3:9: limits: " + name + "_lower is ",
                                                "allowed is [-1e+07, -1e-06] or -.inf", "negative"});
            }
    JointLimits limits = makeLimits();
    limits.velocity.upper[0] = 1e12;
    expectContains(refuse(limits), {"velocity_upper is 1e+12 rad/s;", "unit and exponent"});
}

TEST(JointLimits, Fault06_PositionInvertedEqualOrNonsense) {
    for (int joint = 0; joint < 3; ++joint) {
        const std::string name = "joint `" + kNames[static_cast<std::size_t>(joint)] + "`: ";
        JointLimits limits = makeLimits();
        std::swap(limits.position.lower[joint], limits.position.upper[joint]);
        expectContains(refuse(limits), {name, "position_lower is 3.141592653589793 rad",
                                        "position_upper is -3.141592653589793 rad", "allowed is lower < upper"});
        limits = makeLimits();
        limits.position.lower[joint] = limits.position.upper[joint] = 1.0;
        expectContains(refuse(limits), {name, "allowed is lower < upper"});
        for (const double value : {std::nan(""), 1e12, -kInfinity, 4.9e-324}) {
            SCOPED_TRACE(value);
            limits = makeLimits();
            limits.position.upper[joint] = value;
            expectContains(refuse(limits, 1e-3, true), {name + "position_upper is ", "allowed is"});
            limits = makeLimits();
            limits.position.lower[joint] = -value;
            expectContains(refuse(limits, 1e-3, true), {name + "position_lower is ", "allowed is"});
        }
    }
}

TEST(JointLimits, Fault06_RatioWindows) {
    JointLimits limits = makeLimits();
    limits.acceleration = makeBounds(1e-3);
    limits.jerk = makeBounds(9.9e6);
    limits.velocity = makeBounds(1e-3);
    // A/J is 1.01e-10 s: shorter than any tick can resolve.
    expectContains(refuse(limits, 1e-12), {"joint `shoulder`: acceleration_lower -0.001 divided by jerk_lower -9900000",
                                           "1.0101", "s; allowed is [1e-06, 10000] s"});
    limits = makeLimits();
    limits.acceleration.upper[1] = 5e6;
    limits.jerk.upper[1] = 1.0;
    expectContains(refuse(limits), {"joint `elbow`: acceleration_upper 5e+06 divided by jerk_upper", "is 5e+06 s"});
    limits = makeLimits();
    limits.velocity.lower[2] = -1e6;
    limits.acceleration.lower[2] = -0.1;
    expectContains(refuse(limits),
                   {"joint `wrist`: velocity_lower -1e+06 divided by acceleration_lower -0.1", "is 1e+07 s"});
    limits.velocity.lower[2] = -999.0;  // 9990 s: inside
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", kNames));
}

TEST(JointLimits, Fault07_AccelerationBelowOneTickOfJerk) {
    JointLimits limits = makeLimits();
    // A / J = 1/3 s for the paper's limits: that tick just fits, a longer one does not.
    limits.position = JointLimits::unlimited(3).position;
    EXPECT_NO_THROW(checkLimits(limits, 0.333, false, "f", kNames));
    expectContains(refuse(limits, 0.34),
                   {"joint `shoulder`: acceleration_lower is -12.566370614359172 rad/s^2",
                    "allowed is at least 12.81769802664635", "one tick of 0.34 s", "shorten the tick"});
    limits = makeLimits();
    limits.acceleration.upper[1] = 0.03;  // jerk 37.7 * 1e-3 s = 0.0377
    expectContains(refuse(limits), {"joint `elbow`: acceleration_upper is 0.03 rad/s^2"});
    // The larger jerk of the other side counts: it ends this side's acceleration.
    limits = makeLimits();
    limits.jerk.lower[2] = -1e5;
    limits.acceleration.lower[2] = -1e3;
    expectContains(refuse(limits), {"joint `wrist`: acceleration_upper is 12.566370614359172", "at least 100 "});
}

TEST(JointLimits, Fault07_PositionRangeBelowOneStop) {
    JointLimits limits = makeLimits();
    limits.jerk = makeBounds(1000.0);
    const double stop = 8.0 * 1000.0 * 1e-9;  // 8 J dt^3
    limits.position.lower[1] = 0.5;
    limits.position.upper[1] = 0.5 + 1.01 * stop;
    EXPECT_NO_THROW(checkLimits(limits, 1e-3, false, "f", kNames));
    limits.position.upper[1] = 0.5 + 0.99 * stop;
    expectContains(refuse(limits), {"joint `elbow`: position_lower 0.5 rad to position_upper", "is a range of",
                                    "allowed is at least", "Widen"});
}

TEST(JointLimits, Fault08_TickOfNoUse) {
    for (const double tick : {0.0, -1e-3, std::nan(""), kInfinity}) {
        SCOPED_TRACE(tick);
        expectContains(refuse(makeLimits(), tick), {"the tick is", "allowed is (0, inf)"});
    }
}

bool isAccepted(const JointLimits& limits, double tick_s) {
    try {
        checkLimits(limits, tick_s, true, "here", kNames);
        return true;
    } catch (const Error&) {
        return false;
    }
}

TEST(JointLimits, AreUsableSaysWhatCheckLimitsSays) {
    const double values[] = {0.0, 1e-320, 1e-7, 1e-6, 1e-3, 1.0, 12 * kPi, 1e7, 1e8, -1.0, kInfinity, kNan};
    int accepted = 0, refused = 0;
    for (JointBounds JointLimits::*bounds :
         {&JointLimits::position, &JointLimits::velocity, &JointLimits::acceleration, &JointLimits::jerk})
        for (JointVector JointBounds::*side : {&JointBounds::lower, &JointBounds::upper})
            for (double value : values)
                for (double tick_s : {1e-3, 0.1, 1.0, 0.0}) {
                    JointLimits limits = makeLimits();
                    (limits.*bounds.*side)[1] = side == &JointBounds::lower ? -value : value;
                    const bool expected = isAccepted(limits, tick_s);
                    ++(expected ? accepted : refused);
                    EXPECT_EQ(areUsable(limits, 3, tick_s), expected) << value << " at " << tick_s;
                }
    EXPECT_GT(accepted, 30);
    EXPECT_GT(refused, 100);
    EXPECT_FALSE(areUsable(makeLimits(), 2, 1e-3));
    JointLimits limits = makeLimits();
    limits.jerk.lower.conservativeResize(2);
    EXPECT_FALSE(areUsable(limits, 3, 1e-3));
    EXPECT_TRUE(areUsable(JointLimits::unlimited(3), 3, 1e-3));
}

}  // namespace
}  // namespace viable::test
