#include "core/WholeFile.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <system_error>
#include <utility>

namespace viable {

static Error existsAlready(const std::string& place) {
    return badInput(place, "the file exists already and is never overwritten",
                    "Choose another name or move the old file away");
}

/** The name of a file that is to become `target`. */
static std::filesystem::path makePartName(const std::filesystem::path& target, int attempt) {
    // A name that fits still fits with what is added to it.
    constexpr std::size_t kKept = 200;
    return target.parent_path() / (target.filename().string().substr(0, kKept) + "." + std::to_string(::getpid()) +
                                   "-" + std::to_string(attempt) + ".part");
}

/** A path to what a descriptor has open. */
static std::string nameOf(int descriptor) {
    return "/proc/self/fd/" + std::to_string(descriptor);
}

std::optional<std::string> readWhole(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) return std::nullopt;
    std::string text;
    char buffer[65536];
    while (stream.read(buffer, sizeof buffer) || stream.gcount() > 0)
        text.append(buffer, static_cast<std::size_t>(stream.gcount()));
    return stream.bad() ? std::nullopt : std::optional(std::move(text));  // bad: a folder, or the disk failed
}

void replaceFile(const std::filesystem::path& file, std::string_view text) {
    std::error_code error;
    if (std::filesystem::exists(file, error) && !std::filesystem::is_regular_file(file, error))
        throw Error(ErrorKind::LogNotWritten, file.string(), "this is no file that could be replaced", "Name a file.");
    detail::WholeFile whole(file, true);
    whole.write(text);
    whole.finish();
}

void writeNew(const std::filesystem::path& file, std::string_view text) {
    detail::WholeFile whole(file);
    whole.write(text);
    whole.finish();
}

void refuseExisting(const std::string& option, const std::filesystem::path& file) {
    std::error_code error;
    if (std::filesystem::exists(std::filesystem::symlink_status(file, error)))
        throw existsAlready(option + " " + file.string());
}

namespace detail {

int openBeside(const std::filesystem::path& target, std::filesystem::path& name, bool isReplacing) {
    struct stat info {};
    if (::lstat(target.c_str(), &info) == 0) errno = isReplacing ? ENOENT : EEXIST;
    if (errno != ENOENT) return -1;
    for (int attempt = 0;; ++attempt) {
        name = makePartName(target, attempt);
        const int descriptor = ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor >= 0 || (errno != EEXIST && errno != EINTR)) return descriptor;
    }
}

int giveName(const std::filesystem::path& from, const std::filesystem::path& to) {
    if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
    // Not every file system knows the flag.
    if (errno != EINVAL && errno != ENOSYS) return errno;
    if (::link(from.c_str(), to.c_str()) == 0) {
        ::unlink(from.c_str());
        return 0;
    }
    if (errno == EEXIST) return EEXIST;
    struct stat info {};
    if (::lstat(to.c_str(), &info) == 0) return EEXIST;
    return ::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

int writeAll(int descriptor, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t taken = ::write(descriptor, bytes.data(), bytes.size());
        if (taken < 0 && errno == EINTR) continue;
        if (taken <= 0) return taken < 0 ? errno : EIO;
        bytes.remove_prefix(static_cast<std::size_t>(taken));
    }
    return 0;
}

WholeFile::WholeFile(const std::filesystem::path& target, bool isReplacing)
    : target_(target), isReplacing_(isReplacing) {
    openUnnamed();
    if (descriptor_ < 0) descriptor_ = openBeside(target, path_, isReplacing);
    if (descriptor_ >= 0) return;
    if (errno == EEXIST) throw existsAlready(target.string());
    throw notWritten(errno);
}

WholeFile::~WholeFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!path_.empty()) ::unlink(path_.c_str());
}

Error WholeFile::notWritten(const std::string& reason) const {
    return Error(ErrorKind::LogNotWritten, target_.string(), "the file cannot be written: " + reason,
                 "Choose a folder that exists, may be written to and has room");
}

Error WholeFile::notWritten(int code) const {
    return notWritten(std::generic_category().message(code));
}

void WholeFile::write(std::string_view bytes) {
    if (const int code = writeAll(descriptor_, bytes)) throw notWritten(code);
}

/** Opens a file without a name beside the target, if that can get one later; leaves descriptor_ as it is otherwise. */
void WholeFile::openUnnamed() {
    struct stat info {};
    const bool isThere = ::lstat(target_.c_str(), &info) == 0;
    if (isThere ? !isReplacing_ : errno != ENOENT) return;
    const std::filesystem::path folder = target_.has_parent_path() ? target_.parent_path() : ".";
    const int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
    if (descriptor < 0) return;
    if (::access(nameOf(descriptor).c_str(), F_OK) == 0)
        descriptor_ = descriptor;
    else
        ::close(descriptor);  // no /proc
}

/** Gives the unnamed file a name: the target's, or where that is to be replaced one beside it. Returns 0 or an errno. */
int WholeFile::nameIt() {
    const std::string unnamed = nameOf(descriptor_);
    const auto link = [&](const std::filesystem::path& name) {
        return ::linkat(AT_FDCWD, unnamed.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0 ? 0 : errno;
    };
    int code = link(target_);
    if (code != EEXIST || !isReplacing_) return code;
    for (int attempt = 0; code == EEXIST; ++attempt) {
        const std::filesystem::path name = makePartName(target_, attempt);
        code = link(name);
        if (code == 0) path_ = name;
    }
    return code;
}

/** Where the file system gives an unnamed file no name: copies it to a file with one beside the target. Returns 0 or an
errno. */
int WholeFile::copyBeside() {
    std::filesystem::path name;
    const int copy = openBeside(target_, name, isReplacing_);
    if (copy < 0) return errno;
    path_ = name;
    int code = ::lseek(descriptor_, 0, SEEK_SET) < 0 ? errno : 0;
    char buffer[65536];
    while (code == 0) {
        const ssize_t taken = ::read(descriptor_, buffer, sizeof buffer);
        if (taken == 0) break;
        if (taken > 0)
            code = writeAll(copy, {buffer, static_cast<std::size_t>(taken)});
        else if (errno != EINTR)
            code = errno;
    }
    ::close(descriptor_);
    descriptor_ = copy;
    return code;
}

void WholeFile::finish() {
    int code = 0;
    if (path_.empty()) {
        // Closing a second descriptor tells what the file system has put off, before anybody finds the file.
        const int second = ::dup(descriptor_);
        if (second < 0 || (::close(second) != 0 && errno != EINTR)) throw notWritten(errno);
        code = nameIt();
        if (code != 0 && code != EEXIST) code = copyBeside();
    }
    const int descriptor = descriptor_;
    descriptor_ = -1;
    if (::close(descriptor) != 0 && errno != EINTR && code == 0) code = errno;
    if (code == 0 && !path_.empty()) {
        if (!isReplacing_)
            code = giveName(path_, target_);
        else if (::rename(path_.c_str(), target_.c_str()) != 0)
            code = errno;
    }
    if (code == EEXIST && !isReplacing_) throw existsAlready(target_.string());
    if (code != 0) throw notWritten(code);
    path_.clear();
}

}  // namespace detail

}  // namespace viable
