#pragma once

#include "viable/braking/ExponentialBarrier.h"
#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

struct SoftCbfOptions {
    double kAlpha = 5.0;
    JerkIntervalOptions following;
    double weight = 1000.0;

    template <class V>
    void describe(V& v) {
        v(kAlpha, "k_alpha", "1/s", "Every pole of every barrier lies at -k_alpha; k_alpha * tick_s must not exceed 1.")
            .above(0);
        following.describe(v);
        v(weight, "weight", "", "w: how many times more missing a row costs than missing the desired jerk as far.")
            .above(0)
            .upTo(1e6);
    }
};

/** The exponential control barrier functions of exponential_cbf with a slack variable on every row, so that
there is always an answer.

Method: with t the desired jerk (14), cut off at the jerk limits, r over the rows of ExponentialBarrierRows
and m_i the length of column i of M (so that missing a row costs w times what moving the joint alone as far does),
    minimise |M (j - t)|^2 + w sum_r (m_i s_r)^2   subject to   row_r(j_i) <= bound_r + s_r,  s_r >= 0,
                                                                    -J <= j <= J
Without the slacks, each of which is max(0, violation), this is strictly convex and piecewise quadratic in j alone.
It is solved by the Newton method of Pang and Qi (1995): the rows that are violated at the present j give a
quadratic |R (j - t')|^2 with R'R = M'M + w diag(m_i^2 times violated rows of joint i); BoxQp minimises it in the
box; a line search leads there; done when the violated rows are the same. One joint, one row: t' = (t + w bound) / (1 + w).
Assumes: continuous time, as exponential_cbf. The slack hides what that law shows: where the rows and the jerk
limits have no common solution the tick is Infeasible here too, though a jerk comes out.
Guarantees: jerk limits at every tick; nothing else. No row is kept exactly.
Real time: no allocation, lock or throw after configure(); at most kMaxRounds BoxQp solves, usually one to three. */
class SoftCbf : public JerkIntervalFilter {
public:
    /** A Newton step that needs more rounds leaves the last, which is in the box and no worse than t. */
    static constexpr int kMaxRounds = 30;

    SoftCbf() : JerkIntervalFilter("soft_cbf") {}
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;

    int rounds() const { return rounds_; }  ///< of the last tick

private:
    /** The rows that a jerk of one joint violates. */
    struct Violated {
        unsigned mask = 0;    // a bit per row: lower, then upper
        int count = 0;        // of rows
        double bounds = 0.0;  // their sum [rad/s^3]
    };

    Rows calcRows(const AxisState& state, const AxisLimits& limits) const override;
    FilterStatus chooseJerk(const MotionState& nominal, const Dynamics& dynamics, const JointVector& desired,
                            JointVector& jerk, std::array<JointIntervention, kMaxJoints>& joints) override;
    Violated findViolated(int joint, double jerk) const;
    bool minimisePiece(const JointMatrix& M, const JointVector& at);
    bool isSamePiece(const JointVector& a, const JointVector& b) const;
    void searchLine(const JointMatrix& M, JointVector& jerk);
    void minimise(const JointMatrix& M, JointVector& jerk);
    JointIntervention findIntervention(int joint, double desired, double jerk) const;

    SoftCbfOptions options_;
    std::array<ExponentialBarrierRows, kMaxJoints> rows_{};
    BoxQp qp_;
    int rounds_ = 0;
    JointVector target_, size_, minimum_, step_, moved_, pieceTarget_;
    JointMatrix normal_, root_;
};

}  // namespace viable
