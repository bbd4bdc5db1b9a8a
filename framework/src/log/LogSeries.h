#pragma once

#include "log/LogWriter.h"

namespace viable {

/** A log of limited size: where one file would grow beyond a share of the limit the next one begins, FILE.mcap,
FILE.part2.mcap, ..., each of them a log by itself. Where all of them together would be larger than the limit, the oldest but
the first are deleted: the first is what the run is known by, and where a replay begins.

With a limit a full disk loses rows, and is tried again with a new file kRetryRows later, as often as it takes. */
class LogSeries : public RowWriter {
public:
    static constexpr int kFiles = 8;
    static constexpr std::uint64_t kRetryRows = 10000;

    /** Creates the first file. Throws Error as LogWriter does.
    @param limit_bytes  0: one file without limit */
    LogSeries(std::filesystem::path file, LogOpening opening, std::uint64_t limit_bytes);

    void append(const TickRecord& record) noexcept override;
    /** Into the file at hand, and no other. */
    void attach(const LogAttachment& attachment) noexcept override;
    void finish() noexcept override;
    /** Of all files, the deleted ones included. */
    const LogStatus& status() const override { return status_; }

    /** FILE.mcap, FILE.part2.mcap, ...: the `number`th, from 1. No case's own log is called so. */
    static std::filesystem::path nameFile(const std::filesystem::path& file, int number);
    /** Those of the log after its first file that are there, in order: some may have been deleted between. */
    static std::vector<std::filesystem::path> listLater(const std::filesystem::path& file);

private:
    void beginNext() noexcept;
    void readStatus() noexcept;
    void makeRoom() noexcept;

    const std::filesystem::path file_;
    const LogOpening opening_;
    const std::uint64_t limit_;
    std::unique_ptr<LogWriter> writer_;  // null: the next file could not be made
    int number_ = 1, oldest_ = 2;
    std::vector<std::uint64_t> sizes_;  // of finished files, [bytes]; 0: deleted
    LogStatus before_, status_;         // of finished files; of all
    std::uint64_t lostInARow_ = 0;
};

}  // namespace viable
