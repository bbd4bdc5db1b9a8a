#pragma once

#include "experiment/ConfiguredCase.h"
#include "log/LogSeries.h"
#include "log/Recorder.h"
#include "summary/CaseResult.h"
#include "summary/LimitCounter.h"

namespace viable {

/** What is known of a run before its first tick. The case has not been run. */
CaseResult makeResult(const ConfiguredCase& configured);

/** Where a case's log goes. */
struct CaseLog {
    std::filesystem::path file;                ///< to create; empty: no log
    std::uint64_t limit_bytes = 0;             ///< of a log in several files, see LogSeries; 0: one file without limit
    bool isLive = false;                       ///< with what only a run in real time has
    std::size_t capacity = kRecorderCapacity;  ///< ticks that wait for the disk at most
    std::vector<std::string> moreObstacles{};  ///< names of what LimitReport::other may be beyond the environment's
};

/** A case at work: its loop, its log and its figures. Who runs it (simulated time, or a clock) makes the ticks:
`while (!isStopOver()) { loop().tick(record()); count(); recorder()->append(record()); }`, then finish().
Real time: isStopOver() and count() allocate, lock and throw nothing, but for limits that are slow (LimitRow::isSlow). */
class RunningCase {
public:
    /** How long a run goes on after a stop for lost tracking. */
    static constexpr double kSettling_s = 0.5;

    /** Resets the plugins, which opens a hardware plant, and then creates the log. Throws Error.
    @param judgesSlowly  limits whose judge takes longer than a tick may are counted, too */
    RunningCase(std::unique_ptr<ConfiguredCase> configured, const CaseLog& log, bool judgesSlowly);

    const CasePlan& plan() const { return configured_->plan; }
    const ConfiguredCase& configured() const { return *configured_; }
    ControlLoop& loop() { return *loop_; }
    TickRecord& record() { return record_; }             ///< of the last tick
    const LogLayout& layout() const { return layout_; }  ///< of its log, also without one
    Recorder* recorder() { return recorder_.get(); }     ///< null: no log

    /** Shows people as they walk by the file at the time of the next tick; isStopOver() does, too. */
    void showPeople();
    /** Once before each tick. True: a stop has come to its end, or will never do so, and no tick shall follow. After a
    lost tracking the real arm may need longer than the nominal one: kSettling_s. */
    bool isStopOver();
    /** Once after each tick: record() goes into the figures. */
    void count();

    /** Ends the log, destroys the plugins and tells what came of it. Once, at the end.
    @param isAlone  memory by which the process grew is this case's */
    CaseResult finish(bool isAlone);

private:
    std::unique_ptr<ConfiguredCase> configured_;
    CaseResult result_;
    const LogLayout layout_;
    std::unique_ptr<ControlLoop> loop_;
    std::vector<detail::LimitCounter> counters_;
    PeopleObservation seen_;
    std::unique_ptr<Recorder> recorder_;
    TickRecord record_;
    std::int64_t settling_;
    // An arm that has diverged may never come to its end.
    std::int64_t brakingTicks_ = 0, mostBraking_ = std::numeric_limits<std::int64_t>::max();
    std::chrono::steady_clock::time_point begin_;
    double memory_MB_ = 0.0;
};

/** The poses of the tool, which the records of a run do not have of the real arm. */
std::function<Pose(const JointVector&)> makeToolCalculator(const RobotDescription& robot);

}  // namespace viable
