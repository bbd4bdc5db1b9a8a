#pragma once

#include <filesystem>

namespace viable {

/** Writes a log as CSV (RFC 4180 quoting, LF, one header line): `time_s`, then
`<channel>.<joint>.<field>` as in LogReader::columns(). Numbers read back bit-equal; an infinite
margin is `inf`. A log that was cut off gives the rows that it has. The file appears under its name
only when it is whole.
Throws Error: BadInput when the log cannot be read or `csv` exists already (it is never
overwritten), LogNotWritten when `csv` cannot be written; then nothing is left of it. */
void exportCsv(const std::filesystem::path& log, const std::filesystem::path& csv);

}  // namespace viable
