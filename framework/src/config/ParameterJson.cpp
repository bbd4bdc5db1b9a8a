#include "config/ParameterJson.h"

#include <charconv>

#include "config/ConfigText.h"
#include "config/ParameterText.h"
#include "core/JsonNumber.h"

namespace viable::detail {

namespace {

constexpr double kLargestDouble = std::numeric_limits<double>::max();

/** Numbers and pi with + - * / and parentheses: the reader's expressions (see toNumber), except that a regular expression
cannot pair parentheses. */
constexpr const char* kExpressionPattern =
    R"(^[-+( \t]*(pi|((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?)[) \t]*)"
    R"(([-+*/][-+( \t]*(pi|((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?)[) \t]*)*$)";

/** A value that is drawn anew for every run (see listDraws); the reader looks at what is inside. */
constexpr const char* kDrawPattern = R"(^~(uniform|log_uniform|normal|integer|choice)\(.*\)$)";

std::string getText(const char* text) {
    return text ? text : "";
}

bool isBounds(ParameterType type) {
    return type == ParameterType::Bounds || type == ParameterType::Positions;
}

bool isNumeric(ParameterType type) {
    return type == ParameterType::Number || type == ParameterType::JointNumbers || type == ParameterType::Numbers ||
           type == ParameterType::Rows || isBounds(type);
}

/** A plain number as a number, anything else (".inf", "2*pi") as the text it is. */
Json makeNumberOrText(const std::string& text) {
    double value = 0.0;
    const char* end = text.data() + text.size();
    const auto result = std::from_chars(text.data(), end, value);
    return result.ec == std::errc() && result.ptr == end && std::isfinite(value) ? Json(value) : Json(text);
}

Json makeNodeJson(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::List) {
        Json list = Json::array();
        for (const ConfigNode& item : node.items) list.push_back(makeNodeJson(item));
        return list;
    }
    return node.quoted ? Json(node.text) : makeNumberOrText(node.text);
}

Json makeBound(double bound) {
    constexpr double kExact = 9007199254740992.0;  // 2^53: below it every whole number is a double
    const bool isWhole = bound == std::floor(bound) && std::abs(bound) < kExact;
    return isWhole ? Json(static_cast<std::int64_t>(bound)) : Json(bound);
}

/** Bounds of JSON numbers. YAML's infinities are numbers beyond the largest double. Text passes: it is an expression. */
void addBounds(Json& schema, const NumberRange& range) {
    const bool hasMin = !std::isinf(range.min) || !range.contains(-kInfinity);
    const bool hasMax = !std::isinf(range.max) || !range.contains(kInfinity);
    Json bounds = Json::object();
    if (hasMin)
        bounds[range.minIsOpen && !std::isinf(range.min) ? "exclusiveMinimum" : "minimum"] =
            makeBound(std::max(range.min, -kLargestDouble));
    if (hasMax)
        bounds[range.maxIsOpen && !std::isinf(range.max) ? "exclusiveMaximum" : "maximum"] =
            makeBound(std::min(range.max, kLargestDouble));
    // A finite bound, and yet "no limit" beyond it.
    Json either = Json::array({bounds});
    if (!std::isinf(range.max) && range.contains(kInfinity)) either.push_back({{"exclusiveMinimum", kLargestDouble}});
    if (!std::isinf(range.min) && range.contains(-kInfinity)) either.push_back({{"exclusiveMaximum", -kLargestDouble}});
    if (either.size() > 1)
        schema["anyOf"] = either;
    else
        schema.update(bounds);
}

Json makeNumberSchema(const NumberRange& range) {
    Json schema = {
        {"type", {"number", "string"}},
        {"pattern", std::string("(") + kExpressionPattern + ")|(" + kDrawPattern + ")"},
        // What editors say instead of the pattern; unknown to the standard, which allows that.
        {"patternErrorMessage", "Write a number, an expression such as 2*pi/3, or a draw such as ~uniform(0, 1)."}};
    addBounds(schema, range);
    return schema;
}

Json makeListSchema(const Json& item, int minCount, int maxCount) {
    Json schema = {{"type", "array"}, {"items", item}};
    if (minCount > 0) schema["minItems"] = minCount;
    if (maxCount < std::numeric_limits<int>::max()) schema["maxItems"] = maxCount;
    return schema;
}

/** Or one of its words. */
Json allowWords(const ParameterSpec& spec, Json schema) {
    const std::vector<std::string> words = getWords(spec);
    if (words.empty()) return schema;
    return {{"anyOf", Json::array({{{"enum", words}}, std::move(schema)})}};
}

Json makeJointNumbersSchema(const NumberRange& range) {
    const Json number = makeNumberSchema(range);
    Json schema = makeListSchema(number, 1, kMaxJoints);
    schema.update(number);
    schema["type"] = {"number", "string", "array"};
    return schema;
}

/** None of a pair must be there: a case may change one side. */
Json makeBoundsSchema(const ParameterSpec& spec) {
    const NumberRange positive = spec.range();
    NumberRange any, lower, upper;
    lower.mayBeInfinite = upper.mayBeInfinite = spec.mayBeInfinite;
    if (spec.type == ParameterType::Bounds) {
        lower.max = upper.min = 0.0;
        lower.maxIsOpen = upper.minIsOpen = true;
    }
    Json forms = Json::array(
        {makeJointNumbersSchema(positive),
         makeObjectSchema({{"lower", makeJointNumbersSchema(lower)}, {"upper", makeJointNumbersSchema(upper)}})});
    if (spec.type == ParameterType::Positions)
        forms.push_back(makeObjectSchema(
            {{"center", makeJointNumbersSchema(any)}, {"half_range", makeJointNumbersSchema(positive)}}));
    return {{"anyOf", forms}};
}

/** @param isWhole  its required keys must be there; not where a case may complete the block at the top */
Json makeBlockSchema(const ParameterSpec& spec, bool isWhole) {
    Json properties = Json::object(), required;
    for (const ParameterSpec& inner : spec.inner()) {
        properties[inner.name] = makeSchema(inner);
        if (!inner.defaultText) required.push_back(inner.name);
    }
    Json schema = makeObjectSchema(properties);
    if (isWhole && !required.empty()) schema["required"] = required;
    return schema;
}

Json makeValueSchema(const ParameterSpec& spec) {
    switch (spec.type) {
        case ParameterType::Number:
            return makeNumberSchema(spec.range());
        case ParameterType::Integer: {
            Json schema = {{"type", {"integer", "string"}}, {"pattern", kDrawPattern}};
            const std::int64_t least = getSmallest(spec), most = getLargest(spec);
            if (least != std::numeric_limits<std::int64_t>::min()) schema["minimum"] = least;
            if (most != std::numeric_limits<std::int64_t>::max()) schema["maximum"] = most;
            return schema;
        }
        case ParameterType::Flag:
            return {{"type", {"boolean", "string"}}, {"pattern", kDrawPattern}};
        case ParameterType::Choice: {
            Json names = Json::array();
            for (const std::string& name : splitChoices(spec.choices)) {
                names.push_back(name);
                const Json other = Json::parse(name, nullptr, false);  // YAML reads `1`, `true` as such
                if (!other.is_discarded()) names.push_back(other);
            }
            const Json drawn = {{"type", "string"}, {"pattern", kDrawPattern}};
            return {{"anyOf", Json::array({{{"enum", names}}, drawn})}};
        }
        case ParameterType::Text:
        case ParameterType::File:
            // The reader takes any scalar as it is written.
            return {{"type", {"string", "number", "boolean"}}};
        case ParameterType::JointNumbers:
            return allowWords(spec, makeJointNumbersSchema(spec.range()));
        case ParameterType::Numbers:
            return allowWords(spec, makeListSchema(makeNumberSchema(spec.range()), spec.minCount, spec.maxCount));
        case ParameterType::Rows:
            return makeListSchema(makeListSchema(makeNumberSchema(spec.range()), spec.minCount, spec.maxCount), 0,
                                  std::numeric_limits<int>::max());
        case ParameterType::Texts:
            return {{"type", "array"}, {"items", {{"type", {"string", "number", "boolean"}}}}};
        case ParameterType::Bounds:
        case ParameterType::Positions:
            return makeBoundsSchema(spec);
        case ParameterType::Block:
            return makeBlockSchema(spec, false);
        case ParameterType::Blocks:
            return {{"type", "array"}, {"items", makeBlockSchema(spec, true)}};
        case ParameterType::Named:
            return {{"type", "object"}, {"additionalProperties", makeBlockSchema(spec, false)}};
    }
    return Json::object();  // an unknown type is the reader's to refuse
}

bool hasInfinity(const Json& value) {
    if (value.is_array())
        for (const Json& item : value)
            if (hasInfinity(item)) return true;
    return value == ".inf" || value == "-.inf";
}

}  // namespace

Json makeObjectSchema(const Json& properties) {
    return {{"type", "object"}, {"properties", properties}, {"additionalProperties", false}};
}

Json makeJsonDefault(const ParameterSpec& spec) {
    if (!spec.defaultText) return nullptr;
    switch (spec.type) {
        case ParameterType::Choice:
        case ParameterType::Text:
        case ParameterType::File:
            return spec.defaultText;
        case ParameterType::Flag:
            return std::string(spec.defaultText) == "true";
        case ParameterType::Integer: {
            const Json value = Json::parse(spec.defaultText, nullptr, false);
            return value.is_number_integer() ? value : Json(spec.defaultText);
        }
        default:
            return makeNodeJson(parseYaml(spec.defaultText, "default", "", 0, false));
    }
}

Json describeAsJson(const ParameterSpec& spec) {
    Json json = {{"name", getText(spec.name)},       {"type", getTypeWord(spec.type)},
                 {"unit", getText(spec.unit)},       {"required", !spec.defaultText},
                 {"default", makeJsonDefault(spec)}, {"per_joint", spec.type == ParameterType::JointNumbers}};
    const bool isWhole = spec.type == ParameterType::Integer;
    if (isWhole || isNumeric(spec.type))
        json["range"] = {{"min", isWhole ? Json(getSmallest(spec)) : makeNumberOrWord<Json>(spec.min, kFileInfinity)},
                         {"min_is_open", !isWhole && (spec.minIsOpen || std::isinf(spec.min))},
                         {"max", isWhole ? Json(getLargest(spec)) : makeNumberOrWord<Json>(spec.max, kFileInfinity)},
                         {"max_is_open", !isWhole && (spec.maxIsOpen || std::isinf(spec.max))},
                         {"may_be_infinite", !isWhole && spec.mayBeInfinite}};
    if (spec.type == ParameterType::Choice) json["choices"] = splitChoices(spec.choices);
    if (const std::vector<std::string> words = getWords(spec); !words.empty()) json["words"] = words;
    if (spec.type == ParameterType::Numbers || spec.type == ParameterType::Rows) {
        json["min_count"] = spec.minCount;
        json["max_count"] = spec.maxCount < std::numeric_limits<int>::max() ? Json(spec.maxCount) : Json(nullptr);
    }
    json["help"] = getText(spec.help);
    return json;
}

Json makeSchema(const ParameterSpec& spec) {
    std::string text = getText(spec.help);
    if (!getText(spec.unit).empty()) text += " [" + getText(spec.unit) + "]";
    if (isNumeric(spec.type)) text += " In " + spec.range().text() + ".";
    if (spec.type == ParameterType::JointNumbers || isBounds(spec.type))
        text += " One number for all joints, or a list.";
    Json schema = {{"description", ""}};
    schema.update(makeValueSchema(spec));
    if (!spec.defaultText && !spec.inner) {
        text += " Required.";
    } else if (spec.defaultText && *spec.defaultText) {
        text += std::string(" Default: ") + spec.defaultText;
        const Json value = makeJsonDefault(spec);
        if (!hasInfinity(value)) schema["default"] = value;  // JSON has no infinity
    }
    schema["description"] = text;
    return schema;
}

}  // namespace viable::detail
