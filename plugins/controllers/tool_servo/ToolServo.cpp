#include "ToolServo.h"

#include "viable/plugin/PluginExport.h"
#include "viable/robot/RobotModel.h"

namespace viable {

namespace {

struct ToolServoOptions {
    ToolFollowerOptions follower;
    double rotationLength_m = 0.0;
    bool keepsClear = true, isRelative = false;

    template <class V>
    void describe(V& v) {
        follower.describe(v);
        v(rotationLength_m, "rotation_length_m", "m",
          "An error of 1 rad counts as one of so many metres. 0: the mean lever arm of the joints at the start. It is "
          "a fiftieth of that where they cannot move the tool in all six directions.")
            .atLeast(0);
        v(keepsClear, "keeps_clear",
          "Do not lead the arm nearer to obstacles of the experiment, or to itself, than whole_arm_braking would; "
          "false: it knows nothing of them.");
        v(isRelative, "relative",
          "Follow the command's motion from where the tool is at the start (a clutch), not its pose.");
    }
};

}  // namespace

void ToolServo::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    requireJerkLimits(setup.limits, parameters.resolved().place(), "the controller tool_servo");
    auto options = parameters.get<ToolServoOptions>();
    isRelative_ = options.isRelative;
    options.follower.reference.rotationLength_m = options.rotationLength_m;
    if (options.rotationLength_m == 0.0) {
        RobotModel model(setup.robot);
        Dynamics dynamics;
        model.calcDynamics(setup.start.q, JointVector::Zero(n_), dynamics);
        options.follower.reference.rotationLength_m =
            ToolFreedom(setup.robot, setup.limits).calcRotationLength(dynamics.J);
    }
    surroundings_ = setup.surroundings;
    startTool_ = setup.startTool;
    follower_.configure(setup.robot, setup.limits, setup.tick_s, setup.start, options.follower,
                        options.keepsClear ? setup.geometry : nullptr);
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
    if (!std::exchange(hasOrigin_, true)) origin_ = pose;
    follower_.calc(nominal, place(pose), surroundings_ ? surroundings_->view().surroundings : nullptr, tick.time_s,
                   jerk_);
    askForJerk(input, jerk_, output);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::ToolServo, "tool_servo",
              "Leads the tool to its commanded pose as fast as the joints' limits allow.", viable::ToolServoOptions)
