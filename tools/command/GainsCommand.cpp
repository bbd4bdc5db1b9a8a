#include <CLI/CLI.hpp>

#include "Commands.h"
#include "core/Text.h"
#include "loop/Authority.h"
#include "summary/Sliding.h"
#include "tracking/InertiaSample.h"
#include "viable/robot/RobotModel.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

struct GainsArguments {
    std::string robot;
    double tick_s = 0.001;
    int delayTicks = 0;
};

void run(const GainsArguments& arguments) {
    if (!(arguments.tick_s >= kShortestTick_s && arguments.tick_s <= kLongestTick_s))
        throw badInput("--tick", detail::formatNumber(arguments.tick_s) + " s is outside [1e-05, 0.1]",
                       "Give the length of a tick of the control loop in seconds, such as 0.001.");
    const RobotDescription robot = loadRobot(findRobot(arguments.robot, makeRobotSearchPath({}), "ROBOT"));
    requireDynamics(robot, "ROBOT", "the robust loop");
    const LinearErrorLoop loop = scaleGains(robot, robot.limits, arguments.tick_s, arguments.delayTicks);
    const LoopMargins margins = calcMargins(robot, robot.limits, arguments.tick_s, arguments.delayTicks, loop);
    if (!(loop.kr.maxCoeff() > 0.0))
        throw badInput(robot.folder.string(), "no pose of the robot has a usable inertia matrix",
                       "`viable check` says what is wrong with the robot.");
    const JointVector largest = findLargestGains(robot, robot.limits, arguments.tick_s, arguments.delayTicks);
    const detail::InertiaRange range = detail::findInertiaRange(detail::sampleInertia(robot, robot.limits, 1000));

    std::printf(
        "%s at a tick of %s s%s: gains of the robust loop that the arm carries in every pose\n", robot.name.c_str(),
        detail::formatNumber(arguments.tick_s).c_str(),
        arguments.delayTicks > 0 ? detail::format(" and a delay of %d ticks", arguments.delayTicks).c_str() : "");
    int width = 5;
    for (const JointDescription& joint : robot.joints) width = std::max(width, static_cast<int>(joint.name.size()));
    const Sliding sliding = findSliding(robot);
    const bool isMixed = sliding == Sliding::Some;
    std::printf("%-*s  %17s %8s %8s   %-19s  %-17s%s\n", width, "joint",
                choose(sliding, "K_r [Nms/rad]", "K_r", "K_r [Ns/m]"), "k_p", "k_i",
                choose(sliding, "inertia [kg m^2]", "inertia", "mass [kg]"), "unstable from k_r",
                isMixed ? "  in" : "");
    for (int i = 0; i < robot.size(); ++i) {
        const auto calcGain = [&](double inertia) {
            return 1.0 / (1.0 / loop.kr[i] + 1.0 / (loop.inertiaRate * inertia));
        };
        const char* const units = !isMixed ? "" : robot.slides(i) ? "  Ns/m, kg" : "  Nms/rad, kg m^2";
        std::printf("%-*s  %17s %8.4g %8.4g   %-19s  %-17.4g%s\n", width, robot.joints[i].name.c_str(),
                    detail::format("%.3g to %.3g", calcGain(range.least[i]), calcGain(range.greatest[i])).c_str(),
                    loop.kp[i], loop.ki[i], detail::format("%.3g to %.3g", range.least[i], range.greatest[i]).c_str(),
                    largest[i], units);
    }
    std::printf(
        "K_r follows the inertia of the pose: (1/600 + (%.4g/s M(q))^-1)^-1. Margins: %s (at least 6 dB and 35 "
        "degrees).\n"
        "No product is larger than on the paper's Indy7: K_r 600 Nms/rad, K_r k_p 12000 Nm/rad, K_r k_i 4800 Nm/(rad "
        "s).\n"
        "`robust_loop: {plugin: nric}` takes these gains by itself.\n"
        "inertia: the least with the other joints free, and the greatest of the joint alone, over all poses; rotors "
        "included.\n"
        "unstable from k_r: a loop with these, the same in all poses and for all joints at once, is at the edge of "
        "instability.\n",
        loop.inertiaRate, formatMargins(margins).c_str());
    if (arguments.delayTicks == 0) {
        const LinearErrorLoop constant = detail::scaleConstantGains(robot, robot.limits, arguments.tick_s);
        const LoopMargins left = calcMargins(robot, robot.limits, arguments.tick_s, 0, constant);
        std::printf("Constant ones, for a tracking bound (margins: %s%s):\n  robust_loop: {plugin: nric, %s}\n",
                    formatMargins(left).c_str(), left.isEnough() ? "" : "; too little to rely on",
                    detail::formatGains(constant).c_str());
    }
    const JointVector still = JointVector::Zero(robot.size());
    RunSetup setup{robot, robot.limits, arguments.tick_s, kInfinity, {robot.home, still, still}, {}};
    setup.delayTicks = arguments.delayTicks;
    Dynamics dynamics;
    RobotModel(robot).calcDynamics(robot.home, still, dynamics);
    const detail::Authority authority(setup, detail::calcAuthority(setup, &loop, nullptr));
    std::printf(
        "Added to what moves the nominal arm, without a disturbance_set: %s in the home pose. Twice the viscous "
        "friction of a moving joint comes on top.\n",
        detail::tellPush(robot, authority, dynamics.J).c_str());
    if (robot.actuation.rotorInertia.maxCoeff() == 0.0)
        std::printf("No rotor inertias are given (actuation.yaml): with them light joints carry more.\n");
}

}  // namespace

void addGainsCommand(CLI::App& app, int&) {
    auto arguments = std::make_shared<GainsArguments>();
    CLI::App* command = app.add_subcommand("gains", "Gains of the robust loop that a robot carries, and why");
    command->add_option("ROBOT", arguments->robot, "Name or folder of a robot")->required();
    command->add_option("--tick", arguments->tick_s, "Length of a tick [s] (default: 0.001)");
    command->add_option("--delay", arguments->delayTicks, "Ticks from a torque to the motors (default: 0)")
        ->check(CLI::Range(0, 20));
    command->callback([arguments] { run(*arguments); });
}

}  // namespace viable
