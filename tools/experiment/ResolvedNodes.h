#pragma once

#include "viable/config/ConfigNode.h"
#include "viable/core/JointLimits.h"

namespace viable::detail {

// What the resolved file of a case is made of: nodes that read back as exactly these values.

ConfigNode makeScalar(const std::string& text, bool quoted = false);
ConfigNode makeNumber(double value);
ConfigNode makeList(const JointVector& values);
ConfigNode makeMap(std::vector<std::pair<std::string, ConfigNode>> entries);
/** A map without one of its entries. */
ConfigNode dropEntry(ConfigNode map, const std::string& key);
/** `{lower: [...], upper: [...]}` */
ConfigNode makeBounds(const JointBounds& bounds);

}  // namespace viable::detail
