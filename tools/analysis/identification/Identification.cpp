#include "analysis/identification/Identification.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "analysis/identification/TorqueFit.h"
#include "core/Text.h"
#include "records/WorkShare.h"

namespace viable {

namespace {

using detail::Averages;
using detail::BlockRegression;
using detail::TorqueEquation;
using detail::TorqueEquations;
using detail::TorqueFit;

constexpr double kLevel = 0.95;

/** A joint needs so much motion that its errors can be counted. */
constexpr int kLeastEquations = 20;
constexpr int kLeastJointBlocks = 5;
/** A figure is known when half of its interval is less than this share of itself, or of the joint's friction ... */
constexpr double kKnownShare = 0.5;
constexpr double kKnownFrictionShare = 0.1;
/** ... where a joint's friction is at least this share of its torque: of a joint without, too, can that be known. */
constexpr double kLeastFrictionShare = 0.05;
/** Less than this share of it is written as zero. */
constexpr double kNothing = 1e-4;
/** The viscous velocity that is written for a straight line, over the fastest speed: straight within 0.5 %. */
constexpr double kStraight = 100.0;
/** No figure is told to be better than this share of itself: delays are corrected to first order, a simulation's friction
acts in steps, and no torque is measured that well. */
constexpr double kLeastError = 1e-5;
/** The mean friction of a shaking joint is corrected by what the torques tell of the shaking, and known this well. */
constexpr double kShakingError = 0.25;
/** Longest delay, over the window of an equation. */
constexpr double kLongestDelay = 0.2;
/** Checks: wrong alarms among all of them together; from which shares of the friction on what they explain is told, and
is too much; and what must be explained of what the rigid arm leaves open. */
constexpr double kAlarmLevel = 0.01;
constexpr double kToldShare = 0.004;
constexpr double kDoubtfulShare = 0.05;
constexpr double kLeastExplained = 0.5;

struct Candidate {
    const char* name;
    double (*calc)(const TorqueEquation& row, double load, double fastest);
};

template <class Law>
double averageSpeeds(const TorqueEquation& row, const Law& law) {
    double sum = 0.0;
    for (std::size_t k = 0; k < row.speeds.size(); ++k) sum += row.shares[k] * law(row.speeds[k]);
    return sum;
}

double calcHump(const TorqueEquation& row, double scale) {
    return row.sign * averageSpeeds(row, [&](double v) { return std::exp(-(v / scale) * (v / scale)); });
}

/** Laws that are not fitted. `load` is the torque that the gear carries [Nm]. */
const Candidate kCandidates[] = {
    {"torque offset", [](const TorqueEquation&, double, double) { return 1.0; }},
    {"Stribeck effect",
     [](const TorqueEquation& row, double, double fastest) { return calcHump(row, 0.03 * fastest); }},
    {"Stribeck effect (wide)",
     [](const TorqueEquation& row, double, double fastest) { return calcHump(row, 0.12 * fastest); }},
    {"load friction", [](const TorqueEquation& row, double load, double) { return row.sign * std::abs(load); }},
    {"inertia error", [](const TorqueEquation& row, double, double) { return row.acceleration; }},
    {"tilt of the base about y", [](const TorqueEquation& row, double, double) { return row.tilt[0]; }},
    {"tilt of the base about x", [](const TorqueEquation& row, double, double) { return row.tilt[1]; }},
    {"mass error", [](const TorqueEquation& row, double, double) { return row.rigid; }},
    {"speed squared", [](const TorqueEquation& row, double,
                         double) { return row.sign * averageSpeeds(row, [](double v) { return v * v; }); }},
    {"direction",
     [](const TorqueEquation& row, double, double) { return averageSpeeds(row, [](double v) { return v; }); }},
};

constexpr int kCandidateCount = static_cast<int>(std::size(kCandidates));

/** With one more error that is independent of the others. */
IdentifiedFigure widen(IdentifiedFigure figure, double deviation, double quantile) {
    figure.deviation = std::hypot(figure.deviation, deviation);
    figure.lower = figure.value - quantile * figure.deviation;
    figure.upper = figure.value + quantile * figure.deviation;
    return figure;
}

IdentifiedFigure makeFigure(double value, double deviation, double quantile) {
    IdentifiedFigure figure;
    figure.value = value;
    figure.deviation = deviation;
    figure.isKnown = std::isfinite(value) && std::isfinite(deviation);
    return widen(figure, kLeastError * value, quantile);
}

/** The figure 1 / x of a figure x; for x > 0. */
IdentifiedFigure invert(const IdentifiedFigure& x) {
    IdentifiedFigure figure;
    figure.value = x.value > 0.0 ? 1.0 / x.value : kInfinity;
    figure.deviation = x.value > 0.0 ? x.deviation / (x.value * x.value) : kInfinity;
    figure.lower = x.upper > 0.0 ? 1.0 / x.upper : kInfinity;
    figure.upper = x.lower > 0.0 ? 1.0 / x.lower : kInfinity;
    figure.isKnown = x.lower > 0.0;
    return figure;
}

double halfWidth(const IdentifiedFigure& figure) {
    return 0.5 * (figure.upper - figure.lower);
}

/** The regression for one choice of what each joint's friction tells. */
class Estimator {
public:
    Estimator(const RobotDescription& nominal, const TorqueEquations& equations, const IdentificationOptions& options)
        : nominal_(nominal),
          equations_(equations),
          n_(static_cast<std::size_t>(nominal.size())),
          fit_(nominal, equations),
          choice_(fit_.choice),
          reasons_(n_),
          payload_(options.payload),
          asksForBodies_(options.bodyMasses) {
        const bool withCentre = options.payload == PayloadModel::MassAndCentre;
        choice_.forms.assign(n_, FrictionForm::Saturating);
        choice_.rotor.assign(n_, options.rotorInertias);
        choice_.offset.assign(n_, options.torqueOffsets);
        choice_.bodies.assign(n_, options.bodyMasses);
        choice_.delay = choice_.lag = options.delays;
        choice_.mass = options.payload != PayloadModel::None;
        choice_.moment.fill(withCentre);
        for (std::size_t i = 0; i < n_; ++i) {
            std::set<int> blocks;
            for (const TorqueEquation* row : fit_.rows(i)) blocks.insert(row->block);
            blockCount_.push_back(static_cast<int>(blocks.size()));
            const detail::JointActivity& activity = equations.joints[i];
            if (!activity.hasTorques)
                hold(i, "the records have no torques of it");
            else if (activity.largest == 0.0)
                hold(i, "it never moved");
            else if (static_cast<int>(fit_.rows(i).size()) < kLeastEquations || blockCount_[i] < kLeastJointBlocks)
                hold(i, "it moved too little: " + detail::formatNumber(std::round(100.0 * activity.moving_s) / 100.0) +
                            " s in one direction or the other beyond the noise, at most " +
                            formatSpeed(i, activity.largest));
            else
                fit_.startFriction(i, withCentre ? 4 : choice_.mass ? 1 : 0);
        }
    }

    /** Fits, and takes back what the motion does not tell, until all that is left is known. */
    void run() {
        // Each round takes at least one step down, and each joint has four.
        const int most = 4 * static_cast<int>(n_) + 8;
        for (int round = 0; round < most; ++round) {
            WorkShare::tell("fitting", static_cast<double>(round) / most);  // mostly a few rounds do
            fit_.fit();
            fit_.calcErrors(kCandidateCount, [&](const TorqueEquation& row, double load, double* out) {
                for (const Candidate& candidate : kCandidates)
                    *out++ = candidate.calc(row, load, fit_.fastest(static_cast<std::size_t>(row.joint)));
            });
            if (!removeLast()) return;
        }
    }

    Identification report() const;

private:
    std::string formatSpeed(std::size_t i, double speed) const {
        return detail::format("%.3g", speed) + (nominal_.joints[i].type == JointType::Prismatic ? " m/s" : " rad/s");
    }

    const JointFriction& old() const { return nominal_.actuation.friction; }
    bool isFitted(std::size_t i) const { return fit_.isFitted(i); }
    const detail::FitLayout& layout() const { return fit_.layout(); }
    const detail::FitValues& values() const { return fit_.values(); }

    void hold(std::size_t i, const std::string& reason) {
        choice_.forms[i] = FrictionForm::None;
        if (reasons_[i].empty()) reasons_[i] = reason;
    }

    bool isDetermined(int place) const {
        return fit_.solution().information[place] > BlockRegression::kLeastInformation;
    }
    /** Fitted, and not told. */
    bool isOpen(int place) const { return place >= 0 && !isDetermined(place); }
    double quantile(std::size_t joint) const { return detail::calcStudentQuantile(kLevel, blockCount_[joint] - 1); }
    double quantile() const { return detail::calcStudentQuantile(kLevel, equations_.blocks - 1); }
    IdentifiedFigure figure(int place, double value, double q) const {
        if (place < 0) return {};
        IdentifiedFigure f = makeFigure(value, std::sqrt(std::max(0.0, fit_.covariance()(place, place))), q);
        if (!isDetermined(place)) {
            f.isKnown = false;
            f.reason = "the motion does not tell it from other figures";
        }
        return f;
    }

    /** Friction at the joint's fastest speed, at least what can be seen beside its torque [Nm]. */
    double frictionScale(std::size_t i) const {
        const detail::Friction& law = values().friction[i];
        const double v = fit_.fastest(i);
        return std::max(std::abs(law.coulomb + law.slope * v * detail::calcBend(law.bend * v)),
                        kLeastFrictionShare * equations_.joints[i].torqueRms);
    }
    bool isKnown(std::size_t i, const IdentifiedFigure& f, double factor) const {
        const double width = factor * halfWidth(f);
        return f.isKnown &&
               width <= std::max(kKnownShare * std::abs(factor * f.value), kKnownFrictionShare * frictionScale(i));
    }
    bool isCoulombKnown(std::size_t i) const {
        return isKnown(i, figure(layout().coulomb[i], values().friction[i].coulomb, quantile(i)), 1.0);
    }
    bool isSlopeKnown(std::size_t i) const {
        const detail::Friction& law = values().friction[i];
        const double reach = fit_.fastest(i) * detail::calcBend(law.bend * fit_.fastest(i));
        return isKnown(i, figure(layout().slope[i], law.slope, quantile(i)), reach);
    }

    bool removeFriction(std::size_t i) {
        const std::string range = "speeds up to " + formatSpeed(i, fit_.fastest(i));
        switch (choice_.forms[i]) {
            case FrictionForm::Saturating: {
                const double bend = values().friction[i].bend;
                const IdentifiedFigure f = figure(layout().bend[i], bend, quantile(i));
                const bool isInside = bend < 0.999 * TorqueFit::kMostBend / fit_.fastest(i);
                if (isInside && f.isKnown && f.lower > 0.0 && isDetermined(layout().slope[i]) && isCoulombKnown(i) &&
                    values().friction[i].slope > 0.0)
                    return false;
                const bool wasBent = old().viscous[static_cast<int>(i)] > 0.0;
                const bool fits = !f.isKnown || (fit_.oldBend(i) >= f.lower && fit_.oldBend(i) <= f.upper);
                choice_.forms[i] = wasBent && fits ? FrictionForm::KnownVelocity : FrictionForm::Line;
                reasons_[i] =
                    range + (f.isKnown && f.lower > 0.0 ? " do not tell the bend of the friction from its jump"
                                                        : " do not show that the friction saturates");
                return true;
            }
            case FrictionForm::KnownVelocity:
            case FrictionForm::Line:
                if (isCoulombKnown(i) && isSlopeKnown(i)) return false;
                choice_.forms[i] = FrictionForm::CoulombOnly;
                reasons_[i] = range + " are too much the same to tell what grows with speed";
                return true;
            case FrictionForm::CoulombOnly:
                if (isCoulombKnown(i)) return false;
                choice_.forms[i] = FrictionForm::None;
                reasons_[i] =
                    "the motion does not tell friction from other torques: " + std::to_string(fit_.rows(i).size()) +
                    " equations with " + range;
                return true;
            case FrictionForm::None:
                break;
        }
        return false;
    }

    /** Of a delay that is not fitted, too. The equations hold delays that are short beside their windows. */
    bool isDelayKnown(int place, double delay) const {
        if (place < 0) return true;
        const IdentifiedFigure f = figure(place, delay, quantile());
        return f.isKnown && std::abs(delay) + halfWidth(f) < kLongestDelay * equations_.window_s;
    }

    /** Takes back the least certain; true where there was something. */
    bool removeLast() {
        if (layout().size == 0) return false;
        bool changed = false;
        if (layout().mass >= 0) {
            const std::array<int, 3>& moment = layout().moment;
            if (std::any_of(moment.begin(), moment.end(), [&](int place) { return isOpen(place); })) {
                for (std::size_t k = 0; k < 3; ++k)
                    if (isOpen(layout().mass) || isOpen(moment[k])) choice_.moment[k] = false;
                payloadReason_ = "the motion does not tell where the mass is in every direction of the tool frame";
                if (choice_.moment == std::array<bool, 3>{false, false, false}) payload_ = PayloadModel::Mass;
                changed = true;
            } else if (!isDetermined(layout().mass)) {
                payload_ = PayloadModel::None;
                choice_.mass = false;
                choice_.moment = {false, false, false};
                payloadReason_ = "the motion does not tell a mass at the tool from friction";
                changed = true;
            }
        }
        for (std::size_t i = 0; i < n_; ++i) {
            if (isOpen(layout().rotor[i])) choice_.rotor[i] = false, changed = true;
            if (isOpen(layout().offset[i])) choice_.offset[i] = false, changed = true;
        }
        // Together they may be one: then it is the torques'.
        if (!isDelayKnown(layout().lag, values().lag))
            choice_.lag = false, changed = true;
        else if (!isDelayKnown(layout().delay, values().delay))
            choice_.delay = false, changed = true;
        for (std::size_t b = 0; b < layout().bodies.size(); ++b)
            if (isOpen(layout().bodies[b])) choice_.bodies[b] = false, changed = true;
        if (changed) return true;  // what is left may be clearer without it
        for (std::size_t i = 0; i < n_; ++i) changed = (isFitted(i) && removeFriction(i)) || changed;
        return changed;
    }

    void reportFriction(std::size_t i, JointIdentification& joint) const;
    void reportResiduals(std::size_t i, int tests, JointIdentification& joint) const;
    void reportPayload(PayloadIdentification& payload) const;

    const RobotDescription& nominal_;
    const TorqueEquations& equations_;
    std::size_t n_;
    TorqueFit fit_;
    detail::FitChoice& choice_;
    std::vector<int> blockCount_;  // of blocks with equations, per joint
    std::vector<std::string> reasons_;
    PayloadModel payload_;
    std::string payloadReason_;
    bool asksForBodies_;
};

void Estimator::reportFriction(std::size_t i, JointIdentification& joint) const {
    const int at = static_cast<int>(i);
    joint.old = {old().coulomb[at], old().viscous[at], old().viscousVelocity[at]};
    joint.written = joint.old;
    joint.form = choice_.forms[i];
    joint.reason = reasons_[i];
    joint.covariance.setZero();
    const auto leave = [&](IdentifiedFigure& f) { f.isKnown = false, f.reason = reasons_[i]; };
    if (!isFitted(i)) {
        for (IdentifiedFigure* f : {&joint.coulomb, &joint.viscous, &joint.viscousVelocity, &joint.slope}) leave(*f);
        return;
    }
    const double q = quantile(i);
    const detail::Friction& law = values().friction[i];
    const std::array<int, 3> places{layout().coulomb[i], layout().slope[i], layout().bend[i]};
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
            const int row = places[a], column = places[b];
            if (row >= 0 && column >= 0) joint.covariance(a, b) = fit_.covariance()(row, column);
        }
    // What the shaking takes from the law's mean near rest, where coulomb and viscous share it.
    double square = 0.0;
    for (const TorqueEquation* row : fit_.rows(i))
        square += row->shaking * row->shaking / static_cast<double>(fit_.rows(i).size());
    const double shaken = kShakingError * 0.5 * law.slope * law.bend * square;  // [Nm]
    joint.coulomb = widen(figure(places[0], law.coulomb, q), shaken, q);
    const double nothing = kNothing * frictionScale(i);
    joint.written[0] = joint.coulomb.upper > nothing ? std::max(0.0, law.coulomb) : 0.0;
    joint.slope = figure(places[1], law.slope, q);
    joint.rotorInertia = figure(layout().rotor[i], values().rotor[i], q);
    joint.torqueOffset = figure(layout().offset[i], values().offset[i], q);
    if (choice_.forms[i] == FrictionForm::Saturating) {
        const IdentifiedFigure bend = figure(places[2], law.bend, q);
        joint.viscousVelocity = invert(bend);
        // 1 / Fv1 = bend / slope: its error is nearer to normal than Fv1's.
        const Eigen::Vector2d slopes(-law.bend / (law.slope * law.slope), 1.0 / law.slope);
        const double inverse = law.bend / law.slope;
        const double variance = slopes.dot(joint.covariance.bottomRightCorner<2, 2>() * slopes);
        joint.viscous =
            invert(makeFigure(inverse, std::hypot(std::sqrt(std::max(0.0, variance)), shaken * inverse * inverse), q));
        joint.written[1] = joint.viscous.value;
        joint.written[2] = joint.viscousVelocity.value;
    } else if (choice_.forms[i] == FrictionForm::CoulombOnly) {
        for (IdentifiedFigure* f : {&joint.viscous, &joint.viscousVelocity, &joint.slope}) leave(*f);
    } else {
        leave(joint.viscousVelocity);
        leave(joint.viscous);
        const double velocity = choice_.forms[i] == FrictionForm::Line ? kStraight * fit_.fastest(i) : joint.old[2];
        const bool isNothing = joint.slope.upper * fit_.fastest(i) < nothing || law.slope <= 0.0;
        joint.written[1] = isNothing ? 0.0 : law.slope * velocity;
        joint.written[2] = isNothing ? joint.old[2] : velocity;
        if (choice_.forms[i] == FrictionForm::KnownVelocity)  // given that velocity
            joint.viscous = makeFigure(law.slope * velocity, velocity * joint.slope.deviation, q);
    }
}

void Estimator::reportResiduals(std::size_t i, int tests, JointIdentification& joint) const {
    if (!isFitted(i)) return;
    double weights = 0.0, squares = 0.0, open = 0.0, friction = 0.0, product = 0.0, pairs = 0.0;
    std::vector<double> residuals;
    for (const TorqueEquation* row : fit_.rows(i)) {
        const detail::Friction& law = values().friction[i];
        const Averages a = fit_.average(*row);
        const double r = fit_.calcResidual(*row, a);
        const double f = law.coulomb + law.slope * a.viscous;
        residuals.push_back(r);
        weights += row->weight;
        squares += row->weight * r * r;
        open += row->weight * row->torque * row->torque;
        friction += row->weight * f * f;
    }
    for (std::size_t k = 2; k < residuals.size(); ++k) {
        if (fit_.rows(i)[k]->run != fit_.rows(i)[k - 2]->run) continue;
        product += residuals[k] * residuals[k - 2];
        pairs += 0.5 * (residuals[k] * residuals[k] + residuals[k - 2] * residuals[k - 2]);
    }
    joint.frictionRms = std::sqrt(friction / weights);
    joint.residualRms = std::sqrt(squares / weights);
    joint.explained = open > 0.0 ? 1.0 - squares / open : 0.0;
    joint.correlation = pairs > 0.0 ? product / pairs : 0.0;
    // Beside a joint's torque the friction of one without is nothing, and nothing is its share.
    const double scale = std::max(joint.frictionRms, kLeastFrictionShare * equations_.joints[i].torqueRms);
    double worst = 0.0;
    const auto take = [&](ResidualCheck check, double least) {
        check.isFound = std::abs(check.t) > least && check.share > kToldShare;
        if (check.isFound) worst = std::max(worst, check.share);
        joint.checks.push_back(check);
    };
    // Every second window is apart from the last: half of the equations tell something new.
    const double normalAlarm = detail::calcNormalQuantile(1.0 - kAlarmLevel / tests);
    const double rho = std::clamp(joint.correlation, 0.0, 0.99);
    const double independent = 0.5 * static_cast<double>(residuals.size()) * (1.0 - rho) / (1.0 + rho);
    take({"residuals that last", std::sqrt(std::max(0.0, joint.correlation)) * joint.residualRms / scale,
          joint.correlation * std::sqrt(0.5 * static_cast<double>(residuals.size())), false},
         normalAlarm);
    // A law of slow motion, say, is told by some of the blocks only.
    const double alarm = detail::calcStudentQuantile(1.0 - kAlarmLevel / tests, std::max(8, blockCount_[i] / 2));
    for (std::size_t c = 0; c < std::size(kCandidates); ++c) {
        const std::size_t at = i * std::size(kCandidates) + c;
        ResidualCheck check;
        check.name = kCandidates[c].name;
        const double sum = fit_.variance(i) * fit_.solution().extraSquares[at];
        check.share = std::sqrt(sum / weights) / scale;
        check.t = fit_.solution().extraError[at] > 0.0
                      ? fit_.solution().extraFactor[at] / fit_.solution().extraError[at]
                      : 0.0;
        // A jackknife over blocks cannot be sure of what acts in few of them only; the share of all residuals can,
        // as far as these have one variance.
        const double share = std::min(sum / squares, 1.0 - 1e-12);
        const double plain = std::copysign(std::sqrt(independent * share / (1.0 - share)), check.t);
        if (std::abs(plain) > normalAlarm && std::abs(check.t) < alarm) check.t = plain;
        take(check, check.t == plain ? normalAlarm : alarm);
    }
    const bool isExplained = joint.explained >= kLeastExplained || joint.residualRms < kToldShare * scale;
    joint.verdict = worst > kDoubtfulShare || !isExplained ? ModelVerdict::Doubtful
                    : worst > kToldShare                   ? ModelVerdict::Approximate
                                                           : ModelVerdict::Adequate;
}

void Estimator::reportPayload(PayloadIdentification& payload) const {
    payload.model = layout().mass >= 0 ? payload_ : PayloadModel::None;
    payload.reason = payloadReason_;
    if (layout().mass < 0) {
        if (payload.reason.empty())
            payload.reason = payload_ == PayloadModel::None ? "not asked for" : "no joint's torques tell it";
        return;
    }
    const double q = quantile();
    payload.mass = figure(layout().mass, values().mass, q);
    for (std::size_t k = 0; k < 3; ++k) {
        const int place = layout().moment[k];
        if (place < 0) {
            payload.moment[k].reason = payload.centre[k].reason =
                payloadReason_.empty() ? "not asked for" : payloadReason_;
            continue;
        }
        const double moment = values().moment[static_cast<int>(k)];
        payload.moment[k] = figure(place, moment, q);
        if (!payload.isFound()) {
            payload.centre[k].reason = "the mass may be zero";
            continue;
        }
        const double m = values().mass;
        const Eigen::Vector2d slopes(-moment / (m * m), 1.0 / m);
        Eigen::Matrix2d C;
        C << fit_.covariance()(layout().mass, layout().mass), fit_.covariance()(layout().mass, place),
            fit_.covariance()(place, layout().mass), fit_.covariance()(place, place);
        payload.centre[k] = makeFigure(moment / m, std::sqrt(std::max(0.0, slopes.dot(C * slopes))), q);
    }
}

Identification Estimator::report() const {
    Identification found;
    found.robot = nominal_.name;
    found.duration_s = equations_.duration_s;
    found.window_s = equations_.window_s;
    found.block_s = equations_.block_s;
    found.blocks = equations_.blocks;
    int tests = 0;
    for (std::size_t i = 0; i < n_; ++i)
        if (isFitted(i)) tests += 1 + kCandidateCount;
    for (std::size_t i = 0; i < n_; ++i) {
        JointIdentification& joint = found.joints.emplace_back();
        joint.name = nominal_.joints[i].name;
        joint.isPrismatic = nominal_.joints[i].type == JointType::Prismatic;
        joint.blocks = blockCount_[i];
        joint.moving_s = equations_.joints[i].moving_s;
        joint.fastest = fit_.fastest(i);
        joint.slowest = joint.fastest;
        for (const TorqueEquation* row : fit_.rows(i))
            joint.slowest = std::min(joint.slowest, *std::min_element(row->speeds.begin(), row->speeds.end()));
        reportFriction(i, joint);
        if (!isFitted(i)) continue;
        joint.equations = static_cast<int>(fit_.rows(i).size());
        found.equations += joint.equations;
        reportResiduals(i, tests, joint);
    }
    found.torqueDelay = figure(layout().delay, values().delay, quantile());
    found.frictionDelay = figure(layout().lag, values().lag, quantile());
    reportPayload(found.payload);
    for (std::size_t b = 0; asksForBodies_ && b < n_; ++b) {
        IdentifiedFigure f = figure(layout().bodies[b], 1.0 + values().bodies[b], quantile());
        if (layout().bodies[b] < 0) f.reason = "the motion does not tell it";
        found.bodyMasses.push_back(f);
    }
    return found;
}

}  // namespace

const char* getName(FrictionForm form) {
    return detail::enumName<FrictionForm::None>(form, {"saturating", "known_velocity", "line", "coulomb_only", "none"},
                                                "none");
}

const char* getName(ModelVerdict verdict) {
    return detail::enumName<ModelVerdict::Doubtful>(verdict, {"not identified", "adequate", "approximate", "doubtful"},
                                                    "not identified");
}

Identification identify(const RobotDescription& nominal, const std::vector<MotionRecord>& records,
                        const IdentificationOptions& options) {
    const TorqueEquations equations = detail::makeTorqueEquations(nominal, records, options);
    Estimator estimator(nominal, equations, options);
    estimator.run();
    WorkShare::tell("fitting", 1.0);
    Identification found = estimator.report();
    for (const MotionRecord& record : records) found.sources.push_back(record.source);
    return found;
}

}  // namespace viable
