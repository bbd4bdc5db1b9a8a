#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "viable/core/Numbers.h"

namespace viable {

/** Maximum number of joints of a robot. The vectors below have this capacity inside the object, so that
changing their size never uses the heap. */
inline constexpr int kMaxJoints = 16;

/** One number per joint: run-time size (the number of joints), fixed in-object capacity. */
using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxJoints, 1>;

/** One number per pair of joints, joints x joints, fixed in-object capacity. */
using JointMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxJoints, kMaxJoints>;

/** 6 x joints: rows 0..2 linear velocity [m/s], rows 3..5 angular velocity [rad/s], base frame. */
using ToolJacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMaxJoints>;

/** Linear part (0..2) and angular part (3..5), base frame. */
using Vector6 = Eigen::Matrix<double, 6, 1>;

/** Position [m] and orientation of a frame, seen from the robot's base frame. */
struct Pose {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/** Joint positions [rad] (prismatic: [m]) and velocities [rad/s]. */
struct JointState {
    JointVector q;
    JointVector qd;
};

/** Joint positions [rad], velocities [rad/s] and accelerations [rad/s^2]: the state of the nominal
plant, which is a triple integrator per joint. */
struct MotionState {
    JointVector q;
    JointVector qd;
    JointVector qdd;
};

/** True when `v` has n entries and all of them are finite. */
inline bool isFinite(const JointVector& v, int n) {
    return v.size() == n && v.allFinite();
}
inline bool isFinite(const JointState& s, int n) {
    return isFinite(s.q, n) && isFinite(s.qd, n);
}
inline bool isFinite(const MotionState& s, int n) {
    return isFinite(s.q, n) && isFinite(s.qd, n) && isFinite(s.qdd, n);
}

/** Position [rad], velocity [rad/s] and acceleration [rad/s^2] of one joint. */
struct AxisState {
    double p = 0.0;
    double v = 0.0;
    double a = 0.0;
};

/** The state after jerk `j` [rad/s^3] is held for `t` [s]; exact (paper, eq. 17). */
inline AxisState advance(const AxisState& s, double j, double t) {
    return {s.p + t * (s.v + t * (s.a / 2.0 + t * j / 6.0)), s.v + t * (s.a + t * j / 2.0), s.a + t * j};
}

/** A quantity of every joint: one number for all of them, or one each. */
class PerJoint {
public:
    PerJoint(double all = 0.0) : values_(JointVector::Constant(1, all)) {}
    PerJoint(const JointVector& each) : values_(each) {}

    /** True for one number, or for n of them. */
    bool fits(int n) const { return values_.size() == 1 || values_.size() == n; }
    /** The value for one joint; requires fits(number of joints). */
    double operator[](int joint) const { return values_[values_.size() == 1 ? 0 : joint]; }
    /** One entry for each of n joints; requires fits(n). */
    JointVector expand(int n) const { return values_.size() == 1 ? JointVector::Constant(n, values_[0]) : values_; }
    int count() const { return static_cast<int>(values_.size()); }

private:
    JointVector values_;
};

}  // namespace viable
