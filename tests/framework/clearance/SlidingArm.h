#pragma once

#include "Paths.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** A sliding joint on a turning one on a sliding one, with an offset in every direction. */
inline RobotDescription makeSlidingArm() {
    RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/ur5e");
    robot.joints[1].type = JointType::Prismatic;
    robot.joints[3].type = JointType::Prismatic;
    return robot;
}

/** Two of the project's arms, and that one. */
inline std::vector<RobotDescription> loadArms() {
    return {loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"), loadRobot(VIABLE_SOURCE_DIR "/robots/panda"),
            makeSlidingArm()};
}

}  // namespace viable
