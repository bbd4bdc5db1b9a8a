#pragma once

#include "core/Descriptor.h"
#include "experiment/ExperimentFile.h"
#include "summary/CaseResult.h"

namespace viable {

/** For this process and those of isolated plugins, which are made later: a closed pipe and a file size limit are errors of
a write, no deaths. */
void ignoreWriteSignals();

/** Throws Error (BadInput) where a run cannot have this folder: it is a file, or holds something. */
void requireFreeFolder(const std::filesystem::path& folder);

/** Makes the folder of a run; it must be new, so that nothing is ever overwritten. Throws Error.
@param wanted  empty: a new one in ./runs, named after the experiment and the time */
std::filesystem::path makeRunFolder(const std::string& wanted, const std::filesystem::path& experiment);

/** Makes a folder one run's own, from construction to destruction. */
class FolderClaim {
public:
    /** Throws Error: BadInput where another run has it or anything is in it, LogNotWritten where it cannot be written to. */
    explicit FolderClaim(const std::filesystem::path& folder);
    ~FolderClaim();

private:
    const std::filesystem::path file_;
    detail::Descriptor lock_;  // on the folder, as a sweep has one
};

/** To the terminal: a table of the cases and a sentence on each, or in full each one's account and the ranking; to the error
stream, why one was stopped and what its log lacks. @return  the gravest exit code */
int tellResults(const std::vector<CaseResult>& results, bool inFull);

/** Writes summary.json; where that fails, says so and returns the exit code, else 0. */
int tryWriteSummary(const std::filesystem::path& folder, const Experiment& experiment,
                    const std::vector<CaseResult>& results);

/** Writes the report of a run; its loss does not undo the run. Returns false when there is none. */
bool tryWriteReport(const std::filesystem::path& folder);

}  // namespace viable
