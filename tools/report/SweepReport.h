#pragma once

#include <filesystem>

namespace viable {

/** The name of a sweep's store in its folder. */
inline constexpr const char* kSweepStore = "sweep.sqlite";

/** Writes DIR/report.html from the store DIR/sweep.sqlite: distributions of the results, what they depend on, the worst
and the failed runs. One file that needs nothing else: it opens from disk and makes no request. A sweep that is still
writing, or was stopped, is shown as far as it is; the page then says that it is partial.
@param page  the page without data, sweep_template.html
Returns the file. An older report is replaced, whole or not at all. Throws Error: BadInput when the store is missing, no
SQLite file, of another schema or half-written, LogNotWritten when the report cannot be written. */
std::filesystem::path writeSweepReport(const std::filesystem::path& folder, const std::filesystem::path& page);

}  // namespace viable
