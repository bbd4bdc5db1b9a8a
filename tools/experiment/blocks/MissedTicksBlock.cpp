#include "experiment/CaseBlocks.h"

#include <cmath>

#include "core/ErrorList.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

std::vector<TickGap> readMissedTicks(const ConfigNode& node, double tick_s, double duration_s) {
    if (node.kind != ConfigNode::Kind::List)
        throw badInput(node.place(), "missed_ticks must be a list",
                       "Write for example `missed_ticks: [{at_s: 3.0, count: 20}]`.");
    std::vector<TickGap> gaps;
    ErrorList errors;
    for (const ConfigNode& item : node.items)
        errors.collect([&] {
            GapSettings gap;
            readSettings(item, gap);
            toNumber(*item.find("at_s"), {0.0, duration_s});
            gaps.push_back({std::llround(gap.at_s / tick_s), gap.count});
        });
    errors.throwIfAny(node.place());
    return gaps;
}

ConfigNode resolveMissedTicks(const std::vector<TickGap>& gaps, double tick_s) {
    ConfigNode list;
    list.kind = ConfigNode::Kind::List;
    for (const TickGap& gap : gaps)
        list.items.push_back(makeMap({{"at_s", makeNumber(static_cast<double>(gap.begin) * tick_s)},
                                      {"count", makeScalar(std::to_string(gap.count))}}));
    return list;
}

}  // namespace viable::detail
