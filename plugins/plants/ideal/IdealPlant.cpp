#include "IdealPlant.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct IdealPlantOptions {
    HeldQuantity held = HeldQuantity::Jerk;

    template <class V>
    void describe(V& v) {
        v(held, "held", "jerk|acceleration", "What the filter's decisions hold over a tick.");
    }
};

}  // namespace

void IdealPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    model_ = std::make_unique<RobotModel>(setup.robot);
    decision_.held = parameters.get<IdealPlantOptions>().held;
    external_.setZero(n_);
    reset(setup.start);
}

void IdealPlant::reset(const MotionState& start) {
    motion_ = start;
    state_ = {start.q, start.qd};
}

TickStatus IdealPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    model_->calcDynamics(motion_.q, motion_.qd, dynamics_);
    if (!calcForwardDynamics(dynamics_, torque, decision_.value)) return TickStatus::Faulted;
    if (decision_.held == HeldQuantity::Jerk) decision_.value = 2.0 / tick_s_ * (decision_.value - motion_.qdd);
    MotionState next = motion_;
    advanceNominal(decision_, tick_s_, next);
    if (!isFinite(next, n_)) return TickStatus::Faulted;
    motion_ = next;
    state_ = {motion_.q, motion_.qd};
    applied = torque;
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RealPlant, viable::IdealPlant, "ideal",
              "The nominal arm in the place of the real one: no friction, no error, nothing to correct.",
              viable::IdealPlantOptions)
