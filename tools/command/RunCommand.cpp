#include <CLI/CLI.hpp>
#include <system_error>

#include "Commands.h"
#include "CrashHandler.h"
#include "ExperimentArguments.h"
#include "Progress.h"
#include "RunFolder.h"
#include "StopSignals.h"
#include "core/ErrorList.h"
#include "core/Text.h"
#include "experiment/CaseRun.h"
#include "live/Replay.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

struct RunArguments {
    std::string file, out, draw;
    std::vector<std::string> cases, overrides;
    int jobs = 0;
    bool noReport = false, details = false, again = false, isolate = false;
    std::optional<double> watchdog_s;
};

/** What became of the cases: results in the order of the file, and the first Error that kept one from
starting. */
struct CaseOutcomes {
    std::vector<CaseResult> results;
    std::exception_ptr failure;
};

using ConfiguredCases = std::vector<std::unique_ptr<ConfiguredCase>>;

/** Runs configured cases. After a failure or a signal no further case is begun. */
class CaseRunner {
public:
    CaseRunner(ConfiguredCases cases, fs::path folder)
        : cases_(std::move(cases)), folder_(std::move(folder)), progress_(listNames(cases_)), results_(cases_.size()) {}

    /** `jobs` at a time. */
    CaseOutcomes runAtOnce(int jobs) {
        isAlone_ = jobs == 1;
        std::atomic<int> running{0};
        const auto work = [&] {
            prepareThreadForCrash();
            while (runNext(false)) {
            }
            --running;
        };
        std::vector<std::thread> workers;
        for (int job = 0; job < jobs; ++job) {
            ++running;
            try {
                workers.emplace_back(work);
            } catch (const std::system_error&) {
                // Fewer threads do it too; none is the caller's own turn.
                if (workers.empty())
                    work();
                else
                    --running;
                break;
            }
        }
        while (running > 0) {
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
            progress_.draw();
        }
        for (std::thread& worker : workers) worker.join();
        return collect();
    }

    /** One after the other, in this thread: the plugins' processes end with the thread that made them. */
    CaseOutcomes runHere() {
        while (runNext(true)) {
        }
        return collect();
    }

private:
    static std::vector<std::string> listNames(const ConfiguredCases& cases) {
        std::vector<std::string> names;
        for (const auto& configured : cases) names.push_back(configured->plan.name);
        return names;
    }

    /** False: there is none. */
    bool runNext(bool draws) {
        const std::size_t i = getStopSignal() == 0 ? next_++ : results_.size();
        if (i >= results_.size()) return false;
        RunOptions options;
        options.log = folder_ / (cases_[i]->plan.name + ".mcap");
        options.stopRequest = &getStopSignal();
        options.isAlone = isAlone_;
        options.progress = [this, i, draws](double share) {
            progress_.set(i, share);
            if (draws) progress_.draw();
        };
        try {
            results_[i].emplace(runCase(std::move(cases_[i]), options));
        } catch (...) {
            const std::lock_guard lock(failureMutex_);
            if (!failure_) failure_ = std::current_exception();
            next_ = results_.size();
        }
        return true;
    }

    CaseOutcomes collect() {
        progress_.draw(true);
        CaseOutcomes outcomes;
        outcomes.failure = failure_;
        for (auto& result : results_)
            if (result) outcomes.results.push_back(std::move(*result));
        return outcomes;
    }

    ConfiguredCases cases_;  // null: begun
    const fs::path folder_;
    Progress progress_;
    bool isAlone_ = true;  // the case that runs
    std::vector<std::optional<CaseResult>> results_;
    std::atomic<std::size_t> next_{0};
    std::mutex failureMutex_;
    std::exception_ptr failure_;
};

int replay(const RunArguments& arguments) {
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    const ReplayResult result = replayLog(arguments.file, loader, makeRobotSearchPath(arguments.file));
    if (!result.difference.empty())
        throw badInput(arguments.file,
                       "the replay of " + result.caseName + " differs from the log " + result.difference,
                       "The same version of viable, the same plugins and the same robot give the same bits; `viable "
                       "report` and `viable export` show the log as it is.");
    std::printf("%s: replayed %lld ticks, to %.3f s: all equal to the log, to the bit%s\n", result.caseName.c_str(),
                static_cast<long long>(result.ticks), result.end_s,
                result.isComplete ? ""
                                  : "; but the log does not go on to the end of its run: it was cut off, or its next "
                                    "parts were deleted (--log-limit)");
    return 0;
}

int run(const RunArguments& arguments) {
    if (arguments.again) return replay(arguments);
    refuseLog(arguments.file);
    countPluginAllocations();
    std::optional<HangWatch> hangWatch;  // a thread; none may be there where processes are made
    const Isolation isolation{arguments.watchdog_s.value_or(kDefaultWatchdog_s)};
    if (!arguments.isolate) hangWatch.emplace(arguments.watchdog_s.value_or(kDefaultPatience_s), getStopSignal());
    const PluginsRun where = arguments.isolate ? PluginsRun::Isolated : PluginsRun::Here;
    tellStage("while the experiment was read and its plugins were made", where);
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath(), arguments.isolate ? isolation.watchdog_s : 0.0);
    Experiment experiment = readDrawnExperiment(arguments.file, arguments.overrides, arguments.draw, loader);
    selectCases(experiment, arguments.cases);
    ignoreWriteSignals();
    ConfiguredCases cases;  // refuse everything before a file is made
    detail::ErrorList errors;
    for (const CasePlan& plan : experiment.cases) {
        if (errors.isFull()) break;
        errors.collect([&] { cases.push_back(configureCase(plan, arguments.isolate ? &isolation : nullptr)); });
    }
    errors.throwIfAny(arguments.file);

    catchStopSignals();  // the first one: brake, finish the logs, end
    const fs::path folder = makeRunFolder(arguments.out, arguments.file);
    const FolderClaim claim(folder);
    installCrashHandler(folder);
    tellStage("while the cases ran", where);
    std::printf("%s\n%s, %zu case%s, output in %s\n", makePrintable(experiment.title).c_str(), arguments.file.c_str(),
                experiment.cases.size(), experiment.cases.size() == 1 ? "" : "s", folder.c_str());
    std::fflush(stdout);
    int jobs = arguments.jobs > 0 ? arguments.jobs : static_cast<int>(std::thread::hardware_concurrency());
    jobs = std::max(1, std::min(jobs, static_cast<int>(experiment.cases.size())));
    CaseRunner runner(std::move(cases), folder);
    const auto [results, failure] = arguments.isolate ? runner.runHere() : runner.runAtOnce(jobs);
    tellStage("while summary and report were written", PluginsRun::NoMore);

    int code = tellResults(results, arguments.details);
    if (const int lost = tryWriteSummary(folder, experiment, results); code == 0) code = lost;
    if (getStopSignal() != 0)  // who stops a run wants it to end; the report would read all logs again
        std::printf("for a report: viable report %s\n", folder.c_str());
    else if (!arguments.noReport && !results.empty() && !tryWriteReport(folder) && code == 0)
        code = static_cast<int>(ErrorKind::LogNotWritten);
    if (failure) std::rethrow_exception(failure);
    for (const CasePlan& plan : experiment.cases)
        if (std::none_of(results.begin(), results.end(), [&](const CaseResult& r) { return r.name == plan.name; }))
            std::printf("%s: not run\n", plan.name.c_str());
    const bool anyStopped = std::any_of(results.begin(), results.end(),
                                        [](const CaseResult& r) { return r.stopReason == StopReason::Requested; });
    if (const int signal = getStopSignal().load();
        signal != 0 && (anyStopped || results.size() < experiment.cases.size())) {
        std::fprintf(stderr, "viable: ended early by signal %d; every running arm was braked to rest\n", signal);
        if (code == 0) code = 128 + signal;
    }
    return code;
}

}  // namespace

void addRunCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<RunArguments>();
    CLI::App* command = app.add_subcommand("run", "Run an experiment: every case, with log and summary");
    command->add_option("FILE", arguments->file, "Experiment file, or with --again a log")->required();
    command->add_option("--out", arguments->out, "Folder for logs, summary and report (default: a new one in ./runs)");
    command->add_option("--case", arguments->cases, "Only this case (may be repeated)")->allow_extra_args(false);
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_option("--draw", arguments->draw, "SEED:INDEX, the values of one run of `viable sweep`");
    command->add_option("--jobs", arguments->jobs, "Cases at a time (default: one per core)")
        ->check(CLI::Range(1, 256));
    command->add_flag("--no-report", arguments->noReport,
                      "Logs and summary only; `viable report DIR` writes the report later");
    command->add_flag("--details", arguments->details, "Print the whole account of each case and the ranking");
    CLI::Option* again = command->add_flag(
        "--again", arguments->again,
        "FILE is a log: decide all its ticks again from the recorded commands and readings, and compare");
    command->add_flag("--isolate", arguments->isolate,
                      "Each plugin in a process of its own: one that crashes, hangs or exits is named, and the arm is "
                      "braked (slower, one case at a time)");
    command
        ->add_option("--watchdog", arguments->watchdog_s,
                     "Seconds that a plugin may take for one call: with --isolate the arm is then braked (default: 5), "
                     "without it the program ends (default: 60)")
        ->check(CLI::Range(0.01, 3600.0));
    for (const char* other : {"--out", "--case", "--set", "--draw", "--jobs", "--no-report", "--details", "--isolate"})
        again->excludes(command->get_option(other));  // the log says all that
    command->callback([arguments, &exitCode] { exitCode = run(*arguments); });
}

}  // namespace viable
