#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "viable/config/ConfigNode.h"
#include "viable/environment/Environment.h"
#include "viable/host/PluginLoader.h"
#include "viable/plugin/Parameters.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/robot/RobotDescription.h"
#include "viable/tracking/TrackingBound.h"

namespace viable {

/** A plugin that a case uses, found and with its parameters read, not yet made. */
struct PluginChoice {
    PluginInfo plugin;
    Parameters parameters;
};

/** Ticks in a row that are missed on purpose: command, controller and filter do not run. */
struct TickGap {
    std::int64_t begin = 0;  ///< the first one missed; tick 0 is the run's first
    std::int64_t count = 0;
};

/** One case of an experiment, complete and checked: all that a run needs. */
struct CasePlan {
    std::string name;
    RobotDescription robot;  ///< with the payload that the nominal arm knows
    JointLimits limits;      ///< of the nominal arm: what the filter keeps
    /** Of the real arm: what the file says. Wider than `limits` by the bound under `hold_on: real`. */
    JointLimits realLimits;
    bool holdsOnReal = false;            ///< limits: {hold_on: real}
    std::optional<TrackingBound> bound;  ///< present with a disturbance_set and the robust loop nric
    std::string boundPlace;              ///< of the disturbance_set, for messages
    bool feedsExternalTorque = false;    ///< external_torque: to_nominal
    std::string externalTorquePlace;     ///< where, for messages
    double tick_s = 0.0;
    double duration_s = 0.0;
    MotionState start;       ///< as written; configureCase() judges it
    std::string startPlace;  ///< where, for messages
    std::vector<TickGap> missedTicks;
    std::optional<Environment> environment;
    std::optional<ArmGeometry> geometry;  ///< present exactly when environment is
    PluginChoice command, controller;
    std::vector<PluginChoice> filters;       ///< at least one; several run one after the other
    std::optional<PluginChoice> robustLoop;  ///< present exactly when realPlant is
    std::optional<PluginChoice> realPlant;

    /** "tosbp", or "tosbp + certified_braking". */
    std::string filterName() const;

    ConfigNode resolved;  ///< the case as an experiment file of its own, every default filled in
};

/** An experiment file, read and checked: one question, several cases side by side. */
struct Experiment {
    std::filesystem::path file;
    std::string title;
    std::vector<CasePlan> cases;  ///< in file order, at least one
};

/** The tree of an experiment file, not yet judged.
@param overrides  `key.path=value`, applied in order (see applyOverride) */
ConfigNode readExperimentTree(const std::filesystem::path& file, const std::vector<std::string>& overrides);

/** Reads an experiment file. Strict: an unknown, duplicate or missing key, a wrong size, range or
name is an Error (BadInput) with file:line:column, key path, value and remedy.
@param root         of readExperimentTree(); a value still to be drawn (see resolveDraws) is an error
@param overrides    those in `root`, for messages
@param robotPath    folders searched for robots, see findRobot */
Experiment readExperiment(const ConfigNode& root, const std::filesystem::path& file,
                          const std::vector<std::string>& overrides, const PluginLoader& loader,
                          const std::vector<std::filesystem::path>& robotPath);

/** The same from the file at once. */
Experiment readExperiment(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                          const PluginLoader& loader, const std::vector<std::filesystem::path>& robotPath);

}  // namespace viable
