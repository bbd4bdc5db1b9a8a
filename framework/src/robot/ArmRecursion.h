#pragma once

#include <array>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** Rigid-body motion, torque and dynamics of an arm in fixed-size recursive passes: what RobotModel computes with, and
what asks for hundreds of poses in a tick. Rotor inertia on the diagonal of M, no friction.

Method: recursive Newton-Euler (Luh, Walker and Paul, J. Dyn. Sys. Meas. Control 102, 1980) in the links' own frames,
composite rigid bodies for M (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6). A link enters by its mass and
the first and second moments of it; what a link has on the axis of its own revolute joint is booked on the link before,
which moves it just as well (base parameters: Gautier and Khalil, IEEE Trans. Robotics and Automation 6, 1990).
Real time: no allocation, lock or throw; an input that is NaN gives results that are none.
Thread: immutable after construction; any number of threads. */
class ArmRecursion {
public:
    /** Takes joints, tool, gravity and rotor inertias; 1 to kMaxJoints joints. */
    explicit ArmRecursion(const RobotDescription& robot);

    int size() const { return n_; }

    /** The joints' moving frames in the base frame; entries from size() on are left alone. */
    struct Frames {
        std::array<Eigen::Matrix3d, kMaxJoints> rotation;
        std::array<Eigen::Vector3d, kMaxJoints> origin;  ///< [m]
        std::array<Eigen::Vector3d, kMaxJoints> axis;    ///< base frame, unit vectors
    };
    /** @param q  of size(), [rad], prismatic [m] */
    void calcFrames(const JointVector& q, Frames& frames) const;

    /** tau = M(q) qdd + b(q, qd) [Nm]; all of size(). */
    void calcTorque(const JointVector& q, const JointVector& qd, const JointVector& qdd, JointVector& tau) const;

    /** M(q) [kg m^2], size() x size(). */
    void calcInertia(const JointVector& q, JointMatrix& M) const;

    /** All of Dynamics at (q, qd), both finite and of size(), in one pass outwards and one inwards. The tool hangs on a
    joint. */
    void calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out) const;

    bool isPrismatic(int joint) const { return joints_[joint].isPrismatic; }
    /** The joint before `joint`; -1: it stands on the base. */
    int parent(int joint) const { return joints_[joint].parent; }
    /** True when moving `joint` moves what `carrier` (-1: the base) carries. */
    bool moves(int joint, int carrier) const { return carrier >= 0 && (movers_[carrier] >> joint & 1u) != 0; }

private:
    /** A joint and its link, for torques: in frames that have the joint's axis along z. */
    struct Joint {
        Eigen::Matrix3d rotation;  ///< its frame at q = 0, seen from that of the joint before
        Eigen::Vector3d origin;    ///< [m]
        Eigen::Vector3d moment;    ///< sum of m r [kg m]
        Eigen::Matrix3d second;    ///< sum of m r r^T [kg m^2]
        double mass;               ///< [kg]
        double rotorInertia;       ///< [kg m^2]
        int parent;
        bool isPrismatic;
    };
    /** The same joint in the frames of the description: rotation = fixed + cos q cosine + sin q sine. */
    struct FramePlacement {
        Eigen::Matrix3d fixed, cosine, sine;
        Eigen::Vector3d origin;  ///< at q = 0, in the frame of the joint before [m]
        Eigen::Vector3d axis;    ///< in that frame
    };

    struct Pass;  // what is known of each joint in one state

    int n_ = 0;
    std::array<Joint, kMaxJoints> joints_;
    std::array<FramePlacement, kMaxJoints> placements_;
    std::array<std::uint32_t, kMaxJoints> movers_{};  ///< bit i: joint i moves this one's link
    Eigen::Vector3d gravity_;                         ///< base frame [m/s^2]
    int toolParent_ = -1;
    Eigen::Matrix3d toolRotation_;  ///< seen from the joint that carries it, whose axis is along z
    Eigen::Vector3d toolOrigin_;    ///< [m]
};

}  // namespace viable
