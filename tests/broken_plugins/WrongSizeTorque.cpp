#include "BrokenPlugin.h"

namespace {

class WrongSizeTorque : public broken::Controller {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        window_ = parameters.get<broken::FaultWindow>();
    }
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override {
        const viable::TickStatus status = Controller::compute(input, output);
        if (window_.contains(ticks_)) output.torque.setZero(input.dynamics.b.size() + 1);
        return status;
    }

private:
    broken::FaultWindow window_;
};

}  // namespace

VIABLE_PLUGIN(viable::NominalController, WrongSizeTorque, "wrong_size_torque",
              "Says Ok and gives one torque too many for `ticks` ticks after the first `after_ticks`.",
              broken::FaultWindow)
