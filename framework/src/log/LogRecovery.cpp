#include "log/PendingFile.h"
#include "viable/log/LogExport.h"
#include "viable/log/LogReader.h"
#include "viable/log/LogWriter.h"

namespace viable {

namespace {

/** Log bytes into a file that appears only when it is whole. */
class PendingSink : public LogSink {
public:
    explicit PendingSink(detail::PendingFile& file) : file_(file) {}
    bool write(const void* data, std::size_t size, std::string& error) override {
        return attempt([&] { file_.write({static_cast<const char*>(data), size}); }, error);
    }
    bool close(std::string& error) override {
        return attempt([&] { file_.finish(); }, error);
    }

private:
    template <class Work>
    static bool attempt(Work&& work, std::string& error) {
        try {
            work();
            return true;
        } catch (const Error& e) {
            error = e.what();
            return false;
        }
    }
    detail::PendingFile& file_;
};

}  // namespace

std::uint64_t recoverLog(const std::filesystem::path& log, const std::filesystem::path& whole) {
    LogReader reader(log);
    detail::PendingFile file(whole);
    LogOpening opening{reader.layout(), reader.metadata(), reader.attachments()};
    LogWriter writer(std::make_unique<PendingSink>(file), opening);
    TickRecord record;
    while (reader.read(record)) writer.append(record);
    writer.finish();
    if (!writer.status().ok())
        throw Error(ErrorKind::LogNotWritten, whole.string(), writer.status().error,
                    "Choose a folder that has room.");
    return writer.status().rows;
}

}  // namespace viable
