#include <pybind11/stl.h>

#include <exception>

#include "Keywords.h"
#include "RobotBinding.h"
#include "core/Text.h"
#include "viable/loop/ReferenceGuard.h"
#include "viable/loop/TorqueGuard.h"

namespace viable::python {

namespace {

const char* getName(GuardStop reason) {
    return detail::enumName<GuardStop::LibraryFailed>(
        reason,
        {"none", "requested", "law_failed", "no_readings", "too_far", "ticks_missed", "filter_failed",
         "robust_loop_failed", "guarantee_broken", "library_failed"},
        "library_failed");
}

std::vector<std::string> listActing(const std::array<JointIntervention, kMaxJoints>& acting, int n) {
    std::vector<std::string> words;
    for (int i = 0; i < n; ++i) words.emplace_back(viable::getName(acting[i].limit, acting[i].side));
    return words;
}

py::tuple makeState(const MotionState& state) {
    return py::module_::import("viable._types")
        .attr("State")(makeArray(state.q), makeArray(state.qd), makeArray(state.qdd));
}

/** Numbers of a guard that has not begun are no torque and no reference: whoever sends them on is to hear of it. */
void expectStarted(GuardStatus status, const char* guard) {
    if (status == GuardStatus::NotStarted)
        throw badInput(std::string(guard) + ".step", "start() has not been called, or its start was refused",
                       "Call start(q) with where the arm is first.");
}

class PythonGuard {
public:
    PythonGuard(const std::shared_ptr<PythonRobot>& robot, double tick, const py::kwargs& keywords)
        : n_(robot->size()) {
        TorqueGuardOptions options;
        makeKeywords(options).read("Guard", keywords, n_);
        const py::gil_scoped_release release;
        guard_.emplace(robot->description, tick, std::move(options));
        torque_.setZero(n_);
    }

    void start(const py::object& q, const py::object& qd) {
        const Turn turn(isTaken_, "Guard.start");
        lawError_ = {};
        guard_->start({readVector(q, n_, "Guard.start: q"), readVectorOrZero(qd, n_, "Guard.start: qd")});
        answer_ = {};
        torque_.setZero(n_);
    }

    py::array step(const py::object& q, const py::object& qd, const py::object& torque, const py::object& external) {
        const Turn turn(isTaken_, "Guard.step");
        const JointState reading{readVector(q, n_, "Guard.step: q"), readVector(qd, n_, "Guard.step: qd")};
        std::optional<JointVector> push;
        if (!external.is_none()) push = readVector(external, n_, "Guard.step: external");
        std::exception_ptr thrown;
        if (PyCallable_Check(torque.ptr())) {
            take(reading, push, [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& out) {
                try {
                    out = readVector(torque(makeArray(nominal.q), makeArray(nominal.qd), dynamics), n_,
                                     "the law's torque");
                } catch (py::error_already_set& e) {
                    thrown = std::current_exception();
                    throw std::runtime_error(e.what());
                } catch (const std::exception&) {
                    thrown = std::current_exception();
                    throw;
                }
            });
        } else {
            const JointVector given = readVector(torque, n_, "Guard.step: torque");
            take(reading, push, [&](const MotionState&, const Dynamics&, JointVector& out) { out = given; });
        }
        if (thrown) keep(thrown);
        expectStarted(answer_.status, "Guard");
        return makeArray(torque_);
    }

    void missTicks(std::int64_t ticks) {
        const Turn turn(isTaken_, "Guard.miss_ticks");
        guard_->missTicks(ticks);
    }

    TorqueGuard& guard() { return *guard_; }
    const GuardedTorque& answer() const { return answer_; }
    py::array torque() const { return makeArray(torque_); }
    py::object lawError() const { return lawError_ ? lawError_ : py::none(); }
    std::vector<std::string> acting() const { return listActing(answer_.acting, n_); }

private:
    template <class Law>
    void take(const JointState& reading, const std::optional<JointVector>& push, const Law& law) {
        answer_ = push ? guard_->step(reading, *push, law) : guard_->step(reading, law);
        torque_ = answer_.torque;
    }
    /** What a law threw: the arm is being stopped for it. What is no Exception, such as KeyboardInterrupt, goes on. */
    void keep(const std::exception_ptr& thrown) {
        try {
            std::rethrow_exception(thrown);
        } catch (const py::error_already_set& e) {
            if (!e.matches(PyExc_Exception)) throw;
            lawError_ = e.value();
        } catch (const Error& e) {
            lawError_ =
                py::module_::import("viable._errors").attr("make_error")(e.exitCode(), "law", makeText(e.what()), "");
        }
    }

    const int n_;
    std::optional<TorqueGuard> guard_;
    GuardedTorque answer_;
    JointVector torque_;
    py::object lawError_;
    bool isTaken_ = false;
};

class PythonReferenceGuard {
public:
    PythonReferenceGuard(const std::shared_ptr<PythonRobot>& robot, double tick, const py::kwargs& keywords)
        : n_(robot->size()) {
        ReferenceGuardOptions options;
        makeKeywords(options).read("ReferenceGuard", keywords, n_);
        const py::gil_scoped_release release;
        guard_.emplace(robot->description, tick, std::move(options));
    }

    void start(const py::object& q, const py::object& qd, const py::object& qdd) {
        guard_->start({readVector(q, n_, "ReferenceGuard.start: q"),
                       readVectorOrZero(qd, n_, "ReferenceGuard.start: qd"),
                       readVectorOrZero(qdd, n_, "ReferenceGuard.start: qdd")});
        answer_ = {};
    }

    py::tuple step(const py::object& target) {
        answer_ =
            target.is_none() ? guard_->step() : guard_->step(readVector(target, n_, "ReferenceGuard.step: target"));
        expectStarted(answer_.status, "ReferenceGuard");
        return makeState(answer_.state);
    }

    py::tuple stopAfter(double after) const {
        MotionState state;
        guard_->calcStop(after, state);
        return makeState(state);
    }

    bool changeLimits(const py::object& limits) {
        const std::optional<JointLimits> given = readLimits(limits);
        return given && guard_->changeLimits(*given);
    }

    ReferenceGuard& guard() { return *guard_; }
    const GuardedReference& answer() const { return answer_; }
    std::vector<std::string> acting() const { return listActing(answer_.acting, n_); }

private:
    const int n_;
    std::optional<ReferenceGuard> guard_;
    GuardedReference answer_;
};

/** What both guards tell alike. */
template <class Guard>
void bindCommon(py::class_<Guard>& c) {
    c.def_property_readonly(
         "status", [](const Guard& g) { return viable::getName(g.answer().status); },
         "Of the last step: not_started, passed, limited, recovering, waiting, stopping, stopped, failed.")
        .def_property_readonly("acting", &Guard::acting,
                               "Which limit held each joint back: none, position_upper, jerk_lower, ...")
        .def_property_readonly(
            "stop_reason", [](Guard& g) { return getName(g.guard().stopReason()); },
            "Why the arm was stopped for good; none.")
        .def_property_readonly(
            "stop_message", [](Guard& g) { return makeText(g.guard().stopMessage()); },
            "The same in a sentence; empty without a stop.")
        .def_property_readonly(
            "limits", [](Guard& g) { return makeLimits(g.guard().limits()); }, "In force.")
        .def(
            "request_stop", [](Guard& g) { g.guard().requestStop(); },
            "Brakes the arm for good from the next step on; from any thread.")
        .def(
            "__len__", [](Guard& g) { return g.guard().size(); }, "Joints.");
}

constexpr const char* kGuardDoc = R"doc(Joint limits up to jerk around a torque law: torque in, motor torque out.

    guard = viable.Guard(robot, tick=0.001)
    guard.start(q, qd)
    every tick:  tau = guard.step(q, qd, law)

The law moves a nominal arm, without friction and of known inertia, whose position, velocity, acceleration and jerk limits
are guaranteed, at every tick and between, whatever the law gives; a robust loop keeps the real arm next to it. Compute the
torque from the nominal arm (`nominal`, or what a law is called with), not from the reading.

Keywords, beside robot (viable.Robot) and tick (period of the loop [s], 0.00001 to 0.1):

KEYWORDS
Raises viable.InputError for what does not fit. A step takes 10 us and a Python law what it takes: for a real robot at 1 kHz
let C++ tick (framework/README.md, "In your own loop"). One thread at a time.)doc";

constexpr const char* kReferenceGuardDoc =
    R"doc(Joint limits up to jerk for robots that take positions: targets in, a reference out.

    guard = viable.ReferenceGuard(robot, tick=0.001)
    guard.start(q)
    every tick:  q, qd, qdd = guard.step(target)     # or step() where no new target has come

The reference goes to the targets as fast as the limits allow, and keeps them, up to jerk, at every tick and between, whatever
the targets are. Masses and motors do not count.

Keywords, beside robot (viable.Robot) and tick (period of the loop [s], 0.00001 to 0.1):

KEYWORDS
Raises viable.InputError for what does not fit. One thread at a time.)doc";

}  // namespace

void bindGuards(py::module_& module) {
    constexpr const char* kBefore = "robot: Robot, tick: float = 0.001";
    const auto robot = py::arg("robot");
    const auto tick = py::arg("tick") = 0.001;
    TorqueGuardOptions standard;
    auto guard = defineClass<PythonGuard, const std::shared_ptr<PythonRobot>&, double>(
        module, "Guard", kGuardDoc, makeKeywords(standard), kBefore, robot, tick);
    guard
        .def("start", &PythonGuard::start, py::arg("q"), py::arg("qd") = py::none(),
             "From here on: the nominal arm is where the real one is, q (n,) [rad], qd (n,) [rad/s]. Raises\n"
             "viable.InputError for a start from which no stop within the limits exists (unless recovery).")
        .def("step", &PythonGuard::step, py::arg("q"), py::arg("qd"), py::arg("torque"),
             py::arg("external") = py::none(),
             R"(One tick. Returns the torque for the motors (n,) [Nm], always finite.

q, qd     (n,) the reading [rad], [rad/s]. NaN: the arm brakes and goes on with the next good one; after 10 in a row it
          is stopped.
torque    (n,) what is wanted [Nm]; or a law, called as law(q, qd, dynamics) with the state of the nominal arm and its
          viable.Dynamics there, which returns that. NaN: the last good torque, for 10 ticks; then the arm is stopped. A
          law that raises stops the arm at once (status, law_error); KeyboardInterrupt goes on after that.
external  (n,) what the surroundings put on the joints, as measured [Nm]: the arm yields to it within the limits.)")
        .def("miss_ticks", &PythonGuard::missTicks, py::arg("ticks"),
             "So many ticks passed without a step: the nominal arm has followed its stop meanwhile.")
        .def_property_readonly(
            "nominal", [](PythonGuard& g) { return makeState(g.guard().nominal()); },
            "The nominal arm at the next tick: q, qd, qdd, each (n,).")
        .def_property_readonly("torque", &PythonGuard::torque, "(n,): what the last step returned [Nm].")
        .def_property_readonly("law_error", &PythonGuard::lawError, "What a law raised last, since start(); None.")
        .def_property_readonly(
            "law_failed", [](const PythonGuard& g) { return g.answer().lawFailed; },
            "The last torque was of no use, and the last good one stood in.")
        .def_property_readonly(
            "saturated", [](const PythonGuard& g) { return g.answer().motorsSaturated; }, "A motor is at its limit.")
        .def_property_readonly(
            "reading_fault",
            [](const PythonGuard& g) {
                const ReadingFault fault = g.answer().readingFault;
                return fault == ReadingFault::None ? "none" : fault == ReadingFault::Malformed ? "malformed" : "jumped";
            },
            "What was wrong with the last reading: none, malformed, jumped.");
    bindCommon(guard);

    ReferenceGuardOptions standardReference;
    auto reference = defineClass<PythonReferenceGuard, const std::shared_ptr<PythonRobot>&, double>(
        module, "ReferenceGuard", kReferenceGuardDoc, makeKeywords(standardReference), kBefore, robot, tick);
    reference
        .def("start", &PythonReferenceGuard::start, py::arg("q"), py::arg("qd") = py::none(),
             py::arg("qdd") = py::none(),
             "The reference begins here, which is the first target, too: q, qd, qdd, each (n,).")
        .def("step", &PythonReferenceGuard::step, py::arg("target") = py::none(),
             "One tick. target: (n,) [rad], None: no new one has come. Returns the reference at the end of the tick: q "
             "[rad],\n"
             "qd [rad/s], qdd [rad/s^2], each (n,).")
        .def("stop_after", &PythonReferenceGuard::stopAfter, py::arg("seconds"),
             "Where the reference is so long after its present state when no step follows: on the stop held ready.")
        .def("change_limits", &PythonReferenceGuard::changeLimits, py::arg("limits"),
             "From the next step on. False: they are not usable, and nothing changes.")
        .def(
            "miss_ticks", [](PythonReferenceGuard& g, std::int64_t ticks) { g.guard().missTicks(ticks); },
            py::arg("ticks"), "So many ticks passed without a step, and the robot has gone along stop_after().")
        .def_property_readonly(
            "target_failed", [](const PythonReferenceGuard& g) { return g.answer().targetFailed; },
            "The last target was NaN or beyond 1e7: the one before stands.");
    bindCommon(reference);
}

}  // namespace viable::python
