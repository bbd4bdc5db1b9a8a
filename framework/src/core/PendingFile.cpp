#include "core/PendingFile.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

namespace viable::detail {

namespace {

Error existsAlready(const std::filesystem::path& file) {
    return badInput(file.string(), "the file exists already and is never overwritten",
                    "Choose another name or move the old file away");
}

}  // namespace

int openBeside(const std::filesystem::path& target, std::filesystem::path& name) {
    struct stat info {};
    if (::lstat(target.c_str(), &info) == 0) errno = EEXIST;
    if (errno != ENOENT) return -1;
    // A name that fits still fits with what is added to it.
    constexpr std::size_t kKept = 200;
    const std::string begin = target.filename().string().substr(0, kKept) + "." + std::to_string(::getpid()) + "-";
    for (int attempt = 0;; ++attempt) {
        name = target.parent_path() / (begin + std::to_string(attempt) + ".part");
        const int descriptor = ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor >= 0 || (errno != EEXIST && errno != EINTR)) return descriptor;
    }
}

int giveName(const std::filesystem::path& from, const std::filesystem::path& to) {
    if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
    // Not every file system knows the flag.
    if (errno != EINVAL && errno != ENOSYS) return errno;
    struct stat info {};
    if (::lstat(to.c_str(), &info) == 0) return EEXIST;
    return ::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

PendingFile::PendingFile(const std::filesystem::path& target) : target_(target) {
    descriptor_ = openBeside(target, path_);
    if (descriptor_ >= 0) return;
    if (errno == EEXIST) throw existsAlready(target);
    throw notWritten(errno);
}

PendingFile::~PendingFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!path_.empty()) ::unlink(path_.c_str());
}

Error PendingFile::notWritten(const std::string& reason) const {
    return Error(ErrorKind::LogNotWritten, target_.string(), "the file cannot be written: " + reason,
                 "Choose a folder that exists, may be written to and has room");
}

Error PendingFile::notWritten(int code) const {
    return notWritten(std::generic_category().message(code));
}

void PendingFile::write(std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t taken = ::write(descriptor_, bytes.data(), bytes.size());
        if (taken < 0 && errno == EINTR) continue;
        if (taken <= 0) throw notWritten(taken < 0 ? errno : EIO);
        bytes.remove_prefix(static_cast<std::size_t>(taken));
    }
}

void PendingFile::finish() {
    const int descriptor = descriptor_;
    descriptor_ = -1;
    if (::close(descriptor) != 0 && errno != EINTR) throw notWritten(errno);
    const int code = giveName(path_, target_);
    if (code == EEXIST) throw existsAlready(target_);
    if (code != 0) throw notWritten(code);
    path_.clear();
}

}  // namespace viable::detail
