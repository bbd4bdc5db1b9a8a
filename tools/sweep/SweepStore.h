#pragma once

#include "experiment/ExperimentFile.h"
#include "sweep/SweepRow.h"

namespace viable {

/** What a sweep is: two with the same are the same sweep, and their rows may lie in one store. */
struct SweepPlan {
    std::string title;
    std::string file;        ///< as given by the user; not compared
    std::string experiment;  ///< text of the file
    std::string fileHash;    ///< SHA-256, see calcSweepHash()
    std::uint64_t seed = 1;
    std::int64_t runs = 0;
    std::vector<std::string> cases, joints;
    std::vector<SweepColumn> columns;
};

/** The files besides its own that an experiment's figures depend on. */
struct SweepFiles {
    std::set<std::filesystem::path> data;  ///< *.urdf and *.yaml of the robots' folders, maps, and what plugins read
    std::set<std::filesystem::path> libraries;  ///< of the plugins

    void add(const SweepFiles& other) {
        data.insert(other.data.begin(), other.data.end());
        libraries.insert(other.libraries.begin(), other.libraries.end());
    }
};
SweepFiles findSweepFiles(const Experiment& experiment);

/** SHA-256 over what decides the figures of a sweep besides seed and run: the file's text, the overrides, names and
contents of `files`, wherever they lie, and the program's version. As hexadecimal digits. A robot's meshes are not in
it: they decide no figure. Throws Error (BadInput) where a file cannot be read.
@param files  of all that the draws may choose */
std::string calcSweepHash(const std::string& text, const std::vector<std::string>& overrides, const SweepFiles& files);

/** The results of a sweep: one SQLite file (write-ahead log) with a table `runs`, a row per run and case, and a table
`meta` of texts: schema, title, file, experiment, file_hash, seed, runs, cases, joints, columns (the last three JSON). A run's
rows are added in one transaction, so a killed program loses no run that was added. One writer at a time: the constructor
takes a lock on the folder. All functions throw Error (LogNotWritten; BadInput for a file that is no such store). */
class SweepStore {
public:
    /** Opens DIR/sweep.sqlite, made if need be with its folder. One that is there must hold the same sweep, of no more runs
    than now; a run in it of which a case is missing is removed. What is refused stays as it is. */
    SweepStore(const std::filesystem::path& folder, const SweepPlan& plan);
    /** Opens one that is there, to read. */
    explicit SweepStore(const std::filesystem::path& folder);
    ~SweepStore();

    const SweepPlan& plan() const;
    const std::filesystem::path& folder() const;

    /** Throws Error (BadInput) where `other`, found in `where`, is another sweep than this one. */
    void checkSame(const SweepPlan& other, const std::filesystem::path& where) const;

    /** The rows of one run, all cases, at once. A row that is there already is an error. */
    void add(const std::vector<SweepRow>& rows);
    /** Sorted numbers of the runs that are there with all their cases. */
    std::vector<std::int64_t> findRuns() const;
    /** Removes the runs of which a case crashed or took too long, so that they can be done again. Returns how many. */
    std::int64_t removeLost();
    /** Calls `visit` with each row, sorted by run and case (in the plan's order). */
    template <class Visit>
    void forEach(const Visit& visit) const {
        begin();
        for (SweepRow row; next(row);) visit(static_cast<const SweepRow&>(row));
    }

    /** To be called in a child process after a fork: gives up the store without touching it. The lock stays the
    parent's. */
    void abandon();

private:
    struct Impl;
    void begin() const;
    bool next(SweepRow& row) const;
    std::unique_ptr<Impl> impl_;
};

/** Writes DIR/sweep.csv: sorted by run and case, numbers as the shortest text that reads back to the same; without
`replay` and `wall_s`, so that the same sweep gives the same bytes however it was run. */
void writeSweepCsv(const SweepStore& store);

/** What is printed at the end: how many ended how, per result the least, the median and the largest with the run it
belongs to, and how to replay the first runs that are not ok. */
std::string formatSweepSummary(const SweepStore& store);

/** The gravest exit code of all rows, see isGraver(); 0: all ok. */
int findSweepExitCode(const SweepStore& store);

}  // namespace viable
