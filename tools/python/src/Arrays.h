#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <optional>
#include <string_view>

#include "viable/core/JointLimits.h"

// numpy arrays and the library's vectors. All of it needs the interpreter's lock.

namespace viable::python {

namespace py = pybind11;

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/** `value` as an array of doubles in C order; what is one already is taken as it is. Throws Error (BadInput) for what holds
no real numbers. @param place  who asks, for messages */
Array readArray(const py::handle& value, const std::string& place);

/** n numbers, shape (n,). Throws likewise for another shape; numbers that are not finite pass. */
JointVector readVector(const py::handle& value, int n, const std::string& place);
/** None: zeros. */
JointVector readVectorOrZero(const py::handle& value, int n, const std::string& place);
/** One number for all joints, or shape (n,). */
PerJoint readPerJoint(const py::handle& value, int n, const std::string& place);

/** A copy, shape (n,). */
py::array makeArray(const JointVector& v);
/** A copy, shape (rows, columns). */
template <class Matrix>
py::array makeMatrix(const Matrix& m) {
    py::array_t<double> array({m.rows(), m.cols()});
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<Rows>(array.mutable_data(), m.rows(), m.cols()) = m;
    return array;
}
/** (2, n): lower, upper. */
py::array makeBounds(const JointBounds& bounds);
/** 4 x 4, base frame [m] */
py::array makePose(const Pose& pose);

/** As Python's text: bytes that are no UTF-8, such as of a plugin's message, become U+FFFD. */
py::str makeText(std::string_view text);

/** "(4096, 6)" */
std::string formatShape(const py::array& array);

/** The limits of a viable.Limits; None: nothing. */
std::optional<JointLimits> readLimits(const py::handle& limits, const std::string& place = "limits");
py::object makeLimits(const JointLimits& limits);

void bindRobot(py::module_& module);
void bindGuards(py::module_& module);
void bindBatch(py::module_& module);
void bindLog(py::module_& module);

}  // namespace viable::python
