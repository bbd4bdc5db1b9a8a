#include <dlfcn.h>

#include <exception>

#include "Arrays.h"
#include "core/ErrorParts.h"
#include "viable/robot/RobotDescription.h"

namespace viable::python {

/** Raises the library's errors as viable.Error (viable/_errors.py). */
static void translate(std::exception_ptr thrown) {
    try {
        if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& e) {
        const ErrorParts parts = getParts(e);
        const py::object error =
            py::module_::import("viable._errors")
                .attr("make_error")(e.exitCode(), makeText(parts.place), makeText(parts.cause), makeText(parts.remedy));
        PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
    }
}

/** The file of libviable, from which program, plugins and robots are found. */
static std::string findLibrary() {
    Dl_info info{};
    const auto address =
        reinterpret_cast<const void*>(static_cast<RobotDescription (*)(const std::filesystem::path&)>(&loadRobot));
    return dladdr(address, &info) != 0 && info.dli_fname ? info.dli_fname : "";
}

}  // namespace viable::python

PYBIND11_MODULE(_viable, module) {
    namespace vp = viable::python;
#if PYBIND11_VERSION_HEX < 0x020C0000  // it reads the arrays of numpy 2 wrongly, and says nothing
    if (vp::py::module_::import("numpy").attr("__version__").cast<std::string>().rfind("1.", 0) != 0)
        throw vp::py::import_error("viable was built with pybind11 " PYBIND11_TOSTRING(PYBIND11_VERSION_MAJOR) "." PYBIND11_TOSTRING(
            PYBIND11_VERSION_MINOR) ", which numpy 2 needs newer: pip install 'numpy<2', or build with pybind11 2.12");
#endif
    module.doc() = "The library viable; use it through the package `viable`.";
    module.attr("__version__") = VIABLE_VERSION;
    module.attr("library") = vp::findLibrary();
    vp::py::list acting;
    for (int kind = 0; kind < viable::countLimitKinds(); ++kind)
        acting.append(viable::getName(static_cast<viable::LimitKind>(kind), viable::LimitSide::Neither));
    module.attr("ACTING") = vp::py::tuple(acting);
    vp::py::register_exception_translator(&vp::translate);
    vp::bindRobot(module);
    vp::bindGuards(module);
    vp::bindBatch(module);
    vp::bindLog(module);
}
