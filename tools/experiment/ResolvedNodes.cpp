#include "experiment/ResolvedNodes.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"

namespace viable::detail {

ConfigNode makeScalar(const std::string& text, bool quoted) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::Scalar;
    node.text = text;
    node.quoted = quoted;
    return node;
}

ConfigNode makeNumber(double value) {
    if (std::isinf(value)) return makeScalar(value > 0.0 ? ".inf" : "-.inf");
    return makeScalar(formatNumber(value));
}

ConfigNode makeList(const JointVector& values) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::List;
    for (double value : values) node.items.push_back(makeNumber(value));
    return node;
}

ConfigNode makeMap(std::vector<std::pair<std::string, ConfigNode>> entries) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::Map;
    node.entries = std::move(entries);
    return node;
}

ConfigNode dropEntry(ConfigNode map, const std::string& key) {
    const auto isIt = [&](const auto& entry) { return entry.first == key; };
    map.entries.erase(std::remove_if(map.entries.begin(), map.entries.end(), isIt), map.entries.end());
    return map;
}

ConfigNode makeBounds(const JointBounds& bounds) {
    return makeMap({{"lower", makeList(bounds.lower)}, {"upper", makeList(bounds.upper)}});
}

}  // namespace viable::detail
