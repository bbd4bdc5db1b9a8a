
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
        options_ = parameters.get<FailingPlantOptions>();
        rate_.setConstant(options_.rates, options_.rate);
    }
    viable::PlantTraits traits() const override { return {viable::Encoder::Counts, options_.delayTicks, rate_}; }
    void reset(const viable::MotionState& start) override {
        ticks_ = 0;
        state_ = {start.q, start.qd};
    }
    const viable::JointState& measured() const override {
        if (options_.mode == "throw_measured" && ticks_ > options_.late.afterTicks)
            throw std::runtime_error("sensor lost");
        return state_;
    }
    const viable::JointState& actual() const override { return state_; }
    viable::TickStatus advance(const viable::JointVector& torque, viable::JointVector& applied) override {
        applied = torque;
        if (++ticks_ <= options_.late.afterTicks) return viable::TickStatus::Ok;
        if (options_.mode == "faulted") return viable::TickStatus::Faulted;
        if (options_.mode == "throw_advance") throw std::runtime_error("motor lost");
        if (options_.mode == "nan_state") state_.q.setConstant(std::numeric_limits<double>::quiet_NaN());
        if (options_.mode == "wrong_size") state_.q.resize(1);
        return viable::TickStatus::Ok;
    }

private:
    FailingPlantOptions options_;
    std::int64_t ticks_ = 0;
    viable::JointVector rate_;
    viable::JointState state_;
};

}  // namespace

VIABLE_PLUGIN(viable::RealPlant, FailingPlant, "failing_plant", "Fails in a chosen way after `after_ticks`.",
              FailingPlantOptions)
