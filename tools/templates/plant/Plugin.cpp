#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Each setting described once: its member, initial value and line here are all that reading, range errors and
// `viable plugins --describe @NAME@` need.
struct Options {
    viable::PerJoint friction = 0.5;

    template <class V>
    void describe(V& v) {
        v(friction, "friction", "Nm s/rad", "Torque per velocity.").atLeast(0);
    }
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    friction_ = parameters.get<Options>().friction.expand(n_);
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    model_ = std::make_unique<viable::RobotModel>(setup.robot);
    state_ = {setup.start.q, setup.start.qd};
}

void @CLASS@::reset(const viable::MotionState& start) {
    state_ = {start.q, start.qd};
}

viable::TickStatus @CLASS@::advance(const viable::JointVector& torque, viable::JointVector& applied) {
    if (!viable::isFinite(torque, n_)) return viable::TickStatus::InvalidInput;
    model_->calcDynamics(state_.q, state_.qd, dynamics_);
    const viable::JointVector motors = torque.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
    const viable::JointVector net = motors - friction_.cwiseProduct(state_.qd);
    viable::JointVector acceleration;
    if (!calcForwardDynamics(dynamics_, net, acceleration)) return viable::TickStatus::Faulted;
    const viable::JointVector qd = state_.qd + tick_s_ * acceleration;
    const viable::JointVector q = state_.q + tick_s_ * qd;
    if (!q.allFinite() || !qd.allFinite()) return viable::TickStatus::Faulted;
    state_ = {q, qd};
    applied = motors;
    return viable::TickStatus::Ok;
}

VIABLE_PLUGIN(viable::RealPlant, @CLASS@, "@NAME@", "The robot's rigid-body model with viscous friction.", Options)
