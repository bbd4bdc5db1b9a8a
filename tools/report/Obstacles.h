#pragma once

#include "report/BinaryBlock.h"
#include "viable/config/ConfigNode.h"

namespace viable::detail {

/** Of a map at most so many cells are drawn. */
inline constexpr std::size_t kMaxDrawnCells = 40'000;

/** What stood around the arm, from the `environment` block of a resolved experiment file, for plots and replay:
{"safety_distance_m", "obstacles": [one per obstacle, by index as in Surroundings], "note"}.

Of a map the occupied cells are drawn that the arm can reach and that can be seen: those with a neighbour that is not
occupied, as cubes of one size, coarser where there would be more than kMaxDrawnCells. A map that cannot be read any more,
or is another one by now, is left out; the note says so. Null where the block itself cannot be read.
@param mapSha256    of the map that the run went by; empty: not known
@param robotFolder  of the arm; a folder that is no longer there has no replay that cells could be drawn in */
nlohmann::json describeEnvironment(const ConfigNode& block, const std::string& mapSha256,
                                   const std::filesystem::path& robotFolder, BinaryBlock& binary);

}  // namespace viable::detail
