#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <memory>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>

#include "Commands.h"
#include "ExperimentArguments.h"
#include "PluginTrouble.h"
#include "Progress.h"
#include "StopSignals.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "experiment/CaseRun.h"
#include "report/RunReport.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** For this process and those of isolated plugins, which are made later. */
void ignoreWriteSignals() {
    std::signal(SIGPIPE, SIG_IGN);  // a closed pipe is a write error, not a death
    std::signal(SIGXFSZ, SIG_IGN);  // so is a file size limit
}

struct RunArguments {
    std::string file;
    std::string out;
    std::vector<std::string> cases;
    std::vector<std::string> overrides;
    std::string draw;
    int jobs = 0;
    bool noReport = false;
    bool compact = false;
    bool isolate = false;
    std::optional<double> watchdog_s;
};

Error alreadyHolds(const fs::path& folder) {
    return badInput("--out " + folder.string(), "this folder already holds something",
                    "Name a new or empty folder; a run never overwrites another.");
}

/** Something that is no claim of a run. */
bool holdsSomething(const fs::path& folder) {
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
        if (entry->path().filename() != kClaim) return true;
    return false;
}

/** Makes a folder one run's own, from construction to destruction. */
class FolderClaim {
public:
    /** Throws Error: BadInput where another run has it or anything is in it, LogNotWritten where it cannot be written to. */
    explicit FolderClaim(const fs::path& folder) : file_(folder / kClaim) {
        const int descriptor = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor < 0 && errno == EEXIST)
            throw badInput("--out " + folder.string(),
                           std::string("another run has this folder: its ") + kClaim + " is there",
                           "Name another folder. Only if that run was killed, delete " + file_.string() + ".");
        if (descriptor < 0)
            throw Error(ErrorKind::LogNotWritten, folder.string(),
                        "nothing can be written here: " + std::generic_category().message(errno),
                        "Name another place with --out DIR.");
        ::close(descriptor);
        // A run that was quicker may have come and gone since the folder was looked at.
        if (!holdsSomething(folder)) return;
        ::unlink(file_.c_str());
        throw alreadyHolds(folder);
    }
    ~FolderClaim() { ::unlink(file_.c_str()); }
    FolderClaim(const FolderClaim&) = delete;
    FolderClaim& operator=(const FolderClaim&) = delete;

private:
    const fs::path file_;
};

/** Makes the folder of a run; it must be new, so that nothing is ever overwritten. */
fs::path makeRunFolder(const std::string& wanted, const fs::path& experiment) {
    std::error_code error;
    if (!wanted.empty()) {
        const fs::path folder = wanted;
        const fs::file_status status = fs::status(folder, error);
        if (fs::exists(status) && !fs::is_directory(status))
            throw badInput("--out " + wanted, "this is not a folder", "Name a new or empty folder.");
        if (holdsSomething(folder)) throw alreadyHolds(folder);
        error.clear();
        fs::create_directories(folder, error);
        if (error)
            throw Error(ErrorKind::LogNotWritten, "--out " + wanted, "cannot create the folder: " + error.message(),
                        "Name another place.");
        return folder;
    }
    char stamp[32];
    const std::time_t now = std::time(nullptr);
    std::strftime(stamp, sizeof stamp, "%Y%m%d-%H%M%S", std::localtime(&now));
    fs::create_directories("runs", error);
    if (error)
        throw Error(ErrorKind::LogNotWritten, (fs::current_path() / "runs").string(),
                    "cannot create the folder: " + error.message(), "Name another place with --out DIR.");
    for (int i = 1; i < 1000; ++i) {
        const fs::path folder =
            fs::path("runs") / (experiment.stem().string() + "-" + stamp + (i > 1 ? "-" + std::to_string(i) : ""));
        if (fs::create_directory(folder, error)) return folder;
        if (error)
            throw Error(ErrorKind::LogNotWritten, folder.string(), "cannot create the folder: " + error.message(),
                        "Name another place with --out DIR.");
    }
    throw Error(ErrorKind::LogNotWritten, "runs", "too many runs in one second");
}

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
    CaseRunner(ConfiguredCases cases, fs::path folder, LogForm logForm)
        : cases_(std::move(cases)),
          folder_(std::move(folder)),
          logForm_(logForm),
          progress_(listNames(cases_)),
          results_(cases_.size()) {}

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
                --running;
                if (workers.empty()) {
                    ++running;
                    work();
                }
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
        options.logForm = logForm_;
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
    const LogForm logForm_;
    Progress progress_;
    bool isAlone_ = true;  // the case that runs
    std::vector<std::optional<CaseResult>> results_;
    std::atomic<std::size_t> next_{0};
    std::mutex failureMutex_;
    std::exception_ptr failure_;
};

/** Writes the report of a run; its loss does not undo the run. Returns false when there is none. */
bool tryWriteReport(const fs::path& folder) {
    try {
        for (const fs::path& report : writeReport(folder, findReportPage()))
            std::printf("report: %s\n", report.c_str());
        return true;
    } catch (const std::exception& e) {
        std::fprintf(stderr, "viable: the report was not written: %s\nRemove the cause, then run: viable report %s\n",
                     e.what(), folder.c_str());
        return false;
    }
}

int run(const RunArguments& arguments) {
    countPluginAllocations();
    std::optional<HangWatch> hangWatch;  // a thread; none may be there where processes are made
    const Isolation isolation{arguments.watchdog_s.value_or(kDefaultWatchdog_s)};
    if (!arguments.isolate) hangWatch.emplace(arguments.watchdog_s.value_or(kDefaultPatience_s), getStopSignal());
    const PluginsRun pluginsRun = arguments.isolate ? PluginsRun::Isolated : PluginsRun::Here;
    tellStage("while the experiment was read and its plugins were made", pluginsRun);
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath(), arguments.isolate ? isolation.watchdog_s : 0.0);
    Experiment experiment = readDrawnExperiment(arguments.file, arguments.overrides, arguments.draw, loader);
    selectCases(experiment, arguments.cases);
    ignoreWriteSignals();
    ConfiguredCases cases;  // refuse everything before a file is made
    for (const CasePlan& plan : experiment.cases)
        cases.push_back(configureCase(plan, arguments.isolate ? &isolation : nullptr));

    catchStopSignals();  // the first one: brake, finish the logs, end
    const fs::path folder = makeRunFolder(arguments.out, arguments.file);
    const FolderClaim claim(folder);
    installCrashHandler(folder);
    tellStage("while the cases ran", pluginsRun);
    std::printf("%s\n%s, %zu case%s, output in %s\n", makePrintable(experiment.title).c_str(), arguments.file.c_str(),
                experiment.cases.size(), experiment.cases.size() == 1 ? "" : "s", folder.c_str());
    std::fflush(stdout);
    int jobs = arguments.jobs > 0 ? arguments.jobs : static_cast<int>(std::thread::hardware_concurrency());
    jobs = std::max(1, std::min(jobs, static_cast<int>(experiment.cases.size())));
    CaseRunner runner(std::move(cases), folder, arguments.compact ? LogForm::Compact : LogForm::Open);
    const auto [results, failure] = arguments.isolate ? runner.runHere() : runner.runAtOnce(jobs);
    tellStage("while summary and report were written", PluginsRun::NoMore);

    std::printf("\n%s\n", formatComparison(results).c_str());
    if (const std::string ranking = formatRanking(results); !ranking.empty()) std::printf("%s\n", ranking.c_str());
    int code = 0;
    for (std::size_t i = 0; i < results.size(); ++i) {
        std::printf("%s\n", formatDetails(results[i]).c_str());
        const int own = results[i].exitCode();
        if (isGraver(own, code)) code = own;
        std::fflush(stdout);  // both may go to one pipe
        if (own != 0 && !results[i].stopMessage.empty())
            std::fprintf(stderr, "viable: case %s %s\n%s%s", results[i].name.c_str(), results[i].stopMessage.c_str(),
                         results[i].stopRemedy.c_str(), results[i].stopRemedy.empty() ? "" : "\n");
        if (!results[i].logError.empty())
            std::fprintf(stderr,
                         "viable: case %s: the log could not be written to its end: %s. The run itself continued; free "
                         "space and run it again.\n",
                         results[i].name.c_str(), results[i].logError.c_str());
    }
    try {
        replaceFile(folder / "summary.json", writeSummaryJson(experiment.title, experiment.file, results));
    } catch (const Error& e) {
        std::fprintf(stderr, "viable: %s\n", e.what());
        if (code == 0) code = e.exitCode();
    }
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
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command->add_option("--out", arguments->out, "Folder for logs, summary and report (default: a new one in ./runs)");
    command->add_option("--case", arguments->cases, "Only this case (may be repeated)")->allow_extra_args(false);
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_option("--draw", arguments->draw, "SEED:INDEX, the values of one run of `viable sweep`");
    command->add_option("--jobs", arguments->jobs, "Cases at a time (default: one per core)")
        ->check(CLI::Range(1, 256));
    command->add_flag("--no-report", arguments->noReport,
                      "Logs and summary only; `viable report DIR` writes the report later");
    command->add_flag("--compact", arguments->compact,
                      "Logs of half the size, which PlotJuggler and Foxglove read after `viable export --to mcap`");
    command->add_flag("--isolate", arguments->isolate,
                      "Each plugin in a process of its own: one that crashes, hangs or exits is "
                      "named, and the arm is braked (slower, one case at a time)");
    command
        ->add_option("--watchdog", arguments->watchdog_s,
                     "Seconds that a plugin may take for one call: with --isolate the arm is then "
                     "braked (default: 5), without it the program ends (default: 60)")
        ->check(CLI::Range(0.01, 3600.0));
    command->callback([arguments, &exitCode] { exitCode = run(*arguments); });
}

}  // namespace viable
