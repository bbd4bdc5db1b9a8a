
#include "BrokenPlugin.h"

namespace {

struct FailingPlantOptions {
    broken::LateOptions late;
    std::string mode = "faulted";
    int delayTicks = 0, rates = 0;
    double rate = 1000.0;

    template <class V>
    void describe(V& v) {
        late.describe(v);
        v(mode, "mode", "faulted|nan_state|wrong_size|throw_measured|throw_advance", "How it fails.");
        v(delayTicks, "delay_ticks", "What its traits() tell.");
        v(rates, "rates", "How many numbers its motorRate has.");
        v(rate, "rate_Nmps", "Nm/s", "Each of them.");
    }
};

/** Stands still until it fails. */
class FailingPlant : public viable::RealPlant {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        const auto options = parameters.get<FailingPlantOptions>();
        afterTicks_ = options.late.afterTicks;
        mode_ = options.mode;
        delayTicks_ = options.delayTicks;
        rate_.setConstant(options.rates, options.rate);
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
              FailingPlantOptions)
