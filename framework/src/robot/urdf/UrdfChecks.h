#pragma once

#include "core/Complaints.h"
#include "robot/urdf/UrdfDocument.h"

namespace viable::detail {

/** Whether joints and links are named, named once, and form one tree. */
void checkUrdfTree(UrdfDocument& document, Complaints& complaints);

/** Whether each joint and each body can be simulated.
@param complaints  about the tree or what was chosen of it, so far */
void checkUrdfElements(UrdfDocument& document, Complaints& complaints);

}  // namespace viable::detail
