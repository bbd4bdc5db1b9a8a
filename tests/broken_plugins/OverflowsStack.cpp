#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {broken::kAfterTicks};

class OverflowsStack : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        afterTicks_ = parameters.integer("after_ticks");
    }
    viable::FilterStatus filter(const viable::MotionState& nominal,
                                const viable::JointVector& torque, const viable::Dynamics& dynamics,
                                viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(nominal, torque, dynamics, decision);
        if (ticks_ > afterTicks_) ticks_ += dig(ticks_);
        return status;
    }

private:
    std::int64_t afterTicks_ = 0;

    static std::int64_t dig(std::int64_t depth) {
        volatile char room[4096];
        room[0] = static_cast<char>(depth);
        return depth < 0 ? 0 : dig(depth + 1) + room[0];
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, OverflowsStack, "overflows_stack", "Calls itself without end in every tick after the first after_ticks.",
              kParameters)
