#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/smoothing/BandedLdl.h"
#include "analysis/smoothing/Readings.h"
#include "analysis/smoothing/Smoothing.h"
#include "analysis/smoothing/SplinePiece.h"

namespace viable::detail {

/** Window over the distance of the knots. More: pieces resolve what is smoothed away anyhow, and the system's condition
grows with its eighth power; less: the pieces are too stiff. */
inline constexpr double kKnotsPerWindow = 1.3;

/** How rough the motion is along the record: the density of its jerk's steps over that of the whole record. */
struct Roughness {
    struct Part {
        double begin_s;
        std::size_t first;  ///< of its factors, step_s each
    };
    double step_s = 0.0;
    std::vector<Part> parts;      ///< ascending; a segment each
    std::vector<double> factors;  ///< empty: 1 throughout

    double at(double time_s) const;
};

/** The most likely motion for one distance of the knots.

Model: jerk is a random walk whose steps have density q; readings are y = p + e, e of variance sigma^2 g. Its expected
motion is the smoothing spline that penalises the integral of p''''^2 (Wahba 1978; Kohn and Ansley 1987). Unknowns:
(p, v D, a D^2, j D^3) at knots D apart. sigma^2 and q = sigma^2 / (rho D^7) from the restricted likelihood. */
class SplineFit {
public:
    /** Knots of one segment without a long gap. */
    struct Segment {
        double begin_s, end_s;
        std::size_t firstReading, endReading;
        std::size_t firstKnot, endKnot;
    };

    /** @param storage  of another fit that is no longer needed (releaseStorage()) */
    SplineFit(const Readings& readings, double knotStep_s, const Roughness& roughness,
              std::vector<double> storage = {});
    std::vector<double> releaseStorage() { return system_.releaseStorage(); }

    /** Minus twice the logarithm of the restricted likelihood, but for a constant. */
    double objective() const { return objective_; }
    bool ok() const { return isSolved_; }
    double variance() const { return variance_; }  ///< sigma^2
    double step_s() const { return step_s_; }
    const std::vector<Segment>& segments() const { return segments_; }
    double knotTime(const Segment& s, std::size_t k) const {
        return s.begin_s + step_s_ * static_cast<double>(k - s.firstKnot);
    }

    /** Solves once more for what rounding has left, and makes the deviations known. */
    void finish();

    /** After finish(): expectation of each reading, and its variance over sigma^2. */
    template <class Take>
    void forEachReading(const Take& take) const {
        const SplinePiece& piece = getPiece();
        for (const Segment& s : segments_) {
            std::size_t pair = s.firstKnot;
            Matrix8 covariance = calcPairCovariance(pair);
            for (std::size_t i = s.firstReading; i < s.endReading; ++i) {
                const auto [k, u] = place(s, readings_.times_s[i]);
                if (k != pair) covariance = calcPairCovariance(pair = k);
                const Vector8 h = piece.calcRow(u, 0);
                take(i, h.dot(states(k)), calcForm(covariance, h), piece.calcRow(u, 1).dot(states(k)) / step_s_);
            }
        }
    }

    MotionEstimate evaluate(double time_s) const;

    struct RoughnessSlope {
        Roughness here;                          ///< of the fit: one factor per piece
        std::vector<double> slope, information;  ///< of the log likelihood over the factor's logarithm, per piece
    };
    RoughnessSlope calcRoughnessSlope() const;

    /** Sum of the angles between the errors of one order at neighbouring knots. */
    double calcArc(int order) const;

    std::vector<MeanEstimate> calcMeans(int order, double duration_s) const;

private:
    using Matrix4 = SplinePiece::Matrix4;
    using Vector8 = SplinePiece::Vector8;
    using Matrix8 = SplinePiece::Matrix8;

    /** Infinite where rounding has left nothing of it. */
    double calcDeviation(double unit, double share) const {
        return share > 0.0 ? unit * std::sqrt(variance_ * share) : std::numeric_limits<double>::infinity();
    }
    struct Place {
        std::size_t knot;
        double u;
    };
    Place place(const Segment& s, double time_s) const {
        const double at = (time_s - s.begin_s) / step_s_;
        const std::size_t k = std::min(s.firstKnot + static_cast<std::size_t>(at), s.endKnot - 2);
        return {k, at - static_cast<double>(k - s.firstKnot)};
    }
    Vector8 states(std::size_t k) const { return Eigen::Map<const Vector8>(&x_[4 * k]); }
    static Eigen::Map<Vector8> updStates(std::vector<double>& x, std::size_t k) {
        return Eigen::Map<Vector8>(&x[4 * k]);
    }

    Matrix8 calcPairCovariance(std::size_t k) const;
    static double calcForm(const Matrix8& covariance, const Vector8& h) {
        const Vector8 product = covariance.lazyProduct(h);  // Eigen would call its routine for large matrices
        return h.dot(product);
    }

    static std::vector<Segment> layKnots(const Readings& readings, double step_s);
    void solve();

    double calcSquares() const;

    void addGradient(std::vector<double>& gradient) const;

    const Readings& readings_;
    double step_s_;
    std::vector<Segment> segments_;
    double rho_;
    BandedLdl system_;
    std::vector<double> factor_;  // roughness of the piece behind each knot
    std::vector<double> x_;
    double variance_ = 0.0, objective_ = std::numeric_limits<double>::infinity();
    bool isSolved_ = false;
};

}  // namespace viable::detail
