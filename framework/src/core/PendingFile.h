#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "viable/core/Error.h"

namespace viable::detail {

/** Makes and opens a new file beside `target` and tells its `name`. -1 and errno when that fails, EEXIST when there
is something at `target`. */
int openBeside(const std::filesystem::path& target, std::filesystem::path& name);

/** Gives the file `from` the name `to`, which nothing has yet. Returns 0 or an errno; EEXIST: something has it. */
int giveName(const std::filesystem::path& from, const std::filesystem::path& to);

/** A file beside `target` that takes its name at the end, or disappears: whoever looks finds all of it or nothing, and no
older file is overwritten. Every failure is an Error: BadInput when `target` exists, else LogNotWritten. */
class PendingFile {
public:
    explicit PendingFile(const std::filesystem::path& target);
    ~PendingFile();
    PendingFile(const PendingFile&) = delete;
    PendingFile& operator=(const PendingFile&) = delete;

    void write(std::string_view bytes);
    /** For a library that writes by itself: open for reading and writing until finish(). */
    int descriptor() const { return descriptor_; }
    void finish();

    /** What to throw when it cannot be written for a `reason`, or for a `code` of errno. */
    Error notWritten(const std::string& reason) const;
    Error notWritten(int code) const;

private:
    std::filesystem::path target_, path_;
    int descriptor_ = -1;
};

}  // namespace viable::detail
