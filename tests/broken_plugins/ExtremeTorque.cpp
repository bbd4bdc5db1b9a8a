
#include "BrokenPlugin.h"

namespace {

struct ExtremeTorque : broken::Controller {
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override {
        const viable::TickStatus status = Controller::compute(input, output);
        const double cycle[] = {1e300, -1e300, std::numeric_limits<double>::denorm_min(),
                                -std::numeric_limits<double>::denorm_min()};
        output.torque.setConstant(cycle[(ticks_ - 1) % 4]);
        return status;
    }
};

}  // namespace

VIABLE_PLUGIN(viable::NominalController, ExtremeTorque, "extreme_torque",
              "Cycles through +1e300, -1e300 and both smallest denormal numbers, tick by tick.", viable::NoOptions)
