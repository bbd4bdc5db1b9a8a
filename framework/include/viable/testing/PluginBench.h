#pragma once

#include "viable/plugin/PluginExport.h"
#include "viable/robot/RobotModel.h"
#include "viable/testing/TwoLinkArm.h"

/** Defined by VIABLE_PLUGIN in the plugin that is linked into the test. */
extern "C" const viable::PluginLibrary* viable_plugin_library();

namespace viable::testing {

/** The entry of the plugin that is linked into the test, opened as the host opens it: once. */
inline const PluginEntry& openOwnPlugin() {
    static const PluginEntry& entry = []() -> const PluginEntry& {
        const PluginLibrary& library = *viable_plugin_library();
        library.open();
        return library.entries[0];
    }();
    return entry;
}

/** Configures the plugin that is linked into a test, and supplies the inputs of one tick. The arm is the two-link
arm at rest in its home pose, with 1 ms per tick. Must outlive the plugin. */
class PluginBench {
public:
    PluginBench() : model_(robot_) {
        const JointVector zero = JointVector::Zero(robot_.size());
        setup_.start = {robot_.home, zero, zero};
        model_.calcDynamics(robot_.home, zero, dynamics_);
        setup_.startTool = dynamics_.tool;
    }
    PluginBench(const PluginBench&) = delete;
    PluginBench& operator=(const PluginBench&) = delete;

    int size() const { return robot_.size(); }
    const RunSetup& setup() const { return setup_; }
    const MotionState& state() const { return setup_.start; }
    const Dynamics& dynamics() const { return dynamics_; }  ///< at state()

    /** Parameters as in an experiment file, `gain: 2, mode: fast`, checked by the plugin's own declaration.
    Throws Error (BadInput) where an experiment would be refused. */
    Parameters read(const std::string& parameters) const {
        const PluginEntry& entry = openOwnPlugin();
        const ConfigNode root = parseConfig("plugin: {" + parameters + "}\n", "test.yaml");
        return readParameters(*root.find("plugin"), entry.parameters, entry.parameterCount, size());
    }

    /** configure() and reset(). */
    void configure(Plugin& plugin, const std::string& parameters = "") const {
        plugin.configure(setup_, read(parameters));
        plugin.reset(setup_.start);
    }

    /** The torque that gives `acceleration` [rad/s^2] at state(). */
    JointVector calcTorque(const JointVector& acceleration) const {
        JointVector torque;
        calcInverseDynamics(dynamics_, acceleration, torque);
        return torque;
    }

    /** The command to rest at `q` [rad]. */
    MotionCommand command(const JointVector& q) const {
        MotionCommand command;
        command.q = q;
        command.qd.setZero(size());
        return command;
    }

private:
    RobotDescription robot_ = makeTwoLinkArm();
    RobotModel model_;
    RunSetup setup_{robot_, robot_.limits, 1e-3, 5.0, {}, {}};
    Dynamics dynamics_;
};

}  // namespace viable::testing
