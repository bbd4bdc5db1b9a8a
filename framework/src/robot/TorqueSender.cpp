#include "viable/robot/TorqueSender.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "robot/ArmRecursion.h"

namespace viable {

namespace {

/** A change that is smaller than the largest one by less is the largest one. */
constexpr double kLeastCut = 1e-9;

}  // namespace

struct TorqueSender::Impl {
    Impl(const RobotDescription& robot, const TorqueConvention& convention, double tick_s)
        : arm(robot),
          limit(robot.actuation.torqueLimit),
          largestStep(convention.torqueRate.expand(robot.size()) * tick_s),
          still(JointVector::Zero(robot.size())),
          gravity(still),
          last(still),
          offset(still),
          step_s(tick_s),
          addsGravity(convention.addsGravity) {}

    /** Of the offset, in the next tick. */
    double calcShare() {
        if (blended_s >= blend_s) return 0.0;
        const double share = 0.5 * (1.0 + std::cos(EIGEN_PI * blended_s / blend_s));
        blended_s += step_s;
        return share;
    }

    ArmRecursion arm;
    JointVector limit, largestStep, still, gravity, last;
    JointVector offset;  // by which what the robot held the arm with differs from the model's
    double step_s, blend_s = 0.0, blended_s = 0.0;
    bool addsGravity, isRateLimited = false;
};

RobotDescription withConvention(RobotDescription robot, const TorqueConvention& convention) {
    if (!convention.addsFriction) return robot;
    Actuation& actuation = robot.actuation;
    for (int i = 0; i < robot.size(); ++i) {
        const double most = actuation.friction.coulomb[i] + actuation.friction.viscous[i];
        if (!(actuation.torqueLimit[i] > most))
            throw badInput("TorqueConvention::addsFriction",
                           "the friction of joint `" + robot.joints[i].name + "` takes up to " +
                               detail::formatNumber(most) + " Nm of the " +
                               detail::formatNumber(actuation.torqueLimit[i]) + " Nm that its motor gives",
                           "Correct the figures of friction or the torque limit (actuation.yaml).");
        actuation.torqueLimit[i] -= most;
        actuation.friction.coulomb[i] = actuation.friction.viscous[i] = 0.0;
    }
    return robot;
}

TorqueSender::TorqueSender(const RobotDescription& robot, const TorqueConvention& convention, double tick_s) {
    const PerJoint& rate = convention.torqueRate;
    if (!rate.fits(robot.size()))
        throw badInput(
            "TorqueConvention::torqueRate",
            std::to_string(rate.count()) + " numbers; the robot has " + std::to_string(robot.size()) + " joints",
            "Give one number for all joints, or one each.");
    for (int i = 0; i < robot.size(); ++i)
        if (!(rate[i] > 0.0))
            throw badInput("TorqueConvention::torqueRate",
                           detail::formatNumber(rate[i]) + " Nm/s for joint `" + robot.joints[i].name +
                               "`; allowed is above 0, or infinity",
                           "Without this limit: infinity.");
    impl_ = std::make_unique<Impl>(robot, convention, tick_s);
}
TorqueSender::~TorqueSender() = default;
TorqueSender::TorqueSender(TorqueSender&&) noexcept = default;
TorqueSender& TorqueSender::operator=(TorqueSender&&) noexcept = default;

void TorqueSender::reset(const JointVector& q) {
    Impl& in = *impl_;
    in.isRateLimited = false;
    in.last = in.still;
    in.blend_s = in.blended_s = 0.0;
    if (in.addsGravity) return;
    in.arm.calcTorque(q, in.still, in.still, in.last);
    in.last = in.last.cwiseMax(-in.limit).cwiseMin(in.limit);
}

void TorqueSender::reset(const JointVector& q, const JointVector& held, double blend_s) {
    reset(q);
    Impl& in = *impl_;
    in.offset = held - in.last;
    in.last = held;
    in.blend_s = blend_s;
}

const JointVector& TorqueSender::send(const JointVector& q, JointVector& torque) {
    Impl& in = *impl_;
    in.isRateLimited = false;
    if (in.addsGravity) in.arm.calcTorque(q, in.still, in.still, in.gravity);
    const double share = in.calcShare();
    for (Eigen::Index i = 0; i < torque.size(); ++i) {
        const double asked = share > 0.0 ? torque[i] + share * in.offset[i] : torque[i];
        const double wanted = std::clamp(asked, -in.limit[i], in.limit[i]) - in.gravity[i];
        // The motor's limit comes last: gravity may change faster than the rate.
        const double sent =
            std::clamp(std::clamp(wanted, in.last[i] - in.largestStep[i], in.last[i] + in.largestStep[i]),
                       -in.limit[i] - in.gravity[i], in.limit[i] - in.gravity[i]);
        // What is wanted may have been cut before, by a loop that knows the rate.
        in.isRateLimited |= std::abs(sent - in.last[i]) >= in.largestStep[i] * (1.0 - kLeastCut);
        in.last[i] = sent;
        torque[i] = sent == wanted ? std::clamp(asked, -in.limit[i], in.limit[i]) : sent + in.gravity[i];
    }
    return in.last;
}

bool TorqueSender::isRateLimited() const {
    return impl_->isRateLimited;
}

}  // namespace viable
