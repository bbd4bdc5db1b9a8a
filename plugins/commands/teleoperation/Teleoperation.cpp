#include "Teleoperation.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct TeleoperationOptions {
    MotionCommand::Space space = MotionCommand::Space::Tool;
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();

    template <class V>
    void describe(V& v) {
        v(space, "space", "joint|tool", "What the hand moves: the joints, by sliders, or the tool, by its pose.");
        v(axes, "axes", "", "Rotation matrix, row by row, from the device's to the base's axes.");
    }
};

// A hand is not faster than this; the first term is for the noise of a device and of its clock.
constexpr double kJump_m = 0.05, kFastest_mps = 5.0;
constexpr double kJump_rad = 0.3, kFastest_radps = 20.0;
// Sliders are led to their place by the page as fast as an arm's joint can go.
constexpr double kJumpJoint_rad = 0.2, kFastestJoint_radps = 10.0;
// A device that stood still for longer is where a hand could have gone in this time. [s]
constexpr double kLongestStep_s = 0.1;
// `axes` may be written with this few decimals; it is made an exact rotation.
constexpr double kAxesTolerance = 1e-3;
constexpr double kFarthest_m = 1e3;

Eigen::Quaterniond checkAxes(const Eigen::Matrix3d& axes, const Parameters& parameters) {
    const double deviation = (axes * axes.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    if (!(deviation <= kAxesTolerance) || axes.determinant() < 0.0)
        throw badInput(
            parameters.place("axes"),
            detail::format(
                "axes is not a rotation: its rows deviate by %.3g from unit length and right angles (at most %g), "
                "and its determinant is %.6g instead of 1",
                deviation, kAxesTolerance, axes.determinant()),
            "Give the device's axes seen from the robot's base, row by row");
    return Eigen::Quaterniond(axes).normalized();
}

bool isPose(const Pose& pose) {
    const double norm = pose.orientation.norm();
    return pose.position.allFinite() && pose.position.cwiseAbs().maxCoeff() < kFarthest_m && norm > 0.9 && norm < 1.1;
}

}  // namespace

Teleoperation::Teleoperation(std::function<double()> clock)
    : feed_(std::make_shared<TeleoperationFeed>(std::move(clock))) {}

void Teleoperation::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<TeleoperationOptions>();
    command_.space = options.space;
    axes_ = checkAxes(options.axes, parameters);
    startTool_ = setup.startTool;
    if (isTool()) model_ = std::make_unique<RobotModel>(setup.robot);
    reset(setup.start);
}

void Teleoperation::reset(const MotionState& start) {
    command_.q = start.q;
    command_.qd.setZero(n_);
    command_.tool = startTool_;
    command_.toolTwist.setZero();
    rest_ = start.q;
    isObserved_ = false;
    state_ = HandState::Released;
    refusal_ = HandRefusal::None;
    engagement_ = 0;
    age_s_ = 0.0;
    wasAsked_ = false;
    number_ = feed_->take().number;
}

void Teleoperation::observe(const JointVector& q, const JointVector& rest) noexcept {
    if (!isFinite(q, n_)) return;
    rest_ = q;
    if (rest.size() == n_)
        for (int i = 0; i < n_; ++i)
            if (std::isfinite(rest[i])) rest_[i] = rest[i];
    isObserved_ = true;
}

TickStatus Teleoperation::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    const double now_s = feed_->now();
    const TeleoperationFeed::Arrival& arrival = feed_->take();
    const bool isFresh = arrival.number != number_;
    number_ = arrival.number;
    const bool isFollowing = state_ == HandState::Engaged || state_ == HandState::Held;
    const double gap_s = wasAsked_ ? now_s - asked_s_ : std::numeric_limits<double>::infinity();
    if (isFresh && arrival.message.engagement == 0) {
        release();  // counts however old it is
    } else if (gap_s > TeleoperationFeed::kSilent_s) {
        // Nobody looked at the hand meanwhile. A switch that is pressed now was perhaps pressed for something else.
        if (isFresh) engagement_ = std::max(engagement_, arrival.message.engagement);
        if (isFollowing || isFresh) end(HandState::Refused, HandRefusal::Paused);
    } else if (gap_s > TeleoperationFeed::kHold_s && state_ == HandState::Engaged) {
        end(HandState::Held, HandRefusal::None);
    } else if (isFresh && now_s - arrival.received_s <= TeleoperationFeed::kHold_s && take(arrival.message, now_s)) {
        age_s_ = now_s - arrival.received_s;
    } else if (isFollowing) {
        const double silence_s = now_s - fresh_s_;
        if (silence_s > TeleoperationFeed::kSilent_s) {
            end(HandState::Refused, HandRefusal::Silent);
        } else if (silence_s > TeleoperationFeed::kHold_s && state_ == HandState::Engaged) {
            end(HandState::Held, HandRefusal::None);
        }
    }
    asked_s_ = now_s;
    wasAsked_ = true;
    out = command_;
    feed_->tell({state_, refusal_, engagement_, age_s_, command_});
    return TickStatus::Ok;
}

void Teleoperation::release() {
    if (state_ == HandState::Engaged || state_ == HandState::Held) end(HandState::Released, HandRefusal::None);
    state_ = HandState::Released;
}

/** A hand whose switch is pressed. False: dropped, as if it had not come. */
bool Teleoperation::take(const HandMessage& message, double now_s) {
    const bool isFollowing = state_ == HandState::Engaged || state_ == HandState::Held;
    if (message.engagement < engagement_) return false;  // of a press before this one
    const bool isNew = message.engagement != engagement_;
    if (!isNew && !isFollowing) return false;                    // over, until the switch is pressed anew
    if (!isNew && message.sent_s <= last_.sent_s) return false;  // older than what is known, or the same again
    engagement_ = message.engagement;
    const bool begins =
        isNew || state_ == HandState::Held || message.scale != last_.scale || message.part != last_.part;
    const HandRefusal refusal = !isUsable(message)           ? HandRefusal::NotFinite
                                : !message.isTracked         ? HandRefusal::NotTracked
                                : !begins && isJump(message) ? HandRefusal::Jump
                                                             : HandRefusal::None;
    if (refusal != HandRefusal::None) {
        end(HandState::Refused, refusal);
        return true;
    }
    if (begins) latch(message);
    follow(message);
    fresh_s_ = now_s;
    return true;
}

bool Teleoperation::isUsable(const HandMessage& message) const {
    if (!std::isfinite(message.sent_s)) return false;
    if (!isTool()) return isFinite(message.joints, n_) && message.joints.cwiseAbs().maxCoeff() < kFarthest_m;
    return isPose(message.hand) && message.scale >= HandMessage::kLeastScale &&
           message.scale <= HandMessage::kLargestScale;
}

bool Teleoperation::isJump(const HandMessage& message) const {
    const double step_s = std::min(message.sent_s - last_.sent_s, kLongestStep_s);
    if (!isTool())
        return (message.joints - last_.joints).cwiseAbs().maxCoeff() > kJumpJoint_rad + kFastestJoint_radps * step_s;
    const double way_m = (message.hand.position - last_.hand.position).norm();
    const double turn_rad = message.hand.orientation.normalized().angularDistance(last_.hand.orientation.normalized());
    return way_m > kJump_m + kFastest_mps * step_s || turn_rad > kJump_rad + kFastest_radps * step_s;
}

void Teleoperation::latch(const HandMessage& message) {
    hand_ = message;
    latched_ = command_;
    state_ = HandState::Engaged;
    refusal_ = HandRefusal::None;
}

void Teleoperation::follow(const HandMessage& message) {
    last_ = message;
    if (!isTool()) {
        command_.q = latched_.q + message.joints - hand_.joints;
        return;
    }
    if (message.part != HandMessage::Part::Rotation)
        command_.tool.position =
            latched_.tool.position + message.scale * (axes_ * (message.hand.position - hand_.hand.position));
    if (message.part != HandMessage::Part::Position) {
        Eigen::Quaterniond turn =
            message.hand.orientation.normalized() * hand_.hand.orientation.normalized().conjugate();
        turn.vec() = axes_ * turn.vec();
        command_.tool.orientation = (turn * latched_.tool.orientation).normalized();
    }
}

void Teleoperation::end(HandState state, HandRefusal refusal) {
    const bool wasMoving = state_ == HandState::Engaged;
    state_ = state;
    refusal_ = refusal;
    if (wasMoving) rest();
}

/** The command comes to where the arm does when it brakes now. */
void Teleoperation::rest() {
    if (!isObserved_) return;
    command_.q = rest_;
    if (isTool()) {
        model_->calcDynamics(rest_, JointVector::Zero(n_), dynamics_);
        command_.tool = dynamics_.tool;
    }
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::Teleoperation, "teleoperation",
              "An operator's hand moves the tool or the joints, through the page of viable live.",
              viable::TeleoperationOptions)
