#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <thread>
#include <vector>

namespace viable {

/** From now on a crash (SIGSEGV, abort, ...) and a call of exit() or quick_exit() inside a plugin are answered with a message that names
the plugin and its tick; the logs are finished first, and the program ends with code 4. A crash elsewhere ends the
program by its signal, as ever. Does nothing in sanitizer builds, which tell more themselves.
@param folder  of the run, for the message */
void installCrashHandler(const std::filesystem::path& folder);

/** Gives the calling thread a stack for signal handlers, so that even a plugin that has used up the stack is named. */
void prepareThreadForCrash();

/** From now on the crash handler writes what it has to say into `text`, and nothing to the terminal. The text may lie in
memory that another process reads. */
void tellCrashTo(char* text, std::size_t capacity);

/** Has heap allocations inside plugins counted, where malloc can be replaced (see AllocationCounter). */
void countPluginAllocations();

/** How long a plugin may stay in one tick before the program ends, unless told otherwise [s]. */
constexpr double kDefaultPatience_s = 60.0;

/** Watches for plugins that do not come back from a call, in a thread of its own, from construction to destruction. After 10 s it tells of
one, once; after `patience_s` in a tick, or when the user has asked for the end meanwhile, the logs are finished and the
program ends with code 4. */
class HangWatch {
public:
    /** @param endRequested  non-zero: the user has asked for the end */
    HangWatch(double patience_s, const std::atomic<int>& endRequested);
    ~HangWatch();

private:
    void look();
    struct Seen {
        std::uint64_t calls = 0;
        std::chrono::steady_clock::time_point since;
        bool told = false;
    };
    std::chrono::duration<double> patience_;
    const std::atomic<int>& endRequested_;
    std::vector<Seen> seen_;
    std::atomic<bool> done_{false};
    std::thread thread_;
};

}  // namespace viable
