#include <CLI/CLI.hpp>
#include <csignal>

#include "Commands.h"
#include "ExperimentArguments.h"
#include "RobotServer.h"
#include "StopSignals.h"
#include "core/Text.h"

namespace viable {

namespace {

struct RobotArguments {
    std::string file, caseName, listen, shm;
    std::optional<std::string> keyFile;
    std::vector<std::string> overrides;
    RobotServerOptions options;
};

int serveRobot(const RobotArguments& arguments) {
    RobotServerOptions options = arguments.options;
    if (!arguments.shm.empty())
        options.address = "shm:" + arguments.shm;
    else if (!arguments.listen.empty())
        options.address = arguments.listen;
    if (arguments.keyFile) {  // also an empty name: nobody is to be served without the key that was asked for
        char error[256];
        if (vl_key_from_file(arguments.keyFile->c_str(), &options.key, error, sizeof error) != 0)
            throw badInput("--key-file " + *arguments.keyFile, error);
    }
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    Experiment experiment = readDrawnExperiment(arguments.file, arguments.overrides, "", loader);
    selectOneCase(experiment, arguments.caseName, "served");
    std::signal(SIGPIPE, SIG_IGN);
    const CasePlan& plan = experiment.cases.front();
    RobotServer server(configureTracking(plan), options);
    const std::atomic<int>& stop = catchStopSignals();
    std::printf("%s (case %s, %s): %d joints, tick %s s, at %s\n", plan.robot.name.c_str(), plan.name.c_str(),
                plan.realPlant->plugin.name.c_str(), plan.robot.size(), detail::formatNumber(plan.tick_s).c_str(),
                server.address().c_str());
    std::fflush(stdout);
    server.run(stop);
    std::printf("%s", server.describe().c_str());
    return 0;
}

}  // namespace

void addRobotCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<RobotArguments>();
    RobotServerOptions& options = arguments->options;
    CLI::App* command = app.add_subcommand(
        "robot",
        "Serve the simulated real arm of a case to the plant `link` of another process, by a clock of its own");
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command->add_option("--case", arguments->caseName, "The case whose real arm is served");
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    CLI::Option* listen = command->add_option("--listen", arguments->listen,
                                              "ADDRESS:PORT of UDP (default: 127.0.0.1:47100; port 0: a free one)");
    command->add_option("--shm", arguments->shm, "NAME of shared memory, in place of UDP")->excludes(listen);
    command->add_option("--key-file", arguments->keyFile, "A key of 32 hexadecimal digits that the host has, too");
    command->add_option("--duration", options.duration_s, "Seconds of its time (default: until it is stopped)")
        ->check(CLI::Range(0.001, 1e9));
    command->add_flag("--stay", options.stays,
                      "Stay where a host has left the arm; else each one finds it at the start");
    command->add_option("--repeat", options.mostRepeats, "No torque is repeated for longer, in ticks (default: 100)")
        ->check(CLI::Range(0, 1000));
    command->add_flag("--adds-gravity", options.addsGravity, "It adds gravity's torque to what it is sent");
    command->add_option("--clock", options.clock, "Its seconds per second (default: 1); 1.01 is 1 % fast")
        ->check(CLI::Range(0.001, 10.0));
    command
        ->add_option("--torque-rate", options.torqueRate,
                     "No torque changes faster, whatever comes, in Nm/s (default: as of the case's motors, else from "
                     "zero to their limit in 25 ms)")
        ->check(CLI::Range(1e-3, 1e12));
    command->add_option("--brake-after", options.brakeAfter, "Close the brakes after so many ticks without commands")
        ->check(CLI::Range(1, 1000000));
    const CLI::Range seconds(0.001, 1e9);
    command->add_option("--brake-at", options.brakeAt_s, "Close the brakes so many seconds after a host came")
        ->check(seconds);
    command->add_option("--fault-at", options.faultAt_s, "Report a fault so many seconds after a host came")
        ->check(seconds);
    const CLI::Range share(0.0, 1.0);
    command->add_option("--lose", options.lose, "Share of packets, in both directions, that are lost")->check(share);
    command->add_option("--burst", options.burst, "Packets in a row that are lost, where one is (default: 1)")
        ->check(CLI::Range(1, 1000000));
    command
        ->add_option("--from", options.from_s,
                     "Packets are lost, doubled, reordered and corrupt only so many seconds after a host came")
        ->check(seconds);
    command->add_option("--duplicate", options.duplicate, "Share of packets that come twice")->check(share);
    command->add_option("--reorder", options.reorder, "Share of packets that come after the next one")->check(share);
    command->add_option("--corrupt", options.corrupt, "Share of packets of which a bit is changed")->check(share);
    command->add_option("--delay", options.delay, "Packets come 0 to so many ticks later")->check(CLI::Range(0, 1000));
    command
        ->add_option_function<double>(
            "--latency", [&options](double latency_ms) { options.latency_s = 1e-3 * latency_ms; },
            "Packets come so many milliseconds later, in both directions")
        ->check(CLI::Range(0.0, 1000.0));
    command->add_option("--seed", options.seed, "Of these faults (default: 1)");
    command->callback([arguments, &exitCode] { exitCode = serveRobot(*arguments); });
}

}  // namespace viable
