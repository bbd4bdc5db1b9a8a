#include <cmath>

#include "Joints.h"
#include "RobotFolder.h"
#include "viable/config/Settings.h"

namespace viable::test {
namespace {

JointLimits makeBase() {
    JointLimits base = JointLimits::unlimited(3);
    base.position.upper.setConstant(2.0);
    base.position.lower.setConstant(-2.0);
    return base;
}

struct Limits {
    JointLimits limits;
    bool allowsLargeAngles = false;

    template <class V>
    void describe(V& v) {
        limits.describe(v);
        v(allowsLargeAngles, "allow_large_angles", "Position limits beyond 4 pi are intended, not degrees.");
    }
};

JointLimits read(const std::string& text, bool* allowLargeAngles = nullptr) {
    Limits settings{makeBase(), allowLargeAngles && *allowLargeAngles};
    readSettings(parseConfig(text, "file.yaml"), settings, 3);
    if (allowLargeAngles) *allowLargeAngles = settings.allowsLargeAngles;
    return settings.limits;
}

std::string findFault(const std::string& text) {
    return catchError([&] { read(text); });
}

TEST(ReadLimits, TakesEveryForm) {
    const JointLimits limits = read(
        "velocity_radps: 3\nacceleration_radps2: [1, 2, 3]\n"
        "jerk_radps3: {lower: [-1, -2, -3], upper: 2*pi}\n"
        "position_rad: {center: [1, 0, -1], half_range: [0.5, 1, pi]}\n");
    EXPECT_EQ(limits.velocity.upper, joints(3, 3, 3));
    EXPECT_EQ(limits.velocity.lower, joints(-3, -3, -3));
    EXPECT_EQ(limits.acceleration.lower, joints(-1, -2, -3));
    EXPECT_EQ(limits.jerk.lower, joints(-1, -2, -3));
    EXPECT_NEAR(limits.jerk.upper[2], 2 * EIGEN_PI, 1e-15);
    EXPECT_EQ(limits.position.lower, joints(0.5, -1, -1 - EIGEN_PI));
    EXPECT_EQ(limits.position.upper, joints(1.5, 1, -1 + EIGEN_PI));
}

TEST(ReadLimits, KeepsWhatTheBlockDoesNotName) {
    const JointLimits limits = read("velocity_radps: .inf\n");
    EXPECT_EQ(limits.position.upper, joints(2, 2, 2));
    EXPECT_TRUE(std::isinf(limits.jerk.upper[0]));
    const JointLimits oneSided = read("position_rad: {lower: 0, upper: .inf}\n");
    EXPECT_EQ(oneSided.position.lower, joints(0, 0, 0));
    EXPECT_TRUE(std::isinf(oneSided.position.upper[0]));
    bool allow = false;
    read("allow_large_angles: true\n", &allow);
    EXPECT_TRUE(allow);
    read("velocity_radps: 1\n", &allow);
    EXPECT_TRUE(allow) << "stays as it was";
}

TEST(ReadLimits, RefusesOtherForms) {
    EXPECT_CONTAINS(findFault("velocity_radps: [1, 2]\n"), "file.yaml:1:17: velocity_radps");
    EXPECT_CONTAINS(findFault("velocity_radps: 0\n"), "(0, inf) or .inf");
    EXPECT_CONTAINS(findFault("jerk_radps3: {lower: 1, upper: 2}\n"), "jerk_radps3.lower");
    EXPECT_CONTAINS(findFault("jerk_radps3: {upper: 2}\n"), "`lower` is missing");
    EXPECT_CONTAINS(findFault("velocity_radps: {center: 0, half_range: 1}\n"), "velocity_radps");
    EXPECT_CONTAINS(findFault("position_rad: {center: 0}\n"), "`half_range` is missing");
    EXPECT_CONTAINS(findFault("position_rad: {center: 0, half_range: 1, lower: 0}\n"), "lower");
    EXPECT_CONTAINS(findFault("position_rad: {center: 0, half_range: -1}\n"), "half_range");
    EXPECT_CONTAINS(findFault("velocity_radp: 1\n"), "Did you mean");
    EXPECT_NE(findFault("velocity_radps: .nan\n"), "");
}

}  // namespace
}  // namespace viable::test
