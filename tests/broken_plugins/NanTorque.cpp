
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
        options_ = parameters.get<NanTorqueOptions>();
    }
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override {
        const viable::TickStatus status = Controller::compute(input, output);
        if (!options_.window.contains(ticks_)) return status;
        const double value = options_.isInfinite ? viable::kInfinity : viable::kNan;
        if (options_.joint < 0)
            output.torque.setConstant(value);
        else
            output.torque[options_.joint] = value;
        return status;
    }

private:
    NanTorqueOptions options_;
};

}  // namespace

VIABLE_PLUGIN(viable::NominalController, NanTorque, "nan_torque",
              "Says Ok and gives no number for `ticks` ticks after the first `after_ticks`.", NanTorqueOptions)
