#include "analysis/smoothing/Smoothing.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "analysis/records/MotionRecord.h"
#include "analysis/smoothing/BandedLdl.h"
#include "analysis/smoothing/Readings.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using detail::BandedLdl;
using detail::Readings;
using Matrix4 = Eigen::Matrix4d;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;
using Pair = Eigen::Matrix<double, 4, 8>;  // of the states at both ends of a piece

/** Window over the distance of the knots. More: pieces resolve what is smoothed away anyhow, and the system's condition
grows with its eighth power; less: the pieces are too stiff. */
constexpr double kKnotsPerWindow = 1.3;
/** Knots at most [per reading]: where noise is small, motion changes between two readings. */
constexpr double kKnotsPerReading = 4.0;
/** Roughness of a piece of the motion over that of all, at most, and its inverse at least. */
constexpr double kLargestRoughness = 100.0;

double factorial(int n) {
    double product = 1.0;
    for (int i = 2; i <= n; ++i) product *= i;
    return product;
}

/** exp(A u) of the chain p' = v, v' = a, a' = j. */
Matrix4 makeTransition(double u) {
    Matrix4 F = Matrix4::Zero();
    for (int row = 0; row < 4; ++row)
        for (int column = row; column < 4; ++column)
            F(row, column) = column == row ? 1.0 : F(row, column - 1) * u / (column - row);
    return F;
}

/** Covariance that white noise of density 1 in j' leaves after u. */
Matrix4 makeProcess(double u) {
    constexpr double kFactorial[] = {6.0, 2.0, 1.0, 1.0};  // (3 - row)!
    double powers[8] = {1.0};
    for (int power = 1; power < 8; ++power) powers[power] = powers[power - 1] * u;
    Matrix4 Q;
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) {
            const int power = 7 - row - column;
            Q(row, column) = powers[power] / (kFactorial[row] * kFactorial[column] * power);
        }
    return Q;
}

/** The times-fold integral from 0 to t of a step to 1 that takes rise_s, as 10 u^3 - 15 u^4 + 6 u^5. */
double integrateStep(double t, double rise_s, int times) {
    if (t <= 0.0) return 0.0;
    if (t < rise_s) {
        const double u = t / rise_s;
        double sum = 0.0;
        for (const auto& [power, factor] : {std::pair{3, 10.0}, {4, -15.0}, {5, 6.0}})
            sum += factor * std::pow(u, power + times) * factorial(power) / factorial(power + times);
        return sum * std::pow(rise_s, times);
    }
    double sum = std::pow(t - rise_s, times) / factorial(times);
    for (int i = 0; i < times && rise_s > 0.0; ++i) {
        double atEnd = 0.0;
        for (const auto& [power, factor] : {std::pair{3, 10.0}, {4, -15.0}, {5, 6.0}})
            atEnd += factor * factorial(power) / factorial(power + times - i);
        sum += atEnd * std::pow(rise_s, times - i) * std::pow(t - rise_s, i) / factorial(i);
    }
    return sum;
}

/** What does not depend on the readings: one piece of length 1 between two states (p, v, a, j). */
struct Piece {
    Matrix4 process = makeProcess(1.0);
    Matrix4 information = process.inverse();
    double logDeterminant = std::log(process.determinant());
    Pair innovation;  // w = innovation * (x0, x1)
    Matrix8 prior;    // w' information w as a form in (x0, x1)
    Matrix8 powers;   // coefficients of 1, u, ..., u^7 from (x0, x1)

    Piece() {
        innovation << -makeTransition(1.0), Matrix4::Identity();
        prior = innovation.transpose() * information * innovation;
        Matrix8 ends = Matrix8::Zero();  // (x0, x1) from the coefficients
        for (int order = 0; order < 4; ++order)
            for (int power = order; power < 8; ++power) {
                const double slope = factorial(power) / factorial(power - order);
                if (power == order) ends(order, power) = slope;
                ends(4 + order, power) = slope;
            }
        powers = ends.inverse();
    }

    /** Row that gives the order-th derivative at u in [0, 1] from (x0, x1): the polynomial of degree 7 through both
    states, which is the expected path between them. */
    Vector8 calcRow(double u, int order) const {
        Vector8 monomials = Vector8::Zero();
        double power = 1.0;
        for (int m = order; m < 8; ++m, power *= u) {
            double slope = power;
            for (int k = 0; k < order; ++k) slope *= m - k;
            monomials[m] = slope;
        }
        return powers.transpose() * monomials;
    }

    /** Covariance of the path at u, both ends known, for density 1. */
    Matrix4 calcBridge(double u) const {
        const Matrix4 left = makeProcess(u);
        const Matrix4 cross = left * makeTransition(1.0 - u).transpose();
        return left - cross * information * cross.transpose();
    }
};

const Piece& getPiece() {
    static const Piece piece;
    return piece;
}

/** How rough the motion is along the record: the density of its jerk's steps over that of the whole record. */
struct Roughness {
    struct Part {
        double begin_s;
        std::size_t first;  ///< of its factors, step_s each
    };
    double step_s = 0.0;
    std::vector<Part> parts;      ///< ascending; a segment each
    std::vector<double> factors;  ///< empty: 1 throughout

    double at(double time_s) const {
        if (factors.empty()) return 1.0;
        const auto after = std::upper_bound(parts.begin() + 1, parts.end(), time_s,
                                            [](double t, const Part& part) { return t < part.begin_s; });
        const Part& part = *(after - 1);
        const std::size_t end = after == parts.end() ? factors.size() : after->first;
        const double place = std::floor((time_s - part.begin_s) / step_s);
        const double last = static_cast<double>(end - part.first - 1);
        return factors[part.first + static_cast<std::size_t>(std::clamp(place, 0.0, last))];
    }
};

/** Knots of one segment without a long gap. */
struct Segment {
    double begin_s, end_s;
    std::size_t firstReading, endReading;
    std::size_t firstKnot, endKnot;
};

/** The most likely motion for one distance of the knots.

Model: jerk is a random walk whose steps have density q; readings are y = p + e, e of variance sigma^2 g. Its expected
motion is the smoothing spline that penalises the integral of p''''^2 (Wahba 1978; Kohn and Ansley 1987). Unknowns:
(p, v D, a D^2, j D^3) at knots D apart. sigma^2 and q = sigma^2 / (rho D^7) from the restricted likelihood. */
class Fit {
public:
    Fit(const Readings& readings, double knotStep_s, const Roughness& roughness)
        : readings_(readings),
          step_s_(knotStep_s),
          segments_(layKnots(readings, knotStep_s)),
          rho_(std::pow(kKnotsPerWindow, 8.0) * knotStep_s / readings.interval_s),
          system_(segments_.back().endKnot),
          factor_(segments_.back().endKnot, 1.0) {
        for (const Segment& s : segments_)
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k)
                factor_[k] = roughness.at(knotTime(s, k) + 0.5 * step_s_);
        solve();
    }

    static std::vector<Segment> layKnots(const Readings& readings, double step_s) {
        std::vector<Segment> segments;
        std::size_t knots = 0;
        for (const auto& [first, end] : readings.segments) {
            Segment s{readings.times_s[first], readings.times_s[end - 1], first, end, knots, knots};
            s.endKnot += 2 + static_cast<std::size_t>((s.end_s - s.begin_s) / step_s);
            knots = s.endKnot;
            segments.push_back(s);
        }
        return segments;
    }

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
    void finish() {
        std::vector<double> rest(x_.size(), 0.0);
        addGradient(rest);
        system_.solve(rest);
        for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += rest[i];
        system_.calcInverseBand();
    }

    /** After finish(): expectation of each reading, and its variance over sigma^2. */
    template <class Take>
    void forEachReading(const Take& take) const {
        for (const Segment& s : segments_)
            for (std::size_t i = s.firstReading; i < s.endReading; ++i) {
                const auto [k, u] = place(s, readings_.times_s[i]);
                const Vector8 h = getPiece().calcRow(u, 0);
                take(i, h.dot(states(k)), h.dot(calcPairCovariance(k) * h),
                     getPiece().calcRow(u, 1).dot(states(k)) / step_s_);
            }
    }

    MotionEstimate evaluate(double time_s) const {
        const auto after = std::upper_bound(segments_.begin() + 1, segments_.end(), time_s,
                                            [](double t, const Segment& s) { return t < s.begin_s; });
        const Segment& s = *(after - 1);
        const Piece& piece = getPiece();
        const auto [k, u] = place(s, std::clamp(time_s, s.begin_s, s.end_s));
        const Matrix4 bridge = piece.calcBridge(u) * (factor_[k] / rho_);
        const Matrix8 covariance = calcPairCovariance(k);
        MotionEstimate estimate;
        double unit = 1.0;
        for (int order = 0; order < kMotionOrders; ++order, unit /= step_s_) {
            const Vector8 h = piece.calcRow(u, order);
            const auto o = static_cast<std::size_t>(order);
            estimate.mean[o] = unit * h.dot(states(k));
            estimate.deviation[o] = calcDeviation(unit, h.dot(covariance * h) + bridge(order, order));
        }
        return estimate;
    }

    struct RoughnessSlope {
        Roughness here;                          ///< of the fit: one factor per piece
        std::vector<double> slope, information;  ///< of the log likelihood over the factor's logarithm, per piece
    };
    RoughnessSlope calcRoughnessSlope() const {
        const Piece& piece = getPiece();
        RoughnessSlope all;
        all.here.step_s = step_s_;
        for (const Segment& s : segments_) {
            all.here.parts.push_back({s.begin_s, all.slope.size()});
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
                const double weight = rho_ / factor_[k];
                const Eigen::Vector4d w = piece.innovation * states(k);
                const Matrix4 share = weight * piece.information * piece.innovation * calcPairCovariance(k) *
                                      piece.innovation.transpose();
                const Matrix4 known = Matrix4::Identity() - share;
                all.here.factors.push_back(factor_[k]);
                all.slope.push_back(0.5 * (weight * w.dot(piece.information * w) / variance_ + share.trace()) - 2.0);
                all.information.push_back(0.5 * (known * known).trace());
            }
        }
        return all;
    }

    /** Sum of the angles between the errors of one order at neighbouring knots. */
    double calcArc(int order) const {
        double sum = 0.0;
        for (const Segment& s : segments_)
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
                const std::size_t a = 4 * k + static_cast<std::size_t>(order), b = a + 4;
                const double scale = std::sqrt(system_.getInverse(a, a) * system_.getInverse(b, b));
                sum += std::acos(std::clamp(system_.getInverse(b, a) / scale, -1.0, 1.0));
            }
        return sum;
    }

    std::vector<MeanEstimate> calcMeans(int order, double duration_s) const {
        std::vector<MeanEstimate> means;
        constexpr double kMostPieces = 64.0;  // longer means add nothing but time
        const double fitting = std::min(std::floor(duration_s / step_s_) - 1.0, kMostPieces);
        if (!(fitting >= 1.0) || order < 1) return means;
        const auto pieces = static_cast<std::size_t>(fitting);
        const double length_s = fitting * step_s_, unit = std::pow(step_s_, 1 - order) / length_s;
        const auto o = static_cast<std::size_t>(order - 1);
        const auto get = [&](std::size_t a, std::size_t b) {
            Matrix4 block;
            for (std::size_t i = 0; i < 4; ++i)
                for (std::size_t j = 0; j < 4; ++j)
                    block(static_cast<int>(i), static_cast<int>(j)) = system_.getInverse(4 * a + i, 4 * b + j);
            return block;
        };
        for (const Segment& s : segments_) {
            // The states are a Markov chain: cov(x0, x2) = cov(x0, x1) cov(x1)^-1 cov(x1, x2).
            std::vector<Matrix4> onward;
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k)
                onward.push_back(get(k, k).ldlt().solve(get(k, k + 1)));
            for (std::size_t k = s.firstKnot; k + pieces < s.endKnot; ++k) {
                Eigen::RowVector4d covariance = get(k, k).row(order - 1);
                for (std::size_t j = k; j < k + pieces; ++j) covariance *= onward[j - s.firstKnot];
                const std::size_t a = 4 * k + o, b = 4 * (k + pieces) + o;
                const double variance =
                    system_.getInverse(a, a) + system_.getInverse(b, b) - 2.0 * covariance[order - 1];
                means.push_back({knotTime(s, k), length_s, unit * (x_[b] - x_[a]), calcDeviation(unit, variance)});
            }
        }
        return means;
    }

private:
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

    Matrix8 calcPairCovariance(std::size_t k) const {
        Matrix8 covariance;
        for (std::size_t i = 0; i < 8; ++i)
            for (std::size_t j = 0; j <= i; ++j)
                covariance(static_cast<int>(i), static_cast<int>(j)) =
                    covariance(static_cast<int>(j), static_cast<int>(i)) = system_.getInverse(4 * k + i, 4 * k + j);
        return covariance;
    }

    void solve() {
        x_.assign(system_.size(), 0.0);
        double logNoise = 0.0;
        std::size_t count = 0;
        for (const Segment& s : segments_) {
            Matrix8 sum = Matrix8::Zero();
            std::size_t pair = s.firstKnot;
            for (std::size_t i = s.firstReading; i < s.endReading; ++i) {
                if (!readings_.isUsed[i]) continue;
                const auto [k, u] = place(s, readings_.times_s[i]);
                if (k != pair) {
                    system_.addPair(pair, sum);
                    sum.setZero();
                    pair = k;
                }
                const Vector8 h = getPiece().calcRow(u, 0);
                const double weight = 1.0 / readings_.relative[i];
                sum.noalias() += (weight * h) * h.transpose();
                updStates(x_, k) += weight * readings_.values[i] * h;
                logNoise -= std::log(weight);
                ++count;
            }
            system_.addPair(pair, sum);
        }
        std::size_t pieces = 0;
        double logRoughness = 0.0;
        for (const Segment& s : segments_)
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k, ++pieces) {
                system_.addPair(k, rho_ / factor_[k] * getPiece().prior);
                logRoughness += 4.0 * std::log(factor_[k]);
            }
        isSolved_ = system_.factor();
        if (!isSolved_) return;
        system_.solve(x_);

        const double free = static_cast<double>(count) - 4.0 * static_cast<double>(segments_.size());
        const double squares = calcSquares();
        variance_ =
            readings_.knownVariance > 0.0 ? readings_.knownVariance : std::max(squares / free, readings_.leastVariance);
        const double n = static_cast<double>(pieces);
        objective_ = free * std::log(variance_) + squares / variance_ + logNoise + system_.calcLogDeterminant() -
                     4.0 * n * std::log(rho_) + logRoughness + n * getPiece().logDeterminant +
                     12.0 * static_cast<double>(segments_.size()) * std::log(step_s_);
        isSolved_ = std::isfinite(objective_);
    }

    double calcSquares() const {
        double sum = 0.0;
        for (const Segment& s : segments_) {
            for (std::size_t i = s.firstReading; i < s.endReading; ++i) {
                if (!readings_.isUsed[i]) continue;
                const auto [k, u] = place(s, readings_.times_s[i]);
                const double rest = readings_.values[i] - getPiece().calcRow(u, 0).dot(states(k));
                sum += rest * rest / readings_.relative[i];
            }
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
                const Eigen::Vector4d w = getPiece().innovation * states(k);
                sum += rho_ / factor_[k] * w.dot(getPiece().information * w);
            }
        }
        return sum;
    }

    void addGradient(std::vector<double>& gradient) const {
        for (const Segment& s : segments_) {
            for (std::size_t i = s.firstReading; i < s.endReading; ++i) {
                if (!readings_.isUsed[i]) continue;
                const auto [k, u] = place(s, readings_.times_s[i]);
                const Vector8 h = getPiece().calcRow(u, 0);
                updStates(gradient, k) += (readings_.values[i] - h.dot(states(k))) / readings_.relative[i] * h;
            }
            for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
                const Eigen::Vector4d w = getPiece().innovation * states(k);
                updStates(gradient, k) -=
                    rho_ / factor_[k] * getPiece().innovation.transpose() * (getPiece().information * w);
            }
        }
    }

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

/** One step of Fisher's scoring for a roughness that changes slowly along the record: the likelihood's slope over its
information, both averaged over some pieces, each drawn towards 1. */
Roughness refine(const Fit& fit) {
    constexpr std::size_t kReach = 8;     // pieces on either side that count
    constexpr double kPrior = 0.5;        // information that says 1
    constexpr double kDamping = 0.7;      // neighbouring pieces share information: a whole step goes too far
    constexpr double kLargestStep = 1.5;  // of the logarithm
    const double largest = std::log(kLargestRoughness);
    const auto [here, slope, information] = fit.calcRoughnessSlope();
    Roughness next = here;
    const std::size_t n = slope.size();
    for (std::size_t i = 0; i < n; ++i) {
        const double old = std::log(here.factors[i]);
        double sum = -kPrior * old, weight = kPrior;
        for (std::size_t j = i - std::min(i, kReach); j < std::min(n, i + kReach + 1); ++j) {
            const double distance = static_cast<double>(i > j ? i - j : j - i);
            const double share = 1.0 - distance / static_cast<double>(kReach + 1);
            sum += share * slope[j];
            weight += share * information[j];
        }
        const double step = std::clamp(kDamping * sum / weight, -kLargestStep, kLargestStep);
        next.factors[i] = std::exp(std::clamp(old + step, -largest, largest));
    }
    return next;
}

/** With a geometric mean of 1: what is common to all is the fit's own density. */
void normalise(Roughness& roughness) {
    double mean = 0.0;
    for (const double f : roughness.factors) mean += std::log(f) / static_cast<double>(roughness.factors.size());
    for (double& f : roughness.factors) f *= std::exp(-mean);
}

/** Readings that the search for the best distance of the knots looks at, at most. */
constexpr std::size_t kSearched = 16384, kSearchedPiece = 1024;

/** Pieces of a long record: half of them evenly spread, half where the readings stray most from a straight line. */
Readings takeSample(const Readings& readings) {
    if (readings.values.size() <= kSearched) return readings;
    struct Candidate {
        std::size_t first, end;
        double straying;
    };
    std::vector<Candidate> candidates;
    for (const auto& [first, end] : readings.segments)
        for (std::size_t from = first; from + kLeastSamples <= end; from += kSearchedPiece) {
            const std::size_t to = std::min(from + kSearchedPiece, end);
            if (to < from + kLeastSamples) break;
            const double slope =
                (readings.values[to - 1] - readings.values[from]) / (readings.times_s[to - 1] - readings.times_s[from]);
            double straying = 0.0;
            for (std::size_t i = from; i < to; ++i)
                if (readings.isUsed[i])
                    straying = std::max(straying, std::abs(readings.values[i] - readings.values[from] -
                                                           slope * (readings.times_s[i] - readings.times_s[from])));
            candidates.push_back({from, to, straying});
        }
    constexpr std::size_t kPieces = kSearched / kSearchedPiece;
    std::vector<char> isTaken(candidates.size(), 0);
    for (std::size_t piece = 0; piece < kPieces / 2; ++piece)
        isTaken[(2 * piece + 1) * candidates.size() / kPieces] = 1;
    std::vector<std::size_t> order(candidates.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto middle = order.begin() + static_cast<std::ptrdiff_t>(std::min(kPieces / 2, order.size()));
    std::partial_sort(order.begin(), middle, order.end(),
                      [&](std::size_t a, std::size_t b) { return candidates[a].straying > candidates[b].straying; });
    for (auto i = order.begin(); i != middle; ++i) isTaken[*i] = 1;
    Readings sample = readings.makeEmpty();
    for (std::size_t i = 0; i < candidates.size(); ++i)
        if (isTaken[i]) sample.addSegment(readings, candidates[i].first, candidates[i].end);
    return sample;
}

/** The distance of the knots with the largest restricted likelihood: from coarse to fine in steps of 2^(1/2) until it
falls for good, then a parabola's least point.
@param patience  steps without a better one after which it has fallen for good */
double findKnotStep(const Readings& readings, const Roughness& roughness, double coarsest_s, std::size_t patience) {
    constexpr double kRatio = 0.70710678118654752;
    const Readings sample = takeSample(readings);
    const auto ask = [&](double step_s) { return Fit(sample, step_s, roughness).objective(); };
    std::vector<double> steps, values;
    std::size_t best = 0;
    const double finest_s = readings.interval_s / kKnotsPerReading;
    for (double step_s = std::max(coarsest_s, finest_s); step_s >= finest_s; step_s *= kRatio) {
        steps.push_back(step_s);
        values.push_back(ask(step_s));
        if (values.back() < values[best]) best = values.size() - 1;
        if (values.size() > best + patience && std::isfinite(values[best])) break;
    }
    if (best == 0 || best + 1 >= values.size() || !std::isfinite(values[best - 1]) || !std::isfinite(values[best + 1]))
        return steps[best];
    const double left = values[best - 1], middle = values[best], right = values[best + 1];
    const double bend = left - 2.0 * middle + right;
    return steps[best] * std::pow(kRatio, bend > 0.0 ? 0.5 * (left - right) / bend : 0.0);
}

/** Readings farther than this from what all others say of them are left out [standard deviations]. */
constexpr double kOutlier = 4.5;

/** Readings of so many windows have a say in one estimate. */
constexpr double kCounting = 4.0;

/** Weighs the readings by what a fit says of them: outliers, and the part of the rounding errors that does not change
from one reading to the next. True where it made a difference. */
bool reweigh(Readings& readings, const Fit& fit) {
    const double variance = fit.variance(), quantum = readings.quantum;
    // A reading counts among those of some windows, not more.
    const double window = kCounting * kKnotsPerWindow * fit.step_s() / readings.interval_s;  // [readings]
    // Rounding's error is periodic in the position: over noise of variance s^2, the k-th harmonic of its mean has the
    // amplitude b = quantum / (pi k) exp(-2 (pi k s / quantum)^2) (Widrow and Kollar 2008). It hardly changes from one
    // reading to the next where the joint moves by nearly a whole number of its periods: at rest, and at some speeds.
    constexpr int kHarmonics = 4;
    const double noise = std::max(0.0, variance - quantum * quantum / 12.0);
    double shares[kHarmonics] = {};
    for (int k = 1; k <= kHarmonics && quantum > 0.0; ++k) {
        const double b = quantum / (M_PI * k) * std::exp(-2.0 * M_PI * M_PI * k * k * noise / (quantum * quantum));
        shares[k - 1] = 0.5 * b * b / variance;
    }
    const auto calcRelative = [&](double velocity) {
        double relative = 1.0;
        for (int k = 1; k <= kHarmonics && quantum > 0.0; ++k) {
            const double periods = k * velocity * readings.interval_s / quantum;
            const double change = std::abs(periods - std::round(periods));
            relative += shares[k - 1] * (std::min(1.0 / std::max(change, 1e-9), std::max(1.0, window)) - 1.0);
        }
        return relative;
    };
    bool changed = false;
    fit.forEachReading([&](std::size_t i, double expected, double leverage, double velocity) {
        const double rest = readings.values[i] - expected;
        double spread = readings.relative[i];
        spread += readings.isUsed[i] ? -leverage : leverage;
        spread = std::max(spread, 1e-3 * readings.relative[i]);  // rounding
        const bool isUsed = std::abs(rest) <= kOutlier * std::sqrt(variance * spread) + 0.5 * quantum;
        if (isUsed != bool(readings.isUsed[i])) changed = true;
        readings.isUsed[i] = isUsed;
        const double relative = calcRelative(velocity);
        if (std::abs(std::log(relative / readings.relative[i])) > 0.5) changed = true;
        readings.relative[i] = relative;
    });
    return changed;
}

}  // namespace

double MotionPulse::reach_s() const {
    return 0.5 * duration_s + rise_s;
}

double MotionPulse::calcPosition(double time_s) const {
    const double rise = middle_s - 0.5 * duration_s - rise_s, fall = middle_s + 0.5 * duration_s;
    return height * (integrateStep(time_s - rise, rise_s, order) - integrateStep(time_s - fall, rise_s, order));
}

struct SmoothedMotion::Impl {
    Readings readings;
    std::optional<Fit> fit;
    Roughness roughness;
    std::vector<std::size_t> outliers;
    std::vector<OutlierRun> runs;
    double freedom = 0.0;

    /** Once the fit is the last one. */
    void findOutliers() {
        double used = 0.0, taken = 0.0;
        std::size_t last = 0;
        fit->forEachReading([&](std::size_t i, double expected, double leverage, double) {
            if (readings.isUsed[i]) {
                used += 1.0;
                taken += leverage / readings.relative[i];
                return;
            }
            outliers.push_back(readings.source[i]);
            const double distance = std::abs(readings.values[i] - expected);
            if (runs.empty() || i != last + 1) runs.push_back({readings.times_s[i], readings.times_s[i], 0, 0.0});
            OutlierRun& run = runs.back();
            run.end_s = readings.times_s[i];
            run.distance = std::max(run.distance, distance);
            ++run.count;
            last = i;
        });
        std::sort(outliers.begin(), outliers.end());
        // Noise is known from what the motion leaves over; how smooth the motion is, from its windows.
        double windows = 0.0;
        for (const Segment& s : fit->segments()) windows += (s.end_s - s.begin_s) / (kKnotsPerWindow * fit->step_s());
        freedom = std::max(2.0, std::min(used - taken, windows));
    }
};

SmoothedMotion::SmoothedMotion(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SmoothedMotion::~SmoothedMotion() = default;
SmoothedMotion::SmoothedMotion(SmoothedMotion&&) noexcept = default;
SmoothedMotion& SmoothedMotion::operator=(SmoothedMotion&&) noexcept = default;

double SmoothedMotion::begin_s() const {
    return impl_->fit->segments().front().begin_s;
}
double SmoothedMotion::end_s() const {
    return impl_->fit->segments().back().end_s;
}
double SmoothedMotion::noise() const {
    return std::sqrt(impl_->fit->variance());
}
double SmoothedMotion::quantum() const {
    return impl_->readings.quantum;
}
double SmoothedMotion::window_s() const {
    return kKnotsPerWindow * impl_->fit->step_s();
}
const std::vector<std::size_t>& SmoothedMotion::outliers() const {
    return impl_->outliers;
}
MotionEstimate SmoothedMotion::evaluate(double time_s) const {
    MotionEstimate estimate = impl_->fit->evaluate(time_s);
    estimate.mean[0] += impl_->readings.offset;
    return estimate;
}
double SmoothedMotion::calcArc(int order) const {
    return impl_->fit->calcArc(order);
}
std::vector<std::pair<double, double>> SmoothedMotion::segments() const {
    std::vector<std::pair<double, double>> all;
    for (const Segment& s : impl_->fit->segments()) all.emplace_back(s.begin_s, s.end_s);
    return all;
}
const std::vector<OutlierRun>& SmoothedMotion::outlierRuns() const {
    return impl_->runs;
}
double SmoothedMotion::freedom() const {
    return impl_->freedom;
}
double SmoothedMotion::interval_s() const {
    return impl_->readings.interval_s;
}

std::vector<MeanEstimate> SmoothedMotion::calcMeans(int order, double duration_s) const {
    return impl_->fit->calcMeans(order, duration_s);
}

SmoothedMotion::Tried SmoothedMotion::tryPulse(const MotionPulse& pulse) const {
    constexpr double kWindows = 12.0;  // to either side: what is farther has no say
    constexpr int kRounds = 2;         // of the roughness
    constexpr int kLooks = 7;          // at the plateau
    const Readings& all = impl_->readings;
    const double reach = pulse.reach_s() + kWindows * window_s();
    Readings near = all.makeEmpty();
    for (const auto& [first, end] : all.segments) {
        const auto begin = all.times_s.begin();
        const auto at = [&](std::size_t i) { return begin + static_cast<std::ptrdiff_t>(i); };
        if (*at(first) > pulse.middle_s || *at(end - 1) < pulse.middle_s) continue;
        near.addSegment(all,
                        static_cast<std::size_t>(std::lower_bound(at(first), at(end), pulse.middle_s - reach) - begin),
                        static_cast<std::size_t>(std::lower_bound(at(first), at(end), pulse.middle_s + reach) - begin));
    }
    Tried tried;
    if (near.values.size() < kLeastSamples) return tried;
    near.knownVariance = impl_->fit->variance();
    for (std::size_t i = 0; i < near.values.size(); ++i) near.values[i] += pulse.calcPosition(near.times_s[i]);
    const double step_s = impl_->fit->step_s();
    Roughness roughness;
    std::optional<Fit> fit;
    for (int round = 0;; ++round) {
        fit.emplace(near, step_s, round == 0 ? impl_->roughness : roughness);
        if (!fit->ok()) return tried;
        fit->finish();
        if (round == kRounds) break;
        roughness = refine(*fit);
    }
    const double begin_s = pulse.middle_s - 0.5 * pulse.duration_s;
    for (int look = 0; look < kLooks; ++look) {
        tried.times_s.push_back(begin_s + pulse.duration_s * look / (kLooks - 1));
        tried.estimates.push_back(fit->evaluate(tried.times_s.back()));
        tried.estimates.back().mean[0] += all.offset;
    }
    for (const MeanEstimate& mean : fit->calcMeans(pulse.order, pulse.duration_s))
        if (mean.begin_s >= begin_s && mean.begin_s + mean.duration_s <= begin_s + pulse.duration_s)
            tried.means.push_back(mean);
    return tried;
}

SmoothedMotion smoothMotion(const std::vector<double>& times_s, const std::vector<double>& values,
                            const std::string& where) {
    auto impl = std::make_unique<SmoothedMotion::Impl>();
    Readings& readings = impl->readings;
    readings = detail::takeReadings(times_s, values, where);
    Roughness& roughness = impl->roughness;
    const auto fit = [&](double coarsest_s, std::size_t patience) {
        impl->fit.emplace(readings, findKnotStep(readings, roughness, coarsest_s, patience), roughness);
        if (!impl->fit->ok())
            throw badInput(where, "the readings cannot be smoothed: their times or values differ too much in size");
        impl->fit->finish();
    };
    double longest_s = 0.0;
    for (const auto& [first, end] : readings.segments)
        longest_s = std::max(longest_s, readings.times_s[end - 1] - readings.times_s[first]);
    fit(longest_s / 4.0, 8);
    const auto refit = [&] { fit(4.0 * impl->fit->step_s(), 4); };
    const auto weighAgain = [&] {
        const bool changed = reweigh(readings, *impl->fit);
        const std::vector<std::size_t> dropped = detail::dropBarrenSegments(readings);
        impl->outliers.insert(impl->outliers.end(), dropped.begin(), dropped.end());
        return changed || !dropped.empty();
    };
    constexpr int kWeightRounds = 6, kRoughnessRounds = 3;
    for (int round = 1; round < kWeightRounds && weighAgain(); ++round) refit();
    for (int round = 0; round < kRoughnessRounds; ++round) {
        roughness = refine(*impl->fit);
        normalise(roughness);
        if (round > 0) weighAgain();
        refit();
    }
    impl->findOutliers();
    return SmoothedMotion(std::move(impl));
}

}  // namespace viable
