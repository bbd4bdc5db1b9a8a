#include <cmath>

#include "BrokenPlugin.h"

namespace {

struct JumpingSetpointOptions {
    double every_s = 0.5;

    template <class V>
    void describe(V& v) {
        v(every_s, "every_s", "s", "Time between two jumps.").above(0.0);
    }
};

class JumpingSetpoint : public broken::Command {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        every_s_ = parameters.get<JumpingSetpointOptions>().every_s;
    }
    viable::TickStatus sample(double t, viable::MotionCommand& out) override {
        const double offsets[] = {0.0, 6.283185307179586, 0.0, 1e6, -1e6};  // [rad]
        const auto jumps = static_cast<std::int64_t>(std::floor(t / every_s_));
        return setPoint(offsets[jumps % 5], out);
    }

private:
    double every_s_ = 0.0;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, JumpingSetpoint, "jumping_setpoint",
              "Jumps between the start, 2 pi and 1e6 rad away from it.", JumpingSetpointOptions)
