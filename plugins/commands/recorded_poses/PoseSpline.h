#pragma once

#include "PoseRecording.h"

namespace viable {

/** A smooth motion through timed poses: pose and twist are continuous.

Method: between two samples the position is a cubic Hermite polynomial, the orientation a cubic
Bezier product of three rotations (Kim, Kim and Shin 1995, "A general construction scheme for unit
quaternion curves with simple high order derivatives"), written from the left so that velocities are
in the outer frame:
    q(u) = exp(b3(u) w3) exp(b2(u) w2) exp(b1(u) w1) q_i,
    b1 = 1 - (1-u)^3,  b2 = 3u^2 - 2u^3,  b3 = u^3,  w1 = h w_i / 3,  w3 = h w_{i+1} / 3,
    exp(w2) = exp(-w3) q_{i+1} q_i^-1 exp(-w1).
Velocities at the samples are those of the parabola through a sample and its two neighbours, with
uneven stamps. No chart of all rotations is involved, so full turns are no special case.
Real time: calc() does not allocate, lock or throw; O(log samples). */
class PoseSpline {
public:
    /** @param samples  at least two; stamps increase from 0, rotations from sample to sample are
    below pi */
    void fit(const std::vector<TimedPose>& samples);

    double duration() const { return duration_; }

    /** Pose and twist (linear, angular; outer frame) at `time` in 0 .. duration() [s]. */
    void calc(double time, Pose& pose, Vector6& twist) const;

private:
    struct Piece {
        double begin, length;            // [s]
        Eigen::Vector3d p0, p1, v0, v1;  // v: velocity * length [m]
        Eigen::Quaterniond q0;
        Eigen::Vector3d w1, w2, w3;  // [rad]
    };
    std::vector<Piece> pieces_;
    double duration_ = 0.0;
};

}  // namespace viable
