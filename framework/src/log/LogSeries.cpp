#include "log/LogSeries.h"

#include <charconv>
#include <numeric>
#include <system_error>

namespace viable {

LogSeries::LogSeries(std::filesystem::path file, LogOpening opening, std::uint64_t limit_bytes)
    : file_(std::move(file)),
      opening_(std::move(opening)),
      limit_(limit_bytes),
      writer_(std::make_unique<LogWriter>(file_, opening_)) {}

std::filesystem::path LogSeries::nameFile(const std::filesystem::path& file, int number) {
    if (number == 1) return file;
    return file.parent_path() / (file.stem().string() + ".part" + std::to_string(number) + file.extension().string());
}

std::vector<std::filesystem::path> LogSeries::listLater(const std::filesystem::path& file) {
    const std::string begin = file.stem().string() + ".part";
    std::map<int, std::filesystem::path> later;
    std::error_code error;
    for (std::filesystem::directory_iterator entry(file.parent_path().empty() ? "." : file.parent_path(), error), end;
         !error && entry != end; entry.increment(error)) {
        const std::string stem = entry->path().stem().string();
        if (stem.rfind(begin, 0) != 0) continue;
        int number = 0;
        std::from_chars(stem.data() + begin.size(), stem.data() + stem.size(), number);
        if (number > 1 && entry->path().filename() == nameFile(file, number).filename()) later[number] = entry->path();
    }
    std::vector<std::filesystem::path> files;
    for (const auto& [number, name] : later) files.push_back(name);
    return files;
}

void LogSeries::append(const TickRecord& record) noexcept {
    if (writer_) writer_->append(record);
    const bool isWritten = writer_ && writer_->status().ok();
    if (!writer_) ++before_.lost;
    readStatus();
    if (limit_ == 0) return;
    lostInARow_ = isWritten ? 0 : lostInARow_ + 1;
    if (isWritten ? writer_->status().bytes >= limit_ / kFiles : lostInARow_ >= kRetryRows) beginNext();
}

void LogSeries::attach(const LogAttachment& attachment) noexcept {
    if (writer_) writer_->attach(attachment);
    readStatus();
}

void LogSeries::finish() noexcept {
    if (writer_) writer_->finish();
    readStatus();
}

void LogSeries::readStatus() noexcept {
    status_.rows = before_.rows;
    status_.lost = before_.lost;
    status_.bytes = before_.bytes;
    if (!writer_) return;
    const LogStatus& now = writer_->status();
    status_.rows += now.rows;
    status_.lost += now.lost;
    status_.bytes += now.bytes;
    if (status_.error.empty() && !now.error.empty()) status_.error = now.error;
}

void LogSeries::beginNext() noexcept {
    if (writer_) {
        writer_->finish();
        readStatus();
        sizes_.push_back(writer_->status().bytes);
        before_ = status_;
        writer_.reset();
    }
    lostInARow_ = 0;
    try {
        makeRoom();
        writer_ = std::make_unique<LogWriter>(nameFile(file_, number_ + 1), opening_);
        ++number_;
    } catch (const std::exception& e) {
        if (status_.error.empty()) status_.error = e.what();
    }
}

/** For one file more. */
void LogSeries::makeRoom() noexcept {
    std::uint64_t all = std::accumulate(sizes_.begin(), sizes_.end(), std::uint64_t{0});
    for (; all + limit_ / kFiles > limit_ && oldest_ <= static_cast<int>(sizes_.size()); ++oldest_) {
        std::error_code error;
        std::filesystem::remove(nameFile(file_, oldest_), error);
        all -= sizes_[oldest_ - 1];
        sizes_[oldest_ - 1] = 0;
    }
}

}  // namespace viable
