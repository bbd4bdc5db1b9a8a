#include "analysis/smoothing/SplineFit.h"

#include <Eigen/Dense>

namespace viable::detail {

double Roughness::at(double time_s) const {
    if (factors.empty()) return 1.0;
    const auto after = std::upper_bound(parts.begin() + 1, parts.end(), time_s,
                                        [](double t, const Part& part) { return t < part.begin_s; });
    const Part& part = *(after - 1);
    const std::size_t end = after == parts.end() ? factors.size() : after->first;
    const double place = std::floor((time_s - part.begin_s) / step_s);
    const double last = static_cast<double>(end - part.first - 1);
    return factors[part.first + static_cast<std::size_t>(std::clamp(place, 0.0, last))];
}

SplineFit::SplineFit(const Readings& readings, double knotStep_s, const Roughness& roughness,
                     std::vector<double> storage)
    : readings_(readings),
      step_s_(knotStep_s),
      segments_(layKnots(readings, knotStep_s)),
      rho_(std::pow(kKnotsPerWindow, 8.0) * knotStep_s / readings.interval_s),
      system_(segments_.back().endKnot, std::move(storage)),
      factor_(segments_.back().endKnot, 1.0) {
    for (const Segment& s : segments_)
        for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k)
            factor_[k] = roughness.at(knotTime(s, k) + 0.5 * step_s_);
    solve();
}

std::vector<SplineFit::Segment> SplineFit::layKnots(const Readings& readings, double step_s) {
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

void SplineFit::finish() {
    std::vector<double> rest(x_.size(), 0.0);
    addGradient(rest);
    system_.solve(rest);
    for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += rest[i];
    system_.calcInverseBand();
}

MotionEstimate SplineFit::evaluate(double time_s) const {
    const auto after = std::upper_bound(segments_.begin() + 1, segments_.end(), time_s,
                                        [](double t, const Segment& s) { return t < s.begin_s; });
    const Segment& s = *(after - 1);
    const SplinePiece& piece = getPiece();
    const auto [k, u] = place(s, std::clamp(time_s, s.begin_s, s.end_s));
    const Matrix4 bridge = piece.calcBridge(u) * (factor_[k] / rho_);
    const Matrix8 covariance = calcPairCovariance(k);
    MotionEstimate estimate;
    double unit = 1.0;
    for (int order = 0; order < kMotionOrders; ++order, unit /= step_s_) {
        const Vector8 h = piece.calcRow(u, order);
        estimate.mean[order] = unit * h.dot(states(k));
        estimate.deviation[order] = calcDeviation(unit, calcForm(covariance, h) + bridge(order, order));
    }
    return estimate;
}

SplineFit::RoughnessSlope SplineFit::calcRoughnessSlope() const {
    const SplinePiece& piece = getPiece();
    RoughnessSlope all;
    all.here.step_s = step_s_;
    for (const Segment& s : segments_) {
        all.here.parts.push_back({s.begin_s, all.slope.size()});
        for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
            const double weight = rho_ / factor_[k];
            const Eigen::Vector4d w = piece.innovation * states(k);
            const Matrix4 share =
                weight * piece.information * piece.innovation * calcPairCovariance(k) * piece.innovation.transpose();
            const Matrix4 known = Matrix4::Identity() - share;
            all.here.factors.push_back(factor_[k]);
            all.slope.push_back(0.5 * (weight * w.dot(piece.information * w) / variance_ + share.trace()) - 2.0);
            all.information.push_back(0.5 * (known * known).trace());
        }
    }
    return all;
}

double SplineFit::calcArc(int order) const {
    double sum = 0.0;
    for (const Segment& s : segments_)
        for (std::size_t k = s.firstKnot; k + 1 < s.endKnot; ++k) {
            const std::size_t a = 4 * k + static_cast<std::size_t>(order), b = a + 4;
            const double scale = std::sqrt(system_.getInverse(a, a) * system_.getInverse(b, b));
            sum += std::acos(std::clamp(system_.getInverse(b, a) / scale, -1.0, 1.0));
        }
    return sum;
}

std::vector<MeanEstimate> SplineFit::calcMeans(int order, double duration_s) const {
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
    means.reserve(segments_.back().endKnot);
    // The states are a Markov chain: cov(x0, x2) = cov(x0, x1) cov(x1)^-1 cov(x1, x2).
    std::vector<Matrix4> onward(pieces);  // of the last pieces, in turn
    for (const Segment& s : segments_) {
        for (std::size_t last = s.firstKnot; last + 1 < s.endKnot; ++last) {
            onward[last % pieces] = get(last, last).ldlt().solve(get(last, last + 1));
            if (last + 1 < s.firstKnot + pieces) continue;
            const std::size_t k = last + 1 - pieces;
            Eigen::RowVector4d covariance = get(k, k).row(order - 1);
            for (std::size_t j = k; j <= last; ++j) covariance *= onward[j % pieces];
            const std::size_t a = 4 * k + o, b = 4 * (k + pieces) + o;
            const double variance = system_.getInverse(a, a) + system_.getInverse(b, b) - 2.0 * covariance[order - 1];
            means.push_back({knotTime(s, k), length_s, unit * (x_[b] - x_[a]), calcDeviation(unit, variance)});
        }
    }
    return means;
}

SplineFit::Matrix8 SplineFit::calcPairCovariance(std::size_t k) const {
    Matrix8 covariance;
    for (std::size_t i = 0; i < 8; ++i)
        for (std::size_t j = 0; j <= i; ++j)
            covariance(static_cast<int>(i), static_cast<int>(j)) =
                covariance(static_cast<int>(j), static_cast<int>(i)) = system_.getInverse(4 * k + i, 4 * k + j);
    return covariance;
}

void SplineFit::solve() {
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

double SplineFit::calcSquares() const {
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

void SplineFit::addGradient(std::vector<double>& gradient) const {
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

}  // namespace viable::detail
