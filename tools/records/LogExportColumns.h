#pragma once

#include "records/LogReader.h"

namespace viable::detail {

/** A column of a log as the exports name it. */
struct ExportColumn {
    const LogColumn* column;  ///< the reader's
    std::string name;         ///< "nominal.joint0.q_rad"
    std::string path;         ///< "/nominal/joint0/q_rad"
    std::string unit;         ///< "rad/s"; "1" for a number without one, empty for a word
};

/** All columns of a log, in the order of LogReader::columns(). A log's own columns say rad and Nm for every
joint; here those of a joint that slides say m and N. The path has / for the first and the last dot, so that
dots of a joint's name stay. Throws Error: BadInput when the metadata do not list joints. */
std::vector<ExportColumn> nameExportColumns(const LogReader& reader, const std::string& log);

}  // namespace viable::detail
