#include "JointServo.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct JointServoOptions {
    bool feedforward = true;
    double share = 1.0;
    bool keepsClear = true;

    template <class V>
    void describe(V& v) {
        v(feedforward, "velocity_feedforward",
          "Follow the commanded velocity, and the acceleration that it changes by, instead of stopping at each "
          "set-point.");
        v(share, "share", "",
          "Share of acceleration and jerk limits for the motion relative to the set-point; the rest is for the "
          "set-point's own. 1 suits set-points that jump and rest.")
            .above(0)
            .upTo(1);
        v(keepsClear, "keeps_clear",
          "Where the filter holds the arm back, be led around obstacles and the arm itself, and rest before what bars "
          "the way.");
    }
};

}  // namespace

void JointServo::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    limits_ = setup.limits;
    const auto options = parameters.get<JointServoOptions>();
    feedforward_ = options.feedforward;
    requireJerkLimits(limits_, parameters.resolved().place(), "the controller joint_servo");
    surroundings_ = setup.surroundings;
    servo_.configure(setup.robot, limits_, tick_s_, setup.start, options.share,
                     options.keepsClear ? setup.geometry : nullptr);
    reset(setup.start);
}

void JointServo::reset(const MotionState& start) {
    servo_.reset(start);
    hasTarget_ = false;
}

TickStatus JointServo::compute(const ControllerInput& input, ControllerOutput& output) {
    const auto& [command, nominal, dynamics, tick] = input;
    if (command.space != MotionCommand::Space::Joint || !isFinite(command.q, n_) || !isFinite(command.qd, n_) ||
        !isFinite(nominal, n_) || !isFinite(dynamics, n_))
        return TickStatus::InvalidInput;
    if (tick.missed > 0) {
        servo_.skipTicks(tick.missed);
        hasTarget_ = false;
    }
    target_.qdd.setZero(n_);
    if (feedforward_) {
        if (!hasTarget_) lastRate_.setZero(n_);
        for (int i = 0; hasTarget_ && i < n_; ++i) {
            const double qdd = (command.qd[i] - target_.qd[i]) / tick_s_, jump = (qdd - lastRate_[i]) / tick_s_;
            // Only of set-points that move smoothly: a velocity that comes in steps tells no acceleration.
            if (jump >= limits_.jerk.lower[i] && jump <= limits_.jerk.upper[i]) target_.qdd[i] = qdd;
            lastRate_[i] = qdd;
        }
        target_.qd = command.qd;
        hasTarget_ = true;
    } else {
        target_.qd.setZero(n_);
    }
    target_.q = command.q;
    servo_.calc(nominal, target_, surroundings_ ? surroundings_->view().surroundings : nullptr, tick.time_s, jerk_);
    askForJerk(input, jerk_, output);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::JointServo, "joint_servo",
              "Leads each joint to its set-point as fast as the limits allow, without overshoot and gains.",
              viable::JointServoOptions)
