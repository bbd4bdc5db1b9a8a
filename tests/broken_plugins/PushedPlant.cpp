#include <Eigen/Cholesky>

#include "BrokenPlugin.h"
#include "viable/robot/RobotModel.h"

namespace {

using namespace viable;

struct PushedPlantOptions {
    PerJoint push = 0.0, offset = 0.0;
    double pushAt_s = 0.0, push_s = 1.0, offsetAt_s = 0.0, faultAt_s = 0.0;
    std::string fault = "none";
    std::int64_t faultTicks = 0;

    template <class V>
    void describe(V& v) {
        v(push, "push_Nm", "Nm", "On each joint, while it lasts.");
        v(pushAt_s, "push_at_s", "s", "When it begins.").atLeast(0);
        v(push_s, "push_s", "s", "How long it lasts.").atLeast(0);
        v(offset, "offset_rad", "rad", "Error of the readings.");
        v(offsetAt_s, "offset_at_s", "s", "From when on.").atLeast(0);
        v(fault, "fault", "none|nan|huge|size", "Of the reading of the external torque.");
        v(faultAt_s, "fault_at_s", "s", "When it begins.").atLeast(0);
        v(faultTicks, "fault_ticks", "How long it lasts.").atLeast(0);
    }
};

/** The nominal arm's own dynamics without any loss, pushed from outside; with sensors for that. */
class PushedPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override {
        model_.emplace(setup.robot);
        tick_s_ = setup.tick_s;
        const auto options = parameters.get<PushedPlantOptions>();
        push_ = options.push.expand(setup.size());
        offset_ = options.offset.expand(setup.size());
        push0_ = toTick(options.pushAt_s);
        push1_ = push0_ + toTick(options.push_s);
        offset0_ = toTick(options.offsetAt_s);
        fault_ = options.fault;
        fault0_ = toTick(options.faultAt_s);
        fault1_ = fault0_ + options.faultTicks;
    }
    void reset(const MotionState& start) override {
        tick_ = 0;
        state_ = {start.q, start.qd};
        look();
    }
    const JointState& measured() const override { return measured_; }
    const JointState& actual() const override { return state_; }
    const JointVector* externalTorque() const override { return &external_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        model_->calcDynamics(state_.q, state_.qd, dynamics_);
        const JointVector load = torque + calcPush() - dynamics_.b, qdd = dynamics_.M.llt().solve(load);
        state_.q += tick_s_ * state_.qd + 0.5 * tick_s_ * tick_s_ * qdd;
        state_.qd += tick_s_ * qdd;
        applied = torque;
        ++tick_;
        look();
        return TickStatus::Ok;
    }

private:
    std::int64_t toTick(double t) const { return std::llround(t / tick_s_); }
    JointVector calcPush() const { return tick_ >= push0_ && tick_ < push1_ ? push_ : JointVector(0.0 * push_); }
    void look() {
        measured_ = state_;
        if (tick_ >= offset0_) measured_.q += offset_;
        external_ = calcPush();
        if (tick_ < fault0_ || tick_ >= fault1_) return;
        if (fault_ == "nan") external_[0] = kNan;
        if (fault_ == "huge") external_[0] = 1e300;
        if (fault_ == "size") external_.resize(external_.size() - 1);
    }

    std::optional<RobotModel> model_;
    Dynamics dynamics_;
    double tick_s_ = 0.0;
    JointVector push_, offset_, external_;
    std::int64_t tick_ = 0, push0_ = 0, push1_ = 0, offset0_ = 0, fault0_ = 0, fault1_ = 0;
    std::string fault_;
    JointState state_, measured_;
};

}  // namespace

VIABLE_PLUGIN(viable::RealPlant, PushedPlant, "pushed",
              "The nominal arm's dynamics, pushed from outside, with readings that may be wrong.", PushedPlantOptions)
