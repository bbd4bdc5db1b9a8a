#pragma once

#include "viable/config/Settings.h"

namespace viable::detail {

/** "number", "whole number", "number or list with one per joint", ...: for messages. */
const char* getTypeName(ParameterType type);
/** "number", "integer", "joint_numbers", ...: for programs. */
const char* getTypeWord(ParameterType type);

/** The names in "a|b|c". */
std::vector<std::string> splitChoices(const char* choices);
/** What may stand in place of numbers. */
std::vector<std::string> getWords(const ParameterSpec& spec);

/** The first and the last whole number of an Integer's range. */
std::int64_t getSmallest(const ParameterSpec& spec);
std::int64_t getLargest(const ParameterSpec& spec);

}  // namespace viable::detail
