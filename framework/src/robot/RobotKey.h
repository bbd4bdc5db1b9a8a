#pragma once

#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** A text that two robots share only where all is equal but the folder that they lie in (SHA-256 over every figure, to the
last bit). For a Memo of what follows from a robot. */
std::string calcRobotKey(const RobotDescription& robot);

}  // namespace viable::detail
