#include "viable/log/LogExport.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <string>
#include <string_view>
#include <system_error>

#include "viable/core/Error.h"
#include "viable/log/LogReader.h"

namespace viable {

namespace {

constexpr std::size_t kBlock = 1 << 20;  // [bytes] written at once

Error notWritten(const std::filesystem::path& csv, int code) {
    return Error(ErrorKind::LogNotWritten, csv.string(),
                 "the CSV file cannot be written: " + std::generic_category().message(code),
                 "Choose a folder that exists, may be written to and has room");
}

Error existsAlready(const std::filesystem::path& csv) {
    return badInput(csv.string(), "the file exists already and is never overwritten",
                    "Choose another name or move the old file away");
}

/** A file beside `target` that takes its name at the end, or disappears. */
class PendingFile {
public:
    explicit PendingFile(const std::filesystem::path& target) : target_(target) {
        for (int attempt = 0; descriptor_ < 0; ++attempt) {
            path_ = target;
            path_ += "." + std::to_string(::getpid()) + "-" + std::to_string(attempt) + ".part";
            descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
            if (descriptor_ < 0 && errno != EEXIST && errno != EINTR) {
                throw notWritten(target_, errno);
            }
        }
    }
    ~PendingFile() {
        if (descriptor_ >= 0) ::close(descriptor_);
        if (!path_.empty()) ::unlink(path_.c_str());
    }
    PendingFile(const PendingFile&) = delete;
    PendingFile& operator=(const PendingFile&) = delete;

    void write(std::string_view bytes) {
        while (!bytes.empty()) {
            const ssize_t taken = ::write(descriptor_, bytes.data(), bytes.size());
            if (taken < 0 && errno == EINTR) continue;
            if (taken <= 0) throw notWritten(target_, taken < 0 ? errno : EIO);
            bytes.remove_prefix(static_cast<std::size_t>(taken));
        }
    }

    void finish() {
        const int descriptor = descriptor_;
        descriptor_ = -1;
        if (::close(descriptor) != 0 && errno != EINTR) throw notWritten(target_, errno);
        if (::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.c_str(), RENAME_NOREPLACE) !=
            0) {
            if (errno == EEXIST) throw existsAlready(target_);
            // Not every file system knows the flag.
            if (errno != EINVAL && errno != ENOSYS) throw notWritten(target_, errno);
            if (::access(target_.c_str(), F_OK) == 0) throw existsAlready(target_);
            if (::rename(path_.c_str(), target_.c_str()) != 0) throw notWritten(target_, errno);
        }
        path_.clear();
    }

private:
    std::filesystem::path target_, path_;
    int descriptor_ = -1;
};

void appendText(std::string& line, std::string_view text) {
    if (text.find_first_of(",\"\r\n") == std::string_view::npos) {
        line += text;
        return;
    }
    line += '"';
    for (const char c : text) {
        if (c == '"') line += '"';
        line += c;
    }
    line += '"';
}

template <class Number>
void appendNumber(std::string& line, Number value) {
    char digits[32];
    const auto result = std::to_chars(digits, digits + sizeof(digits), value);
    line.append(digits, result.ptr);
}

}  // namespace

void exportCsv(const std::filesystem::path& log, const std::filesystem::path& csv) {
    LogReader reader(log);
    std::error_code ignored;
    if (std::filesystem::symlink_status(csv, ignored).type() !=
        std::filesystem::file_type::not_found) {
        throw existsAlready(csv);
    }
    PendingFile file(csv);
    const std::vector<LogColumn>& columns = reader.columns();
    std::string text;
    for (const LogColumn& column : columns) {
        if (!text.empty()) text += ',';
        appendText(text, column.name());
    }
    text += '\n';
    TickRecord record;
    while (reader.read(record)) {
        const char* separator = "";
        for (const LogColumn& column : columns) {
            text += separator;
            separator = ",";
            if (column.isText()) {
                appendText(text, column.getText(record));
            } else if (column.isInteger()) {
                appendNumber(text, column.getInteger(record));
            } else {
                appendNumber(text, column.getNumber(record));
            }
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
