#pragma once

#include "analysis/records/MotionRecord.h"

namespace viable::detail {

/** What a column of a CSV file is for. */
struct CsvColumn {
    enum class Use { None, Time, Position, Torque };
    Use use = Use::None;
    std::size_t joint = 0;  ///< of Position and Torque: index in CsvPlan::joints
    double factor = 1.0;    ///< to rad, m, Nm, N; of Time: units in a second, a whole number
};

struct CsvPlan {
    std::vector<CsvColumn> columns;           ///< one per name of the header; exactly one of them is Time
    std::vector<MotionRecord::Joint> joints;  ///< without readings; at least one
};

/** Finds out what the columns are for, from the units in their names or from options.columns.
@param where  the header's place, for messages. Throws Error (BadInput). */
CsvPlan planCsvColumns(const std::vector<std::string>& header, const MotionRecordOptions& options,
                       const std::string& where);

}  // namespace viable::detail
