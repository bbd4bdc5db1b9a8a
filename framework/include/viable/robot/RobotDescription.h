#pragma once

#include "viable/core/JointLimits.h"
#include "viable/robot/SpeedLimits.h"

namespace viable {

enum class JointType { Revolute, Continuous, Prismatic };

/** Mass [kg], centre of mass [m] and inertia tensor [kg m^2] about the centre of mass, all in one frame's axes.
Standard sign: Ixy = -integral of x y dm. */
struct BodyInertia {
    double mass = 0.0;
    Eigen::Vector3d com = Eigen::Vector3d::Zero();
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
};

/** A moving joint and the rigid body behind it (its child link and all links fixed to that). */
struct JointDescription {
    std::string name;
    std::string childLink;
    JointType type = JointType::Revolute;
    int parent = -1;              ///< index of the joint before it, -1 for the base
    Eigen::Isometry3d placement;  ///< joint frame at q = 0, seen from the parent's moving frame
    Eigen::Vector3d axis;         ///< unit vector, joint frame
    BodyInertia body;             ///< in the joint's moving frame
};

/** tau_f(qd) = sign(qd) (coulomb + viscous (1 - exp(-|qd| / viscousVelocity))), output side. */
struct JointFriction {
    JointVector coulomb;          ///< [Nm], >= 0
    JointVector viscous;          ///< [Nm], >= 0: what the viscous part saturates to
    JointVector viscousVelocity;  ///< [rad/s], > 0

    double calcViscous(int joint, double speed) const;  ///< the viscous part at a speed >= 0 [Nm]
};

/** Motors and gears of the joints. Every figure is on the output side of the gear unless it says otherwise. */
struct Actuation {
    JointVector gearRatio;      ///< motor turns per joint turn
    JointVector rotorInertia;   ///< [kg m^2], reflected: motor side times gear ratio squared
    JointVector torqueLimit;    ///< [Nm], > 0, infinity where unknown
    JointVector encoderCounts;  ///< counts per joint turn, prismatic: per metre (0: no figure)
    JointFriction friction;
};

/** A robot as its folder describes it: kinematics and masses from <name>.urdf, limits and home pose
from limits.yaml, motors and friction from actuation.yaml. Plain data. */
struct RobotDescription {
    std::string name;
    std::filesystem::path folder;
    std::vector<JointDescription> joints;  ///< parents before children, in URDF order
    int toolParent = -1;                   ///< joint that carries the tool frame
    std::string toolLink;
    Eigen::Isometry3d toolPlacement;           ///< tool frame in that joint's moving frame
    Eigen::Vector3d gravity{0.0, 0.0, -9.81};  ///< [m/s^2], base frame
    JointLimits limits;
    bool allowLargeAngles = false;
    JointVector home;  ///< [rad]
    SpeedLimits speedLimits;
    Actuation actuation;
    /** Figures that nobody gave: "mass (link1)" of the URDF, keys of limits.yaml and actuation.yaml. */
    std::vector<std::string> assumed;

    int size() const { return static_cast<int>(joints.size()); }
    /** The motion of the joint per encoder count [rad, prismatic: m]; 0: no figure. */
    double encoderStep(int joint) const;
    std::vector<std::string> jointNames() const;
    /** Mass of all that a joint moves, the tool and a payload included [kg]. */
    double movingMass() const;
    /** False for `dynamics: none`, a robot that takes positions: see withoutDynamics(). */
    bool hasDynamics() const { return movingMass() > 0.0; }
    /** The joint is prismatic: m and N in place of rad and Nm. */
    bool slides(int joint) const { return joints[static_cast<std::size_t>(joint)].type == JointType::Prismatic; }
};

/** Reads a robot folder; throws Error (BadInput) with file and place. Faults at different keys of its YAML files are
reported together. */
RobotDescription loadRobot(const std::filesystem::path& folder);

/** The friction of an actuation.yaml, for example of `viable identify`, for joints of these names; throws likewise. */
JointFriction readFriction(const std::filesystem::path& actuationFile, const std::vector<std::string>& joints);

/** The folder of a robot called `name` (or a path to one), searched in `searchPath` in order. The error lists
the known robots, the closest name and every folder searched.
@param where  the place that names it, for the message */
std::filesystem::path findRobot(const std::string& name, const std::vector<std::filesystem::path>& searchPath,
                                const std::string& where);

/** All robots in the search path; of two with one name the first. */
std::vector<std::filesystem::path> listRobots(const std::vector<std::filesystem::path>& searchPath);

/** A robot without masses, motors and gravity. Each joint has an inertia of 1, so that torques are accelerations. Plugins
that need real ones refuse it. */
RobotDescription withoutDynamics(RobotDescription robot);

/** Throws Error (BadInput) for a robot without masses. @param what  needs them */
void requireDynamics(const RobotDescription& robot, const std::string& place, const std::string& what);

/** The description with a point mass fixed to the tool frame. @param offset  in the tool frame [m] */
RobotDescription withPayload(RobotDescription robot, double mass_kg, const Eigen::Vector3d& offset);

/** The description with every body's mass and inertia multiplied by `factor` > 0 (one per joint). */
RobotDescription withScaledMasses(RobotDescription robot, const JointVector& factor);

}  // namespace viable
