#pragma once

#include "config/Draws.h"
#include "sweep/SweepStore.h"

namespace viable {

/** What the command line says of a sweep. */
struct SweepArguments {
    std::string file;
    std::vector<std::string> cases, overrides;
    std::uint64_t seed = 1;
    std::int64_t runs = 0;
};

/** One sweep: what it is of, and how one of its runs is done. Read once, so that an edit of the file meanwhile
changes nothing. Any number of threads may use one. */
class SweepTask {
public:
    /** Throws Error (BadInput): a file that cannot be read, in which nothing is drawn, or of which none of the first
    runs can be configured. */
    explicit SweepTask(const SweepArguments& arguments);

    const SweepPlan& plan() const { return plan_; }

    /** Runs a case of a run, by its number in plan().cases. Whatever goes wrong is in the row. A row of status Stopped with
    `stop` set tells of the stop only. */
    class Run {
    public:
        Run(const SweepTask& task, std::int64_t run);
        SweepRow runCase(std::size_t index, const std::atomic<int>& stop) const;

    private:
        const SweepTask& task_;
        const std::int64_t run_;
        std::map<std::string, std::string> draws_;
        Experiment experiment_;
        std::string failure_;  // why there is no experiment
        int exitCode_ = 0;
    };

    /** The row of a case that did not come to its end. */
    SweepRow makeLostRow(std::int64_t run, std::size_t index, SweepStatus status, const std::string& message) const;

private:
    Experiment read(std::int64_t run, std::map<std::string, std::string>* draws,
                    const std::map<std::string, std::string>& held = {}) const;
    SweepFiles findFiles(const Experiment& first, const std::vector<DrawnKey>& draws) const;
    SweepRow makeRow(std::int64_t run, const std::string& name, SweepEnd end,
                     const std::map<std::string, std::string>& draws, const CaseResult* result) const;

    const SweepArguments arguments_;
    const PluginLoader loader_;
    const std::vector<std::filesystem::path> robotPath_;
    const ConfigNode root_;
    std::set<std::filesystem::path> libraries_;  // of all plugins that may be drawn
    SweepPlan plan_;
};

}  // namespace viable
