#pragma once

#include <string>

namespace viable::detail {

/** A column's last letters, its unit, and the last letters for a joint that slides. */
struct ColumnUnit {
    const char *suffix, *text, *slidingSuffix;
};
/** The unit that a column's name ends in; null: none that is known. */
const ColumnUnit* findColumnUnit(const std::string& column);

/** What a column of a log, or of its CSV, tells: of "nominal.joint0.q_rad" "position of the nominal arm, ...". Of a kind of
limit that a library adds: that it is one. */
std::string explainColumn(const std::string& column);

}  // namespace viable::detail
