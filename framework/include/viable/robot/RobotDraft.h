#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "viable/robot/RobotDescription.h"

namespace viable {

/** What a URDF says about one moving joint. NaN: it says nothing, or nothing that can be meant; a
warning tells which. Prismatic joints: [m], [m/s], [N] in place of [rad], [rad/s], [Nm]. */
struct DraftJoint {
    std::string name;
    JointType type = JointType::Revolute;
    double positionLower = 0.0;  ///< -infinity for a continuous joint [rad]
    double positionUpper = 0.0;  ///< [rad]
    double velocity = 0.0;       ///< limit, either way [rad/s]
    double effort = 0.0;         ///< limit, either way [Nm]
    double home = 0.0;  ///< zero, or the middle of the range where zero is not well inside it [rad]
};

/** The beginning of a robot folder: what can be taken from a URDF, and what is doubtful in it. */
struct RobotDraft {
    std::vector<DraftJoint> joints;      ///< parents before children, in URDF order
    std::vector<std::string> toolLinks;  ///< moving links that carry no joint: one is the tool
    std::vector<std::string> meshes;     ///< files for pictures, as the URDF names them
    /** Each one paragraph: place, link or joint, what is doubtful, what to do. */
    std::vector<std::string> warnings;
};

/** Reads a URDF as loadRobot() does, refusing the same (BadInput), and looks for what can be simulated but can hardly be
meant: limits of zero or in degrees, inertias out of proportion to mass and size, masses far away, parts without mass. */
RobotDraft readRobotDraft(const std::filesystem::path& urdf);

}  // namespace viable
