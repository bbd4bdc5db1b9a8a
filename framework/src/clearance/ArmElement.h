#pragma once

#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** What keeps a clearance: a capsule of the arm from the surroundings, or two capsules of the arm from each other. */
struct ArmElement {
    int first = 0;    ///< capsule
    int second = -1;  ///< the other capsule; -1: the surroundings
    bool isPair() const { return second >= 0; }
};

/** Every capsule that a joint moves, then the pairs. */
inline std::vector<ArmElement> makeElements(const ArmGeometry& geometry) {
    std::vector<ArmElement> elements;
    for (std::size_t i = 0; i < geometry.capsules.size(); ++i)
        if (geometry.capsules[i].carrier >= 0) elements.push_back({static_cast<int>(i), -1});
    for (const auto& [first, second] : geometry.pairs) elements.push_back({first, second});
    return elements;
}

}  // namespace viable::detail
