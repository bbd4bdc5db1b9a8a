#pragma once

#include "experiment/ExperimentKeys.h"

// The blocks of a case, each with a reader, and a writer of what its resolved file says in its place. A reader throws
// Error (BadInput) for what is wrong in its block; what two blocks make of each other is judged in CaseChecks.

namespace viable::detail {

/** `payload_kg` and `payload_offset_m`; none: neither is there. @param experiment  with all keys of the case */
std::optional<Parameters> readPayload(const ConfigNode& experiment);

/** `disturbance_set`, a block of sizes. */
Parameters readDisturbances(const ConfigNode& block, int joints);

/** `stream`, which needs no more than a sample a tick. */
Parameters readStream(const ConfigNode& block, double tick_s);

/** `robot` */
RobotDescription readRobot(const ConfigNode& name, const std::vector<std::filesystem::path>& robotPath);

/** @param block  null: the robot's own. @param place  of the block, or of the robot's own, for messages */
LimitSettings readLimitsBlock(const ConfigNode* block, const RobotDescription& robot, double tick_s,
                              const std::string& place);
ConfigNode resolveLimits(const CasePlan& plan);

ConfigNode resolveSpeedLimits(const SpeedLimits& limits);

/** @param block  null: at rest in the robot's home pose */
MotionState readStart(const ConfigNode* block, const RobotDescription& robot);
ConfigNode resolveStart(const MotionState& start);

/** `missed_ticks: [{at_s: 3.0, count: 20}, ...]` */
std::vector<TickGap> readMissedTicks(const ConfigNode& node, double tick_s, double duration_s);
ConfigNode resolveMissedTicks(const std::vector<TickGap>& gaps, double tick_s);

/** With the SHA-256 of its map: from here on it is this file, whoever reads it and when. */
Environment readEnvironmentBlock(const ConfigNode& block);
ConfigNode resolveEnvironment(ConfigNode block, const Environment& environment);

PluginChoice readPlugin(const ConfigNode& block, PluginKind kind, const PluginLoader& loader, int joints);
/** One block, or a list of blocks and of names without parameters. */
std::vector<PluginChoice> readFilters(const ConfigNode& node, const PluginLoader& loader, int joints);
ConfigNode resolvePlugin(const PluginChoice& choice);
ConfigNode resolveFilters(const std::vector<PluginChoice>& filters);

}  // namespace viable::detail
