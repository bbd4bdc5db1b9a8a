#include <CLI/CLI.hpp>
#include <memory>

#include "Commands.h"
#include "core/Text.h"
#include "summary/Sliding.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

static void describe(const RobotDescription& robot) {
    std::printf("%s: %d joints, tool frame %s, folder %s\n", robot.name.c_str(), robot.size(), robot.toolLink.c_str(),
                robot.folder.c_str());
    int width = 15;
    for (const JointDescription& joint : robot.joints) width = std::max(width, static_cast<int>(joint.name.size()));
    const Sliding sliding = findSliding(robot);
    const bool isMixed = sliding == Sliding::Some;
    const auto head = [&](const char* quantity, LimitKind kind) {
        return std::string(quantity) +
               (isMixed ? "" : std::string(" [") + getUnit(kind, sliding == Sliding::All) + "]");
    };
    std::printf("%-*s %-22s %-20s %-20s %-20s %-9s %-10s%s\n", width, "joint",
                head("position", LimitKind::Position).c_str(), head("velocity", LimitKind::Velocity).c_str(),
                head("accel.", LimitKind::Acceleration).c_str(), head("jerk", LimitKind::Jerk).c_str(), "home",
                head("motor", LimitKind::Torque).c_str(), isMixed ? " in" : "");
    for (int i = 0; i < robot.size(); ++i) {
        const JointDescription& joint = robot.joints[i];
        const AxisLimits l = robot.limits.axis(i);
        const auto range = [](double lower, double upper) { return detail::format("%.4g .. %.4g", lower, upper); };
        const char* const units = !isMixed ? "" : robot.slides(i) ? " m, s, N" : " rad, s, Nm";
        std::printf("%-*s %-22s %-20s %-20s %-20s %-9.4g %-10.4g%s\n", width, joint.name.c_str(),
                    range(l.positionLower, l.positionUpper).c_str(), range(l.velocityLower, l.velocityUpper).c_str(),
                    range(l.accelerationLower, l.accelerationUpper).c_str(), range(l.jerkLower, l.jerkUpper).c_str(),
                    robot.home[i], robot.actuation.torqueLimit[i], units);
    }
    if (!robot.hasDynamics()) std::printf("It takes positions: no masses and motors are known (`dynamics: none`).\n");
    if (!robot.assumed.empty()) std::printf("Assumed, not given: %s.\n", detail::join(robot.assumed).c_str());
}

void addRobotsCommand(CLI::App& app, int&) {
    auto name = std::make_shared<std::string>();
    CLI::App* command = app.add_subcommand("robots", "List the robots, or describe one");
    command->add_option("--describe", *name, "Name or folder of a robot: print its limits");
    command->callback([name] {
        const auto path = makeRobotSearchPath({});
        if (!name->empty()) return describe(loadRobot(findRobot(*name, path, "--describe")));
        const auto folders = listRobots(path);
        for (const auto& folder : folders) {
            try {
                const RobotDescription robot = loadRobot(folder);
                std::printf("%-16s %d joints  %s\n", robot.name.c_str(), robot.size(), folder.c_str());
            } catch (const Error& e) {
                std::fprintf(stderr, "viable: refused %s: %s\n", folder.c_str(), e.what());
            }
        }
        if (folders.empty()) {
            std::string tried;
            for (const auto& folder : path) tried += "\n  " + folder.string();
            throw badInput("", "no robot was found; these folders were searched:" + tried, "Set VIABLE_ROBOT_PATH.");
        }
    });
}

}  // namespace viable
