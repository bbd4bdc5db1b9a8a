#include "viable/tracking/TrackingBound.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/Text.h"
#include "tracking/ArmExtremes.h"
#include "tracking/FrozenLoop.h"
#include "viable/core/Error.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

using detail::ArmExtremes;
using detail::FrozenLoop;
using detail::LoopGains;
using detail::LoopOutput;
using detail::TorqueRange;
using Eigen::MatrixXd;

/** Of the fixed point; far below what the sample of poses leaves open. */
constexpr double kAgreement = 1e-9;
constexpr int kMaxRounds = 2000;
/** A bound beyond this is none [rad, rad/s]. */
constexpr double kLargestBound = 100.0;
/** Stable gains are looked for down to this share. */
constexpr double kLeastGain = 1e-4, kGainStep = 0.9;

JointVector takeLargest(const JointBounds& bounds) {
    return bounds.lower.cwiseAbs().cwiseMax(bounds.upper.cwiseAbs());
}

const MatrixXd& at(const LoopGains::PerOutput& gains, LoopOutput output) {
    return gains[static_cast<std::size_t>(output)];
}

std::string list(const JointVector& values) {
    std::string text;
    for (double value : values) detail::addItem(text, detail::format("%.4g", value));
    return values.size() == 1 ? text : "[" + text + "]";
}

/** All that the bound is made of. */
class BoundMaker {
public:
    BoundMaker(const RobotDescription& robot, const JointLimits& limits, double tick_s, const NricOptions& gains,
               const DisturbanceSet& set, const std::string& place)
        : robot_(robot),
          limits_(limits),
          n_(robot.size()),
          h_(tick_s),
          set_(set),
          place_(place),
          kr_(gains.kr.expand(n_)),
          kp_(gains.kp.expand(n_)),
          ki_(gains.ki.expand(n_)),
          feed_(detail::takeFriction(gains.friction, robot.size())),
          motion_{takeLargest(limits.velocity), takeLargest(limits.acceleration), takeLargest(limits.jerk)} {
        for (int i = 0; i < n_; ++i) {
            if (std::isfinite(motion_.velocity[i]) && std::isfinite(motion_.acceleration[i])) continue;
            throw badInput(place,
                           "joint " + robot.joints[static_cast<std::size_t>(i)].name +
                               " has no limit on velocity or acceleration: no bound without them",
                           "Give both in `limits`.");
        }
        checkFriction(gains);
        // A jerk without limit: from one end of the acceleration to the other in a tick.
        motion_.jerk = motion_.jerk.cwiseMin(2.0 / h_ * motion_.acceleration);
        arm_ = detail::findArmExtremes(robot, limits, motion_, set, kr_, place);
        if (!feed_.isActive()) {
            const JointFriction& f = robot.actuation.friction;
            feed_ = {{JointVector::Zero(n_), JointVector::Zero(n_), f.viscousVelocity}, JointVector::Ones(n_)};
        }
        const JointFriction& f = robot.actuation.friction;
        damping_ = 0.5 * set.frictionScale.expand(n_).cwiseProduct(f.viscous.cwiseQuotient(f.viscousVelocity));
    }

    TrackingBound make() {
        checkStability();
        JointVector e = JointVector::Zero(n_), de = e, load = e;
        const JointVector none = JointVector::Zero(n_);
        const std::vector<LoopGains> free = calcAllGains(none);
        std::vector<View> views{{none, true, free}};
        if (damping_.maxCoeff() > 0.0) {
            if (set_.isFrictionConstant) views.push_back({none, false, free});
            views.push_back({damping_, false, calcAllGains(damping_)});
        }
        std::string worst;
        // |e|, |de| and the torque carried are bounded by themselves: iterated from zero upwards, the first fixed point
        // is a bound, for e and de start at zero and change steadily.
        for (int round = 0; round < kMaxRounds; ++round) {
            TrackingBound bound = evaluate(views.front(), e, de, load);
            for (std::size_t k = 1; k < views.size(); ++k) takeSmaller(evaluate(views[k], e, de, load), bound);
            const double change =
                std::max((bound.position - e).cwiseAbs().maxCoeff(), (bound.velocity - de).cwiseAbs().maxCoeff());
            e = bound.position;
            de = bound.velocity;
            load = bound.torque;
            worst = findLargestPart(bound);
            if (!e.allFinite() || !de.allFinite() || e.maxCoeff() > kLargestBound || de.maxCoeff() > kLargestBound)
                break;
            if (change <= kAgreement * std::max(1.0, de.maxCoeff())) return bound;
        }
        throw badInput(place_,
                       "no bound exists: the disturbance that the error itself causes grows faster than the robust "
                       "loop reduces it, mainly: " +
                           worst,
                       std::string("Raise k_r towards the largest stable value, lower the limits of velocity and "
                                   "acceleration, or state a smaller disturbance_set") +
                           (damping_.maxCoeff() > 0.0 && !set_.isFrictionConstant
                                ? ": less friction_scale, or `friction: constant_in_a_run` where the factor of the "
                                  "friction does not change in a run."
                                : "."));
    }

private:
    /** Viscous friction is a torque that takes any course (`isWhole`); or it is taken at the nominal velocity, where it is known
    but for its factor, and what the error of the velocity adds to it is such a torque, or the arm's damping, give or take as
    much. Which bound is the smaller depends on how much friction there is. */
    struct View {
        JointVector damping;
        bool isWhole;
        std::vector<LoopGains> gains;  // by inertia
    };

    std::vector<LoopGains> calcAllGains(const JointVector& damping) const {
        std::vector<LoopGains> gains;
        for (const detail::PoseInertia& pose : arm_.inertias) {
            gains.push_back(detail::calcGains(makeLoop(pose.M, damping, kr_)));
            checkFinite(gains.back(), pose);
        }
        return gains;
    }

    static std::string findLargestPart(const TrackingBound& bound) {
        return std::max_element(bound.parts.begin(), bound.parts.end(),
                                [](const auto& a, const auto& b) { return a.velocity.sum() < b.velocity.sum(); })
            ->source;
    }

    /** Both hold, so does the smaller one of each. */
    static void takeSmaller(const TrackingBound& other, TrackingBound& bound) {
        const auto take = [](const JointVector& from, JointVector& to) {
            to = to.binaryExpr(from, &detail::smallerOrNan).eval();
        };
        if (other.position.sum() < bound.position.sum()) bound.parts = other.parts;
        take(other.position, bound.position);
        take(other.velocity, bound.velocity);
        take(other.measured, bound.measured);
        take(other.torque, bound.torque);
        take(other.lastingTorque, bound.lastingTorque);
        take(other.torqueStep, bound.torqueStep);
        take(other.integralTorque, bound.integralTorque);
    }

    FrozenLoop makeLoop(const JointMatrix& M, const JointVector& damping, const JointVector& kr) const {
        return {M, damping, kr.asDiagonal(), kp_, ki_, h_, set_.delayTicks};
    }
    /** With any damping that the friction can be. Not finite counts as unstable. */
    double calcWorstRadius(const JointVector& kr) const {
        double worst = 0.0;
        for (const detail::PoseInertia& pose : arm_.inertias)
            for (const double share : {0.0, 1.0, 2.0}) {
                const double radius = detail::calcSpectralRadius(makeLoop(pose.M, share * damping_, kr));
                worst = std::isfinite(radius) ? std::max(worst, radius) : INFINITY;
            }
        return worst;
    }

    void checkFinite(const LoopGains& gains, const detail::PoseInertia& pose) const {
        for (const auto* all : {&gains.torque, &gains.step, &gains.ramp, &gains.reading})
            for (const MatrixXd& values : *all)
                for (int i = 0; i < n_; ++i)
                    if (!values.row(i).allFinite())
                        throw badInput(
                            place_,
                            "the peak gain of the error loop at " + robot_.joints[static_cast<std::size_t>(i)].name +
                                " is not finite at q = " + detail::formatList(pose.q) + ": no bound can be computed",
                            "Its inertia there is " + detail::formatNumber(pose.M(i, i)) +
                                " kg m^2: check masses, rotor inertia, friction and gains of this joint.");
    }

    void checkFriction(const NricOptions& gains) const {
        const JointFriction& f = robot_.actuation.friction;
        for (int i = 0; i < n_; ++i) {
            const double least = set_.frictionScaleMin[i], largest = set_.frictionScale[i];
            if (!std::isfinite(f.coulomb[i] + f.viscous[i] + largest) || !(f.viscousVelocity[i] > 0.0))
                throw badInput(place_,
                               "the friction of " + robot_.joints[static_cast<std::size_t>(i)].name + " is not finite",
                               "Correct the robot's figures or friction_scale.");
            if (least >= 0.0 && least <= largest) continue;
            throw badInput(place_,
                           "friction_scale_min of " + robot_.joints[static_cast<std::size_t>(i)].name + " is " +
                               detail::formatNumber(least) + "; allowed is from 0 to its friction_scale, " +
                               detail::formatNumber(largest),
                           "Give the smallest and the largest factor on the robot's friction figures.");
        }
        if (!std::isinf(gains.inertiaRate) || !gains.motorRate.expand(n_).array().isInf().all())
            throw badInput(place_, "no bound is known for gains that follow the inertia, nor for a motor rate",
                           "Give constant gains and no motor rate.");
    }

    void checkStability() const {
        if (kr_.cwiseProduct(kp_).cwiseProduct(ki_).minCoeff() <= 0.0)
            throw badInput(place_, "a gain of the robust loop is 0: nothing reduces that joint's error",
                           "Give k_r, k_p and k_i above 0 for every joint.");
        if (calcWorstRadius(kr_) < 1.0) return;
        // Too little is unstable as well, against k_i: so from above.
        double stable = kGainStep, unstable = 1.0;
        while (stable > kLeastGain && calcWorstRadius(stable * kr_) >= 1.0) {
            unstable = stable;
            stable *= kGainStep;
        }
        const bool any = stable > kLeastGain;
        for (int i = 0; any && i < 12; ++i) {
            const double middle = std::sqrt(stable * unstable);
            (calcWorstRadius(middle * kr_) < 1.0 ? stable : unstable) = middle;
        }
        const bool equal = kr_.minCoeff() == kr_.maxCoeff();
        throw badInput(place_,
                       "the robust loop is unstable with k_r = " + list(equal ? kr_.head(1) : kr_) + " at a tick of " +
                           detail::formatNumber(h_) + " s" +
                           (set_.delayTicks > 0 ? " and a delay of " + std::to_string(set_.delayTicks) + " ticks" : ""),
                       (any ? "The largest stable value, the other gains kept, is " +
                                  list(stable * (equal ? JointVector(kr_.head(1)) : kr_)) + ". "
                            : "") +
                           adviseGains());
    }

    /** One k_r does not suit joints of different inertia. */
    std::string adviseGains() const {
        const JointVector largest = findLargestGains(robot_, limits_, h_, set_.delayTicks);
        Eigen::Index joint = 0;
        if (kr_.cwiseQuotient(largest).maxCoeff(&joint) < 1.0)
            return "k_p or k_i is too large for such a k_r: at most a fifth of k_r over the joint's greatest inertia, "
                   "which `viable gains` prints, and a tenth of k_p^2.";
        return "That of " + robot_.joints[static_cast<std::size_t>(joint)].name + " is " +
               detail::formatNumber(kr_[joint]) + "; those with which the loop just becomes unstable, together, are " +
               detail::formatList(largest) + ": take half of them.";
    }

    /** The sum of v_k times part k. */
    MatrixXd sum(const std::vector<MatrixXd>& parts, const JointVector& v) const {
        MatrixXd total = MatrixXd::Zero(n_, n_);
        for (int k = 0; k < n_; ++k) total += v[k] * parts[static_cast<std::size_t>(k)];
        return total;
    }

    struct Source {
        const char* name;
        TorqueRange torque;
        JointVector rate;   ///< largest [Nm/s]; infinity: it may jump
        JointVector start;  ///< largest in an arm at rest [Nm]
        bool lasts = true;  ///< more than a moment
    };

    Source makeJumping(const char* name, const JointVector& size, bool lasts = true) const {
        return {name, TorqueRange::within(size), JointVector::Constant(n_, INFINITY), size, lasts};
    }

    /** The torques that do not depend on the error, with those that its size bounds. */
    std::vector<Source> listSources(const View& view, const JointVector& e, const JointVector& de,
                                    const JointVector& load) const {
        const JointVector fastest = motion_.velocity + de;
        const JointFriction& f = robot_.actuation.friction;
        const bool isDamped = view.damping.maxCoeff() > 0.0;
        JointVector dry(n_), viscous(n_), viscousRate(n_), onLoad(n_), slipping(n_), fedLate(n_);
        for (int i = 0; i < n_; ++i) {
            const FrictionFeed& fed = feed_;
            const double V = f.viscousVelocity[i], scale = set_.frictionScale[i];
            // What is fed forward is held for a tick and arrives late: the nominal velocity has changed by so much.
            const double sinceThen = (1.0 + set_.delayTicks) * h_ * motion_.acceleration[i];
            fedLate[i] = fed.figures.viscous[i] / fed.figures.viscousVelocity[i] * sinceThen;
            // The real joint may move against what is fed forward where the nominal one is slower than the error.
            const double against = fed.figures.coulomb[i] * std::min(1.0, (de[i] + sinceThen) / fed.speed[i]);
            dry[i] =
                std::max(calcStanding(i) + against, fed.figures.coulomb[i] - set_.frictionScaleMin[i] * f.coulomb[i]);
            viscous[i] = calcUnknownViscous(i);
            viscousRate[i] = set_.isFrictionConstant ? calcUnknownSlope(i) * motion_.acceleration[i] : INFINITY;
            // Most between two velocities that are de apart: where they are opposite.
            slipping[i] = isDamped ? view.damping[i] * de[i] : 2.0 * scale * calcViscous(i, 0.5 * de[i]);
            const double moving = scale * calcViscous(i, fastest[i]);
            if (view.isWhole) {
                viscous[i] += slipping[i];
                if (fed.figures.viscous[i] == 0.0) viscous[i] = std::min(viscous[i], moving);
                viscousRate[i] = INFINITY;
                slipping[i] = 0.0;
            }
            // Of the torque that the gear carries, friction and ripple with it.
            onLoad[i] = set_.loadFriction[i] * (load[i] + calcStanding(i) + moving + set_.torqueRipple_Nm[i]);
        }
        const JointVector jerkTorque = arm_.inertia * motion_.jerk;
        const JointVector rest =
            arm_.stiffness * motion_.velocity + 2.0 * sum(arm_.coriolis, motion_.velocity) * motion_.acceleration;
        // tau_c is held for a tick and is, within it, off what the nominal arm needs; and it arrives late.
        const JointVector held = h_ * (0.5 * jerkTorque + rest) + set_.delayTicks * h_ * (jerkTorque + rest);
        // d(M de)/dt leaves dM/dt de = (C + C') de, the velocities' part of b takes C(qd + qd_nominal) de.
        const JointVector ofError = arm_.stiffness * e + (sum(arm_.gyroscopic, fastest) + sum(arm_.coriolis, de)) * de;
        return {
            makeJumping("dry friction", dry, false),  // the lasting part of both: see lastingTorque
            {"viscous friction", TorqueRange::within(viscous), viscousRate, JointVector::Zero(n_), false},
            makeJumping("friction fed forward late", fedLate, false),
            makeJumping("viscous friction off the nominal speed", slipping, false),
            makeJumping("friction under load", onLoad, false),  // its lasting part: see lastingTorque
            {"payload", arm_.payload, arm_.payloadRate, arm_.payloadWeight},
            {"mass error", arm_.massError, arm_.massErrorRate, arm_.massErrorWeight},
            {"tilted base", arm_.tilt, arm_.tiltRate, arm_.tilt.upper},
            makeJumping("torque ripple", set_.torqueRipple_Nm.expand(n_)),
            makeJumping("external torque", set_.externalTorque_Nm.expand(n_)),
            makeJumping(set_.delayTicks > 0 ? "held and late torque" : "torque held for a tick", held, false),
            makeJumping("velocity read half a tick late", calcLateReading(), false),
            makeJumping("dynamics off the nominal pose and speed", ofError, false),
        };
    }

    /** Dry friction at most [Nm]. */
    double calcStanding(int i) const {
        return set_.frictionScale[i] * robot_.actuation.friction.coulomb[i] * set_.breakawayRatio;
    }

    /** Viscous friction of the robot's figures at the velocity v [Nm]. */
    double calcViscous(int i, double v) const {
        const JointFriction& f = robot_.actuation.friction;
        return -f.viscous[i] * std::expm1(-v / f.viscousVelocity[i]);
    }

    /** The largest |c + b exp(-v/B) - a exp(-v/A)|, b and a >= 0, over velocities v from 0 to the limit: at an end, or where
    the slope changes its sign. */
    double findLargest(int joint, double c, double b, double B, double a, double A) const {
        const double end = motion_.velocity[joint];
        const auto calc = [&](double v) { return std::abs(c + b * std::exp(-v / B) - a * std::exp(-v / A)); };
        double largest = std::max(calc(0.0), calc(end));
        const double v = std::log((a / A) / (b / B)) / (1.0 / A - 1.0 / B);
        if (v > 0.0 && v < end) largest = std::max(largest, calc(v));
        return largest;
    }

    /** What of the viscous friction at the nominal velocity is not fed forward [Nm]. */
    double calcUnknownViscous(int i) const {
        const JointFriction &f = robot_.actuation.friction, &fed = feed_.figures;
        double largest = 0.0;
        for (const double scale : {set_.frictionScaleMin[i], set_.frictionScale[i]})
            largest =
                std::max(largest, findLargest(i, scale * f.viscous[i] - fed.viscous[i], fed.viscous[i],
                                              fed.viscousVelocity[i], scale * f.viscous[i], f.viscousVelocity[i]));
        return largest;
    }

    /** And of its slope over the velocity [Nms/rad]. */
    double calcUnknownSlope(int i) const {
        const JointFriction &f = robot_.actuation.friction, &fed = feed_.figures;
        double largest = 0.0;
        for (const double scale : {set_.frictionScaleMin[i], set_.frictionScale[i]})
            largest =
                std::max(largest, findLargest(i, 0.0, fed.viscous[i] / fed.viscousVelocity[i], fed.viscousVelocity[i],
                                              scale * f.viscous[i] / f.viscousVelocity[i], f.viscousVelocity[i]));
        return largest;
    }

    /** Half a count and the noise [rad]. */
    JointVector calcReadingError() const {
        JointVector error = JointVector::Constant(n_, set_.readingError_rad);
        for (int i = 0; i < n_; ++i) error[i] += 0.5 * robot_.encoderStep(i);
        return error;
    }

    /** The torque from reading the velocity as a difference, which shows it half a tick ago. */
    JointVector calcLateReading() const {
        return kr_.cwiseProduct(0.5 * h_ * motion_.acceleration + h_ * h_ / 6.0 * motion_.jerk);
    }

    /** What de does through an inertia that was another in the past. */
    MatrixXd calcDrift(const LoopGains& gains, LoopOutput output, const MatrixXd& inertiaRate) const {
        MatrixXd drift = MatrixXd::Zero(n_, n_);
        for (const LoopGains::Variation& span : gains.variations)
            for (int i = 0; i < n_; ++i)
                for (int k = 0; k < n_; ++k) {
                    const double total = at(span.total, output)(i, k);
                    const double aged = at(span.aged, output)(i, k);
                    for (int j = 0; j < n_; ++j)
                        drift(i, j) += std::min(aged * inertiaRate(k, j), total * arm_.inertiaRange(k, j));
                }
        return drift;
    }

    /** The bounds that follow when e, de and the torque keep to those given. */
    TrackingBound evaluate(const View& view, const JointVector& e, const JointVector& de,
                           const JointVector& load) const {
        const JointVector fastest = motion_.velocity + de;
        const std::vector<Source> sources = listSources(view, e, de, load);
        const MatrixXd inertiaRate = sum(arm_.gradient, fastest);
        const JointVector reading = calcReadingError(), late = calcLateReading();
        TrackingBound out;
        const JointVector zero = JointVector::Zero(n_);
        for (const Source& source : sources)
            out.parts.push_back({source.name, source.torque.calcLargest(), zero, zero});
        out.parts.push_back({"encoder", zero, zero, zero});
        out.parts.push_back({"inertia that changes", zero, zero, zero});
        for (JointVector* v : {&out.position, &out.velocity, &out.torque, &out.torqueStep, &out.integralTorque})
            *v = zero;
        const auto take = [](const JointVector& value, JointVector& largest) {
            // What is not finite stays so and ends the search.
            largest = largest.binaryExpr(value, &detail::largerOrNan).eval();
        };
        for (const LoopGains& g : view.gains) {
            const auto raise = [&](JointVector& largest, LoopOutput output) {
                JointVector total = zero;
                for (std::size_t k = 0; k < out.parts.size(); ++k) {
                    const JointVector part = k < sources.size() ? calcEffect(g, output, sources[k])
                                             : k == sources.size()
                                                 ? JointVector(at(g.reading, output) * reading)
                                                 : JointVector(calcDrift(g, output, inertiaRate) * de);
                    total += part;
                    if (output == LoopOutput::Position) take(part, out.parts[k].position);
                    if (output == LoopOutput::Velocity) take(part, out.parts[k].velocity);
                }
                take(total, largest);
            };
            raise(out.position, LoopOutput::Position);
            raise(out.velocity, LoopOutput::Velocity);
            raise(out.torque, LoopOutput::Torque);
            raise(out.torqueStep, LoopOutput::TorqueStep);
            raise(out.integralTorque, LoopOutput::IntegralTorque);
        }
        out.measured = out.position + reading;
        JointVector fed(n_), fedStep(n_);
        for (int i = 0; i < n_; ++i) {
            const JointFriction& f = feed_.figures;
            fed[i] = feed_.calc(i, motion_.velocity[i]);
            fedStep[i] =
                h_ * motion_.acceleration[i] * (f.coulomb[i] / feed_.speed[i] + f.viscous[i] / f.viscousVelocity[i]);
        }
        out.torque += arm_.nominalTorque + late + fed;
        // The motors carry the friction itself, whoever asks them for it.
        out.lastingTorque = arm_.nominalTorque;
        for (int i = 0; i < n_; ++i)
            out.lastingTorque[i] += calcStanding(i) + set_.frictionScale[i] * calcViscous(i, motion_.velocity[i]);
        for (const Source& source : sources)
            if (source.lasts) out.lastingTorque += source.torque.calcLargest();
        out.lastingTorque += set_.loadFriction.expand(n_).cwiseProduct(out.lastingTorque);
        out.torqueStep += 2.0 * late + fedStep;
        out.motorTorque = set_.torqueLimitFactor * robot_.actuation.torqueLimit;
        return out;
    }

    /** The largest output that a source causes: as a torque that takes any course within its range, or as one that is
    somewhere in it at the start and then goes no faster than it can. */
    JointVector calcEffect(const LoopGains& g, LoopOutput output, const Source& source) const {
        JointVector effect = JointVector::Zero(n_);
        for (int i = 0; i < n_; ++i)
            for (int j = 0; j < n_; ++j) {
                const double middle = 0.5 * std::abs(source.torque.lower[j] + source.torque.upper[j]);
                const double half = 0.5 * (source.torque.upper[j] - source.torque.lower[j]);
                const double size = middle + half;
                const double free = at(g.step, output)(i, j) * middle + at(g.torque, output)(i, j) * half;
                double slow = at(g.ramp, output)(i, j) * source.rate[j];
                slow += at(g.step, output)(i, j) * source.start[j];
                if (output == LoopOutput::Torque && i == j) slow += size;  // tau_a goes to -w
                effect[i] += std::isinf(source.rate[j]) ? free : std::min(free, slow);
            }
        return effect;
    }

    const RobotDescription& robot_;
    const JointLimits& limits_;
    int n_;
    double h_;
    const DisturbanceSet& set_;
    const std::string& place_;
    JointVector kr_, kp_, ki_;
    FrictionFeed feed_;  // zeros where nothing is fed forward
    detail::MotionSize motion_;
    JointVector damping_;  // of the viscous friction, half of the most that it can be [Nms/rad]
    ArmExtremes arm_;
};

}  // namespace

TrackingBound calcTrackingBound(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                                const NricOptions& gains, const DisturbanceSet& set, const std::string& place) {
    return BoundMaker(robot, limits, tick_s, gains, set, place).make();
}

}  // namespace viable
