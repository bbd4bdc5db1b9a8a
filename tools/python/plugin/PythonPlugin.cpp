// Command, controller and filter that are classes in Python: one library for all, whose entries the host takes for
// `plugin: FILE.py:CLASS`.
#include <cmath>
#include <iterator>

#include "../src/Arrays.h"
#include "PythonObject.h"
#include "viable/plugin/PluginExport.h"

namespace viable::python {

namespace {

/** (values, rates), or values alone: then `rates` stays as it is. */
template <class ReadValues, class ReadRates>
void readWithRates(const py::object& result, const ReadValues& readValues, const ReadRates& readRates) {
    if (!py::isinstance<py::tuple>(result) || py::len(result) != 2) return readValues(result);
    const py::tuple both = result;
    readValues(both[0]);
    readRates(both[1]);
}

Vector6 readTwist(const py::handle& value, const std::string& place) {
    const Array array = readArray(value, place);
    if (array.ndim() != 1 || array.shape(0) != 6)
        throw badInput(place, "the array has shape " + formatShape(array),
                       "Give linear and angular velocity [m/s, rad/s], shape (6,).");
    return Vector6(array.data());
}

class PythonCommand : public CommandSource {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override {
        n_ = setup.size();
        space_ = object_.make(setup, parameters) == "tool" ? MotionCommand::Space::Tool : MotionCommand::Space::Joint;
    }
    void reset(const MotionState& start) override { object_.reset(start); }
    CommandTraits traits() const override { return {space_}; }

    TickStatus sample(double t, MotionCommand& out) override {
        if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
        out.space = space_;
        out.qd.setZero(n_);
        out.toolTwist.setZero();
        object_.call(
            [&] { return py::make_tuple(t); },
            [&](const py::object& result) {
                if (space_ == MotionCommand::Space::Joint)
                    readWithRates(
                        result, [&](const py::handle& q) { out.q = readVector(q, n_, "what sample() returned"); },
                        [&](const py::handle& qd) { out.qd = readVector(qd, n_, "the velocity of sample()"); });
                else
                    readWithRates(
                        result, [&](const py::handle& pose) { out.tool = readPose(pose, "what sample() returned"); },
                        [&](const py::handle& twist) { out.toolTwist = readTwist(twist, "the twist of sample()"); });
            });
        return TickStatus::Ok;
    }

private:
    PythonObject object_{"sample"};
    int n_ = 0;
    MotionCommand::Space space_ = MotionCommand::Space::Joint;
};

class PythonController : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override {
        n_ = setup.size();
        follows_ = object_.make(setup, parameters);
    }
    void reset(const MotionState& start) override { object_.reset(start); }
    ControllerTraits traits() const override { return {follows_ != "tool", follows_ != "joint"}; }

    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        if (!isFinite(input.nominal, n_) || !isFinite(input.dynamics, n_)) return TickStatus::InvalidInput;
        object_.call(
            [&] {
                return py::make_tuple(makeCommand(input.command), makeState(input.nominal),
                                      makeDynamics(input.dynamics));
            },
            [&](const py::object& torque) { output.torque = readVector(torque, n_, "what compute() returned"); });
        return TickStatus::Ok;
    }

private:
    static py::object makeCommand(const MotionCommand& command) {
        if (command.space == MotionCommand::Space::Joint)
            return getHost().attr("JointCommand")(makeArray(command.q), makeArray(command.qd));
        return getHost().attr("ToolCommand")(makePose(command.tool), py::array_t<double>(6, command.toolTwist.data()));
    }

    PythonObject object_{"compute"};
    int n_ = 0;
    std::string follows_;
};

class PythonFilter : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override {
        n_ = setup.size();
        tick_s_ = setup.tick_s;
        holdsJerk_ = object_.make(setup, parameters) == "jerk";
    }
    void reset(const MotionState& start) override { object_.reset(start); }
    FilterTraits traits() const override { return {}; }

    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override {
        if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
        FilterStatus status = FilterStatus::Modified;
        object_.call(
            [&] {
                return py::make_tuple(makeState(input.nominal), makeArray(input.torque), makeDynamics(input.dynamics));
            },
            [&](const py::object& result) {
                if (result.is_none()) {
                    status = pass(input, decision);
                    return;
                }
                const JointVector value = readVector(result, n_, "what filter() returned");
                holdsJerk_ ? decision.holdJerk(value) : decision.holdAcceleration(value);
            });
        if (status != FilterStatus::Faulted) decision.joints.fill({});
        return status;
    }

private:
    /** What the controller wants, as it is. */
    FilterStatus pass(const FilterInput& input, FilterDecision& decision) {
        JointVector acceleration;
        if (!calcDesiredAcceleration(input, tick_s_, acceleration)) return FilterStatus::Faulted;
        decision.holdAcceleration(acceleration);
        return FilterStatus::Passed;
    }

    PythonObject object_{"filter"};
    int n_ = 0;
    double tick_s_ = 0.0;
    bool holdsJerk_ = true;
};

constexpr char kName[] = "python";
constexpr char kSummary[] = "A class in Python.";

}  // namespace

}  // namespace viable::python

extern "C" VIABLE_PLUGIN_VISIBLE const viable::PluginLibrary* viable_plugin_library() {
    using namespace viable;
    static const PluginEntry entries[] = {
        makePluginEntry<CommandSource, python::PythonCommand>(python::kName, python::kSummary),
        makePluginEntry<NominalController, python::PythonController>(python::kName, python::kSummary),
        makePluginEntry<SafetyFilter, python::PythonFilter>(python::kName, python::kSummary),
    };
    static const PluginLibrary library = {
        kPluginMagic, sizeof(PluginLibrary), makeAbiStamp(), sizeof(PluginEntry), std::size(entries), entries, nullptr};
    return &library;
}
