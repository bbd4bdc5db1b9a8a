#pragma once

#include <filesystem>
#include <vector>

namespace viable {

/** Writes DIR/report.html from what a run left in DIR: its logs (finished or cut off) and summary.json, which may be
missing. One file that needs nothing else: it opens from disk and makes no request. Long runs are thinned out for display
(least and largest value of each segment, so that no peak is lost); the logs keep everything.
@param page  the page without data, report_template.html
@param isFull  up to 32,000 segments instead of 4,000: every row of half a minute, in a file eight times as large
Returns the files: one, or, where cases have different arms, one for each arm (report.html, report_2.html, ...), in the
order of the cases. An older report is replaced, whole or not at all. Throws Error: BadInput when DIR holds no log or a
log cannot be read, LogNotWritten when the report cannot be written. */
std::vector<std::filesystem::path> writeReport(const std::filesystem::path& folder, const std::filesystem::path& page,
                                               bool isFull = false);

/** Where writeReport() looks for what `viable verify` found out about a log: CASE.verify.json beside CASE.mcap or
CASE.recovered.mcap. */
std::filesystem::path nameVerificationFile(const std::filesystem::path& log);

}  // namespace viable
