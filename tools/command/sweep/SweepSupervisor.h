#pragma once

#include "SweepTask.h"
#include "core/ChildProcess.h"

namespace viable {

/** Runs of a sweep in a process of their own, side by side in its threads, watched by this one: a plugin that crashes,
ends the process or hangs costs its own run only, and a process that is killed costs none.

What was in flight when a process died is tried once more, each run alone in a process; the one that dies again is
`crashed`, or `timed_out` when it takes too long. Call it while this process has one thread. */
class SweepSupervisor {
public:
    /** @param jobs       runs at a time
        @param timeout_s  longest time of a case, or 20 times the median so far where that is more
        @param stop       non-zero: the user wants the end
        @param afterFork  called first in each new process */
    SweepSupervisor(const SweepTask& task, int jobs, double timeout_s, const std::atomic<int>& stop,
                    std::function<void()> afterFork);
    ~SweepSupervisor();

    /** Called with each row as it comes. */
    std::function<void(SweepRow&&)> onRow;
    /** Called some ten times a second. */
    std::function<void()> onLook = [] {};

    /** All cases of these runs. Returns false when it ended early because of `stop`: what is in flight then is not
    reported. Throws Error (PluginFailed) when processes die without having begun a run, and what onRow throws. */
    bool run(const std::vector<std::int64_t>& runs);

private:
    struct Job {
        std::int64_t run;
        std::vector<std::size_t> cases;
    };
    struct Shared;
    class Process;

    [[noreturn]] void work(const std::vector<Job>& jobs, int threads, int pipe);
    std::vector<Job> listOpen() const;
    void settle(SweepRow&& row);
    bool tryAlone(std::int64_t run);

    const SweepTask& task_;
    const int jobs_;
    const double timeout_s_;
    const std::atomic<int>& stop_;
    const std::function<void()> afterFork_;
    const detail::SharedObject<Shared> shared_;
    std::vector<Job> open_;                      ///< what is asked for and not settled, in order
    std::map<std::int64_t, std::size_t> where_;  ///< of a run in open_
    std::vector<double> walls_s_;
    double limit_s_;
    int idleDeaths_ = 0;
};

}  // namespace viable
