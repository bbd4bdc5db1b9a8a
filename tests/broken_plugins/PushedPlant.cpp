#include <Eigen/Cholesky>
#include <limits>
#include <optional>

#include "BrokenPlugin.h"
#include "viable/robot/RobotModel.h"

namespace {

using namespace viable;

const ParameterSpec kParameters[] = {
    parameter::jointNumbers("push_Nm", "Nm", "0", "On each joint, while it lasts."),
    parameter::number("push_at_s", "s", "0", "When it begins.").atLeast(0),
    parameter::number("push_s", "s", "1", "How long it lasts.").atLeast(0),
    parameter::jointNumbers("offset_rad", "rad", "0", "Error of the readings."),
    parameter::number("offset_at_s", "s", "0", "From when on.").atLeast(0),
    parameter::choice("fault", "none|nan|huge|size", "none", "Of the reading of the external torque."),
    parameter::number("fault_at_s", "s", "0", "When it begins.").atLeast(0),
    parameter::integer("fault_ticks", "0", "How long it lasts.").atLeast(0)};

/** The nominal arm's own dynamics without any loss, pushed from outside; with sensors for that. */
class PushedPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override {
        model_.emplace(setup.robot);
        tick_s_ = setup.tick_s;
        push_ = parameters.jointNumbers("push_Nm");
        offset_ = parameters.jointNumbers("offset_rad");
        push0_ = toTick(parameters.number("push_at_s"));
        push1_ = push0_ + toTick(parameters.number("push_s"));
        offset0_ = toTick(parameters.number("offset_at_s"));
        fault_ = parameters.text("fault");
        fault0_ = toTick(parameters.number("fault_at_s"));
        fault1_ = fault0_ + parameters.integer("fault_ticks");
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
        const JointVector load = torque + calcPush() - dynamics_.b;
        const JointVector qdd = dynamics_.M.llt().solve(load);
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
        if (fault_ == "nan") external_[0] = std::numeric_limits<double>::quiet_NaN();
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
              "The nominal arm's dynamics, pushed from outside, with readings that may be wrong.", kParameters)
