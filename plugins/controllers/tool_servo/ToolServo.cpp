#include "ToolServo.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number("share", "", "1.0",
                      "Share of acceleration and jerk limits for the motion relative to the reference; the rest is for "
                      "the reference's own.")
        .above(0)
        .upTo(1),
    parameter::number("velocity_filter_s", "s", "0",
                      "Time constant in which the reference's velocity is smoothed before it is followed; infinite: "
                      "the reference counts as resting; 0: from each joint's limits, as far as it could follow.")
        .atLeast(0)
        .orInfinite(),
    parameter::number("rotation_length_m", "m", "0",
                      "An error of 1 rad counts as one of so many metres; 0: the mean lever arm of the joints at the "
                      "start.")
        .atLeast(0),
    parameter::number("rest_rate", "1/s", "0.5",
                      "How fast joints that the tool leaves free go to the middle of their limits, or, without limits, "
                      "to where they started.")
        .atLeast(0),
    parameter::number("apart_m", "m", "0.1",
                      "Joints that the tool leaves free lead the arm away from obstacles and from itself where it is "
                      "nearer than this; 0: they do not.")
        .atLeast(0),
    parameter::flag("relative", "false",
                    "Follow the command's motion from where the tool is at the start (a clutch), not its pose."),
};

}  // namespace

void ToolServo::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    requireJerkLimits(setup.limits, parameters.resolved().place(), "the controller tool_servo");
    velocity_.configure(setup.limits, tick_s_, parameters.number("velocity_filter_s"));
    isRelative_ = parameters.flag("relative");

    JointVector rest = setup.start.q;
    for (int i = 0; i < n_; ++i) {
        const double lower = setup.limits.position.lower[i], upper = setup.limits.position.upper[i];
        if (std::isfinite(lower) && std::isfinite(upper)) rest[i] = (lower + upper) / 2.0;
    }
    ToolReferenceOptions options;
    options.rotationLength_m = parameters.number("rotation_length_m");
    if (options.rotationLength_m == 0.0) {
        RobotModel model(setup.robot);
        Dynamics dynamics;
        model.calcDynamics(setup.start.q, JointVector::Zero(n_), dynamics);
        options.rotationLength_m = calcLeverArm(dynamics.J);
    }
    options.restRate = parameters.number("rest_rate");
    options.apart_m = parameters.number("apart_m");
    surroundings_ = setup.surroundings;
    startTool_ = setup.startTool;
    reference_.configure(setup.robot, setup.limits, tick_s_, rest, options, setup.geometry);
    servo_.configure(setup.limits, tick_s_, parameters.number("share"));
    reset(setup.start);
}

void ToolServo::reset(const MotionState& start) {
    reference_.reset(start.q);
    servo_.reset(start);
    target_ = {start.q, JointVector::Zero(n_), JointVector::Zero(n_)};
    velocity_.reset(start.q);
    hasOrigin_ = false;
}

/** The pose to follow. */
Pose ToolServo::place(const Pose& command) const {
    const Eigen::Quaterniond orientation = command.orientation.normalized();
    if (!isRelative_) return {command.position, orientation};
    return {startTool_.position + command.position - origin_.position,
            orientation * origin_.orientation.conjugate() * startTool_.orientation};
}

TickStatus ToolServo::compute(const ControllerInput& input, ControllerOutput& output) {
    const auto& [command, nominal, dynamics, tick] = input;
    const double norm = command.tool.orientation.norm();
    if (command.space != MotionCommand::Space::Tool || !command.tool.position.allFinite() ||
        !(norm > 0.5 && norm < 2.0) || !isFinite(nominal, n_) || !isFinite(dynamics, n_))
        return TickStatus::InvalidInput;
    if (tick.missed > 0) {
        servo_.skipTicks(tick.missed);
        velocity_.forget();
    }
    if (!hasOrigin_) {
        origin_ = {command.tool.position, command.tool.orientation.normalized()};
        hasOrigin_ = true;
    }
    reference_.advance(place(command.tool), surroundings_ ? surroundings_->view().surroundings : nullptr, tick.time_s);
    if (reference_.isAtSpeedLimit()) velocity_.forget();  // it may stop at any moment: be able to stop with it
    target_.q = reference_.q();
    target_.qd = velocity_.calc(target_.q);
    servo_.calc(nominal, target_, jerk_);
    askForJerk(input, jerk_, output);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::ToolServo, "tool_servo",
              "Leads the tool to its commanded pose as fast as the joints' limits allow.", viable::kParameters)
