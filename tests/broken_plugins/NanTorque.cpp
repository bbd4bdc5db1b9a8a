
#include "BrokenPlugin.h"

namespace {

struct NanTorqueOptions {
    broken::FaultWindow window;
    bool isInfinite = false;
    std::int64_t joint = -1;

    template <class V>
    void describe(V& v) {
        window.describe(v);
        v(isInfinite, "value", "nan|inf", "What it gives.");
        v(joint, "joint", "Only of this joint; -1: of all.").atLeast(-1);
    }
};

class NanTorque : public broken::Controller {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        const auto options = parameters.get<NanTorqueOptions>();
        window_ = options.window;
        value_ =
            options.isInfinite ? std::numeric_limits<double>::infinity() : std::numeric_limits<double>::quiet_NaN();
        joint_ = options.joint;
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
              "Says Ok and gives no number for `ticks` ticks after the first `after_ticks`.", NanTorqueOptions)
