#include "core/RotationVector.h"

#include <cmath>

namespace viable {

// Below this angle [rad] the quotients lose more digits to cancellation than their series do to
// truncation (after three terms: t^6 / 362880 < 1e-14).
constexpr double kSeriesAngle = 0.03;

Eigen::Quaterniond calcRotation(const Eigen::Vector3d& r) {
    const double t2 = r.squaredNorm();
    const double t = std::sqrt(t2);
    const double sinHalfByT = t < kSeriesAngle ? 0.5 - t2 / 48.0 + t2 * t2 / 3840.0 : std::sin(0.5 * t) / t;
    Eigen::Quaterniond q;
    q.w() = std::cos(0.5 * t);
    q.vec() = sinHalfByT * r;
    return q;
}

Eigen::Vector3d calcRotationVector(const Eigen::Quaterniond& q) {
    const double s = q.vec().norm();
    const double w = std::abs(q.w());
    const double sign = q.w() < 0.0 ? -1.0 : 1.0;
    // atan2(s, w) = s/w - s^3/(3 w^3) + ... ; the series would need w = 1, so divide only where the
    // quotient is defined.
    return sign * (s > 0.0 ? 2.0 * std::atan2(s, w) / s : 2.0) * q.vec();
}

Eigen::Vector3d calcAngularVelocity(const Eigen::Vector3d& r, const Eigen::Vector3d& rRate) {
    const double t2 = r.squaredNorm();
    const double t = std::sqrt(t2);
    double first, second;
    if (t < kSeriesAngle) {
        first = 0.5 - t2 / 24.0 + t2 * t2 / 720.0;
        second = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0;
    } else {
        const double sinHalf = std::sin(0.5 * t);
        first = 2.0 * sinHalf * sinHalf / t2;
        second = (t - std::sin(t)) / (t2 * t);
    }
    const Eigen::Vector3d cross = r.cross(rRate);
    return rRate + first * cross + second * r.cross(cross);
}

}  // namespace viable
