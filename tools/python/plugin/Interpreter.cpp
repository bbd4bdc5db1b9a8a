#include "Interpreter.h"

#include <dlfcn.h>
#include <pybind11/numpy.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <mutex>

#include "HostSource.h"
#include "viable/core/Error.h"

namespace viable::python {

namespace {

std::once_flag started;
std::atomic<bool> hasStarted{false};
bool isOwn = false;        // this library started it; before hasStarted
PyObject* host = nullptr;  // never given back: Python may have ended before the program does

/** What numpy's libraries ask for must be found by everyone: this library, and so libpython, was opened for itself alone. */
void showPythonToAll() {
    Dl_info info{};
    if (dladdr(reinterpret_cast<const void*>(&Py_InitializeFromConfig), &info) != 0 && info.dli_fname)
        dlopen(info.dli_fname, RTLD_NOW | RTLD_GLOBAL | RTLD_NOLOAD);
}

Error makeStartError(const std::string& what) {
    return Error(ErrorKind::PluginFailed, "Python", "it cannot be started: " + what,
                 "See whether /usr/bin/python3 starts, and PYTHONHOME, VIABLE_PYTHON and VIRTUAL_ENV.");
}

/** Whose packages are found; a virtual environment of another version has none for this one. */
std::string findExecutable() {
    if (const char* given = std::getenv("VIABLE_PYTHON"); given && *given) return given;
    if (const char* environment = std::getenv("VIRTUAL_ENV")) {
        const std::string version = std::to_string(PY_MAJOR_VERSION) + "." + std::to_string(PY_MINOR_VERSION);
        const std::string folder = environment;
        if (::access((folder + "/lib/python" + version).c_str(), X_OK) == 0) return folder + "/bin/python3";
    }
    return VIABLE_PYTHON_EXECUTABLE;
}

/** Whatever first imports `signal` (subprocess, asyncio) makes Python take SIGINT where nobody has it yet: now, and set back. */
void importSignal() {
    struct sigaction action {};
    const bool isKnown = sigaction(SIGINT, nullptr, &action) == 0;
    PyObject* const module = PyImport_ImportModule("signal");
    if (isKnown) sigaction(SIGINT, &action, nullptr);
    if (!module) PyErr_Clear();  // who needs it is told
    Py_XDECREF(module);
}

void startInterpreter() {
    showPythonToAll();
    PyPreConfig before;
    PyPreConfig_InitPythonConfig(&before);
    before.configure_locale = 0;
    before.coerce_c_locale = before.coerce_c_locale_warn = 0;
    before.utf8_mode = 1;
    before.parse_argv = 0;
    PyStatus status = Py_PreInitialize(&before);
    PyConfig config;
    PyConfig_InitPythonConfig(&config);
    config.parse_argv = 0;
    config.install_signal_handlers = 0;
    config.write_bytecode = 0;
    config.buffered_stdio = 0;  // what a law prints is not lost where the program ends without ending Python
    const std::string executable = findExecutable();
    if (!PyStatus_Exception(status))
        status = PyConfig_SetBytesString(&config, &config.program_name, executable.c_str());
    if (!PyStatus_Exception(status)) status = Py_InitializeFromConfig(&config);
    PyConfig_Clear(&config);
    if (PyStatus_Exception(status)) throw makeStartError(status.err_msg ? status.err_msg : "no reason given");
    importSignal();
    PyEval_SaveThread();  // from now on whoever needs the lock takes it
}

/** Imports what would otherwise be imported in the middle of a call, by whoever comes first. */
void prepare() {
    try {
        py::array_t<double> first(1);
    } catch (const py::error_already_set& e) {
        throw Error(ErrorKind::PluginFailed, "Python", std::string("numpy cannot be imported: ") + e.what(),
                    "apt-get install python3-numpy; in a virtual environment: make it with --system-site-packages.");
    }
    try {
        PyObject* const code = Py_CompileString(kHostSource, kHostName, Py_file_input);
        if (!code) throw py::error_already_set();
        host = PyImport_ExecCodeModule("_viable_plugin_host", code);
        Py_DECREF(code);
        if (!host) throw py::error_already_set();
    } catch (const py::error_already_set& e) {
        throw makeStartError(e.what());
    }
}

void start() {
    if (!Py_IsInitialized()) {
        startInterpreter();
        isOwn = true;
    }
    const PyGILState_STATE state = PyGILState_Ensure();
    try {
        prepare();
    } catch (...) {
        PyGILState_Release(state);
        throw;
    }
    PyGILState_Release(state);
    hasStarted.store(true, std::memory_order_release);
}

/** Gives the lock away, where this thread has it: whoever starts meanwhile needs it. */
class WithoutLock {
public:
    WithoutLock() : mine_(Py_IsInitialized() && PyGILState_Check() ? PyEval_SaveThread() : nullptr) {}
    ~WithoutLock() {
        if (mine_) PyEval_RestoreThread(mine_);
    }
    WithoutLock(const WithoutLock&) = delete;
    WithoutLock& operator=(const WithoutLock&) = delete;

private:
    PyThreadState* const mine_;
};

/** Keeps the thread's state in Python alive between its calls, with what libraries have stored there (threading.local,
numpy.seterr); a thread that Python knows already keeps its own. From construction without the lock to the thread's end. */
class KeptState {
public:
    KeptState() {
        if (PyGILState_GetThisThreadState()) return;
        first_ = PyGILState_Ensure();
        mine_ = PyEval_SaveThread();
    }
    ~KeptState() {
        if (!mine_ || !isAlive()) return;
        PyEval_RestoreThread(mine_);
        PyGILState_Release(first_);
    }
    KeptState(const KeptState&) = delete;
    KeptState& operator=(const KeptState&) = delete;

private:
    PyThreadState* mine_ = nullptr;
    PyGILState_STATE first_ = PyGILState_UNLOCKED;
};

}  // namespace

PythonLock::PythonLock() {
    if (!hasStarted.load(std::memory_order_acquire)) {
        const WithoutLock without;
        std::call_once(started, &start);
    }
    thread_local const KeptState kept;
    state_ = PyGILState_Ensure();
}

PythonLock::~PythonLock() {
    PyGILState_Release(state_);
}

py::handle getHost() {
    return host;
}

bool isNeverEnded() {
    return isOwn;
}

bool isAlive() {
#if PY_VERSION_HEX < 0x030D0000  // 3.13 gave it its public name, and took the other away
    return Py_IsInitialized() && !_Py_IsFinalizing();
#else
    return Py_IsInitialized() && !Py_IsFinalizing();
#endif
}

}  // namespace viable::python
