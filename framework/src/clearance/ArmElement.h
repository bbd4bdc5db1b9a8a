#pragma once

namespace viable::detail {

/** What keeps a clearance: a capsule of the arm from the surroundings, or two capsules of the arm from each other. */
struct ArmElement {
    int first = 0;    ///< capsule
    int second = -1;  ///< the other capsule; -1: the surroundings
    bool isPair() const { return second >= 0; }
};

}  // namespace viable::detail
