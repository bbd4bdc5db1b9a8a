#include "tracking/TrackingBound.h"

#include <algorithm>

#include "core/AtOnce.h"
#include "core/Text.h"
#include "tracking/ArmExtremes.h"
#include "tracking/FrozenLoop.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

using detail::ArmExtremes, detail::FrozenLoop, detail::LoopGains, detail::LoopOutput, detail::TorqueRange;
using Eigen::MatrixXd;

/** Of the fixed point; far below what the sample of poses leaves open. */
constexpr double kAgreement = 1e-9;
constexpr int kMaxRounds = 2000;
/** To find how much less of a source would have a bound. */
constexpr int kTrials = 5, kTrialRounds = 150;
/** Both grow with the velocities, of the nominal arm and of the error. */
constexpr char kDrift[] = "inertia that changes", kOffNominal[] = "dynamics off the nominal pose and speed";

bool isOfMotion(const std::string& source) {
    return source == kDrift || source == kOffNominal;
}
/** A bound beyond this is none [rad, rad/s]. */
constexpr double kLargestBound = 100.0;
/** Stable gains are looked for down to this share. */
constexpr double kLeastGain = 1e-4, kGainStep = 0.9;
/** Shares of the velocity limits up to which a phase lasts, before the last one. */
constexpr std::array<double, 2> kPhases = {0.125, 0.5};
/** The first phase [ticks]; until the first of these shares each is as long as all before it. */
constexpr double kFirstPhase = 4.0;
/** The damping of the loop suits velocities up to so many times the nominal ones; no matter of validity. */
constexpr double kRoom = 1.3;

JointVector calcLargestBound(const JointBounds& bounds) {
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

/** A source that is tried to be smaller; those that grow with the velocities are smaller together. */
struct Reduction {
    std::string source;
    double share = 1.0;

    double of(const std::string& name) const {
        return name == source || (isOfMotion(name) && isOfMotion(source)) ? share : 1.0;
    }
};

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
          feed_(detail::expandFriction(gains.friction, robot.size())),
          motion_{calcLargestBound(limits.velocity), calcLargestBound(limits.acceleration),
                  calcLargestBound(limits.jerk)} {
        for (int i = 0; i < n_; ++i) {
            if (std::isfinite(motion_.velocity[i]) && std::isfinite(motion_.acceleration[i])) continue;
            throw badInput(place,
                           "joint " + robot.joints[static_cast<std::size_t>(i)].name +
                               " has no limit on velocity or acceleration: no bound without them",
                           "Give both in `limits`.");
        }
        checkSet();
        checkBodies();
        checkFriction(gains);
        // A jerk without limit: from one end of the acceleration to the other in a tick.
        motion_.jerk = motion_.jerk.cwiseMin(2.0 / h_ * motion_.acceleration);
        arm_ = detail::findArmExtremes(robot, limits, motion_, set, kr_, place);
        if (!feed_.isActive()) {
            const JointFriction& f = robot.actuation.friction;
            feed_ = {{JointVector::Zero(n_), JointVector::Zero(n_), f.viscousVelocity}, JointVector::Ones(n_)};
        }
        checkFeed();
        const JointFriction& f = robot.actuation.friction;
        // tau_c is held for a tick and is, within it, off what the nominal arm needs; and it arrives late.
        const JointVector jerkTorque = arm_.inertia * motion_.jerk;
        const JointVector rest = arm_.torques.calcTorqueRate(motion_.velocity, motion_.acceleration);
        heldTorque_ = h_ * (0.5 * jerkTorque + rest) + set.delayTicks * h_ * (jerkTorque + rest);
        slope_ = set.frictionScale.expand(n_).cwiseProduct(f.viscous.cwiseQuotient(f.viscousVelocity));
        damping_ = 0.5 * (slope_ + calcLeastSlope(kRoom * motion_.velocity));
        phases_ = listPhases();
        for (std::size_t k = 0; k + 1 < phases_.size(); ++k) ages_.push_back(phases_[k].end_s);
    }

    TrackingBound make() {
        checkStability();
        const JointVector none = JointVector::Zero(n_);
        std::vector<View> views{{none, true, {}}};
        if (damping_.maxCoeff() > 0.0) views.push_back({damping_, false, {}});
        calcGains(views);
        if (views.size() > 1 && set_.isFrictionConstant)
            views.insert(views.begin() + 1, {none, false, views.front().gains});
        Errors errors;
        if (findFixedPoint(views, kMaxRounds, errors)) return evaluate(views, errors, true);
        throw badInput(place_,
                       "no bound exists: the disturbance that the error itself causes grows faster than the robust "
                       "loop reduces it, " +
                           findCause(views, errors),
                       std::string("Raise k_r towards the largest stable value, lower the limits of velocity and "
                                   "acceleration, or state a smaller disturbance_set") +
                           (damping_.maxCoeff() > 0.0 && !set_.isFrictionConstant
                                ? ": less friction_scale, or `friction: constant_in_a_run` where the factor of the "
                                  "friction does not change in a run."
                                : "."));
    }

private:
    /** A part of a run. At its start nothing has happened before and the nominal arm is slow; later what is constant from the
    start on has faded. The largest error is in one of them, and what the errors themselves cause is bounded with those of all. */
    struct Phase {
        detail::MotionSize motion;  ///< largest velocity and acceleration of the nominal arm until its end
        double end_s = INFINITY;
        int number = 0;
    };

    /** What the errors e and de cause in a phase. */
    struct Terms {
        JointVector ofError;       ///< torque [Nm]
        JointVector inertiaRate;   ///< of |dM/dt de| [Nm]
        JointVector inertiaRange;  ///< of |(M - M') de| between any two poses [Nms]
    };

    std::vector<Phase> listPhases() const {
        const auto calcVelocity = [&](int i, double t) {
            const double A = motion_.acceleration[i], J = motion_.jerk[i], rise = A / J;
            return std::min(motion_.velocity[i], t < rise ? 0.5 * J * t * t : A * (t - 0.5 * rise));
        };
        const auto findTime = [&](double share) {
            double time = INFINITY;
            for (int i = 0; i < n_; ++i) {
                const double A = motion_.acceleration[i], J = motion_.jerk[i], v = share * motion_.velocity[i];
                time = std::min(time, v < 0.5 * A * A / J ? std::sqrt(2.0 * v / J) : v / A + 0.5 * A / J);
            }
            return time;
        };
        std::vector<double> ends;
        for (double end = kFirstPhase * h_; end < findTime(kPhases.front()); end *= 2.0) ends.push_back(end);
        for (const double share : kPhases) ends.push_back(std::ceil(findTime(share) / h_) * h_);
        std::vector<Phase> phases;
        for (const double end : ends) {
            Phase phase{motion_, end, static_cast<int>(phases.size())};
            for (int i = 0; i < n_; ++i) {
                phase.motion.velocity[i] = calcVelocity(i, end + h_);  // a jerk may act at the beginning of a tick
                phase.motion.acceleration[i] = std::min(motion_.acceleration[i], motion_.jerk[i] * end);
            }
            phases.push_back(phase);
        }
        phases.push_back({motion_, INFINITY, static_cast<int>(phases.size())});
        return phases;
    }

    /** Viscous friction is a torque that takes any course (`isViscousFree`); or it is taken at the nominal velocity, where it is
    known but for its factor, and what the error of the velocity adds to it is such a torque, or the arm's damping, give or take as
    much. Which bound is the smaller depends on how much friction there is. */
    struct View {
        JointVector damping;
        bool isViscousFree;
        std::vector<LoopGains> gains;  // by inertia
    };

    void calcGains(std::vector<View>& views) const {
        const std::size_t poses = arm_.inertias.size();
        for (View& view : views) view.gains.resize(poses);
        detail::forEachAtOnce(views.size() * poses, [&](std::size_t k) {
            View& view = views[k / poses];
            const detail::PoseInertia& pose = arm_.inertias[k % poses];
            LoopGains& gains = view.gains[k % poses];
            gains = detail::calcGains(makeLoop(pose.M, view.damping, kr_), ages_);
            checkFinite(gains, pose);
        });
    }

    /** What the errors are bounded by, and the torque that the motors carry then. */
    struct Errors {
        JointVector e, de, load;
    };

    /** |e|, |de| and the torque carried are bounded by themselves: iterated from zero upwards, the first fixed point is a bound, for
    e and de start at zero and change steadily. False: none was found. */
    bool findFixedPoint(const std::vector<View>& views, int rounds, Errors& errors,
                        const Reduction& reduction = {}) const {
        errors.e = errors.de = errors.load = JointVector::Zero(n_);
        for (int round = 0; round < rounds; ++round) {
            const TrackingBound bound = evaluate(views, errors, false, reduction);
            const double change = std::max((bound.position - errors.e).cwiseAbs().maxCoeff(),
                                           (bound.velocity - errors.de).cwiseAbs().maxCoeff());
            const bool isFinite = bound.position.allFinite() && bound.velocity.allFinite();
            if (!isFinite || bound.position.maxCoeff() > kLargestBound || bound.velocity.maxCoeff() > kLargestBound)
                return false;
            errors = {bound.position, bound.velocity, bound.torque};
            if (change <= kAgreement * std::max(1.0, errors.de.maxCoeff())) return true;
        }
        return false;
    }

    /** What has the largest part in errors that grow without end, at which joint, and with how much less of it they would not. */
    std::string findCause(const std::vector<View>& views, const Errors& errors) const {
        const TrackingBound bound = evaluate(views, errors, true);
        const std::string source =
            std::max_element(bound.parts.begin(), bound.parts.end(), [](const auto& a, const auto& b) {
                return a.velocity.sum() < b.velocity.sum();
            })->source;
        Eigen::Index joint = 0;
        bound.velocity.cwiseQuotient(motion_.velocity).maxCoeff(&joint);
        Errors ignored;
        const auto exists = [&](double share) { return findFixedPoint(views, kTrialRounds, ignored, {source, share}); };
        std::string cause = "mainly: " + source + ", most at " + robot_.joints[static_cast<std::size_t>(joint)].name;
        const std::string it = isOfMotion(source) ? "what velocities do to the error" : "it";
        if (!exists(0.0)) return cause + "; without " + it + ", too, none was found";
        double good = 0.0, bad = 1.0;
        for (int k = 0; k < kTrials; ++k) {
            const double share = 0.5 * (good + bad);
            (exists(share) ? good : bad) = share;
        }
        return cause + "; there would be one with " +
               (good > 0.0 ? detail::format("%.2g", good) : "less than " + detail::format("%.2g", bad)) + " of " + it;
    }

    /** Both hold, so does the smaller one of each. */
    static void keepSmaller(const TrackingBound& other, TrackingBound& bound) {
        const auto take = [](const JointVector& from, JointVector& to) {
            to = to.binaryExpr(from, &detail::smallerOrNan).eval();
        };
        if (other.position.sum() < bound.position.sum()) bound.parts = other.parts;
        forEach(other, bound, take);
    }
    /** Of two phases. */
    static void keepLarger(const TrackingBound& other, TrackingBound& bound) {
        const auto take = [](const JointVector& from, JointVector& to) {
            to = to.binaryExpr(from, &detail::largerOrNan).eval();
        };
        for (std::size_t k = 0; k < bound.parts.size(); ++k) {
            take(other.parts[k].torque, bound.parts[k].torque);
            take(other.parts[k].position, bound.parts[k].position);
            take(other.parts[k].velocity, bound.parts[k].velocity);
        }
        forEach(other, bound, take);
    }
    template <class Take>
    static void forEach(const TrackingBound& other, TrackingBound& bound, const Take& take) {
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
        std::vector<double> worst(arm_.inertias.size(), 0.0);
        detail::forEachAtOnce(worst.size(), [&](std::size_t k) {
            for (const double share : {0.0, 0.5, 1.0}) {
                const double radius = detail::calcSpectralRadius(makeLoop(arm_.inertias[k].M, share * slope_, kr));
                worst[k] = std::isfinite(radius) ? std::max(worst[k], radius) : INFINITY;
            }
        });
        return *std::max_element(worst.begin(), worst.end());
    }

    void checkFinite(const LoopGains& gains, const detail::PoseInertia& pose) const {
        for (const auto* all : {&gains.torque, &gains.step, &gains.ramp, &gains.reading})
            for (const MatrixXd& values : *all)
                for (int i = 0; i < n_; ++i)
                    if (!values.row(i).allFinite()) throw badGain(i, pose, gains.torque.front()(i, i) == INFINITY);
    }

    Error badGain(int joint, const detail::PoseInertia& pose, bool hardlyDiesOut) const {
        const std::string what =
            (hardlyDiesOut ? "the response of the error loop at " : "the peak gain of the error loop at ") +
            robot_.joints[static_cast<std::size_t>(joint)].name +
            (hardlyDiesOut ? " hardly dies out, it is next to unstable," : " is not finite") +
            " at q = " + detail::formatList(pose.q) + ": no bound can be computed";
        return badInput(place_, what,
                        hardlyDiesOut ? adviseGains()
                                      : "Its inertia there is " + detail::formatNumber(pose.M(joint, joint)) +
                                            " kg m^2: check masses, rotor inertia, friction and gains of this joint.");
    }

    /** Likewise of a set: what is not a number would count as none. */
    void checkSet() const {
        const auto isSize = [](double x) { return std::isfinite(x) && x >= 0.0; };
        bool isSound = isSize(set_.payload_kg) && isSize(set_.payloadOffset_m) && isSize(set_.baseTilt_rad) &&
                       isSize(set_.readingError_rad) && isSize(set_.breakawayRatio) && set_.breakawayRatio >= 1.0 &&
                       set_.torqueLimitFactor > 0.0 && set_.delayTicks >= 0;  // that factor may be infinite
        for (const PerJoint* sizes :
             {&set_.loadFriction, &set_.massError, &set_.torqueRipple_Nm, &set_.externalTorque_Nm})
            for (const double x : sizes->expand(n_)) isSound &= isSize(x);
        for (const PerJoint* shares : {&set_.loadFriction, &set_.massError})
            for (const double x : shares->expand(n_)) isSound &= x < 1.0;
        if (!isSound)
            throw badInput(place_,
                           "a number of the disturbance_set is below 0, not finite, or a share that is too large",
                           "Give sizes that are finite and at least 0, load_friction and mass_error below 1, "
                           "breakaway_ratio from 1 on, torque_limit_factor above 0.");
    }

    /** What no robot folder may have, for descriptions that come from elsewhere. */
    void checkBodies() const {
        for (int i = 0; i < n_; ++i) {
            const JointDescription& joint = robot_.joints[static_cast<std::size_t>(i)];
            const BodyInertia& body = joint.body;
            const double rotor = robot_.actuation.rotorInertia[i];
            const bool isBody = std::isfinite(body.mass) && body.inertia.allFinite() &&
                                (body.mass > 0.0 || (body.mass == 0.0 && body.inertia.isZero()));
            if (isBody && std::isfinite(rotor) && rotor >= 0.0) continue;
            throw badInput(place_,
                           "the body of " + joint.name + " has a mass of " + detail::formatNumber(body.mass) +
                               " kg, its rotor an inertia of " + detail::formatNumber(rotor) + " kg m^2",
                           "Both are finite and at least 0; a body without mass has no inertia.");
        }
    }

    void checkFriction(const NricOptions& gains) const {
        const JointFriction& f = robot_.actuation.friction;
        for (int i = 0; i < n_; ++i) {
            const double least = set_.frictionScaleMin[i], largest = set_.frictionScale[i];
            const bool isFriction = std::isfinite(f.coulomb[i] + f.viscous[i] + largest) && f.coulomb[i] >= 0.0 &&
                                    f.viscous[i] >= 0.0 && f.viscousVelocity[i] > 0.0;
            if (!isFriction)
                throw badInput(
                    place_,
                    "the friction of " + robot_.joints[static_cast<std::size_t>(i)].name + " is below 0 or not finite",
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

    /** More than all that friction can be: then the set, or what is fed forward, is of another arm. */
    void checkFeed() const {
        constexpr double kRounding = 1e-6, kNothing_Nm = 1e-12;
        for (int i = 0; i < n_; ++i) {
            const double v = motion_.velocity[i];
            const auto check = [&](const char* what, double fed, double most) {
                if (fed <= most * (1.0 + kRounding) + kNothing_Nm) return;
                throw badInput(place_,
                               std::string("what is fed forward as ") + what + " friction of " +
                                   robot_.joints[static_cast<std::size_t>(i)].name + " is up to " +
                                   detail::format("%.4g", fed) + " Nm; within the disturbance_set it is at most " +
                                   detail::format("%.4g", most) + " Nm",
                               "friction_scale and friction_scale_min of the set are factors on the robot's own "
                               "figures: state those that cover the figures that are fed forward, or feed less.");
            };
            check("dry", feed_.figures.coulomb[i], calcStanding(i));
            check("viscous", feed_.figures.calcViscous(i, v), set_.frictionScale[i] * calcViscous(i, v));
        }
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
        constexpr double kFarFromUnstable = 0.8;
        if (kr_.cwiseQuotient(largest).maxCoeff(&joint) < kFarFromUnstable)
            return "k_p or k_i is too large for such a k_r: at most a fifth of k_r over the joint's greatest inertia, "
                   "which `viable gains` prints, and a tenth of k_p^2.";
        return "That of " + robot_.joints[static_cast<std::size_t>(joint)].name + " is " +
               detail::formatNumber(kr_[joint]) + "; those with which the loop just becomes unstable, together, are " +
               detail::formatList(largest) + ": take half of them.";
    }

    struct Source {
        const char* name;
        TorqueRange torque;
        JointVector rate;   ///< largest [Nm/s]; infinity: it may jump
        JointVector start;  ///< largest in an arm at rest [Nm]
        bool lasts = true;  ///< more than a moment
        bool jumps = false;

        void scale(double share) {
            for (JointVector* v : {&torque.lower, &torque.upper, &start}) *v *= share;
            if (!jumps) rate *= share;
        }
    };

    Source makeJumping(const char* name, const JointVector& size, bool lasts = true) const {
        return {name, TorqueRange::within(size), JointVector::Constant(n_, INFINITY), size, lasts, true};
    }

    /** The torques that do not depend on the error, with those that its size bounds. */
    std::vector<Source> listSources(const View& view, const Phase& phase, const Terms& terms, const JointVector& de,
                                    const JointVector& load) const {
        const JointVector fastest = phase.motion.velocity + de, leastSlope = calcLeastSlope(fastest);
        const JointFriction& f = robot_.actuation.friction;
        const bool isDamped = view.damping.maxCoeff() > 0.0;
        JointVector dry(n_), viscous(n_), viscousRate(n_), onLoad(n_), slipping(n_), fedLate(n_);
        for (int i = 0; i < n_; ++i) {
            const FrictionFeed& fed = feed_;
            const double scale = set_.frictionScale[i];
            // What is fed forward is held for a tick and arrives late: the nominal velocity has changed by so much.
            const double sinceThen = (1.0 + set_.delayTicks) * h_ * phase.motion.acceleration[i];
            fedLate[i] = fed.figures.viscous[i] / fed.figures.viscousVelocity[i] * sinceThen;
            // The real joint may move against what is fed forward where the nominal one is slower than the error.
            const double against = fed.figures.coulomb[i] * std::min(1.0, (de[i] + sinceThen) / fed.speed[i]);
            dry[i] =
                std::max(calcStanding(i) + against, fed.figures.coulomb[i] - set_.frictionScaleMin[i] * f.coulomb[i]);
            const Unknown unknown = calcUnknown(i, phase.motion.velocity[i]);
            viscous[i] = unknown.torque;
            viscousRate[i] = set_.isFrictionConstant ? unknown.slope * phase.motion.acceleration[i] : INFINITY;
            // Most between two velocities that are de apart: where they are opposite.
            slipping[i] = isDamped ? std::max(slope_[i] - view.damping[i], view.damping[i] - leastSlope[i]) * de[i]
                                   : 2.0 * scale * calcViscous(i, 0.5 * de[i]);
            const double moving = scale * calcViscous(i, fastest[i]);
            if (view.isViscousFree) {
                viscous[i] += slipping[i];
                if (fed.figures.viscous[i] == 0.0) viscous[i] = std::min(viscous[i], moving);
                viscousRate[i] = INFINITY;
                slipping[i] = 0.0;
            }
            // Of the torque that the gear carries, friction and ripple with it.
            onLoad[i] = set_.loadFriction[i] * (load[i] + calcStanding(i) + moving + set_.torqueRipple_Nm[i]);
        }
        return {
            makeJumping("dry friction", dry, false),  // the lasting part of both: see lastingTorque
            {"viscous friction", TorqueRange::within(viscous), viscousRate, JointVector::Zero(n_), false},
            makeJumping("friction fed forward late", fedLate, false),
            makeJumping("viscous friction off the nominal speed", slipping, false),
            makeJumping("friction under load", onLoad, false),  // its lasting part: see lastingTorque
            {"payload", arm_.payload, arm_.payloadRate, arm_.payloadWeight},
            {"mass error", arm_.massError, arm_.massErrorRate, arm_.massErrorWeight},
            {"tilted base", arm_.tilt, arm_.tiltSlope * fastest, arm_.tilt.upper},
            makeJumping("torque ripple", set_.torqueRipple_Nm.expand(n_)),
            makeJumping("external torque", set_.externalTorque_Nm.expand(n_)),
            makeJumping(set_.delayTicks > 0 ? "held and late torque" : "torque held for a tick", heldTorque_, false),
            makeJumping("velocity read half a tick late", calcLateReading(), false),
            makeJumping(kOffNominal, terms.ofError, false),
        };
    }

    /** Dry friction at most [Nm]. */
    double calcStanding(int i) const {
        return set_.frictionScale[i] * robot_.actuation.friction.coulomb[i] * set_.breakawayRatio;
    }

    /** Viscous friction at the velocity v [Nm]. */
    double calcViscous(int i, double v) const { return robot_.actuation.friction.calcViscous(i, v); }

    /** The largest |c + b exp(-v/B) - a exp(-v/A)|, b and a >= 0, over velocities v from 0 to `end`: at an end, or where
    the slope changes its sign. */
    static double findLargest(double end, double c, double b, double B, double a, double A) {
        const auto calc = [&](double v) { return std::abs(c + b * std::exp(-v / B) - a * std::exp(-v / A)); };
        double largest = std::max(calc(0.0), calc(end));
        const double v = std::log((a / A) / (b / B)) / (1.0 / A - 1.0 / B);
        if (v > 0.0 && v < end) largest = std::max(largest, calc(v));
        return largest;
    }

    /** What of the viscous friction at nominal velocities up to `end` is not fed forward [Nm], and of its slope over the
    velocity [Nms/rad]. */
    struct Unknown {
        double torque = 0.0, slope = 0.0;
    };
    Unknown calcUnknown(int i, double end) const {
        const JointFriction &f = robot_.actuation.friction, &fed = feed_.figures;
        const double A = f.viscousVelocity[i], B = fed.viscousVelocity[i], b = fed.viscous[i];
        Unknown largest;
        for (const double scale : {set_.frictionScaleMin[i], set_.frictionScale[i]}) {
            const double a = scale * f.viscous[i];
            largest.torque = std::max(largest.torque, findLargest(end, a - b, b, B, a, A));
            largest.slope = std::max(largest.slope, findLargest(end, 0.0, b / B, B, a / A, A));
        }
        return largest;
    }

    /** Of viscous friction between any two velocities up to `fastest`: f is odd and concave on one side, so its slope is
    least at the end [Nms/rad]. */
    JointVector calcLeastSlope(const JointVector& fastest) const {
        const JointFriction& f = robot_.actuation.friction;
        JointVector slope(n_);
        for (int i = 0; i < n_; ++i)
            slope[i] = set_.frictionScaleMin[i] * f.viscous[i] / f.viscousVelocity[i] *
                       std::exp(-fastest[i] / f.viscousVelocity[i]);
        return slope;
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
    JointVector calcDrift(const LoopGains& gains, LoopOutput output, const Terms& terms) const {
        JointVector drift = JointVector::Zero(n_);
        for (const LoopGains::Variation& span : gains.variations)
            for (int i = 0; i < n_; ++i)
                for (int k = 0; k < n_; ++k)
                    drift[i] += std::min(at(span.aged, output)(i, k) * terms.inertiaRate[k],
                                         at(span.total, output)(i, k) * terms.inertiaRange[k]);
        return drift;
    }

    Terms calcTerms(const Phase& phase, const JointVector& e, const JointVector& de) const {
        const JointVector fastest = phase.motion.velocity + de;
        // d(M de)/dt leaves dM/dt de = (C + C') de, the velocities' part of b takes C(qd + qd_nominal) de.
        return {arm_.torques.calcErrorTorque(fastest, e, de), arm_.torques.calcInertiaRate(fastest, de),
                arm_.inertiaRange * de};
    }

    /** The bounds that follow when e, de and the torque keep to those given.
    @param withParts  with all parts and outputs, else those that the next round takes */
    TrackingBound evaluate(const std::vector<View>& views, const Errors& errors, bool withParts,
                           const Reduction& reduction = {}) const {
        std::vector<TrackingBound> bounds(phases_.size());
        detail::forEachAtOnce(bounds.size(), [&](std::size_t i) {
            const Terms terms = calcTerms(phases_[i], errors.e, errors.de);
            bounds[i] = evaluate(views.front(), phases_[i], terms, errors, withParts, reduction);
            for (std::size_t k = 1; k < views.size(); ++k)
                keepSmaller(evaluate(views[k], phases_[i], terms, errors, withParts, reduction), bounds[i]);
        });
        for (std::size_t i = 1; i < bounds.size(); ++i) keepLarger(bounds[i], bounds.front());
        return bounds.front();
    }

    /** What may take any course as one torque; of each view and phase as many sources, which are compared one by one. */
    std::vector<Source> mergeJumping(const std::vector<Source>& sources) const {
        JointVector size = JointVector::Zero(n_);
        std::vector<Source> merged;
        for (const Source& source : sources)
            if (source.jumps)
                size += source.start;
            else
                merged.push_back(source);
        merged.push_back(makeJumping("", size));
        return merged;
    }

    /** The bounds at the ticks of a phase. */
    TrackingBound evaluate(const View& view, const Phase& phase, const Terms& terms, const Errors& errors,
                           bool withParts, const Reduction& reduction) const {
        std::vector<Source> sources = listSources(view, phase, terms, errors.de, errors.load);
        for (Source& source : sources)
            if (const double share = reduction.of(source.name); share != 1.0) source.scale(share);
        if (!withParts) sources = mergeJumping(sources);
        const JointVector reading = calcReadingError(), late = calcLateReading();
        TrackingBound out;
        const JointVector zero = JointVector::Zero(n_);
        for (const Source& source : sources)
            out.parts.push_back({source.name, source.torque.calcLargest(), zero, zero});
        out.parts.push_back({"encoder", zero, zero, zero});
        out.parts.push_back({kDrift, zero, zero, zero});
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
                    const JointVector part = k < sources.size() ? calcEffect(g, output, phase, sources[k])
                                             : k == sources.size()
                                                 ? JointVector(at(g.reading, output) * reading)
                                                 : JointVector(reduction.of(kDrift) * calcDrift(g, output, terms));
                    total += part;
                    if (output == LoopOutput::Position) take(part, out.parts[k].position);
                    if (output == LoopOutput::Velocity) take(part, out.parts[k].velocity);
                }
                take(total, largest);
            };
            raise(out.position, LoopOutput::Position);
            raise(out.velocity, LoopOutput::Velocity);
            if (withParts || set_.loadFriction.expand(n_).maxCoeff() > 0.0) raise(out.torque, LoopOutput::Torque);
            if (!withParts) continue;
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
    JointVector calcEffect(const LoopGains& g, LoopOutput output, const Phase& phase, const Source& source) const {
        const auto number = static_cast<std::size_t>(phase.number);
        const MatrixXd& step = at(number == 0 ? g.step : g.lateStep[number - 1], output);
        const MatrixXd& torque = at(number < g.earlyTorque.size() ? g.earlyTorque[number] : g.torque, output);
        JointVector effect = JointVector::Zero(n_);
        for (int i = 0; i < n_; ++i)
            for (int j = 0; j < n_; ++j) {
                const double middle = 0.5 * std::abs(source.torque.lower[j] + source.torque.upper[j]);
                const double half = 0.5 * (source.torque.upper[j] - source.torque.lower[j]);
                const double size = middle + half;
                const double free = step(i, j) * middle + torque(i, j) * half;
                double slow = at(g.ramp, output)(i, j) * source.rate[j];
                slow += step(i, j) * source.start[j];
                const bool goesToTorque = output == LoopOutput::Torque || output == LoopOutput::IntegralTorque;
                if (goesToTorque && i == j) slow += size;  // to -w
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
    JointVector slope_;    // of the viscous friction over the velocity, at most [Nms/rad]
    JointVector damping_;  // in the middle of what it can be
    std::vector<Phase> phases_;
    std::vector<double> ages_;  // ends of all phases but the last
    JointVector heldTorque_;    // what the motors' torque within a tick lacks of that of the nominal arm
    ArmExtremes arm_;
};

}  // namespace

TrackingBound calcTrackingBound(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                                const NricOptions& gains, const DisturbanceSet& set, const std::string& place) {
    return BoundMaker(robot, limits, tick_s, gains, set, place).make();
}

}  // namespace viable
