#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>

#include "Keywords.h"
#include "RobotBinding.h"
#include "batch/ArmBatch.h"

namespace viable::python {

namespace {

/** With the blocks of an experiment file that a batch takes. */
Keywords makeBatchKeywords(ArmBatchOptions& options) {
    Keywords keywords = makeKeywords(options);
    keywords.addObject("environment", "Mapping[str, Any]|None",
                       "What stands around each arm, as `environment` of an experiment file; {}: nothing but itself. "
                       "None: not looked at.",
                       [&options](const py::handle& value, const std::string& place) {
                           options.environment = readEnvironment(makeNode(value, place));
                       });
    keywords.addObject("plant", "Mapping[str, Any]|None",
                       "A simulated real arm behind each nominal one, as `real_plant` of an experiment file. "
                       "None: nominal arms alone, four times as fast.",
                       [&options](const py::handle& value, const std::string& place) {
                           ConfigMap{makeNode(value, place)};  // refuses what is none
                           py::dict block;
                           block["plugin"] = "simbody";
                           block.attr("update")(value);
                           if (py::object(block["plugin"]).equal(py::str("simbody")))
                               block.attr("setdefault")("dynamics", "recursion");
                           options.plant = formatValue(block);
                           options.pluginPath = py::cast<std::vector<std::filesystem::path>>(
                               py::module_::import("viable._paths").attr("plugin_folders")());
                       });
    return keywords;
}

class PythonBatch {
public:
    PythonBatch(std::shared_ptr<PythonRobot> robot, int n, double tick, const py::kwargs& keywords)
        : robot_(std::move(robot)) {
        ArmBatchOptions options;
        makeBatchKeywords(options).read("Batch", keywords, robot_->size());
        action_ = options.action;
        keepsClear_ = options.environment.has_value();
        const py::gil_scoped_release release;
        batch_.emplace(robot_->description, n, tick, std::move(options));
    }

    void step(const py::object& actions, int substeps) {
        const Turn turn(isTaken_, "Batch.step");
        const Array array = readArray(actions, "Batch.step: actions");
        const ArmBatch& batch = *batch_;
        const int width = batch.actionSize();
        if (array.ndim() != 2 || array.shape(0) != batch.size() || array.shape(1) != width)
            throw badInput("Batch.step: actions", "the array has shape " + formatShape(array),
                           std::string("Give a row of ") +
                               (action_ == BatchAction::ToolPose       ? "position and quaternion x, y, z, w"
                                : action_ == BatchAction::ToolPosition ? "x, y, z"
                                                                       : "joints") +
                               " per arm, shape (" + std::to_string(batch.size()) + ", " + std::to_string(width) +
                               ").");
        const double* const data = array.data();
        const py::gil_scoped_release release;
        batch_->step(data, substeps);
    }

    void reset(const py::object& mask, const py::object& q, const py::object& qd, const py::object& qdd) {
        const Turn turn(isTaken_, "Batch.reset");
        const std::vector<int> arms = readArms(mask, "Batch.reset: mask");
        std::vector<MotionState> starts(arms.size());
        const JointVector zero = JointVector::Zero(batch_->joints());
        fill(q, "Batch.reset: q", robot_->description.home, arms, starts, &MotionState::q);
        fill(qd, "Batch.reset: qd", zero, arms, starts, &MotionState::qd);
        fill(qdd, "Batch.reset: qdd", zero, arms, starts, &MotionState::qdd);
        const py::gil_scoped_release release;
        batch_->reset(arms, starts);
    }

    /** Of the arms of a mask those whose row of `q` is no place to be put to, at rest. */
    std::vector<int> findUnusable(const py::object& mask, const py::object& q) {
        const Turn turn(isTaken_, "Batch.reset");
        const std::vector<int> arms = readArms(mask, "Batch.reset: mask");
        const JointVector zero = JointVector::Zero(batch_->joints());
        std::vector<MotionState> starts(arms.size(), {zero, zero, zero});
        fill(q, "Batch.reset: q", robot_->description.home, arms, starts, &MotionState::q);
        const py::gil_scoped_release release;
        return batch_->findUnusable(arms, starts);
    }

    void changeLimits(const py::object& limits, const py::object& mask) {
        const Turn turn(isTaken_, "Batch.change_limits");
        const std::vector<int> arms = readArms(mask, "Batch.change_limits: mask");
        if (!py::isinstance<py::list>(limits) && !py::isinstance<py::tuple>(limits)) {
            const std::optional<JointLimits> one = readLimits(limits);
            if (!one)
                throw badInput("Batch.change_limits", "None are no limits", "Give a viable.Limits, or one per arm.");
            batch_->changeLimits(arms, std::vector<JointLimits>(arms.size(), *one));
            return;
        }
        const auto each = py::reinterpret_borrow<py::sequence>(limits);
        if (each.size() != arms.size())
            throw badInput("Batch.change_limits",
                           std::to_string(each.size()) + " limits for " + std::to_string(arms.size()) + " arms",
                           "Give one viable.Limits for all, or a list with one for each.");
        std::vector<JointLimits> all;
        for (std::size_t i = 0; i < arms.size(); ++i) {
            const std::optional<JointLimits> one = readLimits(each[i]);
            if (!one)
                throw badInput("Batch.change_limits", "entry " + std::to_string(i) + " is None",
                               "Give a viable.Limits for each arm, such as batch.limits(arm).");
            all.push_back(*one);
        }
        batch_->changeLimits(arms, all);
    }

    py::object getLimits(int arm) const {
        if (arm < 0 || arm >= batch_->size())
            throw badInput("Batch.limits", "there is no arm " + std::to_string(arm),
                           "They are numbered from 0 to " + std::to_string(batch_->size() - 1) + ".");
        return makeLimits(batch_->limits(arm));
    }

    /** Of each arm x, y, z and, with seven `columns`, the quaternion x, y, z, w. */
    py::array findTools(bool real, py::ssize_t columns, const char* place) {
        const ArmBatch& batch = *batch_;
        const std::vector<double>& from = real ? batch.state().realQ : batch.state().q;
        if (from.empty())
            throw badInput(place, "there are no real arms", "Give the batch a plant, or leave `real` out.");
        py::array_t<double> tools({static_cast<py::ssize_t>(batch.size()), columns});
        auto to = tools.mutable_unchecked<2>();
        const JointVector zero = JointVector::Zero(batch.joints());
        for (int arm = 0; arm < batch.size(); ++arm) {
            const double* const q = &from[static_cast<std::size_t>(arm) * static_cast<std::size_t>(batch.joints())];
            robot_->model.calcDynamics(Eigen::Map<const Eigen::VectorXd>(q, batch.joints()), zero, robot_->dynamics);
            const Pose& tool = robot_->dynamics.tool;
            for (int k = 0; k < columns; ++k) to(arm, k) = k < 3 ? tool.position[k] : tool.orientation.coeffs()[k - 3];
        }
        return tools;
    }
    py::array toolPosition(bool real) { return findTools(real, 3, "Batch.tool_position: real"); }
    py::array toolPose(bool real) { return findTools(real, 7, "Batch.tool_pose: real"); }

    const ArmBatch& batch() const { return *batch_; }
    const std::shared_ptr<PythonRobot>& robot() const { return robot_; }
    bool keepsClear() const { return keepsClear_; }

    /** The arms that a mask names, all without one. */
    std::vector<int> readArms(const py::object& mask, const std::string& place) const {
        std::vector<int> arms;
        const int n = batch_->size();
        if (mask.is_none()) {
            for (int arm = 0; arm < n; ++arm) arms.push_back(arm);
            return arms;
        }
        const py::array any = py::array::ensure(mask);
        if (!any) PyErr_Clear();
        if (any && any.ndim() == 1 && any.dtype().kind() == 'b' && any.shape(0) == n) {
            const auto flags = py::array_t<bool, py::array::c_style | py::array::forcecast>::ensure(any);
            for (int arm = 0; arm < n; ++arm)
                if (flags.data()[arm]) arms.push_back(arm);
            return arms;
        }
        if (any && any.ndim() == 1 && (any.dtype().kind() == 'i' || any.dtype().kind() == 'u' || any.size() == 0)) {
            const auto numbers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>::ensure(any);
            for (py::ssize_t i = 0; i < numbers.size(); ++i) {
                const std::int64_t arm = numbers.data()[i];
                if (arm < 0 || arm >= n)
                    throw badInput(place, "there is no arm " + std::to_string(arm),
                                   "They are numbered from 0 to " + std::to_string(n - 1) + ".");
                arms.push_back(static_cast<int>(arm));
            }
            std::vector<int> sorted = arms;
            std::sort(sorted.begin(), sorted.end());
            if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end()); twice != sorted.end())
                throw badInput(place, "arm " + std::to_string(*twice) + " is named more than once",
                               "Whole numbers are numbers of arms; for a mask pass booleans: mask.astype(bool).");
            return arms;
        }
        throw badInput(
            place,
            any ? "the array has shape " + formatShape(any) + " and type " + py::cast<std::string>(py::str(any.dtype()))
                : std::string("this is no array"),
            "Give truths, shape (" + std::to_string(n) + ",), or numbers of arms.");
    }

private:
    /** One row for all, one per arm that is named, or one per arm of the batch. */
    void fill(const py::object& value, const std::string& place, const JointVector& usual, const std::vector<int>& arms,
              std::vector<MotionState>& starts, JointVector MotionState::*member) const {
        const int joints = batch_->joints();
        if (value.is_none()) {
            for (MotionState& start : starts) start.*member = usual;
            return;
        }
        const Array array = readArray(value, place);
        const auto named = static_cast<py::ssize_t>(arms.size());
        const bool isOne = array.ndim() == 1 && array.shape(0) == joints;
        const bool isNamed = array.ndim() == 2 && array.shape(1) == joints && array.shape(0) == named;
        const bool isAll = array.ndim() == 2 && array.shape(1) == joints && array.shape(0) == batch_->size();
        if (!isOne && !isNamed && !isAll)
            throw badInput(place, "the array has shape " + formatShape(array),
                           "Give (" + std::to_string(joints) + ",) for all, or a row for each of the " +
                               std::to_string(named) + " arms that are reset or of all.");
        for (std::size_t i = 0; i < arms.size(); ++i) {
            const auto row = isOne ? 0 : isNamed ? static_cast<py::ssize_t>(i) : static_cast<py::ssize_t>(arms[i]);
            starts[i].*member = Eigen::Map<const Eigen::VectorXd>(array.data() + row * joints, joints);
        }
    }

    std::shared_ptr<PythonRobot> robot_;
    std::optional<ArmBatch> batch_;
    BatchAction action_ = BatchAction::Torque;
    bool keepsClear_ = false, isTaken_ = false;
};

/** A read-only view of what belongs to `owner`. */
template <class Number>
py::array makeView(const Number* data, std::vector<py::ssize_t> shape, const py::object& owner) {
    py::array_t<Number> view(std::move(shape), data, owner);
    view.attr("setflags")(py::arg("write") = false);
    return view;
}

template <class Class>
void bindView(Class& c, const char* name, const char* doc, std::vector<double> ArmBatchState::*member) {
    c.def_property_readonly(
        name,
        [member](const py::object& self) -> py::object {
            const ArmBatch& batch = py::cast<const PythonBatch&>(self).batch();
            const std::vector<double>& values = batch.state().*member;
            if (values.empty()) return py::none();
            return makeView(values.data(), {batch.size(), batch.joints()}, self);
        },
        doc);
}

}  // namespace

void bindBatch(py::module_& module) {
    ArmBatchOptions standard;
    auto batch = defineClass<PythonBatch, std::shared_ptr<PythonRobot>, int, double>(
        module, "Batch", "Many guarded arms at once; use viable.Batch.\n\nKEYWORDS", makeBatchKeywords(standard),
        "robot: Robot, n: int = 4096, tick: float = 0.001", py::arg("robot"), py::arg("n") = 4096,
        py::arg("tick") = 0.001);
    batch
        .def("step", &PythonBatch::step, py::arg("actions"), py::arg("substeps") = 10,
             R"(`substeps` ticks of every arm with the same actions.

actions  (n, joints): torque [Nm], acceleration [rad/s^2] or target [rad]; tool_pose (n, 7): x, y, z [m] and quaternion
         x, y, z, w, as tool_pose() gives them; tool_position (n, 3): x, y, z [m]. An arm with NaN in its row, or with a
         quaternion that is none, brakes (status 4).

Computes in threads without the interpreter's lock; the results do not depend on their number.)")
        .def("reset", &PythonBatch::reset, py::arg("mask") = py::none(), py::arg("q") = py::none(),
             py::arg("qd") = py::none(), py::arg("qdd") = py::none(),
             R"(Puts arms to new states; all or none: raises viable.InputError for one from which no stop within the
limits exists, or with an environment none that keeps clear.

mask        (n,) of truths, or numbers of arms, each once; None: all
q, qd, qdd  (joints,) for all of them, a row each, or (n, joints) of which theirs are taken. None: home, at rest)")
        .def("change_limits", &PythonBatch::changeLimits, py::arg("limits"), py::arg("mask") = py::none(),
             "New limits from now on: one viable.Limits, or a list with one for each arm of the mask; all or none.")
        .def(
            "_take_arms",
            [](const PythonBatch& b, const py::object& mask) { return b.readArms(mask, "Batch.random_reset: mask"); },
            py::arg("mask"))
        .def("_find_unusable", &PythonBatch::findUnusable, py::arg("mask"), py::arg("q"))
        .def("limits", &PythonBatch::getLimits, py::arg("arm") = 0, "Of one arm, in force.")
        .def("tool_position", &PythonBatch::toolPosition, py::arg("real") = false,
             "(n, 3): where the tools of the nominal arms are, base frame [m]; real: those of the real arms, as "
             "measured.")
        .def("tool_pose", &PythonBatch::toolPose, py::arg("real") = false,
             "(n, 7): the same with the orientation, x, y, z [m] and quaternion x, y, z, w: an action of tool_pose.")
        .def(
            "__len__", [](const PythonBatch& b) { return b.batch().size(); }, "Arms.")
        .def_property_readonly(
            "action_size", [](const PythonBatch& b) { return b.batch().actionSize(); },
            "Numbers of an action of each arm: the joints, 7 of tool_pose, 3 of tool_position.")
        .def_property_readonly(
            "clearance",
            [](const py::object& self) {
                const ArmBatch& b = py::cast<const PythonBatch&>(self).batch();
                return makeView(b.state().clearance.data(), {b.size()}, self);
            },
            "(n,): a stop from here brings the arm no nearer than this to its surroundings and itself [m]; inf where\n"
            "nothing can be met, nan where nobody looked: without environment, and from reset() to the first step.")
        .def_property_readonly("_keeps_clear", &PythonBatch::keepsClear)
        .def_property_readonly("robot", &PythonBatch::robot, "As given.")
        .def_property_readonly(
            "joints", [](const PythonBatch& b) { return b.batch().joints(); }, "Of each arm.")
        .def_property_readonly(
            "tick", [](const PythonBatch& b) { return b.batch().tick_s(); }, "[s]")
        .def_property_readonly(
            "draws", [](const PythonBatch& b) { return b.batch().draws(); },
            "What was drawn for the plants: texts by key, one per arm.")
        .def_property_readonly(
            "acting",
            [](const py::object& self) {
                const ArmBatch& b = py::cast<const PythonBatch&>(self).batch();
                return makeView(reinterpret_cast<const std::int8_t*>(b.state().acting.data()), {b.size(), b.joints()},
                                self);
            },
            "(n, joints) int8: which limit held a joint back in the last step, an index into viable.ACTING, negative "
            "for\n"
            "the lower side; 0: none did.")
        .def_property_readonly(
            "status",
            [](const py::object& self) {
                const ArmBatch& b = py::cast<const PythonBatch&>(self).batch();
                static_assert(sizeof(GuardStatus) == 1);
                return makeView(reinterpret_cast<const std::uint8_t*>(b.state().status.data()), {b.size()}, self);
            },
            "(n,) uint8: the gravest of the last step's ticks, an index into viable.STATUS.");
    bindView(batch, "q", "(n, joints): positions of the nominal arms [rad].", &ArmBatchState::q);
    bindView(batch, "qd", "(n, joints): their velocities [rad/s].", &ArmBatchState::qd);
    bindView(batch, "qdd", "(n, joints): their accelerations [rad/s^2].", &ArmBatchState::qdd);
    bindView(batch, "jerk", "(n, joints): held in the last tick [rad/s^3].", &ArmBatchState::jerk);
    bindView(batch, "torque", "(n, joints): what moved the nominal arms in the last tick [Nm].",
             &ArmBatchState::torque);
    bindView(batch, "margin",
             "(n, joints): least distance of a stop from here to a position limit [rad]; inf where there is none.",
             &ArmBatchState::margin);
    bindView(batch, "real_q", "(n, joints): the real arms, as measured [rad]; None without a plant.",
             &ArmBatchState::realQ);
    bindView(batch, "real_qd", "(n, joints): their velocities [rad/s]; None without a plant.", &ArmBatchState::realQd);
    bindView(batch, "motor_torque", "(n, joints): of their motors in the last tick [Nm]; None without a plant.",
             &ArmBatchState::motorTorque);
}

}  // namespace viable::python
