#include "Keywords.h"

#include <algorithm>

#include "config/ConfigText.h"
#include "core/ErrorList.h"
#include "core/Text.h"
#include "host/PluginDescription.h"

namespace viable::python {

namespace {

using detail::replaceAll;

bool isText(const ParameterSpec& spec) {
    return spec.type == ParameterType::Choice || spec.type == ParameterType::Text || spec.type == ParameterType::File;
}

/** May be None: there is no default to speak of. */
bool isOptional(const ParameterSpec& spec) {
    return spec.defaultText && !*spec.defaultText && (!isText(spec) || spec.choices);
}

std::string formatDefault(const ParameterSpec& spec) {
    if (isOptional(spec)) return "None";
    if (isText(spec)) return "\"" + std::string(spec.defaultText) + "\"";
    if (spec.type == ParameterType::Flag) return *spec.defaultText == 't' ? "True" : "False";
    return replaceAll(spec.defaultText, ".inf", "inf");
}

std::string getType(const ParameterSpec& spec) {
    const std::string type = isText(spec)                          ? "str"
                             : spec.type == ParameterType::Number  ? "float"
                             : spec.type == ParameterType::Integer ? "int"
                             : spec.type == ParameterType::Flag    ? "bool"
                             : spec.type <= ParameterType::Rows    ? "ArrayLike"
                                                                   : "Any";
    return type + (isOptional(spec) ? " | None" : "");
}

/** Of 0 and 1 the flags that they are; all else as it is. */
py::object makeFlag(const py::handle& value) {
    const auto number = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
    const long flag = number ? PyLong_AsLong(number.ptr()) : -1;
    PyErr_Clear();
    if (flag == 0 || flag == 1) return py::bool_(flag == 1);
    return py::reinterpret_borrow<py::object>(value);
}

}  // namespace

std::string formatValue(const py::handle& value) {
    return py::cast<std::string>(py::module_::import("viable._program").attr("format_value")(value));
}

ConfigNode makeNode(const py::handle& value, const std::string& place) {
    ConfigNode node = detail::parseYaml(formatValue(value), place, "", 0, false);
    detail::clearLines(node);
    return node;
}

void Keywords::addObject(const char* name, const char* type, const char* help, Take take) {
    Object& object = objects_.emplace_back(Object{name, "", std::move(take)});
    list_(object.unused, name, type, help);  // so it is known to the reader and stands in the table
}

const Keywords::Object* Keywords::findObject(const std::string& name) const {
    const auto found =
        std::find_if(objects_.begin(), objects_.end(), [&](const Object& object) { return object.name == name; });
    return found == objects_.end() ? nullptr : &*found;
}

/** velocity_filter_s [s]: velocity_filter; ..._radps2 [rad/s^2] likewise. */
const char* Keywords::dropUnit(const std::string& name, std::string unit) {
    unit = "_" + detail::makeUnitSuffix(unit);
    const std::size_t rest = name.size() - std::min(name.size(), unit.size());
    return names_.emplace_back(unit.size() > 1 && name.substr(rest) == unit ? name.substr(0, rest) : name).c_str();
}

void Keywords::read(const std::string& owner, const py::kwargs& given, int joints) const {
    detail::ErrorList errors;
    py::dict settings;
    for (const auto& [key, value] : given) {
        const auto name = py::cast<std::string>(key);
        const auto& specs = list_.specs();
        const auto spec = std::find_if(specs.begin(), specs.end(), [&](const auto& one) { return one.name == name; });
        if (spec != specs.end() && value.is_none() && isOptional(*spec)) continue;
        const Object* const object = findObject(name);
        if (object)
            errors.collect([&, &value = value] { object->take(value, owner + ": " + name); });
        else if (spec != specs.end() && spec->type == ParameterType::Flag)
            settings[key] = makeFlag(value);
        else
            settings[key] = value;
    }
    errors.collect([&] { list_.read(makeNode(settings, owner), joints); });
    errors.throwIfAny(owner);
}

std::string Keywords::document(const std::string& text) const {
    std::vector<ParameterSpec> specs = list_.specs();
    std::vector<std::string> texts;
    for (const ParameterSpec& spec : specs) texts.push_back(formatDefault(spec));
    for (std::size_t i = 0; i < specs.size(); ++i) specs[i].defaultText = texts[i].c_str();
    const std::string table = replaceAll(describeParameters(specs.data(), specs.size()), ".inf", "inf");
    return replaceAll(text, "KEYWORDS", replaceAll(table, "true or false", "True or False"));
}

std::string Keywords::formatSignature(const std::string& before) const {
    std::string text = "__init__(self, " + before + (before.empty() ? "*" : ", *");
    for (const ParameterSpec& spec : list_.specs()) {
        const std::string name = spec.name;
        text += ", " + name + ": " + (findObject(name) ? replaceAll(spec.choices, "|", " | ") : getType(spec)) +
                (spec.defaultText ? " = " + formatDefault(spec) : "");
    }
    return text + ") -> None";
}

}  // namespace viable::python
