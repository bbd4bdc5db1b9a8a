#pragma once

#include <cmath>

namespace viable::detail {

/** The extremes of one joint's position, velocity, acceleration and jerk along segments of constant jerk.

Method: position is a cubic in Bernstein form, velocity a quadratic. A curve lies between the smallest and the
largest of its control points; pieces whose control points pass the largest value found so far are halved until
they do not (de Casteljau). No root is ever computed.
Guarantees: an extreme is short of the true one by at most its resolution; where kMaxSplits halvings do not settle
it, it is the control points' and thus too large. No allocation, bounded work. */
class PathExtent {
public:
    struct Range {
        double lower, upper;
        void include(double x) {
            if (x < lower) lower = x;
            if (x > upper) upper = x;
        }
    };

    /** How well an extreme must be known. */
    struct Accuracy {
        double lower, upper;  ///< the values that matter: limits
        double inside;        ///< resolution of an extreme between them
        double outside;       ///< of one that may be beyond them
    };

    PathExtent(double p, double v, double a, const Accuracy& accuracyP, const Accuracy& accuracyV)
        : position{p, p},
          velocity{v, v},
          acceleration{a, a},
          p_(p),
          v_(v),
          a_(a),
          positionAccuracy_(accuracyP),
          velocityAccuracy_(accuracyV) {}

    /** On for `seconds` >= 0 with this jerk. */
    void follow(double jerk, double seconds);
    /** Jumps to this acceleration. */
    void setAcceleration(double a) {
        a_ = a;
        acceleration.include(a);
    }

    double p() const { return p_; }
    double v() const { return v_; }
    double a() const { return a_; }
    /** False when the path left the range of numbers. */
    bool isFinite() const { return std::isfinite(p_) && std::isfinite(v_) && std::isfinite(a_); }

    Range position, velocity, acceleration;

private:
    double p_, v_, a_;
    Accuracy positionAccuracy_, velocityAccuracy_;
};

}  // namespace viable::detail
