#pragma once

#include <array>

#include "viable/core/JointTypes.h"

namespace viable {

/** Finds the jerk (or acceleration) in a box that is nearest to a desired one, measured in torque:

    minimise |M (x - target)|^2   subject to   lower <= x <= upper                 (paper, eq. 13)

Method: dual active set (Goldfarb and Idnani 1983, for bounds only), started from the joints that
stood on a bound in the last call; each round solves one Cholesky system of the free joints, scaled
to unit diagonal, with one step of iterative refinement.
Assumes: M invertible, lower <= upper, all
finite or infinite bounds, target finite.
Guarantees: the result lies in the box exactly; where the
target does, the result is the target bit for bit.
Real time: no allocation, lock or throw; at most
kMaxRounds Cholesky solves.
*/
class BoxQp {
public:
    static constexpr int kMaxRounds = 250;

    enum class Status : unsigned char {
        TargetInside,  ///< the target is admissible: nothing was solved
        Solved,        ///< optimal; KKT residual below kKktTolerance, scaled
        RoundLimit,  ///< in the box, not optimal: M singular or too ill-conditioned (from about 1e8
                     ///< on)
    };

    /** Optimality is accepted when no scaled gradient or bound is violated by more than this times
    the largest entry of the scaled problem. */
    static constexpr double kKktTolerance = 1e-11;

    /** Solves; `x` gets the size of `target`. */
    Status solve(const JointMatrix& M, const JointVector& target, const JointVector& lower,
                 const JointVector& upper, JointVector& x);

    /** Forgets the free set of the last call. */
    void reset() { side_.fill(0); }

    int rounds() const { return rounds_; }  ///< Cholesky solves of the last call

private:
    std::array<signed char, kMaxJoints> side_{};  // -1 at lower, 0 free, +1 at upper
    int rounds_ = 0;
};

}  // namespace viable
