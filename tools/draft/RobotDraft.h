#pragma once

#include "draft/UrdfRepair.h"

namespace viable {

/** What a URDF says about one moving joint, and what is assumed where it says nothing. NaN: not known; a warning tells
what was said and could not be meant. Prismatic joints: [m], [m/s], [N] in place of [rad], [rad/s], [Nm]. */
struct DraftJoint {
    std::string name;
    JointType type = JointType::Revolute;
    double positionLower = 0.0;  ///< -infinity for a continuous joint [rad]
    double positionUpper = 0.0;  ///< [rad]
    double velocity = 0.0;       ///< limit, either way [rad/s]
    double effort = 0.0;         ///< limit, either way [Nm]
    double home = 0.0;           ///< zero, or the middle of the range where zero is not well inside it [rad]
    double acceleration = kNan;  ///< limit, either way; assumed [rad/s^2]
    double jerk = kNan;          ///< limit, either way; assumed [rad/s^3]
    double rotorInertia = kNan;  ///< as seen at the joint; assumed, or of a MuJoCo model [kg m^2]
    double coulomb = kNan;       ///< friction; likewise [Nm]
    double damping = kNan;       ///< linear friction, of a MuJoCo model [Nm s/rad]
};

/** A capsule that contains one shape of a link, in the link's frame [m]. */
struct DraftCapsule {
    Eigen::Vector3d from = Eigen::Vector3d::Zero(), to = Eigen::Vector3d::Zero();
    double radius = 0.0;
};

/** What of a link can hit something. */
struct DraftLink {
    std::string name;
    std::vector<DraftCapsule> capsules;   ///< one per collision element, or where there are none, visual one
    std::vector<std::string> lostMeshes;  ///< mesh files of it that could not be read: no capsules for these
    BodyInertia solid;                    ///< of its shapes, as if of 1 kg/m^3; no mass where there are none
};

/** Two links whose capsules touch without anything being wrong. */
struct DraftContact {
    std::string first, second;
    std::string reason;
    bool isDoubtful = false;  ///< touch at the home pose: perhaps the capsules are too wide, perhaps the pose is bad
};

/** How to make a draft of a URDF. */
struct DraftOptions {
    detail::UrdfChoice choice;
    bool assumes = false;   ///< figures that a URDF does not hold are assumed, so that the robot can be run at once
    bool hasBodies = true;  ///< false: no masses, for a robot that takes positions
    std::filesystem::path mjcfConverter = {};  ///< mjcf_to_urdf.py where the file is a MuJoCo model
};

/** A figure that nobody gave. */
struct DraftAssumption {
    std::string figure;  ///< such as "acceleration limits"
    std::string rule;    ///< how it was found
};

/** What the arm can be tried with. */
struct DraftTask {
    static constexpr double kHandShare = 0.1;  ///< of the reach: how far a hand moves along each axis
    double reach = 0.0;                        ///< farthest that the tool gets from the first joint that moves it [m]
    int toolJoints = 0;                        ///< joints that move the tool
    int directions = 1;    ///< in which they can move it, turns among them where there are six joints
    double fastest = 0.5;  ///< time of a hand's fastest reach, so that the joints' limits allow it [s]
    double safety = 0.02;  ///< a safety distance that the arm's own links leave room for [m]
    double radius = 0.0;   ///< of a ball in the way of the tool, clear of the arm at its home pose; 0: no capsules [m]
    Eigen::Vector3d ball = Eigen::Vector3d::Zero();  ///< its centre, base frame [m]
    /** How far a hand that is to meet it moves along each base axis [m]. */
    Eigen::Vector3d pastBall = Eigen::Vector3d::Zero();
};

/** The beginning of a robot folder: what can be taken from a URDF, and what is doubtful in it. */
struct RobotDraft {
    std::string urdf;                    ///< text for the folder: the file's bytes, or the repaired document
    std::vector<std::string> repairs;    ///< what was changed in it, one sentence each
    std::vector<DraftJoint> joints;      ///< parents before children, in URDF order
    bool isModel = false;                ///< of MuJoCo: rotors and friction are known
    bool hasBodies = true;               ///< as asked for
    bool hasHome = false;                ///< the joints' home is the file's own
    std::vector<std::string> toolLinks;  ///< moving links that carry no joint: one is the tool
    std::string tool;                    ///< the chosen, only or assumed one; empty: not known
    std::vector<std::string> meshes;     ///< files for pictures, as the URDF names them
    std::vector<DraftLink> links;        ///< all, in URDF order
    /** Links that a joint joins, links that are nearer than 2 cm in nearly all of many poses within the limits, and links
    that are nearer than 2 cm at the home pose. */
    std::vector<DraftContact> contacts;
    std::vector<DraftAssumption> assumptions;  ///< empty unless assumed
    DraftTask task;                            ///< zeros unless assumed
    /** Each one paragraph: place, link or joint, what is doubtful, what to do. */
    std::vector<std::string> warnings;
};

/** Reads and repairs a URDF, refusing what cannot be repaired (BadInput, all of it at once), and looks for what can be
simulated but can hardly be meant: limits of zero or in degrees, inertias out of proportion to mass and size, masses far
away, parts without mass. */
RobotDraft readRobotDraft(const std::filesystem::path& urdf, const DraftOptions& options = {});

}  // namespace viable
