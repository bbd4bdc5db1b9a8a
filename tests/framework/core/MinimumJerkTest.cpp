#include "core/MinimumJerk.h"

#include <gtest/gtest.h>

namespace viable {
namespace {

TEST(MinimumJerk, RunsFromRestToRest) {
    for (double u : {-1.0, 0.0}) {
        EXPECT_EQ(calcMinimumJerk(u).value, 0.0);
        EXPECT_EQ(calcMinimumJerk(u).slope, 0.0);
    }
    for (double u : {1.0, 2.0}) {
        EXPECT_EQ(calcMinimumJerk(u).value, 1.0);
        EXPECT_EQ(calcMinimumJerk(u).slope, 0.0);
    }
    // Acceleration vanishes at the ends too: the slope leaves zero with the square of u.
    EXPECT_LT(calcMinimumJerk(1e-4).slope, 31e-8);
    EXPECT_LT(calcMinimumJerk(1.0 - 1e-4).slope, 31e-8);
    EXPECT_DOUBLE_EQ(calcMinimumJerk(0.5).value, 0.5);
    EXPECT_DOUBLE_EQ(calcMinimumJerk(0.5).slope, kMinimumJerkPeakSlope);
}

TEST(MinimumJerk, SlopeIsTheDerivativeAndPointSymmetric) {
    const double h = 1e-5;
    for (double u = 0.05; u < 0.96; u += 0.05) {
        const double difference = (calcMinimumJerk(u + h).value - calcMinimumJerk(u - h).value) / (2.0 * h);
        EXPECT_NEAR(calcMinimumJerk(u).slope, difference, 1e-8) << u;
        EXPECT_NEAR(calcMinimumJerk(u).value, 1.0 - calcMinimumJerk(1.0 - u).value, 1e-14) << u;
        EXPECT_LE(calcMinimumJerk(u).slope, kMinimumJerkPeakSlope);
    }
}

TEST(MinimumJerk, IntegralAgreesWithASum) {
    double sum = 0.0;
    const int n = 10000;
    for (int i = 0; i < n; ++i) {
        sum += calcMinimumJerk((i + 0.5) / n).value / n;
        if ((i + 1) % 1000 == 0) EXPECT_NEAR(calcMinimumJerkIntegral((i + 1.0) / n), sum, 1e-8) << i;
    }
    EXPECT_DOUBLE_EQ(calcMinimumJerkIntegral(1.0), 0.5);
}

}  // namespace
}  // namespace viable
