#include "core/RotationVector.h"

#include <gtest/gtest.h>

#include <random>

namespace viable {
namespace {

Eigen::Vector3d drawDirection(std::mt19937& random) {
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    Eigen::Vector3d v;
    do v = {unit(random), unit(random), unit(random)};
    while (v.norm() > 1.0 || v.norm() < 0.1);
    return v.normalized();
}

const double kAngles[] = {0.0, 1e-12, 1e-8, 1e-4, 0.0299, 0.03, 0.0301, 0.3, 1.0, 2.0, 3.0, 3.14};

TEST(RotationVector, AgreesWithAngleAxisAndComesBack) {
    std::mt19937 random(1);
    for (int trial = 0; trial < 100; ++trial)
        for (double angle : kAngles) {
            const Eigen::Vector3d axis = drawDirection(random);
            const Eigen::Quaterniond q = calcRotation(angle * axis);
            const Eigen::Quaterniond reference(Eigen::AngleAxisd(angle, axis));
            EXPECT_LE((q.coeffs() - reference.coeffs()).norm(), 1e-15) << angle;
            EXPECT_LE((calcRotationVector(q) - angle * axis).norm(), 1e-15 + 2e-15 * angle);
            // q and -q are the same rotation.
            const Eigen::Quaterniond opposite(-q.coeffs());
            EXPECT_LE((calcRotationVector(opposite) - angle * axis).norm(), 1e-15 + 2e-15 * angle);
        }
}

TEST(RotationVector, TakesTheShortWayBeyondAHalfTurn) {
    const Eigen::Vector3d axis = Eigen::Vector3d(1.0, 2.0, -2.0) / 3.0;
    EXPECT_LE((calcRotationVector(calcRotation(4.0 * axis)) - (4.0 - 2.0 * kPi) * axis).norm(), 1e-14);
    EXPECT_EQ(calcRotationVector(Eigen::Quaterniond::Identity()), Eigen::Vector3d::Zero());
    EXPECT_EQ(calcRotation(Eigen::Vector3d::Zero()).coeffs(), Eigen::Quaterniond::Identity().coeffs());
}

TEST(RotationVector, AngularVelocityIsTheDerivativeOfTheRotation) {
    std::mt19937 random(2);
    const double h = 1e-6;
    for (int trial = 0; trial < 100; ++trial)
        for (double angle : kAngles) {
            const Eigen::Vector3d r = angle * drawDirection(random), rate = 2.0 * drawDirection(random);
            const Eigen::Vector3d difference =
                calcRotationVector(calcRotation(r + h * rate) * calcRotation(r - h * rate).conjugate()) / (2.0 * h);
            EXPECT_LE((calcAngularVelocity(r, rate) - difference).norm(), 2e-9) << angle;
        }
}

TEST(RotationVector, AngularVelocityHasNoStepWhereTheSeriesTakesOver) {
    const Eigen::Vector3d axis = Eigen::Vector3d(2.0, -1.0, 2.0) / 3.0;
    const Eigen::Vector3d rate(0.3, 2.0, -1.0);
    const Eigen::Vector3d below = calcAngularVelocity(0.03 * (1.0 - 1e-15) * axis, rate);
    EXPECT_LE((calcAngularVelocity(0.03 * (1.0 + 1e-15) * axis, rate) - below).norm(), 1e-14);
}

}  // namespace
}  // namespace viable
