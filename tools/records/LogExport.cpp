#include "records/LogExport.h"

#include <charconv>

#include "core/Text.h"
#include "core/WholeFile.h"
#include "records/LogExportColumns.h"

namespace viable {

namespace {

constexpr std::size_t kBlock = 1 << 20;  // [bytes] written at once

template <class Number>
void appendNumber(std::string& line, Number value) {
    char digits[32];
    line.append(digits, std::to_chars(digits, digits + sizeof(digits), value).ptr);
}

}  // namespace

void exportCsv(const std::filesystem::path& log, const std::filesystem::path& csv, bool isReplacing,
               std::int64_t take) {
    LogReader reader(log);
    reader.keepTake(take);
    const std::vector<detail::ExportColumn> columns = detail::nameExportColumns(reader, log.string());
    detail::WholeFile file(csv, isReplacing);
    std::string text;
    for (const detail::ExportColumn& column : columns) detail::addItem(text, detail::quoteCsv(column.name), ",");
    text += '\n';
    TickRecord record;
    while (reader.read(record)) {
        const char* separator = "";
        for (const detail::ExportColumn& named : columns) {
            const LogColumn& column = *named.column;
            text += separator;
            separator = ",";
            if (column.isText())
                text += detail::quoteCsv(column.getText(record));
            else if (column.isInteger())
                appendNumber(text, column.getInteger(record));
            else
                appendNumber(text, column.getNumber(record));
        }
        text += '\n';
        if (text.size() >= kBlock) {
            file.write(text);
            text.clear();
        }
    }
    file.write(text);
    file.finish();
}

}  // namespace viable
