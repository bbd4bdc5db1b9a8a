#pragma once

#include <pybind11/pybind11.h>

namespace viable::python {

namespace py = pybind11;

/** Python's lock, from construction to destruction. The first one starts an interpreter, where the process has none, with numpy
and the functions of host.py.

The interpreter heeds PYTHONPATH and the like, and the virtual environment of VIABLE_PYTHON, or else of VIRTUAL_ENV; it leaves
signals and locale alone, and is never ended. No dead-lock: nothing is started while this thread has the lock and waits for
another one, and no static object is made before the first use.
Throws Error where numpy is missing. Thread: any. */
class PythonLock {
public:
    PythonLock();
    ~PythonLock();
    PythonLock(const PythonLock&) = delete;
    PythonLock& operator=(const PythonLock&) = delete;

private:
    PyGILState_STATE state_;
};

/** The module host.py. Under the lock. */
py::handle getHost();

/** It is this library's interpreter: nobody ends it. After the first lock. */
bool isNeverEnded();

/** Python runs and is not about to end: objects may be given back. */
bool isAlive();

}  // namespace viable::python
