#include "tracking/ArmExtremes.h"

#include <algorithm>

#include "core/Text.h"
#include "robot/InertiaModes.h"
#include "viable/robot/RobotModel.h"

namespace viable::detail {

namespace {

using Eigen::MatrixXd;

constexpr int kPoses = 192;
/** Of those, the poses around which the loop is looked at. */
constexpr int kLoopPoses = 32;
/** Those where gradients are taken: they cost most. */
constexpr int kGradientPoses = 64;
/** Differences for gradients [rad, m]. */
constexpr double kStep = 1e-5;

/** The terms of M qdd + b at a pose. */
struct Terms {
    JointMatrix M;
    JointVector gravity;
    std::vector<MatrixXd> c;  // i: upper triangle, b_i - gravity_i = sum over j <= k of c_jk qd_j qd_k

    Terms operator-(const Terms& other) const {
        Terms d{M - other.M, gravity - other.gravity, c};
        for (std::size_t i = 0; i < c.size(); ++i) d.c[i] -= other.c[i];
        return d;
    }
    /** dC/dv_k, C_ij = sum over k of the Christoffel symbols of the first kind times v_k. */
    MatrixXd calcChristoffel(int k) const {
        const auto n = static_cast<int>(c.size());
        MatrixXd C(n, n);
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n; ++j) {
                const MatrixXd& own = c[static_cast<std::size_t>(i)];
                C(i, j) = j == k ? own(j, j) : 0.5 * own(std::min(j, k), std::max(j, k));
            }
        return C;
    }
    /** The largest |M qdd + centrifugal and Coriolis torque|. */
    JointVector calcMotionTorque(const MotionSize& size) const {
        JointVector sum = M.cwiseAbs() * size.acceleration;
        for (Eigen::Index i = 0; i < sum.size(); ++i)
            sum[i] += size.velocity.dot(c[static_cast<std::size_t>(i)].cwiseAbs() * size.velocity);
        return sum;
    }
    /** With gravity. */
    JointVector calcTorque(const MotionSize& size) const {
        return calcMotionTorque(size) + JointVector(gravity.cwiseAbs());
    }
    /** The largest rate of M qdd + b while the arm stays in the pose. */
    JointVector calcRate(const MotionSize& size) const {
        JointVector sum = M.cwiseAbs() * size.jerk;
        for (Eigen::Index i = 0; i < sum.size(); ++i) {
            const MatrixXd own = c[static_cast<std::size_t>(i)].cwiseAbs();
            sum[i] += size.velocity.dot((own + own.transpose()) * size.acceleration);
        }
        return sum;
    }
};

class Arm {
public:
    explicit Arm(const RobotDescription& robot) : model_(robot), n_(robot.size()) {}

    Terms calcTerms(const JointVector& q) {
        Terms t;
        const JointVector still = JointVector::Zero(n_);
        const auto calcSpin = [&](const JointVector& qd) -> JointVector {
            model_.calcDynamics(q, qd, dynamics_);
            return dynamics_.b - t.gravity;
        };
        model_.calcDynamics(q, still, dynamics_);
        t.M = dynamics_.M;
        t.gravity = dynamics_.gravity;
        t.c.assign(static_cast<std::size_t>(n_), MatrixXd::Zero(n_, n_));
        for (int j = 0; j < n_; ++j) {
            const JointVector own = calcSpin(JointVector::Unit(n_, j));
            for (int i = 0; i < n_; ++i) t.c[static_cast<std::size_t>(i)](j, j) = own[i];
        }
        for (int j = 0; j < n_; ++j)
            for (int k = j + 1; k < n_; ++k) {
                const JointVector both = calcSpin(JointVector::Unit(n_, j) + JointVector::Unit(n_, k));
                for (int i = 0; i < n_; ++i) {
                    MatrixXd& c = t.c[static_cast<std::size_t>(i)];
                    c(j, k) = both[i] - c(j, j) - c(k, k);
                }
            }
        return t;
    }
    /** Valid until the next call. */
    const Dynamics& calcAtRest(const JointVector& q) {
        model_.calcDynamics(q, JointVector::Zero(n_), dynamics_);
        return dynamics_;
    }

private:
    RobotModel model_;
    int n_;
    Dynamics dynamics_;
};

/** Corners of an octahedron around the ball of places that the payload may have: what is convex in the place is largest at one of
them. Not all is: products of two coordinates, in what couples joints, can be larger between them. */
std::vector<Eigen::Vector3d> listPlaces(double distance) {
    std::vector<Eigen::Vector3d> places{Eigen::Vector3d::Zero()};
    if (distance > 0.0)
        for (int axis = 0; axis < 3; ++axis)
            for (double side : {-1.0, 1.0})
                places.push_back(side * std::sqrt(3.0) * distance * Eigen::Vector3d::Unit(axis));
    return places;
}

/** @param sides  of each body: 1 the heaviest, -1 the lightest; the payload goes with the last one */
RobotDescription makeReal(const RobotDescription& robot, const DisturbanceSet& set, const JointVector& sides,
                          const Eigen::Vector3d& place) {
    const JointVector error = set.massError.expand(robot.size());
    RobotDescription real = withScaledMasses(robot, JointVector::Ones(robot.size()) + sides.cwiseProduct(error));
    return sides[sides.size() - 1] > 0.0 ? withPayload(std::move(real), set.payload_kg, place) : real;
}

/** From the least to the greatest value of each entry. */
class EntryRange {
public:
    explicit EntryRange(int n)
        : least_(MatrixXd::Constant(n, n, INFINITY)), greatest_(MatrixXd::Constant(n, n, -INFINITY)) {}
    void add(const MatrixXd& value) {
        least_ = least_.cwiseMin(value);
        greatest_ = greatest_.cwiseMax(value);
    }
    MatrixXd calcWidth() const { return greatest_ - least_; }

private:
    MatrixXd least_, greatest_;
};

/** NaN stays NaN. */
template <class Matrix, class Value>
void raise(Matrix& largest, const Value& value) {
    largest = largest.binaryExpr(Matrix(Matrix(value).cwiseAbs()), &largerOrNan).eval();
}

/** What is not finite would be lost in the extremes. */
void checkFinite(const Terms& terms, const JointVector& q, const RobotDescription& robot, const std::string& place) {
    for (int i = 0; i < robot.size(); ++i) {
        const auto at = static_cast<std::size_t>(i);
        if (terms.M.row(i).allFinite() && std::isfinite(terms.gravity[i]) && terms.c[at].allFinite()) continue;
        throw badInput(place,
                       "the dynamics of " + robot.joints[at].name + " are not finite at q = " + formatList(q) +
                           ": no bound can be computed",
                       "Correct masses and inertias of the robot, or mass_error and payload_kg of the set.");
    }
}

/** Torques of one arm under gravity of 1 m/s^2 along each of three directions: down and two sideways. */
struct TiltTorques {
    JointVector down, side, other;

    TiltTorques operator-(const TiltTorques& from) const {
        return {down - from.down, side - from.side, other - from.other};
    }
    /** The largest torque of a tilt of up to `tilt` [rad] in any direction. */
    JointVector calcLargest(double gravity, double tilt) const {
        const double sideways = tilt < 0.5 * kPi ? std::sin(tilt) : 1.0;
        return gravity * (sideways * (side.cwiseAbs2() + other.cwiseAbs2()).cwiseSqrt() +
                          (1.0 - std::cos(tilt)) * down.cwiseAbs());
    }
};

/** Of arms on a tilted base what gravity's torque changes by, which is affine in the masses: that of each arm, and of what bodies
may have more or less. */
class TiltedArms {
public:
    /** @param tilt  largest [rad] */
    TiltedArms(const RobotDescription& robot, double tilt) : gravity_(robot.gravity.norm()), tilt_(tilt) {
        addArm(robot);
    }
    void addArm(RobotDescription arm) { arms_.emplace_back(std::move(arm)); }
    /** @param heavier  the first arm with twice the body, of which it may have `share` more or less */
    void addBody(double share, RobotDescription heavier) { bodies_.push_back({share, Upright(std::move(heavier))}); }

    /** The largest torque [Nm]. */
    JointVector calcTorque(const JointVector& q) { return sum(calc(q)); }
    /** Its largest change over each position [Nm/rad]. */
    MatrixXd calcSlope(const JointVector& q) {
        const auto n = q.size();
        MatrixXd slope(n, n);
        const std::vector<TiltTorques> here = calc(q);
        for (Eigen::Index j = 0; j < n; ++j) {
            std::vector<TiltTorques> change = calc(q + kStep * JointVector(JointVector::Unit(n, j)));
            for (std::size_t k = 0; k < change.size(); ++k) change[k] = change[k] - here[k];
            slope.col(j) = sum(change) / kStep;
        }
        return slope;
    }

private:
    /** An arm under gravity along each of the three directions. */
    class Upright {
    public:
        explicit Upright(RobotDescription robot) {
            const Eigen::Vector3d g = robot.gravity.norm() > 0.0 ? robot.gravity.normalized().eval()
                                                                 : Eigen::Vector3d(Eigen::Vector3d::UnitZ());
            for (const Eigen::Vector3d& along :
                 {g, Eigen::Vector3d(g.unitOrthogonal()), Eigen::Vector3d(g.cross(g.unitOrthogonal()))}) {
                robot.gravity = along;
                arms_.push_back(std::make_unique<Arm>(robot));
            }
        }
        TiltTorques calc(const JointVector& q) {
            return {arms_[0]->calcAtRest(q).gravity, arms_[1]->calcAtRest(q).gravity, arms_[2]->calcAtRest(q).gravity};
        }

    private:
        std::vector<std::unique_ptr<Arm>> arms_;
    };
    struct Body {
        double share;
        Upright heavier;
    };

    /** Of the arms, then of those with a heavier body. */
    std::vector<TiltTorques> calc(const JointVector& q) {
        std::vector<TiltTorques> torques;
        for (Upright& arm : arms_) torques.push_back(arm.calc(q));
        for (Body& body : bodies_) torques.push_back(body.heavier.calc(q));
        return torques;
    }
    JointVector sum(const std::vector<TiltTorques>& torques) const {
        const JointVector zero = JointVector::Zero(torques.front().down.size());
        JointVector arm = zero, bodies = zero;
        for (std::size_t k = 0; k < arms_.size(); ++k) raise(arm, torques[k].calcLargest(gravity_, tilt_));
        for (std::size_t k = 0; k < bodies_.size(); ++k)
            bodies += bodies_[k].share * (torques[arms_.size() + k] - torques.front()).calcLargest(gravity_, tilt_);
        return arm + bodies;
    }

    double gravity_, tilt_;
    std::vector<Upright> arms_;
    std::vector<Body> bodies_;
};

/** The pose near `q`, within the limits, in which `figure` is largest, by steps of one joint each. */
template <class Figure>
JointVector climb(JointVector q, const JointBounds& range, const Figure& figure) {
    constexpr double kFirstStep = 0.1, kLastStep = 1e-3;  // shares of the range
    double best = figure(q);
    for (double step = kFirstStep; step > kLastStep;) {
        bool isBetter = false;
        for (Eigen::Index i = 0; i < q.size(); ++i)
            for (const double side : {-1.0, 1.0}) {
                JointVector tried = q;
                tried[i] =
                    std::clamp(q[i] + side * step * (range.upper[i] - range.lower[i]), range.lower[i], range.upper[i]);
                const double found = figure(tried);
                if (!(found > best)) continue;
                best = found;
                q = tried;
                isBetter = true;
            }
        if (!isBetter) step *= 0.5;
    }
    return q;
}

/** An arm's terms at a pose and a step of each joint beside it. */
struct TermsAround {
    Terms here;
    std::vector<Terms> beside;

    TermsAround operator-(const TermsAround& other) const {
        TermsAround d{here - other.here, {}};
        for (std::size_t j = 0; j < beside.size(); ++j) d.beside.push_back(beside[j] - other.beside[j]);
        return d;
    }
    PoseTensors calcTensors(const MotionSize& motion) const {
        const auto n = static_cast<int>(here.c.size());
        PoseTensors t{{}, {}, MatrixXd(n, n)};
        for (int k = 0; k < n; ++k) {
            const Terms change = beside[static_cast<std::size_t>(k)] - here;
            t.gradient.emplace_back(change.M / kStep);
            t.coriolis.push_back(here.calcChristoffel(k));
            t.stiffness.col(k) = change.calcTorque(motion) / kStep;
        }
        return t;
    }
    /** The largest rate of M qdd + b in motion. */
    JointVector calcRate(const MotionSize& motion) const {
        JointVector rate = here.calcRate(motion);
        for (std::size_t j = 0; j < beside.size(); ++j)
            rate += motion.velocity[static_cast<Eigen::Index>(j)] / kStep * (beside[j] - here).calcTorque(motion);
        return rate;
    }
};

TermsAround calcTermsAround(Arm& arm, const JointVector& q, const Terms& here) {
    TermsAround t{here, {}};
    for (int j = 0; j < q.size(); ++j)
        t.beside.push_back(arm.calcTerms(q + kStep * JointVector(JointVector::Unit(q.size(), j))));
    return t;
}

/** Of each entry the share times its size. */
void addSize(const PoseTensors& from, double share, PoseTensors& sum) {
    for (std::size_t k = 0; k < from.gradient.size(); ++k) {
        sum.gradient[k] += share * from.gradient[k].cwiseAbs();
        sum.coriolis[k] += share * from.coriolis[k].cwiseAbs();
    }
    sum.stiffness += share * from.stiffness;
}

}  // namespace

ArmExtremes findArmExtremes(const RobotDescription& robot, const JointLimits& limits, const MotionSize& motion,
                            const DisturbanceSet& set, const JointVector& gain, const std::string& source) {
    const int n = robot.size();
    const MatrixXd none = MatrixXd::Zero(n, n);
    const JointVector zero = JointVector::Zero(n);
    ArmExtremes x;
    x.inertia = none;
    x.nominalTorque = zero;
    x.massError = x.payload = x.tilt = TorqueRange::within(zero);
    if (set.payload_kg > 0.0) x.payload = {JointVector::Constant(n, INFINITY), JointVector::Constant(n, -INFINITY)};
    x.massErrorRate = x.payloadRate = x.massErrorWeight = x.payloadWeight = zero;
    x.tiltSlope = none;

    Arm nominal(robot);
    const std::vector<Eigen::Vector3d> places =
        set.payload_kg > 0.0 ? listPlaces(set.payloadOffset_m) : std::vector<Eigen::Vector3d>{Eigen::Vector3d::Zero()};
    std::vector<std::pair<int, std::unique_ptr<Arm>>> doubled;  // the body behind that joint
    std::vector<std::unique_ptr<Arm>> loaded;
    std::vector<std::unique_ptr<Arm>> arms;  // the heaviest and the lightest
    const JointVector error = set.massError.expand(n);
    std::optional<TiltedArms> tilted;
    if (set.baseTilt_rad > 0.0) tilted.emplace(robot, set.baseTilt_rad);
    for (int k = 0; k < n; ++k) {
        if (!(error[k] > 0.0)) continue;
        const RobotDescription heavier =
            withScaledMasses(robot, JointVector::Ones(n) + JointVector(JointVector::Unit(n, k)));
        doubled.emplace_back(k, std::make_unique<Arm>(heavier));
        if (tilted) tilted->addBody(error[k], heavier);
    }
    if (set.payload_kg > 0.0)
        for (const Eigen::Vector3d& place : places) {
            const RobotDescription carrying = withPayload(robot, set.payload_kg, place);
            loaded.push_back(std::make_unique<Arm>(carrying));
            if (tilted) tilted->addArm(carrying);
        }
    const JointVector heavy = JointVector::Ones(n), light = -heavy;
    for (const Eigen::Vector3d& place : places)
        arms.push_back(std::make_unique<Arm>(makeReal(robot, set, heavy, place)));
    if (set.payload_kg > 0.0 || error.maxCoeff() > 0.0)
        arms.push_back(std::make_unique<Arm>(makeReal(robot, set, light, places.front())));
    std::vector<std::unique_ptr<Arm>> mixed;
    if (error.maxCoeff() > 0.0 && n > 1)
        for (const double outer : {1.0, -1.0}) {
            JointVector sides = JointVector::Constant(n, -outer);
            sides.tail(n / 2).setConstant(outer);
            mixed.push_back(std::make_unique<Arm>(makeReal(robot, set, sides, places.front())));
        }
    // Inertia is affine in each body's mass and in the payload's: the widths of the parts add up.
    EntryRange ownRange(n);
    std::vector<EntryRange> doubledRange(doubled.size(), ownRange), loadedRange(loaded.size(), ownRange);

    const std::vector<JointVector> poses = samplePoses(limits, kPoses);
    for (std::size_t pose = 0; pose < poses.size(); ++pose) {
        const JointVector& q = poses[pose];
        const Terms own = nominal.calcTerms(q);
        checkFinite(own, q, robot, source);
        raise(x.nominalTorque, own.calcTorque(motion));
        const bool takesGradient = pose < kGradientPoses;
        TermsAround ownAround;
        PoseTensors massTensors;
        if (takesGradient) {
            ownAround = calcTermsAround(nominal, q, own);
            const Tensor nothing(static_cast<std::size_t>(n), none);
            massTensors = {nothing, nothing, none};
        }
        ownRange.add(own.M);
        JointVector massTorque = zero, massRate = zero, massWeight = zero;
        MatrixXd massInertia = none;
        for (std::size_t k = 0; k < doubled.size(); ++k) {
            const auto& [joint, arm] = doubled[k];
            const Terms terms = arm->calcTerms(q), body = terms - own;
            doubledRange[k].add(body.M);
            massInertia += error[joint] * body.M.cwiseAbs();
            massTorque += error[joint] * body.calcTorque(motion);
            massWeight += error[joint] * body.gravity.cwiseAbs();
            if (!takesGradient) continue;
            const TermsAround around = calcTermsAround(*arm, q, terms) - ownAround;
            massRate += error[joint] * around.calcRate(motion);
            addSize(around.calcTensors(motion), error[joint], massTensors);
        }
        raise(x.massError.upper, massTorque);
        raise(x.massErrorRate, massRate);
        raise(x.massErrorWeight, massWeight);
        // What changes with the pose is affine in the payload and in each body's mass.
        if (takesGradient) x.torques.add({ownAround.calcTensors(motion), massTensors});
        raise(x.inertia, massInertia + own.M.cwiseAbs());
        for (std::size_t k = 0; k < loaded.size(); ++k) {
            Arm& arm = *loaded[k];
            const Terms terms = arm.calcTerms(q), load = terms - own;
            checkFinite(load, q, robot, source);
            loadedRange[k].add(load.M);
            raise(x.inertia, massInertia + terms.M.cwiseAbs());
            const JointVector torque = load.calcMotionTorque(motion);
            raise(x.payloadWeight, load.gravity);
            x.payload.lower = x.payload.lower.cwiseMin(-load.gravity - torque);
            x.payload.upper = x.payload.upper.cwiseMax(-load.gravity + torque);
            if (!takesGradient) continue;
            const TermsAround around = calcTermsAround(arm, q, terms);
            raise(x.payloadRate, (around - ownAround).calcRate(motion));
            x.torques.add({around.calcTensors(motion), massTensors});
        }
        if (tilted) {
            raise(x.tilt.upper, tilted->calcTorque(q));
            if (takesGradient) raise(x.tiltSlope, tilted->calcSlope(q));
        }
        if (pose >= kLoopPoses) continue;
        for (const auto* all : {&arms, &mixed})
            for (const auto& arm : *all) x.inertias.push_back({q, arm->calcAtRest(q).M});
    }
    // A loop is nearest to instability, and a joint moves most easily, in poses that a sample hardly meets: near singular ones. More
    // mass anywhere makes no mode faster and no joint easier to move, so that these need the heaviest and the lightest arms alone.
    const JointBounds range = makeFinite(limits.position, JointVector::Constant(n, kPi));
    for (const auto& each : arms) {
        Arm& arm = *each;
        const auto add = [&](const auto& figure) {
            const auto calc = [&](const JointVector& q) { return figure(arm.calcAtRest(q).M); };
            const JointVector* best = &poses.front();
            double largest = -INFINITY;
            for (const JointVector& q : poses)
                if (const double found = calc(q); found > largest) {
                    largest = found;
                    best = &q;
                }
            const JointVector q = climb(*best, range, calc);
            x.inertias.push_back({q, arm.calcAtRest(q).M});
        };
        add([&](const JointMatrix& M) { return findModes(M, gain).eigenvalues()[n - 1]; });
        add([&](const JointMatrix& M) { return -findModes(M, gain).eigenvalues()[0]; });
        for (int i = 0; i < n; ++i)
            add([&](const JointMatrix& M) { return M.llt().solve(JointVector(JointVector::Unit(n, i)))[i]; });
    }
    MatrixXd payloadRange = none;
    for (const EntryRange& load : loadedRange) raise(payloadRange, load.calcWidth());
    x.inertiaRange = ownRange.calcWidth() + payloadRange;
    for (std::size_t k = 0; k < doubled.size(); ++k)
        x.inertiaRange += error[doubled[k].first] * doubledRange[k].calcWidth();
    x.massError.lower = -x.massError.upper;
    x.tilt.lower = -x.tilt.upper;
    return x;
}

}  // namespace viable::detail
