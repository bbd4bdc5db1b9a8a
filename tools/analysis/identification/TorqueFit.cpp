#include "analysis/identification/TorqueFit.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace viable::detail {

/** A mass at the tool is a point within this of the tool frame [m], once it is so many standard errors from zero. */
constexpr double kFarthestCentre = 1.0;
constexpr double kSureMass = 5.0;

/** The derivative of calcBend(). */
static double calcBendSlope(double x) {
    if (std::abs(x) < 1e-3) return -0.5 + x * (1.0 / 3.0 - x * 0.125);
    return (x * std::exp(-x) + std::expm1(-x)) / (x * x);
}

/** Derivative of the second moments' torque by the moments. */
static Eigen::Vector3d calcSecond(const TorqueEquation& row, const FitValues& values) {
    const auto& y = row.payload;
    Eigen::Matrix3d form;  // symmetric: the torque is the sum of S_ij m c_i c_j, i <= j
    form << 2.0 * y[4], y[7], y[9], y[7], 2.0 * y[5], y[8], y[9], y[8], 2.0 * y[6];
    return form * values.moment / values.mass;
}
static void take(const FitLayout& layout, const Eigen::VectorXd& step, double share, FitValues& values) {
    const auto add = [&](int place, double& value) {
        if (place >= 0) value += share * step[place];
    };
    for (std::size_t i = 0; i < layout.coulomb.size(); ++i) {
        add(layout.coulomb[i], values.friction[i].coulomb);
        add(layout.slope[i], values.friction[i].slope);
        add(layout.bend[i], values.friction[i].bend);
        add(layout.rotor[i], values.rotor[i]);
        add(layout.offset[i], values.offset[i]);
    }
    add(layout.delay, values.delay);
    add(layout.lag, values.lag);
    add(layout.mass, values.mass);
    for (int k = 0; k < 3; ++k) add(layout.moment[k], values.moment[k]);
    for (std::size_t b = 0; b < layout.bodies.size(); ++b) add(layout.bodies[b], values.bodies[b]);
}

double calcBend(double x) {
    return std::abs(x) < 1e-5 ? 1.0 - 0.5 * x : -std::expm1(-x) / x;
}

Averages average(const TorqueEquation& row, double bend, double lag, bool withSlope) {
    const double shift = 0.5 * bend * row.shaking * row.shaking;
    Averages a;
    for (std::size_t k = 0; k < row.speeds.size(); ++k) {
        const double v = row.speeds[k] - lag * row.accelerations[k] - shift, x = bend * v;
        const double bent = calcBend(x);
        a.viscous += row.shares[k] * v * bent;
        a.rate += row.shares[k] * (1.0 - x * bent) * row.accelerations[k];  // exp(-x) = 1 - x calcBend(x)
        if (withSlope) a.bendSlope += row.shares[k] * v * v * calcBendSlope(x);
    }
    return a;
}

TorqueFit::TorqueFit(const RobotDescription& nominal, const TorqueEquations& equations)
    : nominal_(nominal),
      equations_(equations),
      n_(static_cast<std::size_t>(nominal.size())),
      rows_(n_),
      fastest_(n_, 0.0),
      variance_(n_, 1.0) {
    choice.forms.assign(n_, FrictionForm::None);
    choice.rotor.assign(n_, false);
    choice.offset.assign(n_, false);
    choice.bodies.assign(n_, false);
    values_.friction.resize(n_);
    values_.rotor.assign(n_, 0.0);
    values_.offset.assign(n_, 0.0);
    values_.bodies.assign(n_, 0.0);
    for (const TorqueEquation& row : equations.rows) {
        rows_[row.joint].push_back(&row);
        double& fastest = fastest_[row.joint];
        fastest = std::max(fastest, *std::max_element(row.speeds.begin(), row.speeds.end()));
    }
}

Averages TorqueFit::average(const TorqueEquation& row, bool withSlope) const {
    return detail::average(row, values_.friction[row.joint].bend, values_.lag, withSlope);
}

// Over a grid of bends: from the best of them Gauss-Newton finds the bottom.
void TorqueFit::startFriction(std::size_t i, int extra) {
    double best = kInfinity;
    const int count = static_cast<int>(rows_[i].size());
    for (const double share : {0.0, 0.1, 0.3, 0.6, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0}) {
        const double bend = share / fastest_[i];
        Eigen::MatrixXd A(count, 2 + extra);
        Eigen::VectorXd y(count);
        for (int r = 0; r < count; ++r) {
            const TorqueEquation& row = *rows_[i][r];
            const double root = std::sqrt(row.weight);
            A(r, 0) = root * row.sign;
            A(r, 1) = root * row.sign * detail::average(row, bend, 0.0, false).viscous;
            for (int c = 0; c < extra; ++c) A(r, 2 + c) = root * row.payload[c];
            y[r] = root * row.torque;
        }
        const Eigen::VectorXd x = A.colPivHouseholderQr().solve(y);
        const double squares = (y - A * x).squaredNorm();
        if (squares >= best) continue;
        best = squares;
        values_.friction[i] = {x[0], x[1], bend};
        variance_[i] = std::max(squares / count, leastVariance(i));
    }
}

/** Torques are not better than this share of themselves. */
double TorqueFit::leastVariance(std::size_t i) const {
    const double least = 1e-6 * equations_.joints[i].torqueRms;
    return std::max(least * least, 1e-300);
}

FitLayout TorqueFit::makeLayout() const {
    FitLayout layout;
    const auto place = [&](bool isFree) { return isFree ? layout.size++ : -1; };
    for (std::size_t i = 0; i < n_; ++i) {
        layout.coulomb.push_back(place(isFitted(i)));
        layout.slope.push_back(place(isFitted(i) && choice.forms[i] != FrictionForm::CoulombOnly));
        layout.bend.push_back(place(choice.forms[i] == FrictionForm::Saturating));
        layout.rotor.push_back(place(isFitted(i) && choice.rotor[i]));
        layout.offset.push_back(place(isFitted(i) && choice.offset[i]));
    }
    const bool any =
        std::any_of(choice.forms.begin(), choice.forms.end(), [](FrictionForm f) { return f != FrictionForm::None; });
    layout.delay = place(any && choice.delay);
    layout.lag = place(any && choice.lag);
    layout.mass = place(any && choice.mass);
    for (std::size_t k = 0; k < 3; ++k) layout.moment[k] = place(any && choice.moment[k]);
    for (std::size_t i = 0; i < choice.bodies.size(); ++i) layout.bodies.push_back(place(any && choice.bodies[i]));
    return layout;
}

/** What the payload adds. Its second moments m c c' are those of a point, once it is sure that there is a mass. */
double TorqueFit::calcPayload(const TorqueEquation& row, const FitValues& values) const {
    double torque = values.mass * row.payload[0];
    for (int k = 0; k < 3; ++k) torque += values.moment[k] * row.payload[1 + k];
    if (isPoint_) torque += 0.5 * values.moment.dot(calcSecond(row, values));
    return torque;
}
double TorqueFit::calcMasses(const TorqueEquation& row, const FitValues& values) const {
    double torque = calcPayload(row, values);
    for (std::size_t b = 0; b < row.bodies.size(); ++b) torque += values.bodies[b] * row.bodies[b];
    return torque;
}
double TorqueFit::calcResidual(const TorqueEquation& row, const FitValues& values, const Averages& a) const {
    const Friction& law = values.friction[row.joint];
    return row.torque - row.sign * (law.coulomb + law.slope * a.viscous) - values.rotor[row.joint] * row.acceleration -
           values.offset[row.joint] - values.delay * row.torqueRate - calcMasses(row, values);
}
SparseRow TorqueFit::makeRow(const TorqueEquation& row, const FitLayout& layout, const FitValues& values,
                             const Averages& a) const {
    const auto i = static_cast<std::size_t>(row.joint);
    SparseRow entries;
    const auto add = [&](int place, double value) {
        if (place >= 0) entries.add(place, value);
    };
    add(layout.coulomb[i], row.sign);
    add(layout.slope[i], row.sign * a.viscous);
    add(layout.bend[i], row.sign * values.friction[i].slope * a.bendSlope);
    add(layout.rotor[i], row.acceleration);
    add(layout.offset[i], 1.0);
    add(layout.delay, row.torqueRate);
    add(layout.lag, -row.sign * values.friction[i].slope * a.rate);
    Eigen::Vector3d second = Eigen::Vector3d::Zero();
    if (isPoint_) second = calcSecond(row, values);
    add(layout.mass, row.payload[0] - (isPoint_ ? 0.5 * values.moment.dot(second) / values.mass : 0.0));
    for (std::size_t k = 0; k < 3; ++k) add(layout.moment[k], row.payload[1 + k] + second[static_cast<int>(k)]);
    for (std::size_t b = 0; b < row.bodies.size(); ++b) add(layout.bodies[b], row.bodies[b]);
    return entries;
}

/** Half the weighted sum of squares; with `regression`, its normal equations too. */
double TorqueFit::assemble(const FitValues& values, const FitLayout& layout, BlockRegression* regression) const {
    double squares = 0.0;
    for (std::size_t i = 0; i < n_; ++i) {
        if (!isFitted(i)) continue;
        const bool isBent = layout.bend[i] >= 0;
        for (const TorqueEquation* row : rows_[i]) {
            const Averages a = detail::average(*row, values.friction[i].bend, values.lag, regression && isBent);
            const double weight = row->weight / variance_[i];
            const double residual = calcResidual(*row, values, a);
            squares += weight * residual * residual;
            if (regression) regression->add(row->block, weight, makeRow(*row, layout, values, a), residual);
        }
    }
    return 0.5 * squares;
}

void TorqueFit::holdFixed() {
    for (std::size_t i = 0; i < n_; ++i) {
        Friction& law = values_.friction[i];
        if (choice.forms[i] == FrictionForm::KnownVelocity || choice.forms[i] == FrictionForm::CoulombOnly)
            law.bend = oldBend(i);
        if (choice.forms[i] == FrictionForm::CoulombOnly)
            law.slope = oldFriction().viscous[static_cast<int>(i)] * oldBend(i);
        if (choice.forms[i] == FrictionForm::Line) law.bend = 0.0;
        if (!choice.rotor[i]) values_.rotor[i] = 0.0;
        if (!choice.offset[i]) values_.offset[i] = 0.0;
    }
    for (std::size_t b = 0; b < n_; ++b)
        if (!choice.bodies[b]) values_.bodies[b] = 0.0;
    if (!choice.delay) values_.delay = 0.0;
    if (!choice.lag) values_.lag = 0.0;
    if (!choice.mass) values_.mass = 0.0;
    for (int k = 0; k < 3; ++k)
        if (!choice.moment[k]) values_.moment[k] = 0.0;
}

void TorqueFit::gaussNewton(const FitLayout& layout) {
    constexpr int kRounds = 40, kHalvings = 12;
    constexpr double kConverged = 1e-10;  // of the sum of squares
    for (int round = 0; round < kRounds; ++round) {
        BlockRegression regression(layout.size, equations_.blocks);
        const double before = assemble(values_, layout, &regression);
        const Eigen::VectorXd step = regression.solve(false).step;
        double share = 1.0, after = kInfinity;
        FitValues next;
        for (int halving = 0; halving < kHalvings; ++halving, share *= 0.5) {
            next = values_;
            take(layout, step, share, next);
            for (std::size_t i = 0; i < n_; ++i)
                if (layout.bend[i] >= 0)
                    next.friction[i].bend =
                        std::clamp(next.friction[i].bend, kLeastBend / fastest_[i], kMostBend / fastest_[i]);
            next.lag = std::clamp(next.lag, -equations_.window_s, equations_.window_s);
            after = assemble(next, layout, nullptr);
            if (after < before) break;
        }
        if (!(after < before)) return;
        values_ = std::move(next);
        if (before - after < kConverged * before) return;
    }
}

void TorqueFit::updateVariances() {
    for (std::size_t i = 0; i < n_; ++i) {
        if (!isFitted(i)) continue;
        double squares = 0.0, weights = 0.0;
        for (const TorqueEquation* row : rows_[i]) {
            const double r = calcResidual(*row, values_, average(*row));
            squares += row->weight * r * r;
            weights += row->weight;
        }
        variance_[i] = std::max(squares / weights, leastVariance(i));
    }
}

/** A mass that may be zero has no place, and its second moments would be noise over noise. */
bool TorqueFit::isMassSure(const FitLayout& layout) const {
    if (layout.mass < 0 || layout.moment == std::array<int, 3>{-1, -1, -1}) return false;
    return std::abs(values_.mass) > kSureMass * massError(layout) &&
           values_.moment.norm() < kFarthestCentre * std::abs(values_.mass);
}

double TorqueFit::massError(const FitLayout& layout) const {
    BlockRegression regression(layout.size, equations_.blocks);
    assemble(values_, layout, &regression);
    const Eigen::MatrixXd deletions = regression.solve(true).deletions;
    return std::sqrt(detail::calcJackknifeCovariance(deletions.row(layout.mass))(0, 0));
}

void TorqueFit::fit() {
    holdFixed();
    const FitLayout layout = makeLayout();
    if (layout.size == 0) return;
    isPoint_ = false;
    constexpr int kRounds = 4;  // weights change by little after two
    for (int round = 0; round < kRounds; ++round) {
        gaussNewton(layout);
        updateVariances();
        isPoint_ = isMassSure(layout);
    }
    gaussNewton(layout);
}

void TorqueFit::calcErrors(int extras,
                           const std::function<void(const TorqueEquation& row, double load, double* out)>& calcExtras) {
    layout_ = makeLayout();
    solution_ = {};
    covariance_.resize(0, 0);
    if (layout_.size == 0) return;
    BlockRegression regression(layout_.size, equations_.blocks, extras * static_cast<int>(n_));
    std::vector<double> extra(static_cast<std::size_t>(extras));
    for (std::size_t i = 0; i < n_; ++i) {
        if (!isFitted(i)) continue;
        for (const TorqueEquation* row : rows_[i]) {
            const Averages a = average(*row, layout_.bend[i] >= 0);
            const double weight = row->weight / variance_[i], residual = calcResidual(*row, a);
            const SparseRow entries = makeRow(*row, layout_, values_, a);
            regression.add(row->block, weight, entries, residual);
            calcExtras(*row, row->rigid + calcMasses(*row, values_), extra.data());
            for (int e = 0; e < extras; ++e)
                regression.addExtra(static_cast<int>(i) * extras + e, extra[e], row->block, weight, entries, residual);
        }
    }
    solution_ = regression.solve(true);
    covariance_ = calcJackknifeCovariance(solution_.deletions);
}

}  // namespace viable::detail
