#include <limits>
#include <stdexcept>
#include <string>

#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {
    broken::kAfterTicks,
    viable::parameter::choice("mode", "faulted|nan_state|wrong_size|throw_measured|throw_advance", "faulted",
                              "How it fails."),
    viable::parameter::integer("delay_ticks", "0", "What its traits() tell."),
    viable::parameter::integer("rates", "0", "How many numbers its motorRate has."),
    viable::parameter::number("rate_Nmps", "Nm/s", "1000", "Each of them.")};

/** Stands still until it fails. */
class FailingPlant : public viable::RealPlant {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        afterTicks_ = parameters.integer("after_ticks");
        mode_ = parameters.text("mode");
        delayTicks_ = static_cast<int>(parameters.integer("delay_ticks"));
        rate_.setConstant(parameters.integer("rates"), parameters.number("rate_Nmps"));
    }
    viable::PlantTraits traits() const override { return {viable::Encoder::Counts, delayTicks_, rate_}; }
    void reset(const viable::MotionState& start) override {
        ticks_ = 0;
        state_ = {start.q, start.qd};
    }
    const viable::JointState& measured() const override {
        if (mode_ == "throw_measured" && ticks_ > afterTicks_) throw std::runtime_error("sensor lost");
        return state_;
    }
    const viable::JointState& actual() const override { return state_; }
    viable::TickStatus advance(const viable::JointVector& torque, viable::JointVector& applied) override {
        applied = torque;
        if (++ticks_ <= afterTicks_) return viable::TickStatus::Ok;
        if (mode_ == "faulted") return viable::TickStatus::Faulted;
        if (mode_ == "throw_advance") throw std::runtime_error("motor lost");
        if (mode_ == "nan_state") state_.q.setConstant(std::numeric_limits<double>::quiet_NaN());
        if (mode_ == "wrong_size") state_.q.resize(1);
        return viable::TickStatus::Ok;
    }

private:
    std::int64_t afterTicks_ = 0, ticks_ = 0;
    int delayTicks_ = 0;
    viable::JointVector rate_;
    std::string mode_;
    viable::JointState state_;
};

}  // namespace

VIABLE_PLUGIN(viable::RealPlant, FailingPlant, "failing_plant", "Fails in a chosen way after `after_ticks`.",
              kParameters)
