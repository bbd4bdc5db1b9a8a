#pragma once

#include <gtest/gtest.h>

#include "Paths.h"
#include "TemporaryFolder.h"
#include "experiment/CaseRun.h"
#include "experiment/ExperimentFile.h"
#include "records/LogReader.h"

namespace viable {

/** An experiment of the project. */
class ProjectExperiment {
public:
    explicit ProjectExperiment(const std::string& name, const std::vector<std::string>& overrides = {})
        : experiment_(readExperiment(VIABLE_SOURCE_DIR "/experiments/" + name + ".yaml", overrides,
                                     PluginLoader({VIABLE_PLUGIN_DIR}), {VIABLE_SOURCE_DIR "/robots"})) {}

    const Experiment& experiment() const { return experiment_; }

    /** Runs a case; `see` gets every row of its log. */
    CaseResult run(const std::string& name, const std::function<void(const TickRecord&)>& see = {}) const {
        for (const CasePlan& plan : experiment_.cases) {
            if (plan.name != name) continue;
            RunOptions options;
            if (see) options.log = folder_.path() / (name + ".mcap");
            const CaseResult result = runCase(configureCase(plan), options);
            EXPECT_EQ(result.logError, "");
            if (see) {
                LogReader reader(options.log);
                TickRecord record;
                while (reader.read(record)) see(record);
            }
            return result;
        }
        throw std::runtime_error("no case " + name);
    }

private:
    Experiment experiment_;
    test::TemporaryFolder folder_;
};

inline double getUse(const CaseResult& r, LimitKind kind) {
    return r.summary.limit(kind)[static_cast<std::size_t>(r.summary.worstJoint(kind))].worstUse;
}

inline std::int64_t countOutside(const CaseResult& r) {
    std::int64_t outside = 0;
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        outside += r.summary.ticksOutside(kind);
    return outside;
}

inline void print(const CaseResult& r) {
    std::printf(
        "  %-22s position %.5g, velocity %.5g, acceleration %.5g, jerk %.5g of the limit; %lld ticks infeasible\n",
        r.name.c_str(), getUse(r, LimitKind::Position), getUse(r, LimitKind::Velocity),
        getUse(r, LimitKind::Acceleration), getUse(r, LimitKind::Jerk),
        static_cast<long long>(r.summary.ticksWith(FilterStatus::Infeasible)));
}

}  // namespace viable
