#include "log/PendingFile.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

namespace viable::detail {

namespace {

Error notWritten(const std::filesystem::path& file, int code) {
    return Error(ErrorKind::LogNotWritten, file.string(),
                 "the file cannot be written: " + std::generic_category().message(code),
                 "Choose a folder that exists, may be written to and has room");
}

Error existsAlready(const std::filesystem::path& file) {
    return badInput(file.string(), "the file exists already and is never overwritten",
                    "Choose another name or move the old file away");
}

}  // namespace

PendingFile::PendingFile(const std::filesystem::path& target) : target_(target) {
    std::error_code ignored;
    if (std::filesystem::symlink_status(target, ignored).type() !=
        std::filesystem::file_type::not_found)
        throw existsAlready(target);
    for (int attempt = 0; descriptor_ < 0; ++attempt) {
        path_ = target;
        path_ += "." + std::to_string(::getpid()) + "-" + std::to_string(attempt) + ".part";
        descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor_ < 0 && errno != EEXIST && errno != EINTR) {
            throw notWritten(target_, errno);
        }
    }
}

PendingFile::~PendingFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!path_.empty()) ::unlink(path_.c_str());
}

void PendingFile::write(std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t taken = ::write(descriptor_, bytes.data(), bytes.size());
        if (taken < 0 && errno == EINTR) continue;
        if (taken <= 0) throw notWritten(target_, taken < 0 ? errno : EIO);
        bytes.remove_prefix(static_cast<std::size_t>(taken));
    }
}

void PendingFile::finish() {
    const int descriptor = descriptor_;
    descriptor_ = -1;
    if (::close(descriptor) != 0 && errno != EINTR) throw notWritten(target_, errno);
    if (::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.c_str(), RENAME_NOREPLACE) != 0) {
        if (errno == EEXIST) throw existsAlready(target_);
        // Not every file system knows the flag.
        if (errno != EINVAL && errno != ENOSYS) throw notWritten(target_, errno);
        if (::access(target_.c_str(), F_OK) == 0) throw existsAlready(target_);
        if (::rename(path_.c_str(), target_.c_str()) != 0) throw notWritten(target_, errno);
    }
    path_.clear();
}

}  // namespace viable::detail
