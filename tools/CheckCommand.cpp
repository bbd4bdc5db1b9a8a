#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "viable/experiment/CaseRun.h"
#include "viable/experiment/ExperimentFile.h"

namespace viable {

namespace {

struct CheckArguments {
    std::string file;
    std::vector<std::string> overrides;
};

}  // namespace

void addCheckCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<CheckArguments>();
    CLI::App* command = app.add_subcommand(
        "check", "Read an experiment file and configure every case, without a run");
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command
        ->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->callback([arguments, &exitCode] {
        const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
        const Experiment experiment = readExperiment(arguments->file, arguments->overrides, loader,
                                                     makeRobotSearchPath(arguments->file));
        for (const CasePlan& plan : experiment.cases) {
            configureCase(plan);
            std::printf("%s: robot %s, %d joints, %g s at %g Hz, filter %s: ok\n",
                        plan.name.c_str(), plan.robot.name.c_str(), plan.robot.size(),
                        plan.duration_s, 1.0 / plan.tick_s, plan.filterName().c_str());
        }
        std::printf("%s: ok\n", arguments->file.c_str());
        exitCode = 0;
    });
}

}  // namespace viable
