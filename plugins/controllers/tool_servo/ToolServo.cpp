#include "ToolServo.h"

#include "viable/plugin/PluginExport.h"
#include "viable/robot/RobotModel.h"

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
    parameter::number(
        "rest_rate", "1/s", "0.5",
        "How fast joints that the tool leaves free go to the middle of their limits, or, without limits, "
        "to where they started, once the tool is where it is commanded; behind a hand that moves they wait.")
        .atLeast(0),
    parameter::flag(
        "keeps_clear", "true",
        "Do not lead the arm nearer to obstacles of the experiment, or to itself, than whole_arm_braking would; "
        "false: it knows nothing of them."),
    parameter::number("apart_m", "m", "0.1",
                      "Joints that the tool leaves free lead the arm away from obstacles and from itself where it is "
                      "nearer than this; 0, or with keeps_clear: false: they do not.")
        .atLeast(0),
    parameter::flag("relative", "false",
                    "Follow the command's motion from where the tool is at the start (a clutch), not its pose."),
};

}  // namespace

void ToolServo::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    requireJerkLimits(setup.limits, parameters.resolved().place(), "the controller tool_servo");
    isRelative_ = parameters.flag("relative");

    ToolFollowerOptions options;
    options.share = parameters.number("share");
    options.velocityFilter_s = parameters.number("velocity_filter_s");
    options.reference.rotationLength_m = parameters.number("rotation_length_m");
    if (options.reference.rotationLength_m == 0.0) {
        RobotModel model(setup.robot);
        Dynamics dynamics;
        model.calcDynamics(setup.start.q, JointVector::Zero(n_), dynamics);
        options.reference.rotationLength_m = calcLeverArm(dynamics.J);
    }
    options.reference.restRate = parameters.number("rest_rate");
    options.reference.apart_m = parameters.number("apart_m");
    surroundings_ = setup.surroundings;
    startTool_ = setup.startTool;
    follower_.configure(setup.robot, setup.limits, setup.tick_s, setup.start, options,
                        parameters.flag("keeps_clear") ? setup.geometry : nullptr);
    reset(setup.start);
}

void ToolServo::reset(const MotionState& start) {
    follower_.reset(start);
    hasOrigin_ = false;
}

/** The pose to follow. */
Pose ToolServo::place(const Pose& command) const {
    if (!isRelative_) return command;
    return {startTool_.position + command.position - origin_.position,
            command.orientation * origin_.orientation.conjugate() * startTool_.orientation};
}

TickStatus ToolServo::compute(const ControllerInput& input, ControllerOutput& output) {
    const auto& [command, nominal, dynamics, tick] = input;
    Pose pose = command.tool;
    if (command.space != MotionCommand::Space::Tool || !normalise(pose) || !isFinite(nominal, n_) ||
        !isFinite(dynamics, n_))
        return TickStatus::InvalidInput;
    if (tick.missed > 0) follower_.skipTicks(tick.missed);
    if (!hasOrigin_) {
        origin_ = pose;
        hasOrigin_ = true;
    }
    follower_.calc(nominal, place(pose), surroundings_ ? surroundings_->view().surroundings : nullptr, tick.time_s,
                   jerk_);
    askForJerk(input, jerk_, output);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::ToolServo, "tool_servo",
              "Leads the tool to its commanded pose as fast as the joints' limits allow.", viable::kParameters)
