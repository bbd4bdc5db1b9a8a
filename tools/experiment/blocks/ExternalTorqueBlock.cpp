#include "experiment/CaseBlocks.h"

namespace viable::detail {

bool readExternalTorque(const ConfigNode& node) {
    return toChoice(node, {"to_nominal", "ignored"}) == "to_nominal";
}

}  // namespace viable::detail
