#include <limits>

#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {broken::kAfterTicks, broken::kTicks};

class NanTorque : public broken::Controller {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        window_.configure(parameters);
    }
    viable::TickStatus compute(const viable::MotionCommand& command,
                               const viable::MotionState& nominal, const viable::Dynamics& dynamics,
                               viable::JointVector& torque) override {
        const viable::TickStatus status = Controller::compute(command, nominal, dynamics, torque);
        if (window_.contains(ticks_)) torque.setConstant(std::numeric_limits<double>::quiet_NaN());
        return status;
    }

private:
    broken::FaultWindow window_;
};

}  // namespace

VIABLE_PLUGIN(viable::NominalController, NanTorque, "nan_torque",
              "Says Ok and gives NaN for `ticks` ticks after the first `after_ticks`.", kParameters)
