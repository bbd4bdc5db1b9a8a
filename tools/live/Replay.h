#pragma once

#include "host/PluginLoader.h"

namespace viable {

/** What came of a replay. */
struct ReplayResult {
    std::string caseName;
    std::int64_t ticks = 0;  ///< that were compared
    double end_s = 0.0;      ///< time of the last of them
    bool isComplete = true;  ///< the log has its end and all its parts; otherwise it was replayed as far as it goes
    /** Where the first tick differs; empty: nothing does. */
    std::string difference;
};

/** Makes the ticks of a log again: the case that the log carries, with the commands, limits and readings that were recorded
in place of those of its command source and its real plant, with its missed ticks, pauses and stop; the plugins between
(controller, filter, robust loop) decide anew. Every logged figure but the times is compared to the bit.

A real plant is configured, not opened. A log in several files (LogSeries) is read on from its first one.
Throws Error (BadInput): no log of a run from its beginning, ticks are missing in it, its case cannot be configured.
@param robotPath  folders searched for robots */
ReplayResult replayLog(const std::filesystem::path& log, const PluginLoader& loader,
                       const std::vector<std::filesystem::path>& robotPath);

}  // namespace viable
