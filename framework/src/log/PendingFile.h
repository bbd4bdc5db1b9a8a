#pragma once

#include <filesystem>
#include <string_view>

#include "viable/core/Error.h"

namespace viable::detail {

/** A file beside `target` that takes its name at the end, or disappears: whoever looks finds all of it or nothing, and no
older file is overwritten. Every failure is an Error: BadInput when `target` exists, else LogNotWritten. */
class PendingFile {
public:
    explicit PendingFile(const std::filesystem::path& target);
    ~PendingFile();
    PendingFile(const PendingFile&) = delete;
    PendingFile& operator=(const PendingFile&) = delete;

    /** Where it is until finish(), for a library that writes by name. */
    const std::filesystem::path& path() const { return path_; }
    void write(std::string_view bytes);
    void finish();

private:
    std::filesystem::path target_, path_;
    int descriptor_ = -1;
};

}  // namespace viable::detail
