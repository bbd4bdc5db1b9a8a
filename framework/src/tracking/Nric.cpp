#include "viable/tracking/Nric.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "robot/ArmRecursion.h"
#include "tracking/InertiaSample.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

/** Noise of an encoder is withheld for fewer ticks in a row, now to this side, now to that: it is no reason to hold the sum. */
constexpr int kWithheldTicks = 3;

/** The numbers of `n` joints. */
JointVector expand(const PerJoint& values, const std::string& place, const std::string& what, int n) {
    if (!values.fits(n))
        throw badInput(place,
                       std::to_string(values.count()) + " " + what + "; the robot has " + std::to_string(n) + " joints",
                       "Give one number for all joints, or one each.");
    return values.expand(n);
}

/** A gain may be 0, and is finite; a bound is above 0, and may be infinite. */
enum class Option { Gain, Bound };

/** The gains or bounds of `n` joints, checked. */
JointVector expandOption(const PerJoint& option, Option kind, const char* name, int n) {
    const bool isGain = kind == Option::Gain;
    const std::string place = std::string("NricOptions::") + name, what = isGain ? "gain" : "bound";
    const JointVector values = expand(option, place, what + "s", n);
    for (int i = 0; i < n; ++i)
        if (isGain ? !(values[i] >= 0.0) || std::isinf(values[i]) : !(values[i] > 0.0))
            throw badInput(place,
                           "the " + what + " of joint " + std::to_string(i) + " is " + detail::formatNumber(values[i]) +
                               "; allowed is " + (isGain ? "[0, inf)" : "above 0, or infinity"),
                           isGain ? "Without the robust loop: leave it out." : "Without this bound: infinity.");
    return values;
}

}  // namespace

bool detail::isSound(const FrictionFeed& feed, int n) {
    if (!feed.isActive()) return true;
    const JointFriction& f = feed.figures;
    const auto isWithin = [n](const JointVector& v, double least) {
        return isFinite(v, n) && (n == 0 || v.minCoeff() >= least);
    };
    constexpr double kAboveZero = std::numeric_limits<double>::denorm_min();
    return isWithin(f.coulomb, 0.0) && isWithin(f.viscous, 0.0) && isWithin(f.viscousVelocity, kAboveZero) &&
           isWithin(feed.speed, kAboveZero);
}

FrictionFeed detail::expandFriction(const FrictionFeed& feed, int n) {
    if (!feed.isActive()) return {};
    if (!isSound(feed, n))
        throw badInput("NricOptions::friction",
                       "it has not one number for each of " + std::to_string(n) +
                           " joints, torques finite and at least 0, velocities finite and above 0",
                       "Use scaleFriction(), or leave it out.");
    return feed;
}

NricOptions scaleNric(const RobotDescription& robot, const JointLimits& limits, double tick_s) {
    const LinearErrorLoop loop = detail::scaleConstantGains(robot, limits, tick_s);
    return {loop.kr, loop.kp, loop.ki};
}

FrictionFeed scaleFriction(const JointFriction& figures, const PerJoint& scale, const JointLimits& limits,
                           double tick_s) {
    const auto n = static_cast<int>(figures.coulomb.size());
    const JointVector factor = expand(scale, "scaleFriction()", "factors", n);
    if (!factor.allFinite() || factor.minCoeff() < 0.0)
        throw badInput("scaleFriction()", "a factor is below 0 or not finite", "Give one number of at least 0.");
    FrictionFeed feed;
    if (factor.isZero()) return feed;
    feed.figures = {factor.cwiseProduct(figures.coulomb), factor.cwiseProduct(figures.viscous),
                    figures.viscousVelocity};
    /** Of the velocity at which viscous friction saturates, where no limit of acceleration tells more. */
    constexpr double kLargestShare = 0.1;
    feed.speed = kLargestShare * figures.viscousVelocity;
    const JointVector fastest = limits.acceleration.upper.cwiseMin(-limits.acceleration.lower);
    for (int i = 0; i < n; ++i)
        if (std::isfinite(fastest[i]) && fastest[i] > 0.0) feed.speed[i] = kFeedTicks * tick_s * fastest[i];
    return feed;
}

void Nric::configure(const RunSetup& setup, const Parameters& parameters) {
    requireDynamics(setup.robot, parameters.resolved().place(), "the robust loop");
    const auto settings = parameters.get<NricSettings>();
    const int n = setup.size();
    LinearErrorLoop gains;
    if (settings.kr) gains.kr = settings.kr->expand(n);
    if (settings.kp) gains.kp = settings.kp->expand(n);
    if (settings.ki) gains.ki = settings.ki->expand(n);
    if (gains.kr.size() == 0 || gains.kp.size() == 0 || gains.ki.size() == 0)
        gains = scaleGains(setup.robot, setup.limits, setup.tick_s, setup.delayTicks, gains);
    const std::filesystem::path& file = settings.frictionFile;
    const JointFriction figures =
        file.empty() ? setup.robot.actuation.friction : readFriction(file, setup.robot.jointNames());
    // What the motors cut off must not wind it up.
    JointVector motorRate = settings.motorRate.expand(n);
    if (setup.motorRate.size() > 0) motorRate = motorRate.cwiseMin(setup.motorRate);
    configure(setup,
              NricOptions{gains.kr, gains.kp, gains.ki, settings.integralLimit, settings.torqueRate, gains.inertiaRate,
                          motorRate, scaleFriction(figures, settings.frictionScale, setup.limits, setup.tick_s)});
}

void Nric::configure(const RunSetup& setup, const NricOptions& options) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    loop_ = {expandOption(options.kr, Option::Gain, "kr", n_),
             expandOption(options.kp, Option::Gain, "kp", n_),
             expandOption(options.ki, Option::Gain, "ki", n_),
             expandOption(options.integralLimit, Option::Bound, "integralLimit", n_),
             expandOption(options.torqueRate, Option::Bound, "torqueRate", n_),
             options.inertiaRate,
             detail::expandFriction(options.friction, n_),
             expandOption(options.motorRate, Option::Bound, "motorRate", n_)};
    feedsFriction_ = loop_.friction.isActive();
    if (!(options.inertiaRate > 0.0))
        throw badInput("NricOptions::inertiaRate",
                       "it is " + detail::formatNumber(options.inertiaRate) + "; allowed is above 0, or infinity",
                       "For constant gains: infinity.");
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    integralLimit_ = loop_.integralLimit.cwiseMin(torqueLimit_);
    largestStep_ = loop_.torqueRate * tick_s_;
    gain_.setZero(n_, n_);
    gain_.diagonal() = loop_.kr;
    largestMotorStep_ = loop_.motorRate * tick_s_;
    followsInertia_ = std::isfinite(loop_.inertiaRate);
    limitsMotorRate_ = !largestMotorStep_.array().isInf().all();
    arm_.reset();
    if (followsInertia_ || limitsMotorRate_) arm_ = std::make_shared<const ArmRecursion>(setup.robot);
    if (followsInertia_) setGain(setup.start.q);
    reset(setup.start);
}

void Nric::reset(const MotionState& start) {
    integral_.setZero(n_);
    lastTorque_.setZero(n_);
    lastMotorTorque_.setZero(n_);
    withheld_.fill(0);
    isIntegralHeld_ = false;
    if (!limitsMotorRate_) return;
    arm_->calcTorque(start.q, lastTorque_, lastTorque_, lastMotorTorque_);
    lastMotorTorque_ = lastMotorTorque_.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
}

/** Of the pose. */
void Nric::setGain(const JointVector& q) {
    arm_->calcInertia(q, gain_);
    gain_ = detail::calcLoopGain(loop_, gain_);
}

/** What the host added in the tick before: rates count from there. */
void Nric::takeGiven(const JointVector& given) {
    if (!isFinite(given, n_) || given == lastTorque_) {
        withheld_.fill(0);
        return;
    }
    for (int i = 0; i < n_; ++i) {
        int& ticks = withheld_[static_cast<std::size_t>(i)];
        if (lastTorque_[i] > given[i])
            ticks = std::max(0, ticks) + 1;
        else if (lastTorque_[i] < given[i])
            ticks = std::min(0, ticks) - 1;
        else
            ticks = 0;
    }
    lastMotorTorque_ += given - lastTorque_;
    lastTorque_ = given;
}

TickStatus Nric::compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                         JointVector& torque) {
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_)) return TickStatus::InvalidInput;
    takeGiven(torque);
    if (followsInertia_) setGain(nominal.q);
    const JointVector e = real.q - nominal.q, de = real.qd - nominal.qd;
    const JointVector friction = feedsFriction_ ? loop_.friction.calc(nominal.qd) : JointVector(JointVector::Zero(n_));
    const auto calcTorque = [&](const JointVector& integral) {
        const JointVector error = de + loop_.kp.cwiseProduct(e) + loop_.ki.cwiseProduct(integral);
        const JointVector pull = followsInertia_ ? JointVector(gain_.lazyProduct(error)) : loop_.kr.cwiseProduct(error);
        return JointVector(friction - pull);
    };
    const auto cut = [&](int i, double robust) {
        robust = std::clamp(robust, lastTorque_[i] - largestStep_[i], lastTorque_[i] + largestStep_[i]);
        // Unchanged to the last bit where the limit does not act: a rounded difference would look like saturation.
        const double total = filterTorque[i] + robust;
        const double highest = std::min(torqueLimit_[i], lastMotorTorque_[i] + largestMotorStep_[i]);
        const double lowest = std::max(-torqueLimit_[i], lastMotorTorque_[i] - largestMotorStep_[i]);
        if (total > highest) return highest - filterTorque[i];
        if (total < lowest) return lowest - filterTorque[i];
        return robust;
    };
    JointVector bounded = integral_, grown = integral_;
    for (int i = 0; i < n_; ++i) {
        const double gain = gain_(i, i) * loop_.ki[i];
        const double largest = gain > 0.0 ? integralLimit_[i] / gain : std::numeric_limits<double>::infinity();
        bounded[i] = std::clamp(integral_[i], -largest, largest);  // the bound follows the pose
        grown[i] = isIntegralHeld_ ? bounded[i] : std::clamp(integral_[i] + e[i] * tick_s_, -largest, largest);
    }
    const JointVector wanted = calcTorque(grown);
    bool isHeld = false;
    const JointVector growth = grown - bounded;
    for (int i = 0; i < n_; ++i) {
        const double possible = cut(i, wanted[i]);
        const int withheld = withheld_[static_cast<std::size_t>(i)];
        const int side = wanted[i] > possible                  ? 1
                         : wanted[i] < possible                ? -1
                         : std::abs(withheld) < kWithheldTicks ? 0
                                                               : withheld;
        if (side == 0) continue;
        // What grows pushes this joint's torque into what cuts it, or away from it.
        for (int j = 0; j < n_; ++j) {
            const double push = -gain_(i, j) * loop_.ki[j] * growth[j];
            if (!(side * push > 0.0)) continue;
            grown[j] = bounded[j];
            isHeld = true;
        }
    }
    integral_ = grown;
    torque = isHeld ? calcTorque(integral_) : wanted;
    for (int i = 0; i < n_; ++i) torque[i] = cut(i, torque[i]);
    lastTorque_ = torque;
    lastMotorTorque_ = filterTorque + torque;
    return TickStatus::Ok;
}

}  // namespace viable
