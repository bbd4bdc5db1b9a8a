#include <limits>

#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {
    broken::kAfterTicks, broken::kTicks, viable::parameter::choice("value", "nan|inf", "nan", "What it gives."),
    viable::parameter::integer("joint", "-1", "Only of this joint; -1: of all.").atLeast(-1)};

class NanTorque : public broken::Controller {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        window_.configure(parameters);
        value_ = parameters.text("value") == "nan" ? std::numeric_limits<double>::quiet_NaN()
                                                   : std::numeric_limits<double>::infinity();
        joint_ = parameters.integer("joint");
    }
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override {
        const viable::TickStatus status = Controller::compute(input, output);
        if (!window_.contains(ticks_)) return status;
        if (joint_ < 0)
            output.torque.setConstant(value_);
        else
            output.torque[joint_] = value_;
        return status;
    }

private:
    broken::FaultWindow window_;
    double value_ = 0.0;
    std::int64_t joint_ = -1;
};

}  // namespace

VIABLE_PLUGIN(viable::NominalController, NanTorque, "nan_torque",
              "Says Ok and gives no number for `ticks` ticks after the first `after_ticks`.", kParameters)
