#pragma once

#include <array>

#include "viable/core/JointTypes.h"

namespace viable {

/** Finds the jerk in a box and on the allowed side of some planes that is nearest to a desired one, measured
in torque:

    minimise |M (x - target)|^2   subject to   lower <= x <= upper,   row_k . x >= bound_k

Method: dual active set (Goldfarb and Idnani 1983) from the unconstrained minimum, x = target; or, in a solver that solved
before, from the minimum on the planes that held then, less those that pull now, which is little work where rows keep their
places from tick to tick. One that does not come to the optimum from there begins anew from x = target, and is then to the bit
what a solver that never solved before gives. The optimum is unique, so where both ways come to it they differ by rounding only;
but among planes nearly parallel the way from the target may need to leave some out, up to kRowTolerance, or come to nothing,
where the way from the last planes does not. Orthogonal updates of the factors, so that adding and dropping a constraint costs
O(n^2). M itself is factored, and the result is corrected with residuals of M and the rows. Rows are scaled, so their size has
no effect. Where nearly parallel rows make it fail, it is tried once more without the rows that kRowTolerance allows to leave
out.
Assumes: M invertible with a condition number below about 1e7; everything finite but the box's
bounds, which may be infinite. Where lower > upper, by rounding, the upper one counts for both. A
row of zeros always holds where its bound is <= 0 and never where it is > 0. Rows that
contradict each other by less than kRowTolerance count as satisfied.
Guarantees: the result lies in the box exactly for any input, and is finite unless a bound
forces it to be infinite. Of 1e5 problems that have a solution, a quarter of them degenerate (duplicates,
slabs without thickness, many rows through one point, angles down to 1e-4), none failed; with angles
down to rounding and M of condition up to 1e7, 0.5 % end as Failed or are wrongly
called Infeasible.
Real time: no allocation, lock or throw; at most kMaxIterations steps (maximum seen where rows are not
parallel to rounding: 152, with n = 16 and 48 rows, and 2 n of a search from the last planes in vain). */
class RowQp {
public:
    static constexpr int kMaxRows = 48;
    static constexpr int kMaxColdIterations = 10 * (kMaxRows + 2 * kMaxJoints);  ///< from the target
    static constexpr int kMaxWarmIterations = 2 * kMaxJoints;                    ///< from the last planes
    static constexpr int kMaxIterations = kMaxColdIterations + kMaxWarmIterations;

    /** Planes: `normal(k)` has n entries. */
    struct Rows {
        int count = 0;
        std::array<JointVector, kMaxRows> normal;
        std::array<double, kMaxRows> bound{};

        void clear() { count = 0; }
        /** False when kMaxRows is reached. */
        bool add(const JointVector& row, double least);
    };

    enum class Status : unsigned char {
        TargetInside,  ///< the target is admissible: nothing was solved
        Solved,        ///< optimal; rows hold to kRowTolerance sum_i |row_i| (|x_i| + |target_i|)
        Infeasible,    ///< no x satisfies box and rows; x: the last iterate, clamped to the box
        Failed         ///< an input is not finite or of another size, M singular, or kMaxIterations
                       ///< reached; x: the target (0 where it is not finite), clamped to the box
    };
    static constexpr double kRowTolerance = 1e-9;

    /** Solves for n = target.size() joints; M is n x n, `lower`, `upper` and every row have n
    entries. `x` gets the size of `target`. */
    Status solve(const JointMatrix& M, const JointVector& target, const JointVector& lower, const JointVector& upper,
                 const Rows& rows, JointVector& x);

    /** Forgets the planes of the last solution. */
    void reset() { heldCount_ = 0; }

    int iterations() const { return iterations_; }  ///< of the last call

    /** A plane that held with equality: the bound of joint `index`, or row `index`. */
    struct Held {
        enum class Kind : unsigned char { Lower, Upper, Row } kind;
        int index;
    };

private:
    int iterations_ = 0;
    std::array<Held, kMaxJoints> held_{};
    int heldCount_ = 0;
};

}  // namespace viable
