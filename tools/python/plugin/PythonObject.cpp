#include "PythonObject.h"

#include "../src/Arrays.h"
#include "host/PluginCall.h"
#include "host/PythonClass.h"

namespace viable::python {

/** A scalar as an experiment file means it: true, a whole number, a number or expression, or else a text. */
static py::object readScalar(const ConfigNode& node) {
    if (node.quoted) return makeText(node.text);
    if (node.text == "true") return py::bool_(true);
    if (node.text == "false") return py::bool_(false);
    try {
        return py::int_(toInteger(node, INT64_MIN, INT64_MAX));
    } catch (const Error&) {  // none
    }
    try {
        NumberRange any;
        any.mayBeInfinite = true;
        return py::float_(toNumber(node, any));
    } catch (const Error&) {  // none
    }
    return makeText(node.text);
}

static py::object readNode(const ConfigNode& node) {
    switch (node.kind) {
        case ConfigNode::Kind::Empty:
            break;
        case ConfigNode::Kind::Scalar:
            return readScalar(node);
        case ConfigNode::Kind::List: {
            py::list list;
            for (const ConfigNode& item : node.items) list.append(readNode(item));
            return list;
        }
        case ConfigNode::Kind::Map: {
            py::dict map;
            for (const auto& [key, value] : node.entries) map[makeText(key)] = readNode(value);
            return map;
        }
    }
    return py::none();
}

static py::object makeSetup(const RunSetup& setup) {
    const py::handle host = getHost();
    py::list names;
    for (const std::string& name : setup.robot.jointNames()) names.append(makeText(name));
    const JointLimits& limits = setup.limits;
    return host.attr("Setup")(makeText(setup.robot.folder.string()), names, setup.tick_s, setup.duration_s,
                              host.attr("Limits")(makeBounds(limits.position), makeBounds(limits.velocity),
                                                  makeBounds(limits.acceleration), makeBounds(limits.jerk)),
                              makeState(setup.start), makePose(setup.startTool));
}

/** Throws the Error that a Refused of host.py stands for; returns where it is none. */
static void tellRefused(const py::error_already_set& error, const ConfigNode& block) {
    if (!error.matches(getHost().attr("Refused"))) return;
    const py::tuple parts = error.value().attr("args");
    const ConfigNode* const parameter = block.find(parts[0].cast<std::string>());
    const ConfigNode* const plugin = block.find("plugin");
    throw badInput((parameter ? *parameter
                    : plugin  ? *plugin
                              : block)
                       .place(),
                   parts[1].cast<std::string>(), parts[2].cast<std::string>());
}

PythonObject::~PythonObject() {
    if (!object_ || !isAlive()) return;
    const PythonLock lock;
    Py_XDECREF(tick_);
    Py_DECREF(object_);
    if (!isNeverEnded()) return;
    try {
        getHost().attr("flush")();
    } catch (const std::exception&) {  // nothing is left to be told
    }
}

std::string PythonObject::make(const RunSetup& setup, const Parameters& parameters) {
    const ConfigNode& block = parameters.resolved();
    const std::string& request = block.find("plugin")->text;
    const std::size_t colon = request.rfind(':');
    file_ = request.substr(0, colon);
    const std::string name = request.substr(colon + 1);
    const PythonLock lock;
    try {
        py::dict arguments;
        for (const auto& [key, node] : block.entries)
            if (key != "plugin") arguments[makeText(key)] = readNode(node);
        object_ = getHost().attr("make")(makeText(file_), makeText(name), arguments, method_).release().ptr();
        tick_ = py::handle(object_).attr(method_).cast<py::object>().release().ptr();
    } catch (py::error_already_set& e) {
        tellRefused(e, block);
        throw Error(ErrorKind::PluginFailed, file_, explain(e));
    }
    try {
        if (py::hasattr(object_, "configure")) py::handle(object_).attr("configure")(makeSetup(setup));
    } catch (py::error_already_set& e) {
        tellRefused(e, block);
        throw Error(ErrorKind::PluginFailed, block.find("plugin")->place(),
                    "the configure() of " + name + " raised " + explain(e), kOnRaise);
    }
    try {
        return getHost().attr("choose")(py::handle(object_), method_, makeText(file_)).cast<std::string>();
    } catch (py::error_already_set& e) {
        tellRefused(e, block);
        throw Error(ErrorKind::PluginFailed, file_, explain(e));
    }
}

void PythonObject::reset(const MotionState& start) {
    const PythonLock lock;
    try {
        if (py::hasattr(object_, "reset")) py::handle(object_).attr("reset")(makeState(start));
    } catch (py::error_already_set& e) {
        throw PluginFault("its reset() raised " + explain(e), kOnRaise);
    }
}

std::string PythonObject::explain(py::error_already_set& error) const {
    try {
        py::object value = error.value();
        if (error.trace()) value.attr("__traceback__") = error.trace();
        return getHost().attr("explain")(value, makeText(file_)).cast<std::string>();
    } catch (const std::exception&) {
        return "something whose text cannot be made";
    }
}

void PythonObject::tellRaised(py::error_already_set& error) const {
    throw PluginFault("it raised " + explain(error), kOnRaise);
}

void PythonObject::tellUnusable(const Error& error) {
    throw PluginFault(error.what(), kOnRaise);
}

py::tuple makeState(const MotionState& state) {
    return getHost().attr("State")(makeArray(state.q), makeArray(state.qd), makeArray(state.qdd));
}

py::object makeDynamics(const Dynamics& d) {
    return getHost().attr("Dynamics")(makeMatrix(d.M), makeArray(d.b), makeArray(d.gravity), makeMatrix(d.J),
                                      makePose(d.tool));
}

Pose readPose(const py::handle& value, const std::string& place) {
    constexpr double kTolerance = 1e-3;  // of a rotation that was written with few decimals
    const Array array = readArray(value, place);
    if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4)
        throw badInput(place, "the array has shape " + formatShape(array),
                       "Give a pose in the base frame, shape (4, 4): rotation and position [m].");
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(array.data());
    const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
    const double deviation = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    if (matrix.allFinite() && (deviation > kTolerance || rotation.determinant() < 0.0))
        throw badInput(place, "the upper left 3 x 3 of the pose is no rotation",
                       "Its columns have length 1 and right angles, right-handed.");
    return {matrix.topRightCorner<3, 1>(), Eigen::Quaterniond(rotation).normalized()};
}

}  // namespace viable::python
