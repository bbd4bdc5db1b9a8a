#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace viable {

/** Why the program cannot go on; the value is the exit code of the command. */
enum class ErrorKind {
    BadInput = 2,         ///< a file, an argument or a plugin library is not what it must be
    GuaranteeBroken = 3,  ///< a limit that was guaranteed was passed
    PluginFailed = 4,     ///< a plugin threw or returned nonsense during the run
    LogNotWritten = 5,    ///< the log could not be created or written to its end
    TrackingLost = 6,     ///< the real arm left the bound around the nominal one, or did not follow it, and was braked
};

/** An error of loading or configuring, told in one paragraph: where, what, and what to do.
Never thrown inside a tick. */
class Error : public std::runtime_error {
public:
    /** @param where   place: `file:line:column: key.path`, a library's path, or empty
        @param what    what is wrong, with the value and the allowed range
        @param remedy  what the user can do about it; a sentence, may be empty */
    Error(ErrorKind kind, const std::string& where, const std::string& what, const std::string& remedy = {});

    ErrorKind kind() const { return kind_; }
    int exitCode() const { return static_cast<int>(kind_); }

private:
    ErrorKind kind_;
};

/** Shorthand for the commonest kind. */
Error badInput(const std::string& where, const std::string& what, const std::string& remedy = {});

/** The name in `candidates` nearest to `name` by edit distance, or empty when none is near enough
to be a plausible typing error. */
std::string findClosestName(const std::string& name, const std::vector<std::string>& candidates);

namespace detail {
[[noreturn]] void failCheck(const char* condition, const char* file, int line, const char* text);
}

/** States what must hold by this program's own logic. Stays on in every build; prints and aborts. */
#define VIABLE_CHECK(condition, text)                                                        \
    do {                                                                                     \
        if (!(condition)) ::viable::detail::failCheck(#condition, __FILE__, __LINE__, text); \
    } while (false)

}  // namespace viable
