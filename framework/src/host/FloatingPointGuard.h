#pragma once

#include <cfenv>
#include <cstdint>
#include <string>

namespace viable {

/** Remembers the thread's floating point modes and sets them back when it goes out of scope.

Foreign code can change how this thread rounds and whether it keeps denormal numbers: the start-up
code that gcc links into libraries built with -ffast-math does exactly that. Every later number of
the run would differ, silently. Modes only; the exception flags that were raised are set back too.
*/
class FloatingPointGuard {
public:
    FloatingPointGuard();
    ~FloatingPointGuard();
    FloatingPointGuard(const FloatingPointGuard&) = delete;
    FloatingPointGuard& operator=(const FloatingPointGuard&) = delete;

    /** What differs now from the time of construction, in words; empty when nothing does. */
    std::string describeChange() const;

    /** For every tick, where the above costs too much: the modes of the arithmetic as the processor holds them, what
    differs from them now (null: nothing), and setting them back. */
    static std::uint64_t readModes();
    static const char* findChange(std::uint64_t modes);
    static void setModes(std::uint64_t modes);

private:
    std::fenv_t environment_;
    int rounding_;
    std::uint64_t control_;  ///< the processor's own register: MXCSR, FPCR
};

}  // namespace viable
