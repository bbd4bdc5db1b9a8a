#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "experiment/ExperimentFile.h"
#include "loop/ControlLoop.h"
#include "viable/environment/Surroundings.h"
#include "viable/summary/Summary.h"

namespace viable {

/** Each plugin of a case in a process of its own (see isolatePlugin). */
struct Isolation {
    double watchdog_s = kDefaultWatchdog_s;
};

class FilterChain;

/** A case whose plugins are made and configured. The plan must outlive it. */
struct ConfiguredCase {
    explicit ConfiguredCase(RunSetup runSetup);
    ~ConfiguredCase();

    RunSetup setup;
    std::shared_ptr<const Surroundings> surroundings;  ///< at the start; null without an environment
    std::unique_ptr<SurroundingsFeed> feed;            ///< of setup.surroundings
    std::vector<std::unique_ptr<PluginWatch>> watches;
    LoopPlugins plugins;
    const FilterChain* chain = nullptr;  ///< plugins.filter, where there are several
};

/** Makes and configures the plugins of a case, and checks that they fit together. Throws Error:
BadInput for what the file says, PluginFailed when a plugin throws anything else.
@param isolation  null: all in this process. Otherwise call it while the program has one thread. */
std::unique_ptr<ConfiguredCase> configureCase(const CasePlan& plan, const Isolation* isolation = nullptr);

struct RunOptions {
    std::filesystem::path log;  ///< log file to create; empty: none
    /** Becomes non-zero when the user wants the run to end: the arm is braked, the log finished.
     * May be null. */
    const std::atomic<int>* stopRequest = nullptr;
    /** Not null: each plugin in a process of its own; the program must have one thread then. */
    const Isolation* isolation = nullptr;
    /** Called now and then with the share done (0..1), from the running thread, between ticks. May
     * be empty. */
    std::function<void(double)> progress;
};

/** How long a run goes on after a stop for lost tracking. */
inline constexpr double kSettling_s = 0.5;

/** What came of a run. */
struct CaseResult {
    explicit CaseResult(const CasePlan& plan);

    std::string name;
    std::string filter;      ///< plugin names, for tables
    std::string robustLoop;  ///< empty: no real plant
    std::string realPlant;
    bool guarantees = false;           ///< the filter guarantees every limit
    bool guaranteesClearance = false;  ///< and that the nominal arm touches nothing
    /** Of that guarantee position and velocity are the real arm's, as long as the run does not trip. */
    bool holdsOnReal = false;
    std::map<std::string, std::string> seeds;  ///< by plugin name
    Summary summary;
    double simulated_s = 0.0;
    double wall_s = 0.0;
    StopReason stopReason = StopReason::None;
    std::string stopMessage;            ///< one sentence that names plugin, time and cause; empty without a stop
    std::string stopRemedy;             ///< what to do about it; may be empty
    std::vector<std::string> warnings;  ///< what the plugins do that is no failure yet
    double stopTime_s = 0.0;
    std::filesystem::path log;
    std::string logError;  ///< empty: every row was written
    std::int64_t logRows = 0;

    /** The guarantee on the real arm was broken: it passed a limit before anything had tripped. */
    bool isRealGuaranteeBroken() const;
    /** The nominal arm touched what it must not, under a filter that guarantees clearances. */
    bool isClearanceGuaranteeBroken() const;
    /** 0, or the ErrorKind's number: broken guarantee before lost tracking before failed plugin before lost
    log. */
    int exitCode() const;
};

/** True when exit code `a` tells of something graver than `b`: 3, 6, 4, 5, 2, then 0. */
bool isGraver(int a, int b);

/** Runs a case to its end, or to the end of the stop that a failure or a request caused; after a lost tracking for
kSettling_s more, until the real arm has come to rest, too. Throws
Error only before the first tick (configuration, log file). */
CaseResult runCase(const CasePlan& plan, const RunOptions& options);

/** One line per case: worst use of each limit, ticks outside, empty ticks, tracking error, time per
 * tick. */
std::string formatComparison(const std::vector<CaseResult>& results);

/** The cases from best to worst: ticks outside each limit, ticks without a choice, tracking of the command, chatter,
 * time. */
std::string formatRanking(const std::vector<CaseResult>& results);

/** What became of the limits, in one line. */
std::string formatVerdict(const CaseResult& result);

/** "the real arm passed its limits: position by 0.1 rad (joint2)", "the nominal arm collided: ...": the broken guarantees
that show after a run only; empty: none. */
std::string formatBreach(const CaseResult& result);

/** The whole account of one case in about ten lines. */
std::string formatDetails(const CaseResult& result);

/** All cases as JSON, for summary.json. */
std::string writeSummaryJson(const Experiment& experiment, const std::vector<CaseResult>& results);

}  // namespace viable
