#pragma once

#include <functional>

#include "Arrays.h"
#include "viable/config/Settings.h"

namespace viable::python {

/** A value of Python as an experiment file writes it. */
std::string formatValue(const py::handle& value);
/** The same as a part of a file. @param place  stands for the file in messages */
ConfigNode makeNode(const py::handle& value, const std::string& place);

/** The visitor that makes keywords of Python of a struct's settings. They have the names of the settings without their
units. Reader, table, signature and stub come from the line that describes the setting. */
class Keywords {
public:
    template <class T>
    ParameterSpec& operator()(T& member, const char* name, const char* unitOrWords, const char* help) {
        return list_(member, dropUnit(name, unitOrWords), unitOrWords, help);
    }
    template <class T>
    ParameterSpec& operator()(T& member, const char* name, const char* help) {
        return list_(member, name, help);
    }
    /** Takes what was given. @param place  in messages, such as "Guard: limits" */
    using Take = std::function<void(const py::handle& value, const std::string& place)>;
    /** A keyword for what is no setting, None where it is left out. @param type  in Python, with "|None" */
    void addObject(const char* name, const char* type, const char* help, Take take);

    /** Fills the members from what was given. Throws Error (BadInput) with all that is wrong, as for a file.
    @param owner  the class, for messages */
    void read(const std::string& owner, const py::kwargs& given, int joints) const;

    /** The docstring `text`, with the table of the keywords in the place of KEYWORDS: name, unit, range, default, help. */
    std::string document(const std::string& text) const;
    /** `__init__` as the stub has it. @param before  its other arguments */
    std::string formatSignature(const std::string& before) const;

private:
    struct Object {
        std::string name, unused;
        Take take;
    };
    const char* dropUnit(const std::string& name, std::string unit);
    const Object* findObject(const std::string& name) const;

    SettingList list_;
    std::deque<std::string> names_;
    std::deque<Object> objects_;
};

/** Of options with limits. Valid as long as `options`. */
template <class Options>
Keywords makeKeywords(Options& options) {
    Keywords keywords;
    keywords.addObject(
        "limits", "Limits|None", "The limits that are kept. None: the robot's.",
        [&options](const auto& limits, const auto& place) { options.limits = readLimits(limits, place); });
    options.describe(keywords);
    return keywords;
}

/** A class of Python, called with Arguments and py::kwargs.
@param doc  with KEYWORDS in it. @param before, names  the arguments, as in the stub and for pybind11 */
template <class Class, class... Arguments, class... Names>
py::class_<Class> defineClass(py::module_& module, const char* name, const char* doc, const Keywords& keywords,
                              const std::string& before, const Names&... names) {
    py::class_<Class> made(module, name, keywords.document(doc).c_str());
    py::options options;
    options.disable_function_signatures();
    made.def(py::init<Arguments..., const py::kwargs&>(), names..., keywords.formatSignature(before).c_str());
    made.attr("__signature__") = py::module_::import("viable._types").attr("Signature")(made.attr("__init__"));
    return made;
}

}  // namespace viable::python
