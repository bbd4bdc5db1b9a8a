#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "viable/core/Error.h"

namespace viable {

/** The bytes of a file; none where it cannot be read. */
std::optional<std::string> readWhole(const std::filesystem::path& file);

/** Writes a file whole or not at all; one that is there is replaced, a folder or device is not. Throws Error
(LogNotWritten). */
void replaceFile(const std::filesystem::path& file, std::string_view text);

/** The same for a file that must be new: of two writers the second one is refused (BadInput). */
void writeNew(const std::filesystem::path& file, std::string_view text);

/** Refuses a place for a new file where something is already. @param option  that named it. Throws Error (BadInput). */
void refuseExisting(const std::string& option, const std::filesystem::path& file);

namespace detail {

/** Makes and opens a new file beside `target` and tells its `name`. -1 and errno when that fails; EEXIST, unless it is
to be replaced: there is something at `target`. */
int openBeside(const std::filesystem::path& target, std::filesystem::path& name, bool isReplacing = false);

/** Gives the file `from` the name `to`, which nothing has yet. Returns 0 or an errno; EEXIST: something has it. (Where the
file system knows neither RENAME_NOREPLACE nor hard links: had it a moment before.) */
int giveName(const std::filesystem::path& from, const std::filesystem::path& to);

/** Returns 0 or an errno. */
int writeAll(int descriptor, std::string_view bytes);

/** A file that takes the name `target` at the end, or disappears: whoever looks finds all of it or nothing. Where the
file system can, it has no name before, so that a killed program leaves nothing; else one beside `target` (without hard
links: it is copied there at the end). An older file is not overwritten, or (replacing) stays until then. Every failure is an Error: BadInput when `target`
exists, else LogNotWritten. */
class WholeFile {
public:
    explicit WholeFile(const std::filesystem::path& target, bool isReplacing = false);
    ~WholeFile();
    WholeFile(const WholeFile&) = delete;
    WholeFile& operator=(const WholeFile&) = delete;

    void write(std::string_view bytes);
    /** For a library that writes by itself: open for reading and writing until finish(). */
    int descriptor() const { return descriptor_; }
    void finish();

    /** What to throw when it cannot be written for a `reason`, or for a `code` of errno. */
    Error notWritten(const std::string& reason) const;
    Error notWritten(int code) const;

private:
    void openUnnamed();
    int nameIt();
    int copyBeside();

    std::filesystem::path target_, path_;  // path_: its name so far, empty without one
    bool isReplacing_;
    int descriptor_ = -1;
};

}  // namespace detail

}  // namespace viable
