#pragma once

#include <pybind11/numpy.h>

#include "Interpreter.h"
#include "viable/plugin/Plugin.h"

namespace viable::python {

/** An object of a class in a .py file, and the calls that go there. Outside of call() and make() it may be held without
Python's lock. */
class PythonObject {
public:
    /** @param method  what is called in a tick: sample, compute or filter */
    explicit PythonObject(const char* method) : method_(method) {}
    ~PythonObject();
    PythonObject(const PythonObject&) = delete;
    PythonObject& operator=(const PythonObject&) = delete;

    /** Makes the object with the parameters of its block, and lets it configure itself. Throws Error: BadInput for what the
    file, the class or the parameters are not, PluginFailed for what its configure() raises.
    @return the word of the class attribute that belongs to the method, such as `space` */
    std::string make(const RunSetup& setup, const Parameters& parameters);
    void reset(const MotionState& start);

    /** Calls the method with what `makeArguments` gives, a tuple, and hands `take` what it returns, all under Python's lock. Throws
    PluginFault for whatever is raised. */
    template <class MakeArguments, class Take>
    void call(const MakeArguments& makeArguments, const Take& take) const {
        const PythonLock lock;
        try {
            take(py::reinterpret_steal<py::object>(checkCalled(PyObject_Call(tick_, makeArguments().ptr(), nullptr))));
        } catch (py::error_already_set& e) {
            tellRaised(e);
        } catch (const Error& e) {  // of its result
            tellUnusable(e);
        }
    }

private:
    static PyObject* checkCalled(PyObject* result) {
        if (!result) throw py::error_already_set();
        return result;
    }
    std::string explain(py::error_already_set& error) const;
    [[noreturn]] void tellRaised(py::error_already_set& error) const;
    [[noreturn]] static void tellUnusable(const Error& error);

    const char* const method_;
    std::string file_;
    PyObject* object_ = nullptr;
    PyObject* tick_ = nullptr;  // the bound method
};

// What goes in: copies, which the class may keep and change.
py::tuple makeState(const MotionState& state);
py::object makeDynamics(const Dynamics& dynamics);
/** Throws Error for what is no pose; numbers that are not finite pass. */
Pose readPose(const py::handle& value, const std::string& place);

}  // namespace viable::python
