#pragma once

#include <nlohmann/json.hpp>

#include "viable/config/Settings.h"

namespace viable::detail {

using Json = nlohmann::ordered_json;  // a reader finds the keys in the order in which they are explained

/** The declared default as JSON: null where it is required, text for an expression of pi. */
Json makeJsonDefault(const ParameterSpec& spec);

/** One entry of `parameters`, see describePluginsAsJson(). */
Json describeAsJson(const ParameterSpec& spec);

/** JSON Schema of the parameter's value in an experiment file. Never refuses what the reader takes; not seen by it are
quotes around numbers, unbalanced parentheses and the range of expressions. */
Json makeSchema(const ParameterSpec& spec);

/** A map with these entries at most. */
Json makeObjectSchema(const Json& properties);

}  // namespace viable::detail
