// viable_contract: the rules of Plugin.h and of the five interfaces, through the loader. In this project ctest runs it for
// every plugin beside the program; viable_add_plugin_test() runs it for one plugin of somebody else. A new plugin is
// tested here without a line of code, unless it has parameters without defaults: see makeRequiredParameters().
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <ostream>
#include <set>
#include <thread>

#include "core/Text.h"
#include "host/PluginLoader.h"
#include "viable/link/viable_link_linux.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/RobotModel.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {

/** For gtest, which otherwise prints a parameter's bytes. */
static void PrintTo(const PluginInfo& info, std::ostream* out) {
    *out << getName(info.kind) << " " << info.name;
}

namespace {

namespace fs = std::filesystem;

/** What is tested, from the command line. */
struct Tested {
    std::string folder;                   // of the libraries
    std::string plugin;                   // such as "filter my_filter"; empty: every plugin in the folder
    std::vector<std::string> parameters;  // of those that have no default, "name: value", for two joints
};
Tested tested;

constexpr int kJoints = 2;
constexpr double kTick_s = 0.001;
constexpr double kDuration_s = 5.0;
constexpr double kUntouched = 123.25;  // what outputs hold before a tick

// --- A small arm and its run --------------------------------------------------------------------

JointVector pair(double first, double second) {
    JointVector v(kJoints);
    v << first, second;
    return v;
}

const RobotDescription& getArm() {
    static const RobotDescription arm = testing::makeTwoLinkArm();
    return arm;
}

/** Everything that a plugin of any kind may be given in one tick. */
struct Inputs {
    double t = 0.0;
    MotionCommand command;
    MotionState nominal;
    JointState real;
    Dynamics dynamics;
    JointVector torque;
};

/** A smooth motion, well inside the limits; equal for equal ticks. */
Inputs makeInputs(int tick, RobotModel& model) {
    Inputs in;
    in.t = tick * kTick_s;
    const double w = 2.0;  // [rad/s]
    const JointVector amplitude = pair(0.4, 0.6);
    const double s = std::sin(w * in.t), c = std::cos(w * in.t);
    in.nominal.q = getArm().home + amplitude * (1.0 - c);
    in.nominal.qd = amplitude * (w * s);
    in.nominal.qdd = amplitude * (w * w * c);
    in.real.q = in.nominal.q + pair(1e-3, -2e-3) * s;
    in.real.qd = in.nominal.qd + pair(1e-3, -2e-3) * (w * c);
    model.calcDynamics(in.nominal.q, in.nominal.qd, in.dynamics);
    in.torque = in.dynamics.M * pair(3.0 * std::sin(5.0 * in.t), 4.0 * std::cos(3.0 * in.t)) + in.dynamics.b;
    in.command.q = in.nominal.q + pair(0.05, -0.05);
    in.command.qd = in.nominal.qd;
    in.command.tool = in.dynamics.tool;
    in.command.tool.position += Eigen::Vector3d(0.01, 0.0, -0.02);
    in.command.toolTwist.setConstant(0.01 * s);
    return in;
}

RunSetup makeSetup() {
    RunSetup setup{getArm(), getArm().limits, kTick_s, kDuration_s, {}, {}};
    const JointVector zero = JointVector::Zero(kJoints);
    setup.start = {getArm().home, zero, zero};
    RobotModel model(getArm());
    Dynamics dynamics;
    model.calcDynamics(setup.start.q, setup.start.qd, dynamics);
    setup.startTool = dynamics.tool;
    return setup;
}

// --- Parameters ---------------------------------------------------------------------------------

/** A recording in TUM format, written once per process and removed at its end. */
class Recording {
public:
    Recording() {
        std::string name = (fs::temp_directory_path() / "viable-contract-XXXXXX").string();
        if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
        folder_ = name;
        std::ofstream out(file());
        out << "# timestamp tx ty tz qx qy qz qw\n";
        out.precision(12);
        for (int i = 0; i <= 600; ++i) {
            const double t = i * 0.01, angle = 0.2 * std::sin(t);
            out << 1000.0 + t << ' ' << 0.05 * std::sin(2 * t) << ' ' << 0.03 * std::sin(3 * t) << ' '
                << 0.04 * (1 - std::cos(t)) << " 0 " << std::sin(angle / 2) << " 0 " << std::cos(angle / 2) << '\n';
        }
    }
    ~Recording() {
        std::error_code ignored;
        fs::remove_all(folder_, ignored);
    }
    fs::path file() const { return folder_ / "recording.txt"; }

private:
    fs::path folder_;
};

/** A robot for the plant `link`: answers every command with the next state, and so needs no clock. Moves by the torques that
come, as nothing does, but alike each time; each host has its own, at the start. */
class AnsweringRobot {
public:
    AnsweringRobot() {
        char error[256];
        if (vl_line_open(&line_, "127.0.0.1:0", 1, error, sizeof error) != 0) throw std::runtime_error(error);
        RobotModel model(getArm());
        Dynamics dynamics;
        model.calcDynamics(getArm().home, JointVector::Zero(kJoints), dynamics);
        gravity_ = dynamics.gravity;
        thread_ = std::thread([this] { run(); });
    }
    ~AnsweringRobot() {
        ends_ = true;
        thread_.join();
        vl_line_close(&line_);
    }
    std::string address() const { return "\"127.0.0.1:" + std::to_string(vl_line_port(&line_)) + "\""; }

private:
    struct Arm {
        vl_robot robot;
        sockaddr_storage at;
        socklen_t size;
        double q[kJoints], qd[kJoints];
    };

    void run() {
        std::uint8_t bytes[VL_MAX_PACKET + 1];
        while (!ends_) {
            std::uint64_t peer = 0;
            const std::size_t size = vl_line_receive(&line_, bytes, kIdle_ns, &peer);
            if (size == 0) {  // nobody is left without states
                for (auto& [number, arm] : arms_) answer(arm, false);
                continue;
            }
            if (arms_.count(peer) == 0) {
                Arm arm{{}, line_.from, line_.from_size, {}, {}};
                vl_robot_init(&arm.robot, kJoints, kTick_s, peer);
                for (int i = 0; i < kJoints; ++i) arm.q[i] = getArm().home[i];
                arms_[peer] = arm;
            }
            Arm& arm = arms_[peer];
            const bool hadHost = arm.robot.has_host != 0;
            const bool isGood = vl_robot_receive(&arm.robot, bytes, size, peer) == VL_GOOD;
            if (isGood || vl_robot_peer(&arm.robot) != 0) answer(arm, isGood);
            if (hadHost && !arm.robot.has_host) arms_.erase(peer);  // it has said stop
        }
    }
    void answer(Arm& arm, bool moves) {
        double torque[VL_MAX_JOINTS];
        const bool isDriven = vl_robot_tick(&arm.robot, torque) == VL_TORQUE && moves;
        vl_state state{};
        state.flags = VL_ENABLED;
        state.time_ns = static_cast<std::int64_t>(std::llround(1e9 * kTick_s * static_cast<double>(arm.robot.tick)));
        for (int i = 0; i < kJoints; ++i) {
            if (isDriven) arm.q[i] += kTick_s * (arm.qd[i] = 1e-3 * torque[i]);
            state.q[i] = arm.q[i];
            state.qd[i] = arm.qd[i];
            state.tau[i] = gravity_[i];
        }
        line_.to = arm.at;
        line_.to_size = arm.size;
        vl_robot_send(&arm.robot, &line_, &state);
    }

    static constexpr std::int64_t kIdle_ns = 50'000'000;
    vl_line line_{};
    JointVector gravity_;
    std::map<std::uint64_t, Arm> arms_;
    std::atomic<bool> ends_{false};
    std::thread thread_;
};

using Texts = std::map<std::string, std::string>;

/** Values for parameters that have no default, and for what a busy machine needs. */
Texts makeRequiredParameters(const PluginInfo& info) {
    Texts values;
    if (tested.plugin.empty()) {  // the plugins of this project
        static const Recording recording;
        const std::string plugin = std::string(getName(info.kind)) + " " + info.name;
        if (plugin == "command waypoints") return {{"points", "[[0, 0.3, -0.5], [1.5, 0.6, 0.1], [3, -0.2, -0.3]]"}};
        if (plugin == "command recorded_poses") return {{"file", recording.file().string()}};
        if (plugin == "command stream") {  // one socket for each
            static std::atomic<int> made{0};
            return {{"name", "contract-" + std::to_string(::getpid()) + "-" + std::to_string(++made)}};
        }
        if (plugin == "plant link") {
            static const AnsweringRobot robot;
            return {{"address", robot.address()}, {"connect_timeout_s", "20"}, {"silence_timeout_s", "20"}};
        }
    }
    for (const std::string& line : tested.parameters) {
        const std::size_t colon = line.find(": ");
        if (colon == std::string::npos) throw std::runtime_error("PARAMETERS: write 'name: value', not '" + line + "'");
        values[line.substr(0, colon)] = line.substr(colon + 2);
    }
    return values;
}

Parameters readBlock(const PluginInfo& info, const Texts& values) {
    std::string text = "plugin: " + info.name + "\n";
    for (const auto& [name, value] : values) text += name + ": " + value + "\n";
    return readParameters(parseConfig(text, "contract.yaml"), info.entry->parameters, info.entry->parameterCount,
                          kJoints);
}

/** What is said against these values; empty: nothing. */
std::string findComplaint(const PluginInfo& info, const Texts& values) {
    try {
        readBlock(info, values);
        return {};
    } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::BadInput);
        return error.what();
    }
}

// --- Plugins of all kinds, driven alike ---------------------------------------------------------

enum class Outcome { Usable, InvalidInput, Faulted };

Outcome toOutcome(TickStatus status) {
    return status == TickStatus::Ok             ? Outcome::Usable
           : status == TickStatus::InvalidInput ? Outcome::InvalidInput
                                                : Outcome::Faulted;
}

/** The numbers that came out of a tick; no heap, so that it may stand in the counted section. */
struct Output {
    Outcome outcome = Outcome::Faulted;
    std::array<double, 256> values{};
    int count = 0;
    bool isFinite = true, hasRightSizes = true;

    void addAny(double value) { values[count++] = value; }
    void add(double value) {
        addAny(value);
        isFinite = isFinite && std::isfinite(value);
    }
    void add(const JointVector& v) {
        hasRightSizes = hasRightSizes && v.size() == kJoints;
        for (int i = 0; i < v.size(); ++i) add(v[i]);
    }
    bool isUntouched() const {
        return std::all_of(values.begin(), values.begin() + count, [](double v) { return v == kUntouched; });
    }
    bool hasSameBits(const Output& other) const {
        return outcome == other.outcome && count == other.count &&
               std::memcmp(values.data(), other.values.data(), static_cast<std::size_t>(count) * sizeof(double)) == 0;
    }
};

/** One of the inputs that a plugin reads. */
struct Slot {
    std::string name;
    std::function<std::vector<double*>(Inputs&)> numbers;
    std::function<void(Inputs&, int)> resize;  // empty: has no run-time size
};

template <class Vector>
std::vector<double*> addressesOf(Vector& v) {
    std::vector<double*> addresses;
    for (Eigen::Index i = 0; i < v.size(); ++i) addresses.push_back(v.data() + i);
    return addresses;
}

void resizeKeeping(JointVector& v, int n) {
    const Eigen::Index before = v.size();
    v.conservativeResize(n);
    for (Eigen::Index i = before; i < n; ++i) v[i] = 0.25;
}

using Find = std::function<JointVector&(Inputs&)>;

Slot makeSlot(const std::string& name, const Find& find) {
    return {name, [find](Inputs& in) { return addressesOf(find(in)); },
            [find](Inputs& in, int n) { resizeKeeping(find(in), n); }};
}

std::vector<Slot> makeNominalSlots() {
    return {makeSlot("nominal.q", [](Inputs& in) -> JointVector& { return in.nominal.q; }),
            makeSlot("nominal.qd", [](Inputs& in) -> JointVector& { return in.nominal.qd; }),
            makeSlot("nominal.qdd", [](Inputs& in) -> JointVector& { return in.nominal.qdd; })};
}

std::vector<Slot> makeArmSlots() {
    std::vector<Slot> slots = makeNominalSlots();
    slots.push_back({"M", [](Inputs& in) { return addressesOf(in.dynamics.M); },
                     [](Inputs& in, int n) { in.dynamics.M = JointMatrix::Identity(n, n); }});
    slots.push_back(makeSlot("b", [](Inputs& in) -> JointVector& { return in.dynamics.b; }));
    return slots;
}

Slot makeTorqueSlot() {
    return makeSlot("torque", [](Inputs& in) -> JointVector& { return in.torque; });
}

class Subject {
public:
    virtual ~Subject() = default;
    virtual void reset(const MotionState& start) = 0;
    /** Replaces inputs that this plugin's own outputs determine (a filter moves the nominal arm).
     */
    virtual void close(Inputs&) {}
    /** One call of the tick function; outputs hold kUntouched before it. */
    virtual Output step(const Inputs& in) = 0;
    /** After a good tick. */
    virtual void advance() {}
    virtual std::vector<Slot> slots() const = 0;
};

template <class Interface>
class PluginSubject : public Subject {
public:
    PluginSubject(const PluginInfo& info, const RunSetup& setup) : plugin_(PluginLoader::create<Interface>(info)) {
        plugin_->configure(setup, readBlock(info, makeRequiredParameters(info)));
    }
    void reset(const MotionState& start) override { plugin_->reset(start); }

protected:
    const PluginPtr<Interface> plugin_;
};

class CommandSubject : public PluginSubject<CommandSource> {
public:
    CommandSubject(const PluginInfo& info, const RunSetup& setup)
        : PluginSubject(info, setup), space_(plugin_->traits().space) {}
    Output step(const Inputs& in) override {
        MotionCommand command;
        const bool isJoint = space_ == MotionCommand::Space::Joint;
        command.space = space_;
        command.q.setConstant(kJoints, kUntouched);
        command.qd.setConstant(kJoints, kUntouched);
        command.tool.position.setConstant(kUntouched);
        command.tool.orientation.coeffs().setConstant(kUntouched);
        command.toolTwist.setConstant(kUntouched);
        Output out;
        out.outcome = toOutcome(plugin_->sample(in.t, command));
        out.hasRightSizes = command.space == space_;
        if (isJoint) {
            out.add(command.q);
            out.add(command.qd);
        } else {
            for (int i = 0; i < 3; ++i) out.add(command.tool.position[i]);
            for (int i = 0; i < 4; ++i) out.add(command.tool.orientation.coeffs()[i]);
            for (int i = 0; i < 6; ++i) out.add(command.toolTwist[i]);
        }
        return out;
    }
    std::vector<Slot> slots() const override {
        return {{"t", [](Inputs& in) { return std::vector<double*>{&in.t}; }, {}}};
    }

private:
    MotionCommand::Space space_;
};

class ControllerSubject : public PluginSubject<NominalController> {
public:
    ControllerSubject(const PluginInfo& info, const RunSetup& setup)
        : PluginSubject(info, setup),
          space_(plugin_->traits().follows(MotionCommand::Space::Joint) ? MotionCommand::Space::Joint
                                                                        : MotionCommand::Space::Tool) {
        if (!plugin_->traits().follows(space_)) throw std::runtime_error(info.name + " follows nothing");
    }
    void close(Inputs& in) override { in.command.space = space_; }
    Output step(const Inputs& in) override {
        ControllerOutput output{JointVector::Constant(kJoints, kUntouched), {}, false};
        Output out;
        out.outcome = toOutcome(plugin_->compute({in.command, in.nominal, in.dynamics}, output));
        out.add(output.torque);
        if (output.hasAccelerationRate) out.add(output.accelerationRate);
        return out;
    }
    std::vector<Slot> slots() const override {
        std::vector<Slot> slots = makeArmSlots();
        slots.push_back(makeSlot("gravity", [](Inputs& in) -> JointVector& { return in.dynamics.gravity; }));
        slots.push_back({"J", [](Inputs& in) { return addressesOf(in.dynamics.J); },
                         [](Inputs& in, int n) { in.dynamics.J.setConstant(6, n, 0.1); }});
        slots.push_back({"position", [](Inputs& in) { return addressesOf(in.dynamics.tool.position); }, {}});
        slots.push_back(
            {"orientation", [](Inputs& in) { return addressesOf(in.dynamics.tool.orientation.coeffs()); }, {}});
        if (space_ == MotionCommand::Space::Joint) {
            slots.push_back(makeSlot("command.q", [](Inputs& in) -> JointVector& { return in.command.q; }));
            slots.push_back(makeSlot("command.qd", [](Inputs& in) -> JointVector& { return in.command.qd; }));
        } else {
            slots.push_back(
                {"command.tool.position", [](Inputs& in) { return addressesOf(in.command.tool.position); }, {}});
            slots.push_back({"command.tool.orientation",
                             [](Inputs& in) { return addressesOf(in.command.tool.orientation.coeffs()); },
                             {}});
            slots.push_back({"command.toolTwist", [](Inputs& in) { return addressesOf(in.command.toolTwist); }, {}});
        }
        return slots;
    }

private:
    MotionCommand::Space space_;
};

/** The filter moves the nominal arm, as in the control loop. */
class FilterSubject : public PluginSubject<SafetyFilter> {
public:
    using PluginSubject::PluginSubject;
    void reset(const MotionState& start) override {
        nominal_ = start;
        plugin_->reset(start);
    }
    void close(Inputs& in) override {
        in.nominal = nominal_;
        model_.calcDynamics(nominal_.q, nominal_.qd, in.dynamics);
    }
    Output step(const Inputs& in) override {
        decision_ = FilterDecision();
        decision_.value.setConstant(kJoints, kUntouched);
        const FilterStatus status = plugin_->filter({in.nominal, in.torque, in.dynamics}, decision_);
        Output out;
        out.outcome = status == FilterStatus::InvalidInput ? Outcome::InvalidInput
                      : status == FilterStatus::Faulted    ? Outcome::Faulted
                                                           : Outcome::Usable;
        out.add(decision_.value);
        if (decision_.held != HeldQuantity::Jerk)
            out.add(static_cast<double>(decision_.held));  // the default is no number
        for (std::size_t i = 0; decision_.hasStops && i < kJoints; ++i)
            for (int k = 0; k < GridStop::kSegments; ++k) {
                out.add(static_cast<double>(decision_.stops[i].remaining(k).ticks));
                out.add(decision_.stops[i].remaining(k).jerk);
            }
        return out;
    }
    void advance() override { advanceNominal(decision_, kTick_s, nominal_); }
    std::vector<Slot> slots() const override {
        std::vector<Slot> slots = makeArmSlots();
        slots.push_back(makeTorqueSlot());
        return slots;
    }

private:
    RobotModel model_{getArm()};
    FilterDecision decision_;
    MotionState nominal_;
};

class RobustLoopSubject : public PluginSubject<RobustLoop> {
public:
    using PluginSubject::PluginSubject;
    Output step(const Inputs& in) override {
        JointVector torque = JointVector::Constant(kJoints, kUntouched);
        Output out;
        out.outcome = toOutcome(plugin_->compute(in.real, in.nominal, in.torque, torque));
        out.add(torque);
        return out;
    }
    std::vector<Slot> slots() const override {
        std::vector<Slot> slots = makeNominalSlots();
        slots.push_back(makeSlot("real.q", [](Inputs& in) -> JointVector& { return in.real.q; }));
        slots.push_back(makeSlot("real.qd", [](Inputs& in) -> JointVector& { return in.real.qd; }));
        slots.push_back(makeTorqueSlot());
        return slots;
    }
};

class PlantSubject : public PluginSubject<RealPlant> {
public:
    using PluginSubject::PluginSubject;
    Output step(const Inputs& in) override {
        JointVector applied = JointVector::Constant(kJoints, kUntouched);
        Output out;
        std::int64_t passed = 0;
        if (plugin_->traits().hasClock && (plugin_->read(passed) != TickStatus::Ok || passed < 1)) return out;
        const JointState before = plugin_->actual();
        out.outcome = toOutcome(plugin_->advance(in.torque, applied));
        out.add(applied);
        if (out.outcome != Outcome::Usable) {
            out.hasRightSizes &= plugin_->actual().q == before.q && plugin_->actual().qd == before.qd;
        } else {
            out.add(plugin_->measured().q);
            out.add(plugin_->measured().qd);
            out.add(plugin_->actual().q);
            out.add(plugin_->actual().qd);
        }
        return out;
    }
    std::vector<Slot> slots() const override { return {makeTorqueSlot()}; }
};

std::unique_ptr<Subject> makeSubject(const PluginInfo& info, const RunSetup& setup) {
    if (info.kind == PluginKind::CommandSource) return std::make_unique<CommandSubject>(info, setup);
    if (info.kind == PluginKind::NominalController) return std::make_unique<ControllerSubject>(info, setup);
    if (info.kind == PluginKind::SafetyFilter) return std::make_unique<FilterSubject>(info, setup);
    if (info.kind == PluginKind::RobustLoop) return std::make_unique<RobustLoopSubject>(info, setup);
    return std::make_unique<PlantSubject>(info, setup);
}

// --- The suite ----------------------------------------------------------------------------------

std::vector<PluginInfo> findPlugins(std::vector<RefusedLibrary>& refused) {
    std::vector<PluginInfo> plugins = PluginLoader({tested.folder}).list(refused);
    const auto isOther = [&](const PluginInfo& info) {
        return !tested.plugin.empty() && std::string(getName(info.kind)) + " " + info.name != tested.plugin;
    };
    plugins.erase(std::remove_if(plugins.begin(), plugins.end(), isOther), plugins.end());
    return plugins;
}

std::vector<PluginInfo> findPlugins() {
    std::vector<RefusedLibrary> refused;
    return findPlugins(refused);
}

TEST(Plugins, NoLibraryIsRefused) {
    std::vector<RefusedLibrary> refused;
    findPlugins(refused);
    for (const RefusedLibrary& library : refused) ADD_FAILURE() << library.library << ": " << library.reason;
}

TEST(Plugins, WhatIsToBeTestedIsThere) {
    if (!tested.plugin.empty()) {
        EXPECT_EQ(findPlugins().size(), 1u) << "no " << tested.plugin << " in " << tested.folder;
        return;
    }
    std::set<PluginKind> kinds;
    for (const PluginInfo& info : findPlugins()) kinds.insert(info.kind);
    for (PluginKind kind : kPluginKinds)
        EXPECT_EQ(kinds.count(kind), 1u) << "no " << getName(kind) << " plugin in " << tested.folder;
}

class Contract : public ::testing::TestWithParam<PluginInfo> {
protected:
    const PluginInfo& info() const { return GetParam(); }

    std::unique_ptr<Subject> make() {
        std::unique_ptr<Subject> subject = makeSubject(info(), setup_);
        subject->reset(setup_.start);
        return subject;
    }

    /** The tick's inputs for this subject. */
    Inputs prepare(Subject& subject, int tick) {
        Inputs in = makeInputs(tick, model_);
        subject.close(in);
        return in;
    }

    /** A tick with good inputs, checked. */
    Output run(Subject& subject, int tick) {
        const Output out = subject.step(prepare(subject, tick));
        EXPECT_EQ(out.outcome, Outcome::Usable) << "tick " << tick;
        EXPECT_TRUE(out.isFinite) << "tick " << tick;
        EXPECT_TRUE(out.hasRightSizes) << "tick " << tick;
        if (out.outcome == Outcome::Usable && out.isFinite && out.hasRightSizes) subject.advance();
        return out;
    }

    std::vector<Output> runFromStart(Subject& subject, int ticks) {
        subject.reset(setup_.start);
        std::vector<Output> outputs;
        for (int tick = 0; tick < ticks; ++tick) outputs.push_back(run(subject, tick));
        return outputs;
    }

    /** Rules for a tick that said InvalidInput. */
    static void checkRefusal(const Output& out, const std::string& what) {
        EXPECT_TRUE(out.isUntouched()) << what << ": InvalidInput, and yet the output was written";
        EXPECT_TRUE(out.hasRightSizes) << what << ": InvalidInput, and yet something changed";
    }

    RunSetup setup_ = makeSetup();
    RobotModel model_{getArm()};
};

constexpr int kGoodTicks = 5;

TEST_P(Contract, NeverPutsOutNanForNanOrInfinityIn) {
    const std::vector<Slot> slots = make()->slots();
    ASSERT_FALSE(slots.empty());
    for (const Slot& slot : slots) {
        Inputs sample = makeInputs(0, model_);
        const std::size_t count = slot.numbers(sample).size();
        ASSERT_GT(count, 0u) << slot.name;
        for (std::size_t entry = 0; entry < count; ++entry) {
            for (const double bad : {kNan, kInfinity, -kInfinity}) {
                const std::string what = slot.name + "[" + std::to_string(entry) + "] = " + std::to_string(bad);
                const std::unique_ptr<Subject> subject = make();
                for (int tick = 0; tick < kGoodTicks; ++tick) run(*subject, tick);
                Inputs in = prepare(*subject, kGoodTicks);
                *slot.numbers(in)[entry] = bad;
                const Output out = subject->step(in);
                EXPECT_NE(out.outcome, Outcome::Faulted) << what;
                if (out.outcome == Outcome::InvalidInput)
                    checkRefusal(out, what);
                else
                    EXPECT_TRUE(out.isFinite && out.hasRightSizes) << what << " came through";
                // What was bad once must not come out later.
                for (int tick = kGoodTicks + 1; tick < 2 * kGoodTicks; ++tick) {
                    const Output later = subject->step(prepare(*subject, tick));
                    EXPECT_TRUE(later.isFinite) << what << ", tick " << tick;
                }
            }
        }
    }
}

TEST_P(Contract, RefusesWrongSizesWithoutACrash) {
    for (const Slot& slot : make()->slots()) {
        if (!slot.resize) continue;
        for (const int size : {kJoints - 1, kJoints + 1, 0, kMaxJoints}) {
            const std::string what = slot.name + " with " + std::to_string(size) + " entries";
            const std::unique_ptr<Subject> subject = make(), twin = make();
            for (int tick = 0; tick < kGoodTicks; ++tick) {
                run(*subject, tick);
                run(*twin, tick);
            }
            Inputs in = prepare(*subject, kGoodTicks);
            slot.resize(in, size);
            const Output out = subject->step(in);
            if (out.outcome == Outcome::InvalidInput) {
                checkRefusal(out, what);
            } else {  // right only for inputs that this plugin does not read
                EXPECT_TRUE(out.hasSameBits(twin->step(prepare(*twin, kGoodTicks))))
                    << what << " is not refused and changes the output";
            }
        }
    }
}

TEST_P(Contract, ResetTwiceIsResetOnce) {
    const std::unique_ptr<Subject> subject = make();
    const std::vector<Output> first = runFromStart(*subject, 50);
    subject->reset(setup_.start);
    subject->reset(setup_.start);
    const std::vector<Output> second = runFromStart(*subject, 50);
    for (std::size_t i = 0; i < first.size(); ++i) ASSERT_TRUE(first[i].hasSameBits(second[i])) << "tick " << i;
}

TEST_P(Contract, SameInputsGiveTheSameBits) {
    const std::unique_ptr<Subject> one = make(), two = make();
    const std::vector<Output> first = runFromStart(*one, 300);
    const std::vector<Output> second = runFromStart(*two, 300);
    const std::vector<Output> again = runFromStart(*one, 300);
    for (std::size_t i = 0; i < first.size(); ++i) {
        ASSERT_TRUE(first[i].hasSameBits(second[i])) << "another instance, tick " << i;
        ASSERT_TRUE(first[i].hasSameBits(again[i])) << "after a reset, tick " << i;
    }
}

TEST_P(Contract, AllocatesNothingInATick) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    constexpr int kWarmUp = 100, kTicks = 1000;
    const std::unique_ptr<Subject> subject = make();
    for (int tick = 0; tick < kWarmUp; ++tick) run(*subject, tick);
    std::int64_t allocations = 0;
    for (int tick = kWarmUp; tick < kWarmUp + kTicks; ++tick) {
        const Inputs in = prepare(*subject, tick);
        const testing::AllocationCounter counter;
        const Output out = subject->step(in);
        allocations += counter.count();
        ASSERT_EQ(out.outcome, Outcome::Usable) << "tick " << tick;
        subject->advance();
    }
    EXPECT_EQ(allocations, 0) << "in " << kTicks << " ticks";
    // Neither does a tick that refuses its input, nor a reset.
    const Slot slot = subject->slots().front();
    Inputs in = prepare(*subject, kWarmUp + kTicks);
    *slot.numbers(in)[0] = kNan;
    const testing::AllocationCounter counter;
    subject->step(in);
    subject->reset(setup_.start);
    EXPECT_EQ(counter.count(), 0) << "in a tick with NaN in " << slot.name << " and a reset";
}

// --- The declaration of its parameters ----------------------------------------------------------

std::string write(double value) {
    return detail::format("%.17g", value);
}

std::string writeList(const std::string& value, int count) {
    std::string text = "[";
    for (int i = 0; i < count; ++i) text += (i ? ", " : "") + value;
    return text + "]";
}

/** Values that `spec` must refuse. */
std::vector<std::string> makeRefusedValues(const ParameterSpec& spec) {
    const auto beyond = [](double bound, double sign) {
        return write(bound + sign * std::max(1e-9, std::abs(bound) * 1e-9));
    };
    std::vector<std::string> numbers = {".nan", "text"};
    const bool isInteger = spec.type == ParameterType::Integer;
    if (std::isfinite(spec.min)) {
        numbers.push_back(isInteger ? std::to_string(std::llround(std::ceil(spec.min)) - 1) : beyond(spec.min, -1));
        if (spec.minIsOpen) numbers.push_back(write(spec.min));
    }
    if (std::isfinite(spec.max)) {
        numbers.push_back(isInteger ? std::to_string(std::llround(std::floor(spec.max)) + 1) : beyond(spec.max, 1));
        if (spec.maxIsOpen) numbers.push_back(write(spec.max));
    }
    if (!spec.mayBeInfinite) numbers.push_back(".inf");

    std::vector<std::string> values;
    switch (spec.type) {
        case ParameterType::Number:
        case ParameterType::Integer:
            values = numbers;
            values.push_back(isInteger ? "1.5" : "[1, 2]");
            break;
        case ParameterType::Flag:
            values = {"maybe", "1", "[true]"};
            break;
        case ParameterType::Choice:
            values = {"no_such_choice", "[a, b]"};
            break;
        case ParameterType::Text:
            values = {"[a, b]", "{a: b}"};
            break;
        case ParameterType::File:
            values = {"/nowhere/at/all.txt", "[a, b]"};
            break;
        case ParameterType::JointNumbers:
            values = numbers;
            for (const std::string& number : numbers) values.push_back(writeList(number, kJoints));
            values.push_back(writeList("1", kJoints + 1));
            values.push_back(writeList("1", kJoints - 1));
            break;
        case ParameterType::Numbers:
        case ParameterType::Rows: {
            const int some = std::max(1, spec.minCount);
            for (const std::string& number : numbers) values.push_back(writeList(number, some));
            values.push_back(writeList("1", spec.maxCount + 1));
            if (spec.minCount > 0) values.push_back(writeList("1", spec.minCount - 1));
            if (spec.type == ParameterType::Rows)
                for (std::string& value : values) value = "[" + value + "]";
            values.push_back("text");
            break;
        }
        default:  // not in a plugin's table
            break;
    }
    return values;
}

TEST_P(Contract, DefaultsParseAndReadBackAsTheyAre) {
    const PluginEntry& entry = *info().entry;
    Parameters parameters;
    try {
        parameters = readBlock(info(), makeRequiredParameters(info()));
    } catch (const Error& error) {
        FAIL() << error.what()
               << "\nA parameter without default needs a value: PARAMETERS of viable_add_plugin_test(), "
               << "for a plugin of this project makeRequiredParameters() in tools/contract/Contract.cpp.";
    }
    for (std::uint64_t i = 0; i < entry.parameterCount; ++i)
        EXPECT_NE(parameters.resolved().find(entry.parameters[i].name), nullptr) << entry.parameters[i].name;
    // The complete block, written out, is a block with the same values.
    const std::string text = writeConfig(parameters.resolved());
    const Parameters again =
        readParameters(parseConfig(text, "resolved.yaml"), entry.parameters, entry.parameterCount, kJoints);
    EXPECT_EQ(writeConfig(again.resolved()), text);
}

TEST_P(Contract, DeclaresParametersWithWordsForPeople) {
    const PluginEntry& entry = *info().entry;
    EXPECT_GT(std::strlen(entry.summary), 10u);
    for (std::uint64_t i = 0; i < entry.parameterCount; ++i) {
        const ParameterSpec& spec = entry.parameters[i];
        EXPECT_GT(std::strlen(spec.help), 5u) << spec.name;
        std::string name = spec.name;
        for (const std::string unit : {"_N", "_Pa"})  // those with a capital
            if (const std::size_t at = name.find(unit); at != std::string::npos) name.erase(at, unit.size());
        for (const char c : name) EXPECT_TRUE(std::islower(c) || std::isdigit(c) || c == '_') << spec.name;
    }
}

TEST_P(Contract, RefusesEveryValueOutOfRangeByName) {
    const PluginEntry& entry = *info().entry;
    for (std::uint64_t i = 0; i < entry.parameterCount; ++i) {
        const ParameterSpec& spec = entry.parameters[i];
        for (const std::string& value : makeRefusedValues(spec)) {
            Texts values = makeRequiredParameters(info());
            values[spec.name] = value;
            const std::string message = findComplaint(info(), values);
            EXPECT_FALSE(message.empty()) << spec.name << ": " << value << " was accepted";
            EXPECT_EQ(message.rfind("contract.yaml:", 0), 0u) << message;
            EXPECT_NE(message.find(spec.name), std::string::npos) << message;
        }
    }
}

TEST_P(Contract, RefusesUnknownAndMissingParameters) {
    Texts values = makeRequiredParameters(info());
    values["no_such_parameter"] = "1";
    const std::string unknown = findComplaint(info(), values);
    EXPECT_FALSE(unknown.empty()) << "an unknown parameter was accepted";
    EXPECT_NE(unknown.find("no_such_parameter"), std::string::npos) << unknown;
    std::set<std::string> required;
    for (std::uint64_t i = 0; i < info().entry->parameterCount; ++i)
        if (!info().entry->parameters[i].defaultText) required.insert(info().entry->parameters[i].name);
    for (const std::string& name : required) {
        Texts fewer = makeRequiredParameters(info());
        fewer.erase(name);
        const std::string missing = findComplaint(info(), fewer);
        EXPECT_FALSE(missing.empty()) << name << " was not missed";
        EXPECT_NE(missing.find(name), std::string::npos) << missing;
    }
}

INSTANTIATE_TEST_SUITE_P(All, Contract, ::testing::ValuesIn(findPlugins()), [](const auto& test) {
    return std::string(getName(test.param.kind)) + "_" + test.param.name;
});

}  // namespace
}  // namespace viable

int main(int argc, char** argv) {
    std::vector<std::string> words;
    for (int i = 1; i < argc; ++i)
        if (std::strncmp(argv[i], "--", 2) != 0) words.emplace_back(argv[i]);  // the rest is GoogleTest's
    if (words.empty() || words.size() == 2) {
        std::fputs(
            "usage: viable_contract FOLDER [KIND NAME [\"PARAMETER: VALUE\"...]] [--gtest_filter=...]\n"
            "Tests the rules that every plugin keeps: of that plugin in FOLDER, or of all in it. KIND is command,\n"
            "controller, filter, robust_loop or plant. Parameters that have no default need a value, for two joints.\n",
            stderr);
        return 2;
    }
    viable::tested.folder = words[0];
    if (words.size() > 1) {
        viable::tested.plugin = words[1] + " " + words[2];
        viable::tested.parameters.assign(words.begin() + 3, words.end());
    }
    ::testing::InitGoogleTest(&argc, argv);
    return RUN_ALL_TESTS();
}
