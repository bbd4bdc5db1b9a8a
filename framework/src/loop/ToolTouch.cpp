#include "loop/ToolTouch.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/RotationVector.h"
#include "tracking/InertiaSample.h"

namespace viable::detail {

/** Weights of the angular part and of the wish, beside that of the linear part: of the tool's lever arm. */
constexpr double kAngular = 0.1, kWish = 0.01;
/** Of the torques that the sensors show, at most so much may be no force at the tool. */
constexpr double kMoment = 0.3;
/** A joint with less pull on the tool does not hold it [m]; all of them with less than this share of the lever arm do not. */
constexpr double kNoLever = 1e-6, kLeastPull = 0.1;
/** No contact is less than this share of the force asked for: where the joints may not give that none begins, and one is lost. */
constexpr double kLeastForce = 0.1;

static double follow(double tick_s, double time_s) {
    return std::min(1.0, tick_s / time_s);
}

/** The force at the tool that explains the joints' torques best [N]. */
static Eigen::Vector3d calcToolForce(const ToolJacobian& J, const JointVector& torque) {
    const auto linear = J.topRows<3>();
    const Eigen::Matrix3d A = linear * linear.transpose();
    const double damping = 1e-6 * A.trace();
    return (A + damping * Eigen::Matrix3d::Identity()).llt().solve(Eigen::Vector3d(linear * torque));
}

JointVector calcJointStep(const ToolJacobian& J, const Vector6& step, const JointVector& wish) {
    const double lever = calcLeverArm(J), angular = kAngular * lever, own = kWish * lever;
    const auto n = static_cast<int>(J.cols());
    JointMatrix A = JointMatrix::Identity(n, n) * (own * own);
    A += J.topRows<3>().transpose() * J.topRows<3>();
    A += (angular * angular) * (J.bottomRows<3>().transpose() * J.bottomRows<3>());
    JointVector b = (own * own) * wish;
    b += J.topRows<3>().transpose() * step.head<3>();
    b += (angular * angular) * (J.bottomRows<3>().transpose() * step.tail<3>());
    Eigen::LLT<JointMatrix>(A).solveInPlace(b);
    return b;
}

ToolTouch::ToolTouch(const RunSetup& setup, double force, const LinearErrorLoop* law)
    : force_(force),
      tick_s_(setup.tick_s),
      friction_(setup.robot.actuation.friction),
      motor_(setup.robot.actuation.torqueLimit),
      model_(std::make_shared<RobotModel>(setup.robot)) {
    if (law) law_ = *law;
    reset();
}

void ToolTouch::reset() {
    isOn_ = false;
    const auto n = friction_.coulomb.size();
    external_.setZero(n);
    push_.setZero(n);
    lifted_.setZero(n);
    since_s_ = air_s_ = measured_ = stiffness_ = integral_ = share_ = 0.0;
    hasFree_ = false;
}

void ToolTouch::begin(const Eigen::Vector3d& force) {
    isOn_ = true;
    lifted_.setZero();
    normal_ = force.normalized();
    place_ = dynamics_.tool.position;
    offset_ = normal_.dot(place_);
    begin_ = place_;
    beginForce_ = force.norm();
    deepest_ = stiffness_ = integral_ = share_ = air_s_ = since_s_ = 0.0;
}

/** Pressing takes torque against the pull off what drives a motor: where both have one sign there is more room, and less the other
way. */
void ToolTouch::limitForce(const Eigen::Vector3d& direction, const JointVector& rest, const JointVector& driving) {
    const JointVector pull = dynamics_.J.topRows<3>().transpose() * direction;
    const JointVector along = pull.cwiseSign().cwiseProduct(driving), lever = pull.cwiseAbs();
    const auto findMost = [&](const JointVector& room) {
        const JointVector force = rest.cwiseMin(room.cwiseMax(0.0)).cwiseQuotient(lever);
        return (lever.array() > kNoLever).select(force, kInfinity).minCoeff();
    };
    most_ = findMost(motor_ + along);
    mostBack_ = findMost(motor_ - along);
    asked_ = std::min(force_, kRoom * most_);
}

bool ToolTouch::feels(double force) const {
    return force > 0.5 * std::max(asked_, kLeastForce * force_);
}

void ToolTouch::update(const JointState& real, const JointVector& external, const JointVector& rest,
                       const JointVector& driving) {
    push_.setZero();
    external_ = external;
    model_->calcDynamics(real.q, real.qd, dynamics_);
    const Eigen::Vector3d at = dynamics_.tool.position, force = calcToolForce(dynamics_.J, external_);
    if (!isOn_) {
        limitForce(force.normalized(), rest, driving);
        if (!hasFree_ || !feels(force.norm())) free_ = at;
        hasFree_ = true;
        const JointVector ofForce = dynamics_.J.topRows<3>().transpose() * force, other = external_ - ofForce;
        if (asked_ >= kLeastForce * force_ && force.norm() > asked_ && other.norm() < kMoment * external_.norm() &&
            ofForce.norm() > kLeastPull * calcLeverArm(dynamics_.J) * force.norm())
            begin(force);
        if (!isOn_) return;
    }
    since_s_ += tick_s_;
    place_ += follow(tick_s_, kPlace_s) * (at - place_);
    measured_ = normal_.dot(force);
    limitForce(normal_, rest, driving);
    air_s_ = feels(measured_) ? 0.0 : air_s_ + tick_s_;
    if (air_s_ > 0.0) {
        begin_ = at;
        beginForce_ = measured_;
    } else {
        turnNormal(force);
    }
    learnStiffness(measured_);
    // Without a force it has only bounced.
    const double height = normal_.dot(place_);
    offset_ = feels(measured_) ? height : std::min(height, offset_);
}

/** The way is that of the surface, but for what the tool went deeper. */
void ToolTouch::turnNormal(const Eigen::Vector3d& force) {
    const Eigen::Vector3d at = dynamics_.tool.position;
    const double deeper = stiffness_ > 0.0 ? (measured_ - beginForce_) / stiffness_ : 0.0;
    const Eigen::Vector3d moved = at - begin_ + deeper * normal_;
    const double out = normal_.dot(moved), along = (moved - out * normal_).norm();
    if (!(along > kWay) || !(std::abs(out) < kSlope * along)) return;
    const Eigen::Vector3d way = moved.normalized(), seen = force - way.dot(force) * way;
    normal_ = (normal_ + kTurn * (seen.normalized() - normal_)).normalized();
    begin_ = at;
    beginForce_ = normal_.dot(force);
}

void ToolTouch::learnStiffness(double force) {
    if (!isSettling()) return;  // a way along a hollow surface is no depth
    const double depth = normal_.dot(free_ - dynamics_.tool.position);
    if (!(depth > deepest_) || !(force > 0.0)) return;
    deepest_ = depth;
    if (stiffness_ == 0.0 || depth < kLead) stiffness_ = force / depth;
}

/** The velocity along the normal [m/s]. */
double ToolTouch::calcWanted() {
    const double softness = std::max(asked_ / kApproach, kContact_s * stiffness_);
    const double pressing = (asked_ - measured_) / softness;
    const double away = normal_.dot(dynamics_.tool.position) - offset_;
    const double back = std::max(away / kContact_s, kApproach * (air_s_ / kContact_s - 1.0));
    return -std::clamp(air_s_ > 0.0 ? std::max(pressing, back) : pressing, -kApproach, kApproach);
}

/** The arm with the nominal tool's pose, but for the place along the normal, and with its velocity, but for a share of that along it.
Nearest to where it was, so that it goes on where the two are far apart. */
void ToolTouch::liftNominal(const MotionState& nominal, const Dynamics& dynamics, double above, double share) {
    model_->calcDynamics(nominal.q + lifted_, nominal.qd, ofLifted_);
    Vector6 step;
    step.head<3>() = dynamics.tool.position + above * normal_ - ofLifted_.tool.position;
    step.tail<3>() = calcRotationVector(dynamics.tool.orientation * ofLifted_.tool.orientation.conjugate());
    lifted_ += calcJointStep(ofLifted_.J, step, -lifted_);
    Vector6 twist = dynamics.J * nominal.qd;
    twist.head<3>() -= share * normal_.dot(twist.head<3>()) * normal_;
    liftedRate_ = calcJointStep(ofLifted_.J, twist, nominal.qd) - nominal.qd;
}

/** B [Ns/m]: force along the normal for each velocity, of the robust loop as it is in this pose. */
double ToolTouch::calcDamping(const JointVector& pull, const JointMatrix& M) const {
    if (!law_) return 0.0;
    JointMatrix K = calcLoopGain(*law_, M);
    K.diagonal().array() += kNoLever;
    const JointVector rate = Eigen::LLT<JointMatrix>(K).solve(pull);
    const double softness = pull.dot(rate);
    return softness > 0.0 ? 1.0 / softness : 0.0;
}

void ToolTouch::see(const MotionState& nominal, const Dynamics& dynamics, const Eigen::Vector3d& wants,
                    JointState& real) {
    const Eigen::Vector3d at = dynamics_.tool.position;
    const JointVector pull = dynamics_.J.topRows<3>().transpose() * normal_;
    const double wanted = calcWanted();
    const double above = normal_.dot(at - dynamics.tool.position);
    const double share = std::clamp(above / kLead, 0.0, 1.0);
    share_ = share * std::clamp(normal_.dot(at - wants) / kLead, 0.0, 1.0);
    liftNominal(nominal, dynamics, std::max(0.0, above), share);
    real.q -= lifted_;
    real.qd -= liftedRate_;
    const double damping = calcDamping(pull, dynamics.M);
    // Against friction, no faster than the surface answers.
    const double rate = std::min(1.0 / kFriction_s, damping > 0.0 ? stiffness_ / damping : kInfinity);
    if (air_s_ == 0.0)
        integral_ += share_ * rate * tick_s_ * std::max(-2.0 * asked_, asked_ - measured_);
    else
        integral_ -= follow(tick_s_, kContact_s) * integral_;
    integral_ = std::clamp(integral_, -mostBack_ - asked_, most_ - asked_);
    push_ = share_ * (damping * wanted - asked_ - integral_) * pull;
}

void ToolTouch::fill(TickRecord::Touch& record) const {
    record = {};
    if (isOn_) record = {true, measured_, asked_, normal_};
}

bool ToolTouch::explains(int joint, double beyond) const {
    return isSettling() ||
           std::abs(beyond + external_[joint]) <= 2.0 * friction_.coulomb[joint] + 0.1 * std::abs(external_[joint]);
}

}  // namespace viable::detail
