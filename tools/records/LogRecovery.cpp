#include <algorithm>

#include "core/WholeFile.h"
#include "records/LogExport.h"
#include "records/LogReader.h"

namespace viable {

namespace {

/** Log bytes into a file that is whole, and gets its name, only when the writer says so. */
class PendingSink : public LogSink {
public:
    PendingSink(detail::WholeFile& file, std::optional<Error>& failure) : file_(file), failure_(failure) {}
    bool write(const void* data, std::size_t size, std::string& error) override {
        try {
            file_.write({static_cast<const char*>(data), size});
            return true;
        } catch (const Error& e) {
            failure_ = e;
            error = e.what();
            return false;
        }
    }
    bool close(std::string&) override { return true; }

private:
    detail::WholeFile& file_;
    std::optional<Error>& failure_;
};

bool hasColumn(const LogReader& reader, const std::string& name) {
    return std::any_of(reader.columns().begin(), reader.columns().end(),
                       [&](const LogColumn& column) { return column.name() == name; });
}

/** Writes the rows of `log` (of a take, or 0: all) into a new log with the same opening; returns their number. */
std::uint64_t copyLog(const std::filesystem::path& log, const std::filesystem::path& target, bool isReplacing,
                      std::int64_t take, const char* remedy) {
    LogReader reader(log);
    reader.keepTake(take);
    detail::WholeFile file(target, isReplacing);
    LogOpening opening{reader.layout(), reader.metadata(), reader.attachments()};
    if (take > 0) opening.metadata["take"] = std::to_string(take);
    std::optional<Error> failure;
    LogWriter writer(std::make_unique<PendingSink>(file, failure), opening);
    TickRecord record;
    std::size_t attached = opening.attachments.size();
    while (writer.status().ok() && reader.read(record)) {
        for (; attached < reader.attachments().size(); ++attached) writer.attach(reader.attachments()[attached]);
        writer.append(record);
    }
    writer.finish();
    if (failure) throw *failure;
    if (!writer.status().ok())
        throw Error(ErrorKind::LogNotWritten, target.string(), writer.status().error, "Free memory and try again");
    // Columns that are missing would come out as if somebody had logged zeros.
    const std::vector<LogColumn> expected = listColumns(reader.layout());
    const bool lacks = std::any_of(expected.begin(), expected.end(), [&](const LogColumn& column) {
        return !column.mayLack() && !hasColumn(reader, column.name());
    });
    if (lacks) {
        if (writer.status().rows == 0)
            throw badInput(log.string(), "the log ends within its opening and holds no rows",
                           "There is nothing to recover; run the experiment again");
        throw badInput(log.string(), "the log has other columns than this version writes", remedy);
    }
    file.finish();
    return writer.status().rows;
}

}  // namespace

std::uint64_t recoverLog(const std::filesystem::path& log, const std::filesystem::path& whole) {
    return copyLog(log, whole, false, 0, "Recover it with the version that wrote it, or export it as it is");
}

void exportMcap(const std::filesystem::path& log, const std::filesystem::path& mcap, bool isReplacing,
                std::int64_t take) {
    copyLog(log, mcap, isReplacing, take,
            "Logs of before this form open in other programs as they are; else export it to csv or hdf5");
}

}  // namespace viable
