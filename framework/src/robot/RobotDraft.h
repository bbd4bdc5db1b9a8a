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
    double home = 0.0;           ///< zero, or the middle of the range where zero is not well inside it [rad]
};

/** A capsule that contains one shape of a link, in the link's frame [m]. */
struct DraftCapsule {
    Eigen::Vector3d from = Eigen::Vector3d::Zero();
    Eigen::Vector3d to = Eigen::Vector3d::Zero();
    double radius = 0.0;
};

/** What of a link can hit something. */
struct DraftLink {
    std::string name;
    std::vector<DraftCapsule> capsules;   ///< one per collision element, or where there are none, visual one
    std::vector<std::string> lostMeshes;  ///< mesh files of it that could not be read: no capsules for these
};

/** Two links whose capsules touch without anything being wrong. */
struct DraftContact {
    std::string first, second;
    std::string reason;
};

/** The beginning of a robot folder: what can be taken from a URDF, and what is doubtful in it. */
struct RobotDraft {
    std::vector<DraftJoint> joints;      ///< parents before children, in URDF order
    std::vector<std::string> toolLinks;  ///< moving links that carry no joint: one is the tool
    std::vector<std::string> meshes;     ///< files for pictures, as the URDF names them
    std::vector<DraftLink> links;        ///< all, in URDF order
    /** Links that a joint joins, and links that are nearer than 2 cm in nearly all of many poses within the limits. */
    std::vector<DraftContact> contacts;
    /** Each one paragraph: place, link or joint, what is doubtful, what to do. */
    std::vector<std::string> warnings;
};

/** Reads a URDF as loadRobot() does, refusing the same (BadInput), and looks for what can be simulated but can hardly be
meant: limits of zero or in degrees, inertias out of proportion to mass and size, masses far away, parts without mass. */
RobotDraft readRobotDraft(const std::filesystem::path& urdf);

}  // namespace viable
