#pragma once

#include <cstdint>
#include <filesystem>

namespace viable {

/** Writes a log as CSV (RFC 4180 quoting, LF, one header line): `time_s`, then
`<channel>.<joint>.<field>` as in LogReader::columns(), with m and N for rad and Nm where the log's metadata
name the joint in `prismatic_joints` (a JSON list). Numbers read back bit-equal; an infinite
margin is `inf`. A log that was cut off gives the rows that it has. The file appears under its name
only when it is whole.
@param isReplacing  an older file gives way to the whole new one
@param take         only the rows of that take of an operator (LogReader::keepTake); 0: all of this file
Throws Error: BadInput when the log cannot be read, has no such take or `csv` exists already and is not to be replaced,
LogNotWritten when `csv` cannot be written; then nothing is left of it, and the older file stays. */
void exportCsv(const std::filesystem::path& log, const std::filesystem::path& csv, bool isReplacing = false,
               std::int64_t take = 0);

/** Writes a log as HDF5: one dataset per column, named as in the CSV with / for the first and the last dot
(/nominal/joint0/q_rad), all of equal length. A dataset's attributes: `column`, its name in the CSV; `units`, such
as "rad/s^2" or "1"; `meaning`; for words (a limit, a status), which are small integers, instead the `words` that they stand
for. Attributes of the root: what wrote the log, its metadata and attachments
(the resolved experiment file, obstacles that were placed by hand). Errors as for exportCsv(). One thread at a time: the HDF5 library is not thread-safe. */
void exportHdf5(const std::filesystem::path& log, const std::filesystem::path& hdf5, bool isReplacing = false,
                std::int64_t take = 0);

/** Writes a log, or a take of it, as a log of this version. Errors as for exportCsv(), and BadInput for a log that
lacks columns of this version. */
void exportMcap(const std::filesystem::path& log, const std::filesystem::path& mcap, bool isReplacing = false,
                std::int64_t take = 0);

/** Writes the rows of a log that was cut off (or of a whole one) into a new, whole log with the same opening;
returns their number. Errors as for exportCsv(). */
std::uint64_t recoverLog(const std::filesystem::path& log, const std::filesystem::path& whole);

}  // namespace viable
