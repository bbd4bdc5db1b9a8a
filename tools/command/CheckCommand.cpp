#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "Commands.h"
#include "ExperimentArguments.h"
#include "config/Draws.h"
#include "experiment/ConfiguredCase.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** Runs that are tried of a file with drawn values. */
constexpr int kTriedRuns = 10;

struct CheckArguments {
    std::string file;
    std::vector<std::string> overrides;
    std::string draw;
};

void checkOne(const Experiment& experiment, bool tells) {
    for (const CasePlan& plan : experiment.cases) {
        configureCase(plan);
        if (tells)
            std::printf("%s: robot %s, %d joints, %g s at %g Hz, filter %s: ok\n", plan.name.c_str(),
                        plan.robot.name.c_str(), plan.robot.size(), plan.duration_s, 1.0 / plan.tick_s,
                        plan.filterName().c_str());
    }
}

/** Some runs, and each drawn value at each of its ends, the others as in run 0. */
void checkDraws(const CheckArguments& arguments, const ConfigNode& root, const std::vector<DrawnKey>& draws,
                const PluginLoader& loader) {
    const auto check = [&](std::int64_t run, const std::map<std::string, std::string>& held, const std::string& what) {
        ConfigNode drawn = root;
        resolveDraws(drawn, {1, run}, held);
        try {
            checkOne(
                readExperiment(drawn, arguments.file, arguments.overrides, loader, makeRobotSearchPath(arguments.file)),
                run == 0 && held.empty());
        } catch (const Error& e) {
            throw Error(e.kind(), what, e.what());
        }
    };
    for (int run = 0; run < kTriedRuns; ++run) check(run, {}, "--draw 1:" + std::to_string(run));
    std::size_t ends = 0;
    for (const DrawnKey& draw : draws)
        for (const std::string& end : draw.ends) {
            check(0, {{draw.keyPath, end}}, "--draw 1:0 --set " + draw.keyPath + "=" + end);
            ++ends;
        }
    std::printf("%zu values drawn; %d runs and %zu ends of their ranges tried\n", draws.size(), kTriedRuns, ends);
}

}  // namespace

void addCheckCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<CheckArguments>();
    CLI::App* command = app.add_subcommand("check", "Read an experiment file and configure every case, without a run");
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_option("--draw", arguments->draw,
                        "SEED:INDEX, the values of one run of `viable sweep` (default: runs 0 to 9 "
                        "of seed 1 and the ends of every range)");
    command->callback([arguments, &exitCode] {
        const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
        const ConfigNode root = readExperimentTree(arguments->file, arguments->overrides);
        const std::vector<DrawnKey> draws = listDraws(root);
        if (draws.empty() || !arguments->draw.empty())
            checkOne(readDrawnExperiment(arguments->file, arguments->overrides, arguments->draw, loader), true);
        else
            checkDraws(*arguments, root, draws, loader);
        std::printf("%s: ok\n", arguments->file.c_str());
        exitCode = 0;
    });
}

}  // namespace viable
