#include "qp/RowQp.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "qp/QpBounds.h"
#include "viable/core/Numbers.h"

namespace viable {

namespace {

constexpr double kRounding = std::numeric_limits<double>::epsilon();

/** By how much a plane may be missed before it is enforced, relative to sum_i |normal_i| |x_i|:
what the rounding of x and of the sum makes of an exact solution, with a margin. */
constexpr double kTightTolerance = 1e-13;
/** Steps per joint after which the tolerance grows, by kToleranceGrowth a step and up to
RowQp::kRowTolerance: rounding could exchange the same planes for ever, a larger tolerance ends it.
*/
constexpr int kPatiencePerJoint = 6;
constexpr double kToleranceGrowth = 2.0;
/** The target's share in the rounding of x, which is found as the target plus steps. */
constexpr double kTargetRounding = 8 * kRounding;

/** A normal whose part independent of the enforced ones is smaller than this, relative, is a
combination of them: rounding is about 1e-16 times the number of joints. */
constexpr double kDependence = 1e-13;
/** A share of an enforced plane in that combination that is smaller than this counts as none. */
constexpr double kLeastShare = 1e-12;
/** A column of M whose part independent of the others is smaller than this, relative: M singular.
*/
constexpr double kSingular = 1e-13;

/** A correction below this, relative to the solution, is the last one; the tolerance grows from one
to the next, as rounding of the residuals keeps them up where M or the planes are near singular. */
constexpr int kMaxCorrections = 8;
constexpr double kCorrectionTolerance = 1e-10;
constexpr double kCorrectionToleranceGrowth = 8.0;
/** A pressure below minus this, relative to the whole gradient, is one of a plane that pulls. */
constexpr double kPullTolerance = 1e-12;

/** What RowQp::solve is asked for. */
struct Task {
    const JointMatrix& M;
    const JointVector& target;
    const JointVector& lower;
    const JointVector& upper;
    const RowQp::Rows& rows;

    int size() const { return static_cast<int>(target.size()); }

    /** Whether M and the rows are of the target's size. */
    bool hasSizes() const {
        const int n = size();
        bool fits = M.rows() == n && M.cols() == n && rows.count >= 0 && rows.count <= RowQp::kMaxRows;
        for (int k = 0; fits && k < rows.count; ++k) fits = rows.normal[k].size() == n;
        return fits;
    }

    /** All finite; bounds may be infinite where a finite x lies between them. */
    bool isFinite() const {
        bool finite = M.allFinite() && target.allFinite();
        for (int i = 0; i < size(); ++i)
            finite &= lower[i] < kInfinity && upper[i] > -kInfinity && !std::isnan(upper[i]);
        for (int k = 0; k < rows.count; ++k) finite &= rows.normal[k].allFinite() && std::isfinite(rows.bound[k]);
        return finite;
    }

    bool isTargetInside() const {
        for (int i = 0; i < size(); ++i)
            if (!(target[i] >= std::min(lower[i], upper[i]) && target[i] <= upper[i])) return false;
        for (int k = 0; k < rows.count; ++k) {
            double value = 0.0;
            for (int i = 0; i < size(); ++i) value += rows.normal[k][i] * target[i];
            if (!(value >= rows.bound[k])) return false;
        }
        return true;
    }
};

/** Stuck: a plane cannot be reached, but that nothing can keep all is not proven. */
enum class Outcome { Optimal, Infeasible, Stuck, Failed };

/** The problem of one call. Plane i < n is the bound of joint i (the one last looked at), plane n +
k row k; all are normal . x >= bound. Enforced planes N hold with equality at x, which is the
minimum on them; with A = M'M

    A (x - target) = N u,  u >= 0 (pressures),   J'AJ = I,   J'N = [R; 0],  R upper triangular

so J = [J1 J2], J2 spans the directions in which x can move on all of them (Goldfarb and Idnani
1983, section 4). kSize is the number of joints where it is known when compiling, so that the loops
unroll, else 0. */
template <int kSize>
class RowProblem {
public:
    RowProblem(const Task& task, double tolerance)
        : joints_(task.size()), rows_(task.rows.count), tolerance_(tolerance) {
        const double* column = task.M.data();
        const double size = task.M.cwiseAbs().maxCoeff();
        const double scale = size > 0.0 ? 1.0 / size : 0.0;  // the optimum is that of any multiple
        for (int i = 0; i < n(); ++i, column += n()) {
            for (int r = 0; r < n(); ++r) M_[i][r] = scale * column[r];
            target_[i] = x_[i] = task.target[i];
            hi_[i] = task.upper[i];
            lo_[i] = std::min(task.lower[i], hi_[i]);
        }
        for (int k = 0; k < rows_; ++k) {
            const double* normal = task.rows.normal[k].data();
            double largest = 0.0;
            for (int i = 0; i < n(); ++i) largest = std::max(largest, std::abs(normal[i]));
            const double factor = 1.0 / largest, bound = factor * task.rows.bound[k];
            Plane& plane = planes_[n() + k];
            plane.isIdle = !std::isfinite(factor) || !std::isfinite(bound);
            if (plane.isIdle) {  // of no finite x, or of all
                isContradictory_ |= task.rows.bound[k] > 0.0;
                continue;
            }
            for (int i = 0; i < n(); ++i) plane.normal[i] = factor * normal[i];
            plane.bound = bound;
        }
    }

    /** Steps are counted in `iterations`, up to `most`. */
    Outcome solve(int& iterations, int most) {
        most_ = most;
        if (!factor()) return Outcome::Failed;
        bool settled = false;  // since the last settle() no plane was enforced or dropped
        while (takeIteration(iterations)) {
            const int plane = findWorst();
            if (plane >= 0) {
                const Step step = enforce(plane, iterations);
                const bool isExact = std::exchange(settled, false);
                if (step == Step::Failed) return Outcome::Failed;
                if (step == Step::Contradiction) return Outcome::Infeasible;
                if (step == Step::Enforced) continue;
                if (isExact) {  // else the way to x has left its rounding in it
                    if (tolerance_ >= RowQp::kRowTolerance ||
                        !(calcMiss(plane) <= calcTolerance(plane, RowQp::kRowTolerance)))
                        return Outcome::Stuck;
                    tolerance_ = RowQp::kRowTolerance;  // missed by rounding: leave it out
                }
            } else if (settled) {
                if (isContradictory_) return Outcome::Infeasible;
                return holdsEnforced() ? Outcome::Optimal : Outcome::Failed;
            }
            if (!settle(iterations)) return Outcome::Failed;
            settled = true;
        }
        return Outcome::Failed;
    }

    /** The present point, cut off at the box: bounds that are enforced hold exactly. */
    double getX(int i) const { return detail::clampTarget(x_[i], lo_[i], hi_[i]); }

private:
    static constexpr int kCapacity = kSize > 0 ? kSize : kMaxJoints;

    struct Plane {
        double normal[kCapacity];
        double bound;
        double length = 0.0;  // |J' normal|, of a unit of pressure; 0: not known yet
        bool isIdle = false;  // enforced, or never to be
    };
    enum class Step { Enforced, Dependent, Contradiction, Failed };

    int n() const { return kSize > 0 ? kSize : joints_; }

    double dot(const double* a, const double* b) const {
        double sum = 0.0;
        for (int i = 0; i < n(); ++i) sum += a[i] * b[i];
        return sum;
    }

    bool takeIteration(int& iterations) {
        if (iterations >= most_) return false;
        if (++iterations > kPatiencePerJoint * n())
            tolerance_ = std::min(kToleranceGrowth * tolerance_, RowQp::kRowTolerance);
        return true;
    }

    /** M = QR by modified Gram-Schmidt (its R is as exact as that of reflections, Bjorck 1967),
    then J = R^-1. False: M is singular to working precision. */
    bool factor() {
        double Q[kCapacity][kCapacity], R[kCapacity][kCapacity];  // columns of Q, rows of R
        for (int j = 0; j < n(); ++j)
            for (int r = 0; r < n(); ++r) Q[j][r] = M_[j][r];
        for (int j = 0; j < n(); ++j) {
            columnLength_[j] = std::sqrt(dot(M_[j], M_[j]));
            const double length = std::sqrt(dot(Q[j], Q[j]));
            if (!(length > kSingular * columnLength_[j])) return false;
            const double inverse = 1.0 / length;
            for (int r = 0; r < n(); ++r) Q[j][r] *= inverse;
            R[j][j] = inverse;
            for (int i = j + 1; i < n(); ++i) {
                R[j][i] = dot(Q[j], Q[i]);
                for (int r = 0; r < n(); ++r) Q[i][r] -= R[j][i] * Q[j][r];
            }
        }
        for (int j = 0; j < n(); ++j) {  // column j of R^-1, from its last entry up
            for (int i = 0; i < n(); ++i) J_[j][i] = 0.0;
            J_[j][j] = R[j][j];
            for (int i = j - 1; i >= 0; --i) {
                double sum = 0.0;
                for (int k = i + 1; k <= j; ++k) sum += R[i][k] * J_[j][k];
                J_[j][i] = -sum * R[i][i];
            }
        }
        return true;
    }

    /** How far x is on the wrong side. */
    double calcMiss(int plane) const { return planes_[plane].bound - dot(planes_[plane].normal, x_); }
    /** What of it is as good as none: `relative` to the terms of the sum, and the target's
    rounding. */
    double calcTolerance(int plane, double relative) const {
        double tolerance = 0.0;
        for (int i = 0; i < n(); ++i)
            tolerance += std::abs(planes_[plane].normal[i]) *
                         (relative * std::abs(x_[i]) + kTargetRounding * std::abs(target_[i]));
        return tolerance;
    }

    /** False: the enforced planes are too near to parallel for x to be computed. */
    bool holdsEnforced() const {
        for (int k = 0; k < enforced_; ++k)
            if (!(calcMiss(set_[k]) <= calcTolerance(set_[k], RowQp::kRowTolerance))) return false;
        return true;
    }

    double findLength(int plane) {
        Plane& p = planes_[plane];
        if (p.length == 0.0) {
            for (int j = 0; j < n(); ++j) p.length += detail::square(dot(J_[j], p.normal));
            p.length = std::sqrt(p.length);
        }
        return p.length;
    }

    /** The plane farthest from x of those missed, measured in torque; -1: none. */
    int findWorst() {
        int worst = -1;
        double farthest = 0.0;
        const auto consider = [&](int plane, double miss) {
            if (!(miss > calcTolerance(plane, tolerance_))) return;
            const double distance = miss / findLength(plane);
            if (distance <= farthest) return;
            farthest = distance;
            worst = plane;
        };
        for (int i = 0; i < n(); ++i) {
            Plane& p = planes_[i];
            if (p.isIdle || (x_[i] >= lo_[i] && x_[i] <= hi_[i])) continue;
            const double side = x_[i] < lo_[i] ? 1.0 : -1.0;
            for (int j = 0; j < n(); ++j) p.normal[j] = 0.0;
            p.normal[i] = side;
            p.bound = side > 0.0 ? lo_[i] : -hi_[i];
            consider(i, p.bound - side * x_[i]);
        }
        for (int k = n(); k < n() + rows_; ++k) {
            if (planes_[k].isIdle) continue;
            const double miss = calcMiss(k);
            if (miss > 0.0) consider(k, miss);
        }
        return worst;
    }

    /** Moves x until `plane` holds, keeping the enforced ones or, where their pressure ends on the
    way, dropping them. Dependent: it cannot be reached, its normal being a combination of enforced
    ones that press against it. Contradiction: moreover, nothing can keep them all. */
    Step enforce(int plane, int& iterations) {
        const double* normal = planes_[plane].normal;
        const double length = findLength(plane);
        double pressure = 0.0;
        do {
            double d[kCapacity], z[kCapacity] = {}, share[kCapacity];
            double slope = 0.0;  // of the miss along z
            for (int j = 0; j < n(); ++j) d[j] = dot(J_[j], normal);
            for (int j = enforced_; j < n(); ++j) {
                slope += detail::square(d[j]);
                for (int i = 0; i < n(); ++i) z[i] += d[j] * J_[j][i];
            }
            solveUpper(d, share);
            double step = kInfinity;
            int blocking = -1;
            for (int k = 0; k < enforced_; ++k)
                if (share[k] * planes_[set_[k]].length > kLeastShare * length && u_[k] < share[k] * step) {
                    step = u_[k] / share[k];
                    blocking = k;
                }
            const bool independent = slope > detail::square(kDependence * length);
            if (independent) {
                const double whole = std::max(0.0, calcMiss(plane)) / slope;
                if (whole <= step) {
                    step = whole;
                    blocking = -1;
                }
            } else if (blocking < 0) {
                return contradicts(plane, share) ? Step::Contradiction : Step::Dependent;
            }
            for (int k = 0; k < enforced_; ++k) u_[k] = std::max(0.0, u_[k] - step * share[k]);
            pressure += step;
            if (independent)
                for (int i = 0; i < n(); ++i) x_[i] += step * z[i];
            if (!std::isfinite(pressure)) return Step::Failed;
            if (blocking < 0) {
                add(plane, pressure, d, z);
                return Step::Enforced;
            }
            drop(blocking);
        } while (takeIteration(iterations));
        return Step::Failed;
    }

    /** Farkas' proof that no point of the box keeps `plane` and the enforced ones: the sum of their
    conditions, each times its -share >= 0, asks more of x than any has. Free of x and u, so their
    rounding does not count. */
    bool contradicts(int plane, const double* share) const {
        double rest[kCapacity];
        double asked = planes_[plane].bound, size = std::abs(asked);
        for (int i = 0; i < n(); ++i) rest[i] = planes_[plane].normal[i];
        for (int k = 0; k < enforced_; ++k) {
            if (share[k] >= 0.0) continue;
            const Plane& p = planes_[set_[k]];
            for (int i = 0; i < n(); ++i) rest[i] -= share[k] * p.normal[i];
            asked -= share[k] * p.bound;
            size += std::abs(share[k] * p.bound);
        }
        for (int i = 0; i < n(); ++i) {
            const double reach = std::max(std::abs(lo_[i]), std::abs(hi_[i]));
            asked -= std::abs(rest[i]) * (std::isfinite(reach) ? reach : std::abs(x_[i]) + std::abs(target_[i]));
        }
        return asked > RowQp::kRowTolerance * size;
    }

    /** Enforces `plane`: a reflection of J2 that makes J2' normal a multiple of the first unit
    vector. `d` = J' normal, `z` = J2 J2' normal. */
    void add(int plane, double pressure, double* d, const double* z) {
        double squares = 0.0;
        for (int j = enforced_; j < n(); ++j) squares += detail::square(d[j]);
        const double first = d[enforced_];
        const double diagonal = first > 0.0 ? -std::sqrt(squares) : std::sqrt(squares);
        const double factor = 1.0 / (squares - diagonal * first);
        double w[kCapacity];
        for (int i = 0; i < n(); ++i) w[i] = factor * (z[i] - diagonal * J_[enforced_][i]);
        d[enforced_] -= diagonal;
        for (int j = enforced_; j < n(); ++j)
            for (int i = 0; i < n(); ++i) J_[j][i] -= d[j] * w[i];
        for (int k = 0; k < enforced_; ++k) R_[enforced_][k] = d[k];
        R_[enforced_][enforced_] = diagonal;
        set_[enforced_] = plane;
        u_[enforced_] = pressure;
        planes_[plane].isIdle = true;
        ++enforced_;
    }

    /** Takes out the `k`-th enforced plane: rotations make R triangular again. */
    void drop(int k) {
        planes_[set_[k]].isIdle = false;
        --enforced_;
        for (int c = k; c < enforced_; ++c) {
            set_[c] = set_[c + 1];
            u_[c] = u_[c + 1];
            for (int r = 0; r <= c + 1; ++r) R_[c][r] = R_[c + 1][r];
        }
        for (int r = k; r < enforced_; ++r) {
            const double length = std::sqrt(detail::square(R_[r][r]) + detail::square(R_[r][r + 1]));
            const double c = R_[r][r] / length, s = R_[r][r + 1] / length;
            for (int j = r; j < enforced_; ++j) rotate(c, s, R_[j][r], R_[j][r + 1]);
            for (int i = 0; i < n(); ++i) rotate(c, s, J_[r][i], J_[r + 1][i]);
        }
    }
    static void rotate(double c, double s, double& a, double& b) {
        const double first = a;
        a = c * first + s * b;
        b = c * b - s * first;
    }

    /** R out = right. */
    void solveUpper(const double* right, double* out) const {
        for (int k = enforced_ - 1; k >= 0; --k) {
            double sum = right[k];
            for (int j = k + 1; j < enforced_; ++j) sum -= R_[j][k] * out[j];
            out[k] = sum / R_[k][k];
        }
    }
    /** R' out = right. */
    void solveLower(const double* right, double* out) const {
        for (int k = 0; k < enforced_; ++k) {
            double sum = right[k];
            for (int j = 0; j < k; ++j) sum -= R_[k][j] * out[j];
            out[k] = sum / R_[k][k];
        }
    }

    /** Brings x and u to the minimum on the enforced planes, dropping those that pull. */
    bool settle(int& iterations) {
        do {
            if (!correct()) return false;
            int pulling = -1;
            double most = kPullTolerance * torque_;
            for (int k = 0; k < enforced_; ++k) {
                const double pull = -u_[k] * calcGradientLength(set_[k]);
                if (pull > most) {
                    most = pull;
                    pulling = k;
                }
            }
            if (pulling < 0) {
                for (int k = 0; k < enforced_; ++k) u_[k] = std::max(0.0, u_[k]);
                return true;
            }
            drop(pulling);
        } while (takeIteration(iterations));
        return false;
    }

    /** What a unit of pressure adds to a gradient that is scaled with the columns of M. */
    double calcGradientLength(int plane) const {
        double most = 0.0;
        for (int i = 0; i < n(); ++i) most = std::max(most, std::abs(planes_[plane].normal[i]) / columnLength_[i]);
        return most;
    }

    /** Newton's steps with residuals of M and of the planes themselves (corrected seminormal
    equations, Bjorck 1987), so that the error of J counts once and not by its square. */
    bool correct() {
        double tolerance = kCorrectionTolerance;
        for (int count = 0; count < kMaxCorrections; ++count, tolerance *= kCorrectionToleranceGrowth) {
            double y[kCapacity] = {}, residual[kCapacity], h[kCapacity], a[kCapacity] = {};
            for (int i = 0; i < n(); ++i)
                for (int r = 0; r < n(); ++r) y[r] += M_[i][r] * (x_[i] - target_[i]);
            for (int i = 0; i < n(); ++i) residual[i] = dot(M_[i], y);
            for (int k = 0; k < enforced_; ++k) {
                const double* normal = planes_[set_[k]].normal;
                for (int i = 0; i < n(); ++i) residual[i] -= u_[k] * normal[i];
                h[k] = calcMiss(set_[k]);
            }
            solveLower(h, a);
            for (int j = 0; j < n(); ++j) h[j] = dot(J_[j], residual);
            double change = 0.0;
            for (int j = 0; j < n(); ++j) {
                const double step = j < enforced_ ? a[j] : -h[j];
                change += detail::square(step);
                for (int i = 0; i < n(); ++i) x_[i] += step * J_[j][i];
            }
            for (int k = 0; k < enforced_; ++k) h[k] += a[k];
            solveUpper(h, a);
            for (int k = 0; k < enforced_; ++k) {
                u_[k] += a[k];
                if (set_[k] < n()) x_[set_[k]] = planes_[set_[k]].normal[set_[k]] * planes_[set_[k]].bound;
            }
            const double size = dot(y, y);
            torque_ = std::sqrt(size);
            if (!std::isfinite(change) || !std::isfinite(size)) return false;
            if (change <= detail::square(tolerance) * size) return true;
        }
        return false;
    }

    const int joints_, rows_;
    int most_ = 0;
    double M_[kCapacity][kCapacity];  // column by column, as are J and R
    double J_[kCapacity][kCapacity], R_[kCapacity][kCapacity];
    double target_[kCapacity], lo_[kCapacity], hi_[kCapacity], x_[kCapacity];
    double columnLength_[kCapacity];  // of M
    Plane planes_[kCapacity + RowQp::kMaxRows];
    int set_[kCapacity] = {};  // the enforced planes, in the order of R's columns
    double u_[kCapacity] = {};
    int enforced_ = 0;
    double tolerance_;
    double torque_ = 0.0;  // |M (x - target)|
    bool isContradictory_ = false;
};

/** Once as exactly as can be; where planes that are nearly parallel defeat that, once more leaving
out what the tolerance guaranteed allows to. */
template <int kSize>
Outcome solveTask(const Task& task, int& iterations, JointVector& x) {
    Outcome outcome = Outcome::Failed;
    for (const double tolerance : {kTightTolerance, RowQp::kRowTolerance}) {
        const bool isLast = tolerance == RowQp::kRowTolerance;
        RowProblem<kSize> problem(task, tolerance);
        outcome = problem.solve(iterations, RowQp::kMaxIterations / (isLast ? 1 : 2));
        if (outcome == Outcome::Failed || (outcome == Outcome::Stuck && !isLast)) continue;
        for (int i = 0; i < task.size(); ++i) x[i] = problem.getX(i);
        break;
    }
    return outcome;
}

}  // namespace

bool RowQp::Rows::add(const JointVector& row, double least) {
    if (count >= kMaxRows) return false;
    normal[count] = row;
    bound[count] = least;
    ++count;
    return true;
}

RowQp::Status RowQp::solve(const JointMatrix& M, const JointVector& target, const JointVector& lower,
                           const JointVector& upper, const Rows& rows, JointVector& x) {
    const Task task{M, target, lower, upper, rows};
    iterations_ = 0;
    const int n = task.size();
    x.setZero(n);
    if (lower.size() != n || upper.size() != n) return Status::Failed;
    for (int i = 0; i < n; ++i) x[i] = detail::clampTarget(target[i], lower[i], upper[i]);
    if (!task.hasSizes()) return Status::Failed;
    if (!task.isFinite()) return Status::Failed;
    if (task.isTargetInside()) return Status::TargetInside;
    const Outcome outcome = n == 6   ? solveTask<6>(task, iterations_, x)
                            : n == 7 ? solveTask<7>(task, iterations_, x)
                                     : solveTask<0>(task, iterations_, x);
    return outcome == Outcome::Optimal  ? Status::Solved
           : outcome == Outcome::Failed ? Status::Failed
                                        : Status::Infeasible;
}

}  // namespace viable
