#include "viable/plugin/PluginExport.h"
#include "viable/tracking/Nric.h"

namespace {

using namespace viable;

const ParameterSpec kParameters[] = {
    parameter::jointNumbers("k_r", "Nms/rad", "auto", "Gain on the whole error term; auto: what the arm can carry.")
        .atLeast(0)
        .orAuto(),
    parameter::jointNumbers("k_p", "1/s", "auto", "Weight of the position error; auto: as k_r and the arm allow.")
        .atLeast(0)
        .orAuto(),
    parameter::jointNumbers("k_i", "1/s^2", "auto", "Weight of the integral of the position error; likewise.")
        .atLeast(0)
        .orAuto(),
    parameter::jointNumbers("integral_limit_Nm", "Nm", ".inf",
                            "Largest torque of the integral, k_r k_i |integral|; the motor's limit "
                            "where that is less.")
        .above(0)
        .orInfinite(),
    parameter::jointNumbers("torque_rate_Nmps", "Nm/s", ".inf", "Fastest change of the loop's torque.")
        .above(0)
        .orInfinite(),
    parameter::jointNumbers(
        "motor_rate_Nmps", "Nm/s", ".inf",
        "Fastest change of the motor's whole torque, the filter's and the loop's; no tracking bound "
        "covers it.")
        .above(0)
        .orInfinite(),
    parameter::jointNumbers("friction_scale", "", "0.0",
                            "Factor on the friction figures that are fed forward at the nominal velocity; 0: none.")
        .atLeast(0),
    parameter::file("friction_file", "",
                    "Those figures: an actuation.yaml, as of `viable identify`; the robot's own when empty."),
};

}  // namespace

VIABLE_PLUGIN(viable::RobustLoop, viable::Nric, "nric",
              "Nonlinear robust internal-loop compensator: the real arm follows the nominal one.", kParameters)
