#include <CLI/CLI.hpp>

#include "Commands.h"
#include "ExperimentArguments.h"
#include "config/Draws.h"
#include "core/ErrorList.h"
#include "experiment/CaseForecast.h"
#include "records/WorkShare.h"

namespace viable {

namespace {

/** Runs that are tried of a file with drawn values. */
constexpr int kTriedRuns = 10;

struct CheckArguments {
    std::string file, draw;
    std::vector<std::string> overrides;
};

/** Tells of one case. Returns the number of warnings. @param last  what was told of the case before; gets this one's */
int tell(const ConfiguredCase& configured, CaseForecast& last) {
    const CasePlan& plan = configured.plan;
    const CaseForecast forecast = forecastCase(configured);
    std::printf("%s: robot %s, %d joints, %g s at %g Hz, filter %s: ok\n", plan.name.c_str(), plan.robot.name.c_str(),
                plan.robot.size(), plan.duration_s, 1.0 / plan.tick_s, plan.filterName().c_str());
    if (!forecast.gains.empty() && forecast.gains != last.gains) std::printf("  gains    %s\n", forecast.gains.c_str());
    if (!forecast.push.empty() && forecast.push != last.push) std::printf("  push     %s\n", forecast.push.c_str());
    if (!forecast.motors.empty() && forecast.motors != last.motors)
        std::printf("  motors   %s\n", forecast.motors.c_str());
    if (!forecast.limits.empty() && forecast.limits != last.limits)
        std::printf("  limits   %s\n", forecast.limits.c_str());
    const bool isListed = forecast.people != last.people && !forecast.people.empty();
    if (isListed)
        for (const std::string& person : forecast.people)
            std::printf("  %-8s %s\n", &person == &forecast.people.front() ? "people" : "", person.c_str());
    if (!forecast.keepsApart)
        std::printf("  %-8s are not known to the filter %s\n", isListed ? "" : "people", plan.filterName().c_str());
    for (const std::string& warning : forecast.warnings) std::printf("  WARNING  %s\n", warning.c_str());
    last = forecast;
    for (const auto& watch : configured.watches)
        if (!watch->sharedChange.empty())
            std::fprintf(stderr, "viable: warning: case %s: %s\n", plan.name.c_str(),
                         formatSharedChange(*watch).c_str());
    return static_cast<int>(forecast.warnings.size());
}

/** Returns the number of warnings. */
int checkOne(const Experiment& experiment, bool tells) {
    int warnings = 0;
    CaseForecast last;
    detail::ErrorList errors;
    for (const CasePlan& plan : experiment.cases) {
        if (errors.isFull()) break;
        errors.collect([&] {
            const auto configured = configureCase(plan);
            if (tells) warnings += tell(*configured, last);
        });
    }
    errors.throwIfAny(experiment.file.string());
    return warnings;
}

/** Some runs, and each drawn value at each of its ends, the others as in run 0. */
int checkDraws(const CheckArguments& arguments, const ConfigNode& root, const std::vector<DrawnKey>& draws,
               const PluginLoader& loader) {
    int warnings = 0;
    std::size_t ends = 0, all = kTriedRuns;
    for (const DrawnKey& draw : draws) all += draw.ends.size();
    const auto tellShare = [&](std::size_t done) {
        WorkShare::tell("trying draws", static_cast<double>(done) / static_cast<double>(all));
    };
    const auto check = [&](std::int64_t run, const std::map<std::string, std::string>& held, const std::string& what) {
        ConfigNode drawn = root;
        resolveDraws(drawn, {1, run}, held);
        try {
            warnings += checkOne(
                readExperiment(drawn, arguments.file, arguments.overrides, loader, makeRobotSearchPath(arguments.file)),
                run == 0 && held.empty());
        } catch (const Error& e) {
            tellShare(all);
            throw Error(e.kind(), what, e.what());
        }
    };
    for (int run = 0; run < kTriedRuns; ++run) {
        tellShare(static_cast<std::size_t>(run));
        check(run, {}, "--draw 1:" + std::to_string(run));
    }
    for (const DrawnKey& draw : draws)
        for (const std::string& end : draw.ends) {
            tellShare(kTriedRuns + ends);
            check(0, {{draw.keyPath, end}}, "--draw 1:0 --set " + draw.keyPath + "=" + end);
            ++ends;
        }
    tellShare(all);
    std::printf("%zu values drawn; %d runs and %zu ends of their ranges tried\n", draws.size(), kTriedRuns, ends);
    return warnings;
}

}  // namespace

void addCheckCommand(CLI::App& app, int&) {
    auto arguments = std::make_shared<CheckArguments>();
    CLI::App* command = app.add_subcommand(
        "check", "Read an experiment file, configure every case and say what will fail, without a run");
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_option("--draw", arguments->draw,
                        "SEED:INDEX, the values of one run of `viable sweep` (default: runs 0 to 9 of seed 1 and the "
                        "ends of every range)");
    command->callback([arguments] {
        const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
        const ConfigNode root = readExperimentTree(arguments->file, arguments->overrides);
        const std::vector<DrawnKey> draws = listDraws(root);
        const int warnings =
            !draws.empty() && arguments->draw.empty()
                ? checkDraws(*arguments, root, draws, loader)
                : checkOne(readDrawnExperiment(arguments->file, arguments->overrides, arguments->draw, loader), true);
        if (warnings == 0)
            std::printf("%s: ok\n", arguments->file.c_str());
        else
            std::printf("%s: can be run, with %d warning%s\n", arguments->file.c_str(), warnings,
                        warnings == 1 ? "" : "s");
    });
}

}  // namespace viable
