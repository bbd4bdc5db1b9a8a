#include "qp/RowQp.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "core/FixedSize.h"
#include "qp/QpBounds.h"

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

/** Largest |entry|, and whether all are finite; in parts, as processors add several numbers at once. */
struct Extent {
    double largest = 0.0;
    bool isFinite = true;

    Extent(const double* entries, Eigen::Index count) {
        constexpr int kParts = 4;
        double most[kParts] = {}, zero[kParts] = {};  // 0 times what is not finite is NaN
        const auto see = [&](double entry, int part) {
            most[part] = std::max(most[part], std::abs(entry));
            zero[part] += 0.0 * entry;
        };
        Eigen::Index i = 0;
        for (; i + kParts <= count; i += kParts)
            for (int part = 0; part < kParts; ++part) see(entries[i + part], part);
        for (; i < count; ++i) see(entries[i], 0);
        for (int part = 0; part < kParts; ++part) {
            largest = std::max(largest, most[part]);
            isFinite &= zero[part] == 0.0;
        }
    }
};

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
        bool finite = Extent(M.data(), M.size()).isFinite && Extent(target.data(), size()).isFinite;
        for (int i = 0; i < size(); ++i)
            finite &= lower[i] < kInfinity && upper[i] > -kInfinity && !std::isnan(upper[i]);
        for (int k = 0; k < rows.count; ++k)
            finite &= Extent(rows.normal[k].data(), size()).isFinite && std::isfinite(rows.bound[k]);
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

/** Of a plane that held in the last solution the part independent of those that are enforced already, relative: below this it
is left to the search, which can tell what parallel planes mean. */
constexpr double kWarmDependence = 1e-5;

/** Steps per joint for a start from there, should so many planes have changed that it leads nowhere soon. */
constexpr int kWarmStepsPerJoint = RowQp::kMaxWarmIterations / kMaxJoints;
static_assert(kWarmStepsPerJoint > 0);

/** Vectors over the joints are padded to an even number of entries; there must be room for that. */
static_assert(kMaxJoints % 2 == 0);

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
        const double size = Extent(task.M.data(), task.M.size()).largest;
        if (n() < width()) target_[n()] = x_[n()] = 0.0;
        const double scale = size > 0.0 ? 1.0 / size : 0.0;  // the optimum is that of any multiple
        for (int i = 0; i < n(); ++i, column += n()) {
            for (int r = 0; r < n(); ++r) M_[i][r] = scale * column[r];
            if (n() < width()) M_[i][n()] = 0.0;
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
            if (n() < width()) plane.normal[n()] = 0.0;
            plane.bound = bound;
        }
    }

    /** Steps are counted in `iterations`, up to `most`. */
    Outcome solve(int& iterations, int most) {
        most_ = most;
        if (!factor()) return Outcome::Failed;
        return search(iterations, false);
    }

    /** The same, beginning with the minimum on those planes of the last solution that press here. Only Optimal counts, and only
    to the tolerance begun with. */
    Outcome solveWarm(const RowQp::Held* held, int count, int& iterations) {
        most_ = kWarmStepsPerJoint * n();
        if (!factor()) return Outcome::Failed;
        for (int k = 0; k < count; ++k) enforceHeld(held[k]);
        findMinimum();
        if (!settle(iterations)) return Outcome::Failed;
        const double tolerance = tolerance_;
        const Outcome outcome = search(iterations, true);
        return tolerance_ == tolerance ? outcome : Outcome::Stuck;
    }

    /** The enforced planes, at most kMaxJoints. */
    int getHeld(RowQp::Held* held) const {
        using Kind = RowQp::Held::Kind;
        for (int k = 0; k < enforced_; ++k) {
            const int plane = set_[k];
            if (plane >= n())
                held[k] = {Kind::Row, plane - n()};
            else
                held[k] = {planes_[plane].normal[plane] > 0.0 ? Kind::Lower : Kind::Upper, plane};
        }
        return enforced_;
    }

    /** The present point, cut off at the box: bounds that are enforced hold exactly. */
    double getX(int i) const { return detail::clampTarget(x_[i], lo_[i], hi_[i]); }

private:
    /** @param settled  since the last settle() no plane was enforced or dropped */
    Outcome search(int& iterations, bool settled) {
        while (countIteration(iterations)) {
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

    static constexpr int kCapacity = kSize > 0 ? kSize + kSize % 2 : kMaxJoints;

    struct Plane {
        alignas(16) double normal[kCapacity];
        double bound;
        double length = 0.0;  // |J' normal|, of a unit of pressure; 0: not known yet
        bool isIdle = false;  // enforced, or never to be
    };
    enum class Step { Enforced, Dependent, Contradiction, Failed };

    int n() const { return kSize > 0 ? kSize : joints_; }
    /** Entries of a vector over the joints: an even number, as processors take two at once; beyond n() it has zeros. */
    int width() const { return kSize > 0 ? kSize + kSize % 2 : joints_ + joints_ % 2; }

    using Entries = Eigen::Matrix<double, (kSize > 0 ? kCapacity : Eigen::Dynamic), 1, 0, kCapacity, 1>;
    /** Of width() entries. */
    auto map(double* v) const { return Eigen::Map<Entries, Eigen::Aligned16>(v, width()); }
    auto map(const double* v) const { return Eigen::Map<const Entries, Eigen::Aligned16>(v, width()); }

    double dot(const double* a, const double* b) const { return map(a).dot(map(b)); }
    /** sum += factor * v */
    void accumulate(double factor, const double* v, double* sum) const { map(sum) += factor * map(v); }

    bool countIteration(int& iterations) {
        if (iterations >= most_) return false;
        if (++iterations > kPatiencePerJoint * n())
            tolerance_ = std::min(kToleranceGrowth * tolerance_, RowQp::kRowTolerance);
        return true;
    }

    /** M = QR by modified Gram-Schmidt (its R is as exact as that of reflections, Bjorck 1967), then J = R^-1. Columns of Q
    keep their length until the end, R = D U with a diagonal of ones in U: no root is waited for. False: M is singular to
    working precision. */
    bool factor() {
        alignas(16) double Q[kCapacity][kCapacity];
        double U[kCapacity][kCapacity], length[kCapacity];  // columns of Q, rows of U
        for (int j = 0; j < n(); ++j) map(Q[j]) = map(M_[j]);
        for (int j = 0; j < n(); ++j) {
            const double square = dot(Q[j], Q[j]), inverse = 1.0 / square;
            length[j] = std::sqrt(square);
            columnLength_[j] = std::sqrt(dot(M_[j], M_[j]));
            for (int i = j + 1; i < n(); ++i) {
                U[j][i] = inverse * dot(Q[j], Q[i]);
                accumulate(-U[j][i], Q[j], Q[i]);
            }
        }
        for (int j = 0; j < n(); ++j) {
            if (!(length[j] > kSingular * columnLength_[j])) return false;
            // Column j of U^-1 is the unit vector less those before it, each times its entry of U.
            alignas(16) double column[kCapacity] = {};
            column[j] = 1.0;
            for (int k = 0; k < j; ++k) accumulate(-U[k][j], J_[k], column);
            map(J_[j]) = map(column);
        }
        for (int j = 0; j < n(); ++j) {
            const double inverse = 1.0 / length[j];
            map(J_[j]) *= inverse;
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

    /** Makes plane i the lower (side 1) or the upper bound (-1) of joint i. */
    void setBound(int i, double side) {
        Plane& p = planes_[i];
        map(p.normal).setZero();
        p.normal[i] = side;
        p.bound = side > 0.0 ? lo_[i] : -hi_[i];
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
            setBound(i, side);
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
            alignas(16) double z[kCapacity] = {};
            double d[kCapacity], share[kCapacity];
            double slope = 0.0;  // of the miss along z
            for (int j = 0; j < n(); ++j) d[j] = dot(J_[j], normal);
            for (int j = enforced_; j < n(); ++j) {
                slope += detail::square(d[j]);
                accumulate(d[j], J_[j], z);
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
            if (independent) accumulate(step, z, x_);
            if (!std::isfinite(pressure)) return Step::Failed;
            if (blocking < 0) {
                add(plane, pressure, d, z);
                return Step::Enforced;
            }
            drop(blocking);
        } while (countIteration(iterations));
        return Step::Failed;
    }

    /** Enforces a plane that held before, whatever it does to the others' pressures; x and u are not those of the set until
    findMinimum(). */
    void enforceHeld(const RowQp::Held& held) {
        using Kind = RowQp::Held::Kind;
        if (held.index >= (held.kind == Kind::Row ? rows_ : n()) || enforced_ == n()) return;
        const int plane = held.kind == Kind::Row ? n() + held.index : held.index;
        Plane& p = planes_[plane];
        if (p.isIdle) return;
        if (held.kind != Kind::Row) {
            setBound(plane, held.kind == Kind::Lower ? 1.0 : -1.0);
            if (!std::isfinite(p.bound)) return;
        }
        alignas(16) double z[kCapacity] = {};
        double d[kCapacity];
        double inside = 0.0, slope = 0.0;
        for (int j = 0; j < n(); ++j)
            d[j] = held.kind == Kind::Row ? dot(J_[j], p.normal) : p.normal[plane] * J_[j][plane];
        for (int j = 0; j < enforced_; ++j) inside += detail::square(d[j]);
        for (int j = enforced_; j < n(); ++j) {
            slope += detail::square(d[j]);
            accumulate(d[j], J_[j], z);
        }
        if (!(slope > detail::square(kWarmDependence) * (inside + slope))) return;
        p.length = std::sqrt(inside + slope);
        add(plane, 0.0, d, z);
    }

    /** x and u of the enforced planes, from x = target. */
    void findMinimum() {
        double miss[kCapacity], a[kCapacity];
        for (int k = 0; k < enforced_; ++k) miss[k] = calcMiss(set_[k]);
        solveLower(miss, a);
        for (int k = 0; k < enforced_; ++k) accumulate(a[k], J_[k], x_);
        solveUpper(a, u_);
        snapToBounds();
    }

    void snapToBounds() {
        for (int k = 0; k < enforced_; ++k)
            if (set_[k] < n()) x_[set_[k]] = planes_[set_[k]].normal[set_[k]] * planes_[set_[k]].bound;
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
        alignas(16) double w[kCapacity];
        map(w) = factor * (map(z) - diagonal * map(J_[enforced_]));
        d[enforced_] -= diagonal;
        for (int j = enforced_; j < n(); ++j) accumulate(-d[j], w, J_[j]);
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
            for (int i = 0; i < width(); ++i) rotate(c, s, J_[r][i], J_[r + 1][i]);
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
        } while (countIteration(iterations));
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
            alignas(16) double y[kCapacity] = {}, residual[kCapacity] = {};
            double h[kCapacity], a[kCapacity] = {};
            for (int i = 0; i < n(); ++i) accumulate(x_[i] - target_[i], M_[i], y);
            for (int i = 0; i < n(); ++i) residual[i] = dot(M_[i], y);
            for (int k = 0; k < enforced_; ++k) {
                const double* normal = planes_[set_[k]].normal;
                accumulate(-u_[k], normal, residual);
                h[k] = calcMiss(set_[k]);
            }
            solveLower(h, a);
            for (int j = 0; j < n(); ++j) h[j] = dot(J_[j], residual);
            double change = 0.0;
            for (int j = 0; j < n(); ++j) {
                const double step = j < enforced_ ? a[j] : -h[j];
                change += detail::square(step);
                accumulate(step, J_[j], x_);
            }
            for (int k = 0; k < enforced_; ++k) h[k] += a[k];
            solveUpper(h, a);
            for (int k = 0; k < enforced_; ++k) u_[k] += a[k];
            snapToBounds();
            const double size = dot(y, y);
            torque_ = std::sqrt(size);
            if (!std::isfinite(change) || !std::isfinite(size)) return false;
            if (change <= detail::square(tolerance) * size) return true;
        }
        return false;
    }

    const int joints_, rows_;
    int most_ = 0;
    alignas(16) double M_[kCapacity][kCapacity];  // column by column, as are J and R
    alignas(16) double J_[kCapacity][kCapacity];
    double R_[kCapacity][kCapacity];
    alignas(16) double target_[kCapacity], x_[kCapacity];
    double lo_[kCapacity], hi_[kCapacity];
    double columnLength_[kCapacity];  // of M
    Plane planes_[kCapacity + RowQp::kMaxRows];
    int set_[kCapacity] = {};  // the enforced planes, in the order of R's columns
    double u_[kCapacity] = {};
    int enforced_ = 0;
    double tolerance_;
    double torque_ = 0.0;  // |M (x - target)|
    bool isContradictory_ = false;
};

/** From the planes that held in the last solution, if there are any; else, or where that does not lead to the optimum, from
the target: once as exactly as can be; where planes that are nearly parallel defeat that, once more leaving out what the
tolerance guaranteed allows to.
@param held  on return the planes that hold now */
template <int kSize>
Outcome solveTask(const Task& task, int& iterations, RowQp::Held* held, int& heldCount, JointVector& x) {
    const auto take = [&](const RowProblem<kSize>& problem) {
        for (int i = 0; i < task.size(); ++i) x[i] = problem.getX(i);
        heldCount = problem.getHeld(held);
    };
    if (heldCount > 0) {
        RowProblem<kSize> problem(task, kTightTolerance);
        if (problem.solveWarm(held, heldCount, iterations) == Outcome::Optimal) {
            take(problem);
            return Outcome::Optimal;
        }
    }
    const int wasted = std::exchange(iterations, 0);
    Outcome outcome = Outcome::Failed;
    for (const double tolerance : {kTightTolerance, RowQp::kRowTolerance}) {
        const bool isLast = tolerance == RowQp::kRowTolerance;
        RowProblem<kSize> problem(task, tolerance);
        outcome = problem.solve(iterations, isLast ? RowQp::kMaxColdIterations : RowQp::kMaxColdIterations / 2);
        if (outcome == Outcome::Failed || (outcome == Outcome::Stuck && !isLast)) continue;
        take(problem);
        break;
    }
    iterations += wasted;
    if (outcome != Outcome::Optimal) heldCount = 0;
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
    if (lower.size() != n || upper.size() != n) return reset(), Status::Failed;
    for (int i = 0; i < n; ++i) x[i] = detail::clampTarget(target[i], lower[i], upper[i]);
    if (!task.hasSizes() || !task.isFinite()) return reset(), Status::Failed;
    if (task.isTargetInside()) return reset(), Status::TargetInside;
    const auto solveOf = [&](auto size) {
        return solveTask<decltype(size)::value>(task, iterations_, held_.data(), heldCount_, x);
    };
    const Outcome outcome = detail::withFixedSize(n, solveOf);
    return outcome == Outcome::Optimal  ? Status::Solved
           : outcome == Outcome::Failed ? Status::Failed
                                        : Status::Infeasible;
}

}  // namespace viable
