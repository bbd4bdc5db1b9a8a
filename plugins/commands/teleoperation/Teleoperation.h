#pragma once

#include "plugin/Teleoperation.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The hand of an operator moves the tool, or sliders the joints, while a switch is held.

Method: an engagement latches the hand's pose (h, H) to the command (p, R) of that moment. From then on, with A `axes`,
    position = p + scale A (h' - h)
    orientation = A (H' H^T) A^T R
of the newest pose (h', H'): engaging moves nothing, wherever the hand is. A change of scale or part latches anew, as does
the first message after a hold. Released, held or refused, the command is where the stop held ready leaves the arm.
The command has no velocity: it is a pose to go to.
Refused, until the switch is pressed anew: what HandRefusal says; also a switch that was pressed before the first sample(). A
message of an older time or engagement than one before is dropped; a release always counts.
Times are those of the feed's clock.
Guarantees: finite commands, whatever arrives. Limits are kept by the filter, not here.
Real time: no allocation, lock or throw after configure(); one evaluation of the arm's dynamics where an engagement ends, of
which the tool's pose is used. */
class Teleoperation : public TeleoperatedCommand {
public:
    explicit Teleoperation(std::function<double()> clock = {});
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    CommandTraits traits() const override { return {command_.space}; }
    TickStatus sample(double t, MotionCommand& out) override;
    std::shared_ptr<TeleoperationFeed> feed() const override { return feed_; }
    void observe(const JointVector& q, const JointVector& rest) noexcept override;

private:
    bool isTool() const { return command_.space == MotionCommand::Space::Tool; }
    void release();
    bool take(const HandMessage& message, double now_s);
    bool isUsable(const HandMessage& message) const;
    bool isJump(const HandMessage& message) const;
    void latch(const HandMessage& message);
    void follow(const HandMessage& message);
    void end(HandState state, HandRefusal refusal);
    void rest();

    const std::shared_ptr<TeleoperationFeed> feed_;
    std::unique_ptr<RobotModel> model_;
    Dynamics dynamics_;
    Eigen::Quaterniond axes_ = Eigen::Quaterniond::Identity();
    int n_ = 0;
    Pose startTool_;

    MotionCommand command_;
    JointVector rest_;
    bool isObserved_ = false;
    HandState state_ = HandState::Released;
    HandRefusal refusal_ = HandRefusal::None;
    std::uint64_t engagement_ = 0;  // the last one
    std::uint64_t number_ = 0;      // of the last message that was looked at
    HandMessage last_;              // the last one that was followed
    HandMessage hand_;              // latched to ...
    MotionCommand latched_;         // ... this command
    double fresh_s_ = 0.0;          // when last_ came
    double asked_s_ = 0.0;          // when sample() was called last
    double age_s_ = 0.0;
    bool wasAsked_ = false;
};

}  // namespace viable
