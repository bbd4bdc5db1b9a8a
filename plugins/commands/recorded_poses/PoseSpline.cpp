#include "PoseSpline.h"

#include <algorithm>

#include "core/RotationVector.h"
#include "viable/core/Error.h"

namespace viable {

void PoseSpline::fit(const std::vector<TimedPose>& samples) {
    VIABLE_CHECK(samples.size() >= 2, "a motion needs two poses");
    const std::size_t n = samples.size();
    // Mean velocity of each piece, then the velocity at each sample.
    std::vector<Vector6> mean(n - 1), at(n);
    for (std::size_t i = 0; i + 1 < n; ++i) {
        const double h = samples[i + 1].time_s - samples[i].time_s;
        mean[i].head<3>() = (samples[i + 1].position - samples[i].position) / h;
        mean[i].tail<3>() = calcRotationVector(samples[i + 1].orientation * samples[i].orientation.conjugate()) / h;
    }
    at.front() = mean.front();
    at.back() = mean.back();
    for (std::size_t i = 1; i + 1 < n; ++i) {
        const double before = samples[i].time_s - samples[i - 1].time_s;
        const double after = samples[i + 1].time_s - samples[i].time_s;
        at[i] = (after * mean[i - 1] + before * mean[i]) / (before + after);
    }

    pieces_.resize(n - 1);
    for (std::size_t i = 0; i + 1 < n; ++i) {
        const TimedPose& a = samples[i];
        const TimedPose& b = samples[i + 1];
        Piece& piece = pieces_[i];
        piece.begin = a.time_s;
        piece.length = b.time_s - a.time_s;
        piece.p0 = a.position;
        piece.p1 = b.position;
        piece.v0 = piece.length * at[i].head<3>();
        piece.v1 = piece.length * at[i + 1].head<3>();
        piece.q0 = a.orientation;
        piece.w1 = piece.length / 3.0 * at[i].tail<3>();
        piece.w3 = piece.length / 3.0 * at[i + 1].tail<3>();
        piece.w2 = calcRotationVector(calcRotation(-piece.w3) * b.orientation * a.orientation.conjugate() *
                                      calcRotation(-piece.w1));
    }
    duration_ = samples.back().time_s;
}

void PoseSpline::calc(double time, Pose& pose, Vector6& twist) const {
    const auto next =
        std::upper_bound(pieces_.begin(), pieces_.end(), time, [](double t, const Piece& p) { return t < p.begin; });
    const Piece& piece = next == pieces_.begin() ? *next : *(next - 1);
    const double u = std::clamp((time - piece.begin) / piece.length, 0.0, 1.0);
    const double u2 = u * u, u3 = u2 * u;

    pose.position = piece.p0 + (3.0 * u2 - 2.0 * u3) * (piece.p1 - piece.p0) + (u - 2.0 * u2 + u3) * piece.v0 +
                    (u3 - u2) * piece.v1;
    twist.head<3>() = (6.0 * (u - u2) * (piece.p1 - piece.p0) + (1.0 - 4.0 * u + 3.0 * u2) * piece.v0 +
                       (3.0 * u2 - 2.0 * u) * piece.v1) /
                      piece.length;

    const double b1 = u * (3.0 - u * (3.0 - u)), b1Rate = 3.0 * (1.0 - u) * (1.0 - u);
    const double b2 = u2 * (3.0 - 2.0 * u), b2Rate = 6.0 * (u - u2);
    const double b3 = u3, b3Rate = 3.0 * u2;
    const Eigen::Quaterniond e1 = calcRotation(b1 * piece.w1);
    const Eigen::Quaterniond e2 = calcRotation(b2 * piece.w2);
    const Eigen::Quaterniond e3 = calcRotation(b3 * piece.w3);
    pose.orientation = e3 * (e2 * (e1 * piece.q0));
    // Each factor turns about its own fixed vector; the factors to its left carry that along.
    const Eigen::Vector3d inner = b2Rate * piece.w2 + e2 * Eigen::Vector3d(b1Rate * piece.w1);
    twist.tail<3>() = (b3Rate * piece.w3 + e3 * inner) / piece.length;
}

}  // namespace viable
