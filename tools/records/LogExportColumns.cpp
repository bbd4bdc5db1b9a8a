#include "records/LogExportColumns.h"

#include <algorithm>

#include "core/Text.h"
#include "log/LogMetadata.h"
#include "records/ColumnMeaning.h"

namespace viable::detail {

static ExportColumn nameColumn(const LogColumn& column, const std::vector<std::string>& prismaticJoints) {
    ExportColumn named{&column, column.name(), "/" + column.name(), column.isText() ? "" : "1"};
    const std::size_t first = named.name.find('.'), last = named.name.rfind('.');
    if (first != std::string::npos) named.path[first + 1] = named.path[last + 1] = '/';
    if (column.isText()) return named;
    const bool slides =
        first != last && std::find(prismaticJoints.begin(), prismaticJoints.end(),
                                   named.name.substr(first + 1, last - first - 1)) != prismaticJoints.end();
    const std::size_t suffix = named.name.rfind('_') + 1;
    if (suffix == 0 || (last != std::string::npos && suffix < last)) return named;
    if (const ColumnUnit* unit = findColumnUnit(named.name)) {
        if (slides) {
            named.name.replace(suffix, std::string::npos, unit->slidingSuffix);
            named.path.replace(suffix + 1, std::string::npos, unit->slidingSuffix);
        }
        named.unit = findColumnUnit(named.name)->text;
        return named;
    }
    for (const LimitKind kind : listArmLimits())  // a library's own unit
        if (named.name.compare(0, first, getName(kind, LimitSide::Neither)) == 0 &&
            named.name.compare(suffix, std::string::npos, makeUnitSuffix(getUnit(kind, false))) == 0)
            named.unit = getUnit(kind, false);
    return named;
}

std::vector<ExportColumn> nameExportColumns(const LogReader& reader, const std::string& log) {
    const LogMetadata metadata = readLogMetadata(reader.metadata(), reader.layout().jointNames);
    metadata.refuseDamaged(LogMetadata::kPrismaticJoints, log);
    std::vector<ExportColumn> columns;
    for (const LogColumn& column : reader.columns()) columns.push_back(nameColumn(column, metadata.prismaticJoints));
    return columns;
}

}  // namespace viable::detail
