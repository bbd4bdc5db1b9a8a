#include "RobotBinding.h"

#include <pybind11/eval.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cmath>

#include "core/Text.h"
#include "viable/braking/Servo.h"
#include "viable/simulation/ArmHardware.h"
#include "viable/tracking/LoopStability.h"

namespace viable::python {

namespace {

/** viable.Limits */
struct PythonLimits {
    JointLimits limits;
};

/** One side of a limit: a number for all joints, or one each. @param n  joints; 0: not known yet, and found here */
JointVector readSide(const py::handle& value, int& n, double sign, const std::string& place) {
    const Array array = readArray(value, place);
    if (array.ndim() == 0) {
        if (n == 0)
            throw badInput(place, "one number for all joints, and nothing says how many there are",
                           "Give `joints`, or an array with one number per joint.");
        return JointVector::Constant(n, sign * *array.data());
    }
    if (array.ndim() != 1 || array.size() < 1 || array.size() > kMaxJoints || (n > 0 && array.size() != n))
        throw badInput(place, "the array has shape " + formatShape(array),
                       n > 0 ? "Give one number for all joints, or shape (" + std::to_string(n) + ",)."
                             : "Give one number per joint, up to " + std::to_string(kMaxJoints) + ".");
    n = static_cast<int>(array.size());
    return sign * Eigen::Map<const Eigen::VectorXd>(array.data(), n);
}

bool isPair(const py::handle& value) {
    return py::isinstance<py::tuple>(value);
}

/** The number of joints that `value` tells, or 0. */
int countJoints(const py::handle& value) {
    if (value.is_none()) return 0;
    if (isPair(value)) {
        for (const py::handle side : py::reinterpret_borrow<py::tuple>(value))
            if (const int n = countJoints(side)) return n;
        return 0;
    }
    const py::array array = py::array::ensure(value);
    if (!array) PyErr_Clear();
    return array && array.ndim() == 1 && array.size() <= kMaxJoints ? static_cast<int>(array.size()) : 0;
}

JointBounds readBounds(const py::handle& value, int n, const std::string& place) {
    if (value.is_none()) return {JointVector::Constant(n, -kInfinity), JointVector::Constant(n, kInfinity)};
    if (!isPair(value)) return {readSide(value, n, -1.0, place), readSide(value, n, 1.0, place)};
    const auto pair = py::reinterpret_borrow<py::tuple>(value);
    if (pair.size() != 2)
        throw badInput(place, "a tuple of " + std::to_string(pair.size()),
                       "A tuple is (lower, upper); one number per joint is a list or an array.");
    return {readSide(pair[0], n, 1.0, place + " lower"), readSide(pair[1], n, 1.0, place + " upper")};
}

constexpr const char* kQuantities[] = {"position", "velocity", "acceleration", "jerk"};

JointBounds& getBounds(JointLimits& limits, int quantity) {
    JointBounds* const all[] = {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk};
    return *all[quantity];
}

PythonLimits newLimits(const py::object& position, const py::object& velocity, const py::object& acceleration,
                       const py::object& jerk, int joints) {
    const py::object* const given[] = {&position, &velocity, &acceleration, &jerk};
    int n = joints;
    for (const py::object* value : given)
        if (n == 0) n = countJoints(*value);
    if (n < 1 || n > kMaxJoints)
        throw badInput(
            "Limits", n == 0 ? "nothing says how many joints there are" : std::to_string(n) + " joints",
            "Give `joints`, 1 to " + std::to_string(kMaxJoints) + ", or an array with one number per joint.");
    PythonLimits limits;
    for (int i = 0; i < 4; ++i)
        getBounds(limits.limits, i) = readBounds(*given[i], n, std::string("Limits: ") + kQuantities[i]);
    return limits;
}

PythonLimits replaceLimits(const PythonLimits& old, const py::kwargs& changes) {
    PythonLimits limits = old;
    const int n = old.limits.size();
    for (const auto& [key, value] : changes) {
        const auto name = py::cast<std::string>(key);
        int found = -1;
        for (int i = 0; i < 4; ++i)
            if (name == kQuantities[i]) found = i;
        if (found < 0)
            throw badInput("Limits.replace", "there is no limit `" + name + "`",
                           "They are position, velocity, acceleration and jerk.");
        getBounds(limits.limits, found) = readBounds(value, n, "Limits.replace: " + name);
    }
    return limits;
}

bool areEqual(const JointLimits& a, const JointLimits& b) {
    const auto same = [](const JointBounds& x, const JointBounds& y) {
        return x.lower == y.lower && x.upper == y.upper;
    };
    return a.size() == b.size() && same(a.position, b.position) && same(a.velocity, b.velocity) &&
           same(a.acceleration, b.acceleration) && same(a.jerk, b.jerk);
}

void bindLimits(py::module_& module) {
    py::class_<PythonLimits> limits(module, "Limits",
                                    R"(Position, velocity, acceleration and jerk limits of every joint.

Each is None (no limit), one number or an array (n,) for both sides (+-), or a tuple (lower, upper) of those.
Units: rad, rad/s, rad/s^2, rad/s^3; of joints that slide m, m/s, ...

    Limits(position=([-1, -2], [1, 2]), velocity=1.5, acceleration=[5, 8], jerk=100)

Guards need finite jerk limits, with zero inside the limits of velocity, acceleration and jerk; whether limits fit a
tick, a guard says (viable.InputError).)");
    limits.def(py::init(&newLimits), py::kw_only(), py::arg("position") = py::none(), py::arg("velocity") = py::none(),
               py::arg("acceleration") = py::none(), py::arg("jerk") = py::none(), py::arg("joints") = 0);
    const auto bounds = [&](const char* name, const char* doc, JointBounds JointLimits::*member) {
        limits.def_property_readonly(
            name, [member](const PythonLimits& self) { return makeBounds(self.limits.*member); }, doc);
    };
    bounds("position", "(2, n): lower, upper [rad]", &JointLimits::position);
    bounds("velocity", "(2, n): lower, upper [rad/s]", &JointLimits::velocity);
    bounds("acceleration", "(2, n): lower, upper [rad/s^2]", &JointLimits::acceleration);
    bounds("jerk", "(2, n): lower, upper [rad/s^3]", &JointLimits::jerk);
    limits.def("replace", &replaceLimits,
               "replace(position=..., velocity=..., acceleration=..., jerk=...): the same limits but for these.");
    limits.def(
        "__len__", [](const PythonLimits& self) { return self.limits.size(); }, "Joints.");
    limits.def("__eq__", [](const PythonLimits& self, const py::object& other) {
        return py::isinstance<PythonLimits>(other) &&
               areEqual(self.limits, py::cast<const PythonLimits&>(other).limits);
    });
    limits.attr("__hash__") = py::none();
    limits.def("__repr__", [](const PythonLimits& self) {
        return "<viable.Limits of " + std::to_string(self.limits.size()) + " joints>";
    });
}

void bindDynamics(py::module_& module) {
    py::class_<Dynamics>(module, "Dynamics",
                         R"(The rigid-body dynamics at (q, qd): tau = M qdd + b, without friction.)")
        .def_property_readonly(
            "M", [](const Dynamics& d) { return makeMatrix(d.M); },
            "(n, n): joint-space inertia with rotor inertias [kg m^2]")
        .def_property_readonly(
            "b", [](const Dynamics& d) { return makeArray(d.b); },
            "(n,): Coriolis, centrifugal and gravity torque [Nm]")
        .def_property_readonly(
            "gravity", [](const Dynamics& d) { return makeArray(d.gravity); }, "(n,): gravity's part of b [Nm]")
        .def_property_readonly(
            "J", [](const Dynamics& d) { return makeMatrix(d.J); },
            "(6, n): twist of the tool (linear, angular; base frame) = J qd")
        .def_property_readonly(
            "tool", [](const Dynamics& d) { return makePose(d.tool); },
            "(4, 4): pose of the tool in the base frame [m]");
}

const Dynamics& calcAt(PythonRobot& robot, const py::handle& q, const py::handle& qd, const char* place) {
    const JointVector position = readVector(q, robot.size(), std::string(place) + ": q");
    Dynamics& found = robot.dynamics;
    robot.model.calcDynamics(position, readVectorOrZero(qd, robot.size(), std::string(place) + ": qd"), found);
    if (!robot.description.hasDynamics()) {
        found.M.setConstant(kNan);
        found.b.setConstant(kNan);
        found.gravity.setConstant(kNan);
    }
    return found;
}

py::dict makeFriction(const JointFriction& friction) {
    py::dict d;
    d["coulomb"] = makeArray(friction.coulomb);
    d["viscous"] = makeArray(friction.viscous);
    d["viscous_velocity"] = makeArray(friction.viscousVelocity);
    return d;
}

py::dict calcGains(const PythonRobot& robot, double tick_s, const py::object& limits, int delayTicks) {
    if (!(tick_s >= kShortestTick_s && tick_s <= kLongestTick_s))
        throw badInput("Robot.gains: tick", detail::formatNumber(tick_s) + " s; allowed is [0.00001, 0.1] s",
                       "Give the period of the loop in seconds: 0.001 at 1 kHz.");
    const JointLimits in = limits.is_none() ? robot.description.limits : *readLimits(limits);
    if (in.size() != robot.size())
        throw badInput("Robot.gains: limits", "limits of " + std::to_string(in.size()) + " joints",
                       "The robot has " + std::to_string(robot.size()) + ".");
    for (const JointBounds* bounds : {&in.position, &in.velocity, &in.acceleration, &in.jerk})
        if (!(bounds->lower.array() < bounds->upper.array()).all())
            throw badInput("Robot.gains: limits", "a lower limit is not below the upper one, or is NaN",
                           "Give numbers with lower < upper; infinite ones where there is no limit.");
    if (delayTicks < 0 || delayTicks > ArmHardware::kMaxDelay)
        throw badInput("Robot.gains: delay_ticks",
                       std::to_string(delayTicks) + "; allowed is 0 to " + std::to_string(ArmHardware::kMaxDelay),
                       "Give the ticks from a command to the motor's torque.");
    requireDynamics(robot.description, "Robot.gains", "the robust loop");
    LinearErrorLoop loop;
    LoopMargins margins;
    {
        const py::gil_scoped_release release;
        loop = scaleGains(robot.description, in, tick_s, delayTicks);
        margins = calcMargins(robot.description, in, tick_s, delayTicks, loop);
    }
    py::dict d;
    d["k_r"] = makeArray(loop.kr);
    d["k_p"] = makeArray(loop.kp);
    d["k_i"] = makeArray(loop.ki);
    d["inertia_rate"] = loop.inertiaRate;
    d["gain_margin"] = margins.gain;
    d["phase_margin"] = margins.phase_rad;
    return d;
}

/** viable.Servo */
class PythonServo {
public:
    PythonServo(const py::object& limits, double tick, double share) {
        const std::optional<JointLimits> given = readLimits(limits);
        if (!given) throw badInput("Servo: limits", "None are no limits", "Give a viable.Limits.");
        n_ = given->size();
        if (!(tick >= kShortestTick_s && tick <= kLongestTick_s) || !areUsable(*given, n_, tick) ||
            !given->hasJerkLimits())
            throw badInput(
                "Servo: limits", "they are not usable at a tick of " + detail::formatNumber(tick) + " s",
                "Give finite jerk limits, zero inside those of velocity, acceleration and jerk, and a tick of "
                "[0.00001, 0.1] s.");
        if (!(share > 0.0 && share <= 1.0))
            throw badInput("Servo: share", detail::formatNumber(share) + "; allowed is above 0, up to 1",
                           "1 for targets that jump and rest.");
        servo_.configure(*given, tick, share);
    }
    void reset(const py::object& q, const py::object& qd, const py::object& qdd) {
        servo_.reset(readState(q, qd, qdd, "Servo.reset: "));
    }
    py::array jerk(const py::object& q, const py::object& qd, const py::object& qdd, const py::object& target,
                   const py::object& targetVelocity, const py::object& targetAcceleration) {
        const MotionState state = readState(q, qd, qdd, "Servo.jerk: ");
        const MotionState wanted{readFinite(target, "Servo.jerk: target"),
                                 readVectorOrZero(targetVelocity, n_, "Servo.jerk: target_qd"),
                                 readVectorOrZero(targetAcceleration, n_, "Servo.jerk: target_qdd")};
        JointVector jerk;
        servo_.calc(state, wanted, jerk);
        return makeArray(jerk);
    }

private:
    JointVector readFinite(const py::object& value, const std::string& place) const {
        const JointVector v = readVectorOrZero(value, n_, place);
        if (!v.allFinite()) throw badInput(place, "a number is not finite", "Give finite numbers.");
        return v;
    }
    MotionState readState(const py::object& q, const py::object& qd, const py::object& qdd,
                          const std::string& place) const {
        return {readFinite(q, place + "q"), readFinite(qd, place + "qd"), readFinite(qdd, place + "qdd")};
    }

    int n_ = 0;
    Servo servo_;
};

void bindServo(py::module_& module) {
    py::class_<PythonServo>(module, "Servo",
                            R"(Leads an arm to a joint target, which may move or jump, as fast as its limits allow.

    servo = viable.Servo(robot.limits, tick=0.001)
    servo.reset(q, qd, qdd)
    every tick:  jerk = servo.jerk(q, qd, qdd, target)      # held for the tick

Position, velocity, acceleration and jerk limits hold at every tick and between; a target at rest is reached in the shortest
time or nearly so, without overshoot. ReferenceGuard is this with a filter and a monitor behind it.

limits  viable.Limits, jerk limits finite
tick    [s]
share   of acceleration and jerk limits that the motion relative to the target may take, in (0, 1])")
        .def(py::init<const py::object&, double, double>(), py::arg("limits"), py::arg("tick") = 0.001,
             py::arg("share") = 1.0)
        .def("reset", &PythonServo::reset, py::arg("q"), py::arg("qd") = py::none(), py::arg("qdd") = py::none(),
             "From this state on: q [rad], qd [rad/s], qdd [rad/s^2], each (n,).")
        .def("jerk", &PythonServo::jerk, py::arg("q"), py::arg("qd"), py::arg("qdd"), py::arg("target"),
             py::arg("target_qd") = py::none(), py::arg("target_qdd") = py::none(),
             "(n,): the jerk to hold in this tick [rad/s^3], from the state of the arm and the target, each (n,).");
}

}  // namespace

std::optional<JointLimits> readLimits(const py::handle& limits, const std::string& place) {
    if (limits.is_none()) return {};
    if (!py::isinstance<PythonLimits>(limits))
        throw badInput(place, "a " + std::string(Py_TYPE(limits.ptr())->tp_name) + " are no limits",
                       "Give a viable.Limits, such as robot.limits.replace(velocity=1.0).");
    return py::cast<const PythonLimits&>(limits).limits;
}

py::object makeLimits(const JointLimits& limits) {
    return py::cast(PythonLimits{limits});
}

void bindRobot(py::module_& module) {
    bindLimits(module);
    bindServo(module);
    bindDynamics(module);
    using Robot = PythonRobot;
    py::class_<Robot, std::shared_ptr<Robot>>(module, "Robot", R"(A robot arm: joints, limits, masses, motors.

Robot("indy7")             one that comes with viable, or of a folder in VIABLE_ROBOT_PATH or ./robots
Robot("path/to/folder")    a robot's folder: NAME.urdf, limits.yaml, actuation.yaml (`viable new robot` makes one)

n joints, in the order of `joints`. Units: rad, rad/s, Nm; of joints that slide m, m/s, N.)")
        .def(py::init([](const py::object& name) {
                 const auto text = py::cast<std::string>(py::module_::import("os").attr("fspath")(name));
                 const auto folders = py::cast<std::vector<std::filesystem::path>>(
                     py::module_::import("viable._paths").attr("robot_folders")());
                 const py::gil_scoped_release release;
                 return std::make_shared<Robot>(loadRobot(findRobot(text, folders, "Robot")));
             }),
             py::arg("name"))
        .def_property_readonly("name", [](const Robot& r) { return r.description.name; })
        .def_property_readonly("folder", [](const Robot& r) { return r.description.folder.string(); })
        .def_property_readonly(
            "joints", [](const Robot& r) { return r.description.jointNames(); }, "Names, base first.")
        .def_property_readonly("limits", [](const Robot& r) { return makeLimits(r.description.limits); })
        .def_property_readonly(
            "home", [](const Robot& r) { return makeArray(r.description.home); }, "(n,): a pose amid the limits [rad]")
        .def_property_readonly(
            "torque_limit", [](const Robot& r) { return makeArray(r.description.actuation.torqueLimit); },
            "(n,): of the motors, at the joint [Nm]")
        .def_property_readonly(
            "friction", [](const Robot& r) { return makeFriction(r.description.actuation.friction); },
            "coulomb, viscous [Nm] and viscous_velocity [rad/s], each (n,): "
            "sign(qd) (coulomb + viscous (1 - exp(-|qd| / viscous_velocity)))")
        .def_property_readonly(
            "assumed", [](const Robot& r) { return r.description.assumed; },
            "Keys of the robot's files whose figures nobody gave.")
        .def("__len__", &Robot::size, "Joints.")
        .def("__repr__",
             [](const Robot& r) {
                 return "<viable.Robot " + r.description.name + ", " + std::to_string(r.size()) + " joints>";
             })
        .def(
            "dynamics",
            [](Robot& r, const py::object& q, const py::object& qd) { return calcAt(r, q, qd, "Robot.dynamics"); },
            py::arg("q"), py::arg("qd") = py::none(),
            "M, b, gravity, J and tool at q (n,) and qd (n,), at rest without it. NaN where a robot without masses has "
            "none.")
        .def(
            "forward_dynamics",
            [](Robot& r, const py::object& q, const py::object& qd, const py::object& torque) {
                requireDynamics(r.description, "Robot.forward_dynamics", "an acceleration by torques");
                // All arguments first: what converts one may call this robot again.
                const JointVector position = readVector(q, r.size(), "Robot.forward_dynamics: q");
                const JointVector velocity = readVectorOrZero(qd, r.size(), "Robot.forward_dynamics: qd");
                const JointVector given = readVector(torque, r.size(), "Robot.forward_dynamics: torque");
                r.model.calcDynamics(position, velocity, r.dynamics);
                JointVector qdd;
                if (!calcForwardDynamics(r.dynamics, given, qdd))
                    throw badInput("Robot.forward_dynamics",
                                   "a number is not finite, or the inertia not positive definite",
                                   "Give finite numbers.");
                return makeArray(qdd);
            },
            py::arg("q"), py::arg("qd"), py::arg("torque"), "(n,): the acceleration M^-1 (torque - b) [rad/s^2].")
        .def("gains", &calcGains, py::arg("tick"), py::arg("limits") = py::none(), py::arg("delay_ticks") = 0,
             "Gains of the robust loop that every pose within the limits can carry (0.3 s): k_r [Nms/rad], k_p [1/s],\n"
             "k_i [1/s^2], each (n,), inertia_rate [1/s], and the loop's margins: gain_margin (a factor), phase_margin "
             "[rad].")
        .def(
            "with_payload",
            [](const Robot& r, double mass, const py::object& offset) {
                if (!(mass >= 0.0 && std::isfinite(mass)))
                    throw badInput("Robot.with_payload: mass",
                                   detail::formatNumber(mass) + " kg; allowed is 0 and more", "Give it in kg.");
                const JointVector at = readVectorOrZero(offset, 3, "Robot.with_payload: offset");
                return std::make_shared<Robot>(withPayload(r.description, mass, at.head<3>()));
            },
            py::arg("mass"), py::arg("offset") = py::none(),
            "The robot with a point mass [kg] fixed to its tool, at `offset` (3,) in the tool's frame [m].")
        .def(
            "with_scaled_masses",
            [](const Robot& r, const py::object& factor) {
                const JointVector each =
                    readPerJoint(factor, r.size(), "Robot.with_scaled_masses: factor").expand(r.size());
                if (!(each.array() > 0.0).all() || !each.allFinite())
                    throw badInput("Robot.with_scaled_masses: factor", "a factor is not above 0 and finite",
                                   "1 changes nothing.");
                return std::make_shared<Robot>(withScaledMasses(r.description, each));
            },
            py::arg("factor"),
            "The robot with mass and inertia of the body behind each joint times `factor`, a number or (n,).");
}

}  // namespace viable::python
