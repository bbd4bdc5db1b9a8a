#pragma once

#include <array>

#include "viable/core/JointTypes.h"

namespace viable {

/** Finds the jerk (or acceleration) in a box that is nearest to a desired one, measured in torque:

    minimise |M (x - target)|^2   subject to   lower <= x <= upper                 (paper, eq. 13)

Method: block principal pivoting (Judice and Pires 1994), started from the joints that stood on a bound in the last
call. A round solves for the free joints. Then it exchanges every joint that is outside its bounds or whose gradient
points away from its bound. When their number stops falling, a dual active set method (Goldfarb and Idnani 1983, for
bounds only) continues from there, one joint after the other. A round factors the normal equations of the free joints
and corrects the solution with residuals of M itself (corrected seminormal equations, Bjorck 1987).
Assumes: M invertible with a condition number below about 1e7 (M'M: 1e14), target finite, bounds finite or infinite. If
lower > upper, by rounding, the upper one counts for both.
Guarantees: the result lies in the box exactly; where the target does, the result is the target bit for bit. A target
that is not finite counts as 0, so the result is never NaN. It is finite unless a bound forces it to be infinite.
Real time: no allocation, lock or throw; at most kMaxRoundsPerJoint n rounds, each a little more than one Cholesky
solve. */
class BoxQp {
public:
    /** Random and adversarial problems with n = 1..16 took at most half of it. An arm whose active set is that of
    the previous tick takes one round. */
    static constexpr int kMaxRoundsPerJoint = 12;

    enum class Status : unsigned char {
        TargetInside,  ///< the target is admissible: nothing was solved
        Solved,        ///< optimal; KKT residual below 1e-9, scaled (see kBoundTolerance)
        Clamped        ///< the target, clamped to the bounds: an input is not finite, M singular or
                       ///< too ill-conditioned, or kMaxRoundsPerJoint n reached
    };

    /** Let s_i = |column i of M| and D^2 = sum (s_i (x_i - target_i))^2. A free joint may be outside by
    kBoundTolerance D / s_i (and is then put on the bound). The gradient of a joint on a bound may point inwards by
    kGradientTolerance D s_i. This is the rounding error of a gradient. A joint that is held by mistake is wrong by
    it times the condition number of M'M. */
    static constexpr double kBoundTolerance = 1e-11;
    static constexpr double kGradientTolerance = 1e-14;

    /** Solves for n = target.size() <= kMaxJoints joints; M is n x n, `lower` and `upper` have n
    entries. `x` gets the size of `target`. */
    Status solve(const JointMatrix& M, const JointVector& target, const JointVector& lower, const JointVector& upper,
                 JointVector& x);

    /** Clears the set of free joints of the last call. */
    void reset() { side_.fill(0); }

    int rounds() const { return rounds_; }  ///< number in the last call

private:
    std::array<signed char, kMaxJoints> side_{};  // -1 at lower, 0 free, +1 at upper
    int rounds_ = 0;
};

}  // namespace viable
