#pragma once

#include <cmath>
#include <vector>

#include "viable/core/JointTypes.h"

namespace viable::detail {

/** The larger and the smaller of two numbers, NaN where one of them is: for extremes that must not lose it. */
inline double largerOrNan(double a, double b) {
    return a < b || std::isnan(b) ? b : a;
}
inline double smallerOrNan(double a, double b) {
    return a > b || std::isnan(b) ? b : a;
}

/** A tensor per joint k: row i, column j. */
using Tensor = std::vector<Eigen::MatrixXd>;

/** What the equations of motion of an arm change by around a pose: T(v) = sum over k of T_k v_k. */
struct PoseTensors {
    Tensor gradient;            ///< k: dM/dq_k [kg m^2/rad]
    Tensor coriolis;            ///< k: dC/dv_k with C(q, v) of the Christoffel symbols, b - gravity = C(q, qd) qd
    Eigen::MatrixXd stiffness;  ///< largest |d(M qdd + b)_i / dq_j| [Nm/rad]
};

/** Of a real arm at a pose: `given` and, either way, up to `error` of each entry. */
struct PoseSample {
    PoseTensors given, error;
};

/** The largest torque of each joint over a sample of poses and all velocities and errors up to given sizes. Each pose by
itself, and each velocity with one sign in all columns of a row: |sum_jk T_ijk v_k x_j| is convex in v, so it is largest at a
corner. Sizes are >= 0. */
class PoseTorques {
public:
    void add(const PoseSample& sample);

    /** stiffness e + ((C' - C)(fastest) + C(de)) de. */
    JointVector calcErrorTorque(const JointVector& fastest, const JointVector& e, const JointVector& de) const;
    /** |dM/dt de| at velocities up to `fastest`. */
    JointVector calcInertiaRate(const JointVector& fastest, const JointVector& de) const;
    /** stiffness v + 2 C(v) a: the rate of the torque, but for M times the jerk. */
    JointVector calcTorqueRate(const JointVector& v, const JointVector& a) const;

private:
    struct Sample {
        Tensor gradient, coriolis, gyroscopic;
        Eigen::MatrixXd stiffness;
        // sizes of what is to be added, zero in most arms
        Tensor gradientError, coriolisError, gyroscopicError;
    };
    std::vector<Sample> samples_;
};

}  // namespace viable::detail
