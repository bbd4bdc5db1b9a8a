#pragma once

#include "summary/CaseResult.h"

namespace viable {

/** One value of a sweep's table: nothing, a number, a whole number, or text. */
using SweepValue = std::variant<std::monostate, double, std::int64_t, std::string>;

/** A column of a sweep's table. */
struct SweepColumn {
    enum class Kind { Status, Draw, Result };

    Kind kind = Kind::Result;
    std::string name;          ///< "status", "draw.real_plant.payload_kg", "tracking.max_rad"
    std::string unit;          ///< "rad", "Nm/s", ...; empty: none
    std::string label;         ///< for people
    std::string distribution;  ///< of a draw, as written in the file without `~`
};

/** What became of one case of one run: a row of the table. */
struct SweepRow {
    std::int64_t run = 0;
    std::string caseName;
    std::vector<SweepValue> values;  ///< one per column, in the order of makeSweepColumns()
};

/** How a case of a run ended. */
enum class SweepStatus { Ok, Tripped, Stopped, GuaranteeBroken, Crashed, TimedOut, Failed };
/** "ok", "tripped", "stopped", "guarantee_broken", "crashed", "timed_out", "failed". */
const char* getName(SweepStatus status);
/** Ok only where `viable run` ends with 0. */
SweepStatus getSweepStatus(const CaseResult& result);

/** What can be said of a case's end besides its figures. */
struct SweepEnd {
    SweepStatus status = SweepStatus::Ok;
    int exitCode = 0;  ///< what `viable run` would end with
    std::string message, replay;
    double wall_s = 0.0;
};

/** All columns: the status ones first, then a column per draw, then the results. Throws Error (BadInput) for names
that differ in upper and lower case only.
@param drawKeys  key path and distribution
@param joints    of the robots of all cases */
std::vector<SweepColumn> makeSweepColumns(const std::vector<std::pair<std::string, std::string>>& drawKeys,
                                          const std::vector<std::string>& joints);

/** A row. @param draws  values by key path; @param result  null: no figures, the case did not end by itself */
SweepRow makeSweepRow(const std::vector<SweepColumn>& columns, std::int64_t run, const std::string& caseName,
                      const SweepEnd& end, const std::map<std::string, std::string>& draws, const CaseResult* result);

/** The row as bytes, and back. What is cut off or wrong throws std::runtime_error. */
std::string packRow(const SweepRow& row);
SweepRow unpackRow(const std::string& bytes);

}  // namespace viable
