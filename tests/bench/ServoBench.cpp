#include <benchmark/benchmark.h>

#include "Paths.h"
#include "host/PluginLoader.h"
#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
constexpr int kTicks = 6000;

const PluginLoader& loader() {
    static const PluginLoader loader({VIABLE_PLUGIN_DIR});
    return loader;
}

template <class Interface>
PluginPtr<Interface> make(PluginKind kind, const std::string& name, const RunSetup& setup) {
    const PluginInfo info = loader().find(kind, name, "bench", {});
    PluginPtr<Interface> plugin = PluginLoader::create<Interface>(info);
    const ConfigNode block = parseConfig("plugin: {plugin: " + name + "}\n", "bench");
    plugin->configure(
        setup, readParameters(*block.find("plugin"), info.entry->parameters, info.entry->parameterCount, setup.size()));
    return plugin;
}

/** A servo controller that leads the Indy7, which does as it is asked. A first pass records what it is given; replaying
that gives the same answers again, so that nothing but the controller is timed. */
class ServoLoop {
public:
    ServoLoop(const std::string& controller, const std::string& command)
        : robot_(loadRobot(std::string(VIABLE_SOURCE_DIR) + "/robots/indy7")),
          setup_{robot_, robot_.limits, kTick_s, kTick_s * kTicks, makeStart(robot_), {}} {
        RobotModel model(robot_);
        Dynamics dynamics;
        model.calcDynamics(robot_.home, setup_.start.qd, dynamics);
        setup_.startTool = dynamics.tool;
        controller_ = make<NominalController>(PluginKind::NominalController, controller, setup_);
        const PluginPtr<CommandSource> source = make<CommandSource>(PluginKind::CommandSource, command, setup_);
        MotionState nominal = setup_.start;
        source->reset(nominal);
        controller_->reset(nominal);
        for (int k = 0; k < kTicks; ++k) {
            Row row;
            source->sample(k * kTick_s, row.command);
            model.calcDynamics(nominal.q, nominal.qd, row.dynamics);
            row.nominal = nominal;
            rows_.push_back(row);
            controller_->compute({rows_.back().command, nominal, rows_.back().dynamics, {k * kTick_s, 0}}, output_);
            for (int i = 0; i < setup_.size(); ++i) {
                const AxisState next =
                    advance({nominal.q[i], nominal.qd[i], nominal.qdd[i]}, output_.accelerationRate[i], kTick_s);
                nominal.q[i] = next.p, nominal.qd[i] = next.v, nominal.qdd[i] = next.a;
            }
        }
        controller_->reset(setup_.start);
    }

    TickStatus step() {
        if (tick_ == kTicks) {
            tick_ = 0;
            controller_->reset(setup_.start);
        }
        const Row& row = rows_[static_cast<std::size_t>(tick_)];
        return controller_->compute({row.command, row.nominal, row.dynamics, {tick_++ * kTick_s, 0}}, output_);
    }

private:
    struct Row {
        MotionCommand command;
        MotionState nominal;
        Dynamics dynamics;
    };
    static MotionState makeStart(const RobotDescription& robot) {
        const JointVector zero = JointVector::Zero(robot.size());
        return {robot.home, zero, zero};
    }

    RobotDescription robot_;
    RunSetup setup_;
    PluginPtr<NominalController> controller_{nullptr, nullptr};
    ControllerOutput output_;
    std::vector<Row> rows_;
    int tick_ = 0;
};

void runServo(benchmark::State& state, const std::string& controller, const std::string& command) {
    ServoLoop loop(controller, command);
    for (auto _ : state) benchmark::DoNotOptimize(loop.step());
    state.counters["n"] = 6;
}

const bool registered = [] {
    benchmark::RegisterBenchmark("joint_servo/n:6", runServo, "joint_servo", "random_steps");
    benchmark::RegisterBenchmark("tool_servo/n:6", runServo, "tool_servo", "generated_hand_motion");
    return true;
}();

}  // namespace
}  // namespace viable
