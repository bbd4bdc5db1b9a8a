#include "SimbodyPlant.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "viable/core/Error.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::integer("substeps", "1", "Integration steps per tick.").atLeast(1).upTo(1000),
    parameter::choice("friction", "robot|none", "robot",
                      "Friction figures of the robot's actuation.yaml, or none."),
    parameter::jointNumbers("friction_scale", "", "1.0",
                            "Factor on all friction torques, Fc and Fv1.")
        .atLeast(0),
    parameter::number(
        "breakaway_ratio", "", "1.0",
        "Stribeck: friction at standstill over Coulomb friction, Fs / Fc; 1 switches it "
        "off.")
        .atLeast(1),
    parameter::number("stribeck_velocity_radps", "rad/s", "0.02",
                      "vs: velocity over which that excess fades.")
        .above(0),
    parameter::number("payload_kg", "kg", "0.0",
                      "Point mass at the tool that the nominal model does not know.")
        .atLeast(0),
    parameter::numbers("payload_offset_m", "m", 3, 3, "[0, 0, 0]",
                       "Where it is, in the tool frame."),
    parameter::jointNumbers("mass_factor", "", "1.0",
                            "Real over nominal mass and inertia of the body behind each joint.")
        .above(0),
    parameter::number("torque_limit_factor", "", "1.0",
                      "Motor torque available, as a share of the robot's figure.")
        .above(0)
        .orInfinite(),
    parameter::choice("encoder", "robot|exact", "robot",
                      "robot: positions in whole counts, velocity by their difference over a tick; "
                      "exact: the truth."),
    parameter::number("encoder_noise_rad", "rad", "0.0",
                      "Standard deviation of the position reading.")
        .atLeast(0),
    parameter::integer("seed", "1", "Of the reading noise: same seed, same readings.").atLeast(0),
};

/** Rounds for the viscous friction. Each lowers the (convex) function whose minimum is v+, and even
the first takes energy out, so their number is a matter of accuracy only. */
constexpr int kViscousRounds = 3;

/** The inverse of the lower triangle of `L`. */
JointMatrix invertLower(const JointMatrix& L) {
    const int n = static_cast<int>(L.rows());
    JointMatrix inverse = JointMatrix::Zero(n, n);
    for (int k = 0; k < n; ++k) {
        inverse(k, k) = 1.0 / L(k, k);
        for (int i = k + 1; i < n; ++i) {
            double sum = 0.0;
            for (int j = k; j < i; ++j) sum -= L(i, j) * inverse(j, k);
            inverse(i, k) = sum / L(i, i);
        }
    }
    return inverse;
}

}  // namespace

double SimbodyPlant::FrictionLaw::calcDry(double v) const {
    const double x = v / stribeckVelocity;
    return coulomb + (breakaway - coulomb) * std::exp(-x * x);
}

double SimbodyPlant::FrictionLaw::calcDamping(double v) const {
    const double x = std::abs(v) / viscousVelocity;
    const double share = x > 0.0 ? -std::expm1(-x) / x : 1.0;
    return viscous / viscousVelocity * share;
}

void SimbodyPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    substeps_ = static_cast<int>(parameters.integer("substeps"));
    substep_s_ = tick_s_ / substeps_;

    RobotDescription robot = withScaledMasses(setup.robot, parameters.jointNumbers("mass_factor"));
    const std::vector<double>& offset = parameters.numbers("payload_offset_m");
    robot = withPayload(std::move(robot), parameters.number("payload_kg"),
                        {offset[0], offset[1], offset[2]});
    model_ = std::make_unique<RobotModel>(robot);

    torqueLimit_ = robot.actuation.torqueLimit * parameters.number("torque_limit_factor");
    hasFriction_ = parameters.text("friction") == "robot";
    const JointFriction& figures = robot.actuation.friction;
    const JointVector& scale = parameters.jointNumbers("friction_scale");
    for (int i = 0; i < n_; ++i) {
        friction_[i].coulomb = scale[i] * figures.coulomb[i];
        friction_[i].breakaway = parameters.number("breakaway_ratio") * friction_[i].coulomb;
        friction_[i].stribeckVelocity = parameters.number("stribeck_velocity_radps");
        friction_[i].viscous = scale[i] * figures.viscous[i];
        friction_[i].viscousVelocity = figures.viscousVelocity[i];
    }

    const bool exact = parameters.text("encoder") == "exact";
    noise_ = parameters.number("encoder_noise_rad");
    seed_ = static_cast<std::uint64_t>(parameters.integer("seed"));
    exactVelocity_ = exact && noise_ == 0.0;
    resolution_.setZero(n_);
    for (int i = 0; i < n_; ++i)
        if (!exact && robot.actuation.encoderCounts[i] > 0.0)
            resolution_[i] = (robot.joints[i].type == JointType::Prismatic ? 1.0 : 2.0 * EIGEN_PI) /
                             robot.actuation.encoderCounts[i];
    reset(setup.start);
}

void SimbodyPlant::reset(const MotionState& start) {
    random_.seed(seed_);
    dryFriction_.reset();
    actual_.q = start.q;
    actual_.qd = start.qd;
    measured_ = actual_;
    measure(actual_);
    measured_.qd = start.qd;
}

double SimbodyPlant::drawNormal() {
    // Box and Muller, with an own mapping to (0, 1]: the standard distributions differ between
    // libraries.
    const double unit = 0x1p-53;
    const double u1 = (static_cast<double>(random_() >> 11) + 1.0) * unit;
    const double u2 = static_cast<double>(random_() >> 11) * unit;
    return std::sqrt(-2.0 * std::log(u1)) * std::cos(2.0 * EIGEN_PI * u2);
}

void SimbodyPlant::measure(const JointState& truth) {
    for (int i = 0; i < n_; ++i) {
        double reading = truth.q[i];
        if (noise_ > 0.0) reading += noise_ * drawNormal();
        if (resolution_[i] > 0.0) reading = resolution_[i] * std::round(reading / resolution_[i]);
        measured_.qd[i] = exactVelocity_ ? truth.qd[i] : (reading - measured_.q[i]) / tick_s_;
        measured_.q[i] = reading;
    }
}

void SimbodyPlant::calcFriction(const JointMatrix& M, const JointVector& v,
                                const JointVector& push) {
    JointVector dry(n_), damping(n_), after = v;
    for (int i = 0; i < n_; ++i) dry[i] = friction_[i].calcDry(v[i]);
    // Without dry friction v+ = A^-1 h target; with it v+ = A^-1 h (target - f), and f in [-F, F]
    // minimises |L^-1 (f - target)|^2, A = L L': its optimality conditions are the friction law.
    JointVector target = push;
    target.noalias() += M.lazyProduct(v) / substep_s_;
    const JointVector lower = -dry;
    for (int round = 0; round < kViscousRounds; ++round) {
        JointMatrix A = M;
        for (int i = 0; i < n_; ++i) {
            damping[i] = friction_[i].calcDamping(after[i]);
            A(i, i) += substep_s_ * damping[i];
        }
        const Eigen::LLT<JointMatrix> factor(A);
        dryFriction_.solve(invertLower(factor.matrixLLT()), target, lower, dry, frictionTorque_);
        after = substep_s_ * (target - frictionTorque_);
        factor.solveInPlace(after);
    }
    frictionTorque_ += damping.cwiseProduct(after);
}

bool SimbodyPlant::step(const JointVector& torque) {
    const double h = substep_s_;
    JointVector& q = next_.q;
    JointVector& v = next_.qd;
    JointVector k1v, k2v, k3v, k4v;

    model_->calcDynamics(q, v, dynamics_);
    if (!isFinite(dynamics_, n_)) return false;
    frictionTorque_.setZero(n_);
    if (hasFriction_) calcFriction(dynamics_.M, v, torque - dynamics_.b);
    const JointVector net = torque - frictionTorque_;

    if (!calcForwardDynamics(dynamics_, net, k1v)) return false;
    const JointVector k2q = v + h / 2.0 * k1v;
    const auto accelerate = [&](const JointVector& atQ, const JointVector& atV, JointVector& out) {
        model_->calcDynamics(atQ, atV, dynamics_);
        return calcForwardDynamics(dynamics_, net, out);
    };
    if (!accelerate(q + h / 2.0 * v, k2q, k2v)) return false;
    const JointVector k3q = v + h / 2.0 * k2v;
    if (!accelerate(q + h / 2.0 * k2q, k3q, k3v)) return false;
    const JointVector k4q = v + h * k3v;
    if (!accelerate(q + h * k3q, k4q, k4v)) return false;
    q += h / 6.0 * (v + 2.0 * k2q + 2.0 * k3q + k4q);
    v += h / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v);
    return q.allFinite() && v.allFinite();
}

TickStatus SimbodyPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    applied = torque.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
    next_ = actual_;
    for (int i = 0; i < substeps_; ++i)
        if (!step(applied)) return TickStatus::Faulted;
    actual_ = next_;
    measure(actual_);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RealPlant, viable::SimbodyPlant, "simbody",
              "The arm in simulation: Simbody's multibody model with friction, payload, motor "
              "limits and encoders.",
              viable::kParameters)
