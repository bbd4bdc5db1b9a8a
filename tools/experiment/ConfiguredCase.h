#pragma once

#include "experiment/CasePlan.h"
#include "loop/ControlLoop.h"
#include "viable/environment/Surroundings.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

/** Each plugin of a case in a process of its own (see isolatePlugin). */
struct Isolation {
    double watchdog_s = kDefaultWatchdog_s;
};

class FilterChain;

/** A case whose plugins are made and configured: opened once, ready for one run (see runCase). */
struct ConfiguredCase {
    ConfiguredCase(const CasePlan& casePlan, RunSetup runSetup);
    ~ConfiguredCase();

    const CasePlan& plan;                ///< must outlive this object
    std::optional<LoopMargins> margins;  ///< of a robust loop that tells its law
    RunSetup realSetup;                  ///< of robust loop and plant: with the file's limits
    RunSetup setup;                      ///< of the others: with the nominal arm's limits
    /** Fastest change of the motors' torque that plant and robust loop tell [Nm/s]; of size 0: neither does. */
    JointVector motorRate{};
    JointVector robustRate{};            ///< LinearErrorLoop::torqueRate [Nm/s]; of size 0: not told
    std::optional<TrackingBound> bound;  ///< with a disturbance_set and a robust loop that one follows from
    std::shared_ptr<const Surroundings> surroundings;  ///< at the start; null without an environment
    std::unique_ptr<SurroundingsFeed> feed;            ///< of setup.surroundings
    std::unique_ptr<PeopleFeed> people;                ///< of setup.people; null without any
    std::vector<std::unique_ptr<PluginWatch>> watches;
    LoopPlugins plugins;
    const FilterChain* chain = nullptr;  ///< plugins.filter, where there are several
};

/** What limits of the whole arm hang on in a case. @param plan  must outlive it */
LimitScene makeScene(const CasePlan& plan);
/** The kinds of limits that the case has. Those of a plugin's library only where a case of its experiment uses that. */
LimitSet findLimits(const CasePlan& plan);

/** Makes and configures the plugins of a case, judges its start, and checks that all fit together. Throws Error:
BadInput for what the file says, PluginFailed when a plugin throws anything else.
@param isolation  null: all in this process. Otherwise call it while the program has one thread. */
std::unique_ptr<ConfiguredCase> configureCase(const CasePlan& plan, const Isolation* isolation = nullptr);

/** The first part of that: robust loop and plant, and the tracking bound that follows from them. The other plugins are null:
enough to show a bound. */
std::unique_ptr<ConfiguredCase> configureTracking(const CasePlan& plan, const Isolation* isolation = nullptr);

/** The second part: the limits of the nominal arm, less the bound with `hold_on: real`. Throws Error where that leaves no room, or
where motors cannot carry what the bound is for. */
void applyBound(const CasePlan& plan, ConfiguredCase& configured);

}  // namespace viable
