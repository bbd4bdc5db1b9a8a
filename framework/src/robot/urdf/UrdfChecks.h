#pragma once

#include "core/ErrorList.h"
#include "robot/urdf/UrdfDocument.h"

namespace viable::detail {

/** Whether joints and links are named, named once, and form one tree. */
void checkUrdfTree(UrdfDocument& document, ErrorList& errors);

/** Whether each joint and each body can be simulated.
@param errors  about the tree or what was chosen of it, so far */
void checkUrdfElements(UrdfDocument& document, ErrorList& errors);

}  // namespace viable::detail
