#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "RobotBinding.h"
#include "viable/batch/ArmBatch.h"
#include "viable/core/Numbers.h"

namespace viable::python {

namespace {

BatchAction takeAction(const std::string& word) {
    if (word == "torque") return BatchAction::Torque;
    if (word == "acceleration") return BatchAction::Acceleration;
    if (word == "target") return BatchAction::Target;
    throw badInput("Batch: action", "`" + word + "`", "It is torque, acceleration or target.");
}

class PythonBatch {
public:
    PythonBatch(std::shared_ptr<PythonRobot> robot, int n, double tick, const py::object& limits,
                const std::string& action, double kAlpha, double gamma, bool recovery, const std::string& objective,
                const std::string& plant, std::uint64_t seed, int threads)
        : robot_(std::move(robot)) {
        ArmBatchOptions options;
        options.limits = takeLimits(limits);
        options.filter = {kAlpha, gamma, recovery, takeObjective(objective)};
        options.action = takeAction(action);
        options.plant = plant;
        options.seed = seed;
        options.threads = threads;
        if (!plant.empty())
            options.pluginPath = py::cast<std::vector<std::filesystem::path>>(
                py::module_::import("viable._paths").attr("plugin_folders")());
        const py::gil_scoped_release release;
        batch_.emplace(robot_->description, n, tick, std::move(options));
    }

    void step(const py::object& actions, int substeps) {
        const Turn turn(isTaken_, "Batch.step");
        const Array array = takeArray(actions, "Batch.step: actions");
        const ArmBatch& batch = *batch_;
        if (array.ndim() != 2 || array.shape(0) != batch.size() || array.shape(1) != batch.joints())
            throw badInput("Batch.step: actions", "the array has shape " + formatShape(array),
                           "Give a row of joints per arm, shape (" + std::to_string(batch.size()) + ", " +
                               std::to_string(batch.joints()) + ").");
        const double* const data = array.data();
        const py::gil_scoped_release release;
        batch_->step(data, substeps);
    }

    void reset(const py::object& mask, const py::object& q, const py::object& qd, const py::object& qdd) {
        const Turn turn(isTaken_, "Batch.reset");
        const std::vector<int> arms = takeArms(mask, "Batch.reset: mask");
        std::vector<MotionState> starts(arms.size());
        const JointVector zero = JointVector::Zero(batch_->joints());
        fill(q, "Batch.reset: q", robot_->description.home, arms, starts, &MotionState::q);
        fill(qd, "Batch.reset: qd", zero, arms, starts, &MotionState::qd);
        fill(qdd, "Batch.reset: qdd", zero, arms, starts, &MotionState::qdd);
        const py::gil_scoped_release release;
        batch_->reset(arms, starts);
    }

    void changeLimits(const py::object& limits, const py::object& mask) {
        const Turn turn(isTaken_, "Batch.change_limits");
        const std::vector<int> arms = takeArms(mask, "Batch.change_limits: mask");
        if (!py::isinstance<py::list>(limits) && !py::isinstance<py::tuple>(limits)) {
            const std::optional<JointLimits> one = takeLimits(limits);
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
            const std::optional<JointLimits> one = takeLimits(each[i]);
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

    py::array toolPosition() {
        const ArmBatch& batch = *batch_;
        py::array_t<double> tools({batch.size(), 3});
        auto to = tools.mutable_unchecked<2>();
        const JointVector zero = JointVector::Zero(batch.joints());
        for (int arm = 0; arm < batch.size(); ++arm) {
            robot_->model.calcDynamics(
                Eigen::Map<const Eigen::VectorXd>(&batch.state().q[static_cast<std::size_t>(arm * batch.joints())],
                                                  batch.joints()),
                zero, robot_->dynamics);
            for (int k = 0; k < 3; ++k) to(arm, k) = robot_->dynamics.tool.position[k];
        }
        return tools;
    }

    const ArmBatch& batch() const { return *batch_; }

    /** The arms that a mask names, all without one. */
    std::vector<int> takeArms(const py::object& mask, const std::string& place) const {
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
        const Array array = takeArray(value, place);
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
    bool isTaken_ = false;
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
    py::class_<PythonBatch> batch(module, "Batch", R"(Many guarded arms at once; use viable.Batch.)");
    batch
        .def(py::init<std::shared_ptr<PythonRobot>, int, double, const py::object&, const std::string&, double, double,
                      bool, const std::string&, const std::string&, std::uint64_t, int>(),
             py::arg("robot"), py::arg("n"), py::arg("tick"), py::kw_only(), py::arg("limits"), py::arg("action"),
             py::arg("k_alpha"), py::arg("gamma"), py::arg("recovery"), py::arg("objective"), py::arg("plant"),
             py::arg("seed"), py::arg("threads"))
        .def("step", &PythonBatch::step, py::arg("actions"), py::arg("substeps") = 10,
             R"(`substeps` ticks of every arm with the same actions.

actions  (n, joints): torque [Nm], acceleration [rad/s^2] or target [rad]. An arm with NaN in its row brakes (status 4).

Computes in threads without the interpreter's lock; the results do not depend on their number.)")
        .def(
            "reset", &PythonBatch::reset, py::arg("mask") = py::none(), py::arg("q") = py::none(),
            py::arg("qd") = py::none(), py::arg("qdd") = py::none(),
            R"(Puts arms to new states; all or none: raises viable.InputError for one from which no stop within the limits exists.

mask        (n,) of truths, or numbers of arms, each once; None: all
q, qd, qdd  (joints,) for all of them, a row each, or (n, joints) of which theirs are taken. None: home, at rest)")
        .def("change_limits", &PythonBatch::changeLimits, py::arg("limits"), py::arg("mask") = py::none(),
             "New limits from now on: one viable.Limits, or a list with one for each arm of the mask; all or none.")
        .def(
            "_take_arms",
            [](const PythonBatch& b, const py::object& mask) { return b.takeArms(mask, "Batch.random_reset: mask"); },
            py::arg("mask"))
        .def("limits", &PythonBatch::getLimits, py::arg("arm") = 0, "Of one arm, in force.")
        .def("tool_position", &PythonBatch::toolPosition,
             "(n, 3): where the tools of the nominal arms are, base frame [m].")
        .def(
            "__len__", [](const PythonBatch& b) { return b.batch().size(); }, "Arms.")
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
