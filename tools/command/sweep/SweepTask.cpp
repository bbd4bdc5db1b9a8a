#include "SweepTask.h"

#include "command/Commands.h"
#include "command/ExperimentArguments.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "experiment/CaseRun.h"

namespace viable {

/** Runs of which one at least must be well configured: they say which joints there are. */
constexpr std::int64_t kTriedRuns = 10;

/** Without the places of plugin libraries, which differ from machine to machine: the plugins are named. */
static std::string hidePlaces(std::string message, const std::set<std::filesystem::path>& libraries) {
    for (const std::filesystem::path& library : libraries) {
        message = detail::replaceAll(std::move(message), " (" + library.string() + ")", "");
        message = detail::replaceAll(std::move(message), library.string(), library.filename().string());
    }
    return message;
}

/** A draw in another case's block is none of this one. */
static bool belongsTo(const std::string& keyPath, const std::string& caseName) {
    const std::string cases = "cases.";
    return keyPath.compare(0, cases.size(), cases) != 0 ||
           keyPath.compare(cases.size(), caseName.size() + 1, caseName + ".") == 0;
}

/** The bound of a case is known to every run then. What its plugins complain of is for the runs to tell. */
static void readBound(const CasePlan& plan) {
    if (!plan.disturbances) return;
    try {
        applyBound(plan, *configureTracking(plan));
    } catch (const Error& e) {
        if (e.kind() != ErrorKind::PluginFailed) throw;
    }
}

SweepTask::SweepTask(const SweepArguments& arguments)
    : arguments_(arguments),
      loader_(PluginLoader::makeDefaultSearchPath()),
      robotPath_(makeRobotSearchPath(arguments.file)),
      root_(readExperimentTree(arguments.file, arguments.overrides)) {
    const std::vector<DrawnKey> draws = listDraws(root_);
    if (draws.empty())
        throw badInput(arguments.file, "nothing in this file is drawn, so all runs would be the same",
                       "Write a value such as ~uniform(0, 1) in place of a number.");
    Experiment first;
    for (std::int64_t run = 0; first.cases.empty(); ++run) {
        try {
            Experiment tried = read(run, nullptr);
            Experiment chosen = tried;
            selectCases(chosen, arguments.cases);
            for (const CasePlan& plan : chosen.cases) readBound(plan);
            first = std::move(tried);
        } catch (const Error&) {
            if (run + 1 == kTriedRuns || run + 1 >= arguments.runs) throw;
        }
    }
    plan_.title = first.title;
    plan_.file = arguments.file;
    plan_.experiment = readWhole(arguments.file).value_or("");
    const SweepFiles files = findFiles(first, draws);
    libraries_ = files.libraries;
    plan_.fileHash = calcSweepHash(plan_.experiment, arguments.overrides, files);
    plan_.seed = arguments.seed;
    plan_.runs = arguments.runs;
    selectCases(first, arguments.cases);
    for (const CasePlan& plan : first.cases) {
        plan_.cases.push_back(plan.name);
        for (const std::string& joint : plan.robot.jointNames())
            if (std::find(plan_.joints.begin(), plan_.joints.end(), joint) == plan_.joints.end())
                plan_.joints.push_back(joint);
    }
    std::vector<std::pair<std::string, std::string>> keys;
    for (const DrawnKey& draw : draws)
        if (std::any_of(plan_.cases.begin(), plan_.cases.end(),
                        [&](const std::string& name) { return belongsTo(draw.keyPath, name); }))
            keys.emplace_back(draw.keyPath, draw.distribution);
    plan_.columns = makeSweepColumns(keys, plan_.joints);
}

/** Of the first run, and of each alternative to what it has drawn. */
SweepFiles SweepTask::findFiles(const Experiment& first, const std::vector<DrawnKey>& draws) const {
    SweepFiles files = findSweepFiles(first);
    for (const DrawnKey& draw : draws) {
        if (!draw.isOfWords) continue;  // numbers choose no file
        for (const std::string& alternative : draw.ends)
            for (std::int64_t run = 0; run < kTriedRuns; ++run) {
                try {
                    files.add(findSweepFiles(read(run, nullptr, {{draw.keyPath, alternative}})));
                    break;
                } catch (const Error&) {  // does not go with what else is drawn: another run may
                }
            }
    }
    return files;
}

Experiment SweepTask::read(std::int64_t run, std::map<std::string, std::string>* draws,
                           const std::map<std::string, std::string>& held) const {
    ConfigNode drawn = root_;
    std::map<std::string, std::string> values = resolveDraws(drawn, {arguments_.seed, run}, held);
    if (draws) *draws = std::move(values);
    return readExperiment(drawn, arguments_.file, arguments_.overrides, loader_, robotPath_);
}

SweepRow SweepTask::makeRow(std::int64_t run, const std::string& name, SweepEnd end,
                            const std::map<std::string, std::string>& draws, const CaseResult* result) const {
    end.replay = "viable run " + detail::quoteForShell(arguments_.file) + " --draw " + std::to_string(arguments_.seed) +
                 ":" + std::to_string(run) + " --case " + name;
    for (const std::string& assignment : arguments_.overrides)
        end.replay += " --set " + detail::quoteForShell(assignment);
    end.message = hidePlaces(end.message, libraries_);
    std::map<std::string, std::string> own;
    for (const auto& [keyPath, value] : draws)
        if (belongsTo(keyPath, name)) own[keyPath] = value;
    return makeSweepRow(plan_.columns, run, name, end, own, result);
}

SweepRow SweepTask::makeLostRow(std::int64_t run, std::size_t index, SweepStatus status,
                                const std::string& message) const {
    ConfigNode drawn = root_;
    const SweepEnd end{status, static_cast<int>(ErrorKind::PluginFailed), message, "", kNan};
    return makeRow(run, plan_.cases[index], end, resolveDraws(drawn, {arguments_.seed, run}), nullptr);
}

SweepTask::Run::Run(const SweepTask& task, std::int64_t run) : task_(task), run_(run) {
    try {
        experiment_ = task.read(run, &draws_);
    } catch (const Error& e) {
        failure_ = e.what();
        exitCode_ = e.exitCode();
    }
}

SweepRow SweepTask::Run::runCase(std::size_t index, const std::atomic<int>& stop) const {
    const std::string& name = task_.plan_.cases[index];
    SweepEnd end;
    const auto begin = std::chrono::steady_clock::now();
    const auto finish = [&](const CaseResult* result) {
        end.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        return task_.makeRow(run_, name, end, draws_, result);
    };
    const auto fail = [&](const std::string& message, int exitCode) {
        end.status = SweepStatus::Failed;
        end.message = message;
        end.exitCode = exitCode;
        return finish(nullptr);
    };
    if (!failure_.empty()) return fail(failure_, exitCode_);
    const auto plan = std::find_if(experiment_.cases.begin(), experiment_.cases.end(),
                                   [&](const CasePlan& other) { return other.name == name; });
    try {
        RunOptions options;
        options.stopRequest = &stop;
        options.isAlone = false;
        const CaseResult result = viable::runCase(configureCase(*plan), options);
        end.status = getSweepStatus(result);
        end.exitCode = result.exitCode();
        end.message = result.stopMessage;
        if (const std::string breach = formatBreach(result); !breach.empty())
            end.message += (end.message.empty() ? "" : "; ") + breach;
        return finish(&result);
    } catch (const Error& e) {
        return fail(e.what(), e.exitCode());
    } catch (const std::exception& e) {
        return fail(std::string("unexpected: ") + e.what(), static_cast<int>(ErrorKind::PluginFailed));
    }
}

}  // namespace viable
