#pragma once

#include "core/ErrorList.h"
#include "robot/urdf/UrdfDocument.h"

namespace viable::detail {

/** Which joints of a URDF are to move; empty: all that can. */
struct UrdfChoice {
    std::string base;                ///< joints that do not hang on this link stay still
    std::string tip;                 ///< joints that do not carry this link stay still
    std::vector<std::string> fixed;  ///< joints that stay still: NAME or NAME=VALUE, VALUE in rad or m

    bool isEmpty() const { return base.empty() && tip.empty() && fixed.empty(); }
};

/** Makes an arm of a URDF as it is found, by changing the document: joints outside of the chosen chain, coupled and
gripper's joints, and end joints that move no mass become fixed where they are; inertias that miss the triangle inequality
by less than 5 % are corrected; limits that are missing become blanks (zeros). What cannot be mended is left to
checkUrdfElements().
@param errors  of checkUrdfTree(): of an unsound tree no chain is chosen. Gets what cannot be chosen so
@return what was changed, one sentence each; empty: the document is as it was */
std::vector<std::string> repairUrdf(UrdfDocument& document, const UrdfChoice& choice, ErrorList& errors);

}  // namespace viable::detail
