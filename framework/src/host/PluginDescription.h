#pragma once

#include "host/PluginLoader.h"

namespace viable {

/** Plugins and their parameters as JSON (UTF-8, ends with a line break), for programs:

    {"plugins": [{"kind": "filter", "name": "tosbp", "summary": "...", "library": "/.../viable_filter_tosbp.so",
                  "guarantees_limits": false,
                  "parameters": [{"name": "k_alpha", "type": "number", "unit": "1/s", "required": false,
                                  "default": 5.0, "per_joint": false,
                                  "range": {"min": 0.0, "min_is_open": true, "max": ".inf", "max_is_open": true,
                                            "may_be_infinite": false},
                                  "help": "..."}]}],
     "refused": [{"library": "...", "reason": "..."}]}

`type` is number, integer, flag, choice, text, file, joint_numbers, numbers or rows; numbers alone have `range`, a choice
has `choices`, numbers and rows have `min_count` and `max_count` (null: any number). JSON has no infinity: it is the text
".inf" or "-.inf", as in an experiment file; an expression such as 2*pi stays text, too. A required parameter's
`default` is null.
@param withGuarantees  makes each filter and asks for `guarantees_limits`; throws Error when one cannot be made */
std::string describePluginsAsJson(const std::vector<PluginInfo>& plugins, const std::vector<RefusedLibrary>& refused,
                                  bool withGuarantees);

/** The declaration as lines of text for `viable plugins --describe`. */
std::string describeParameters(const ParameterSpec* specs, std::size_t count);
/** The declaration as a table in Markdown: the one in the plugin's README. */
std::string describeParametersAsMarkdown(const ParameterSpec* specs, std::size_t count);

}  // namespace viable
