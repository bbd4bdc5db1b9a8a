#include "Arrays.h"

#include <cstring>

namespace viable::python {

py::str makeText(std::string_view text) {
    PyObject* const made = PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace");
    if (!made) throw py::error_already_set();
    return py::reinterpret_steal<py::str>(made);
}

std::string formatShape(const py::array& array) {
    std::string text = "(";
    for (py::ssize_t i = 0; i < array.ndim(); ++i) text += (i > 0 ? ", " : "") + std::to_string(array.shape(i));
    return text + (array.ndim() == 1 ? ",)" : ")");
}

Array readArray(const py::handle& value, const std::string& place) {
    if (Array::check_(value)) return py::reinterpret_borrow<Array>(value);
    const py::array any = py::array::ensure(value);
    if (!any) {
        PyErr_Clear();
        throw badInput(place, "a " + std::string(Py_TYPE(value.ptr())->tp_name) + " is no array of numbers",
                       "Give a numpy array or a list of numbers.");
    }
    if (!std::strchr("fiub", any.dtype().kind()))
        throw badInput(place, "the array's type is " + py::cast<std::string>(py::str(any.dtype())),
                       "Give real numbers: float64 as it is, float32 and integers are converted.");
    Array numbers = Array::ensure(any);
    if (!numbers) {
        PyErr_Clear();
        throw badInput(place, "the array cannot be converted to float64", "Give real numbers.");
    }
    return numbers;
}

JointVector readVector(const py::handle& value, int n, const std::string& place) {
    const Array array = readArray(value, place);
    if (array.ndim() != 1 || array.shape(0) != n)
        throw badInput(place, "the array has shape " + formatShape(array),
                       "Give one number per joint, shape (" + std::to_string(n) + ",).");
    return Eigen::Map<const Eigen::VectorXd>(array.data(), n);
}

JointVector readVectorOrZero(const py::handle& value, int n, const std::string& place) {
    return value.is_none() ? JointVector(JointVector::Zero(n)) : readVector(value, n, place);
}

PerJoint readPerJoint(const py::handle& value, int n, const std::string& place) {
    const Array array = readArray(value, place);
    if (array.ndim() == 0) return *array.data();
    return readVector(array, n, place);
}

py::array makeArray(const JointVector& v) {
    return py::array_t<double>(v.size(), v.data());
}

py::array makeBounds(const JointBounds& bounds) {
    Eigen::MatrixXd rows(2, bounds.lower.size());
    rows << bounds.lower.transpose(), bounds.upper.transpose();
    return makeMatrix(rows);
}

py::array makePose(const Pose& pose) {
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    matrix.topLeftCorner<3, 3>() = pose.orientation.toRotationMatrix();
    matrix.topRightCorner<3, 1>() = pose.position;
    return makeMatrix(matrix);
}

}  // namespace viable::python
