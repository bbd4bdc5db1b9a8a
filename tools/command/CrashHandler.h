#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <thread>
#include <vector>

namespace viable {

/** From now on a crash (SIGSEGV, abort, ...), an exception that nobody catches, and a call of exit() or quick_exit() inside
a plugin are answered with a message that names the plugin and its call; the logs are finished, and the program ends
with code 4. Where no plugin's call fails (a thread of a plugin's own, or memory that was damaged before), it names the
library whose code the thread runs, or all that are loaded; without any, or where no plugin's code runs (see tellStage), the
fault is viable's (code 70). Only in the process that called this last: those forked from it end by their signal. Does nothing
in sanitizer builds, which tell more themselves.
@param folder  of the run, for the message and its claim, until the program ends; empty: there is none */
void installCrashHandler(const std::filesystem::path& folder);

/** Where the code of plugins runs. */
enum class PluginsRun {
    Here,
    Isolated,  ///< in processes of their own; a library's start-up code runs here, too
    NoMore,    ///< all cases have ended
};
/** What the program does from now on, for the crash handler. @param what  a literal, such as "while the cases ran" */
void tellStage(const char* what, PluginsRun where);

/** Gives the calling thread a stack for signal handlers, so that even a plugin that has used up the stack is named. */
void prepareThreadForCrash();

/** From now on the crash handler writes what it has to say into `text`, and nothing to the terminal. The text may lie in
memory that another process reads. */
void tellCrashTo(char* text, std::size_t capacity);

/** From now on the process ends with code 4 when memory runs out, in place of std::bad_alloc in whatever asks next; the
crash handler says who asked. */
void endWhenMemoryRunsOut();

/** Has heap allocations inside plugins counted, where malloc can be replaced (see AllocationCounter). */
void countPluginAllocations();

/** A file in a run's folder for as long as the run lasts: of two that begin at once, one can make it. */
constexpr char kClaim[] = "run.claim";

/** Exit code of a fault of viable itself, as sysexits.h numbers it. */
constexpr int kUnexpected = 70;

/** How long a plugin may stay in one call before the program ends, unless told otherwise [s]. */
constexpr double kDefaultPatience_s = 60.0;

/** Watches for plugins that do not come back from a call, in a thread of its own, from construction to destruction. After 10 s it tells of
one, once; after `timeout_s`, or when the user has asked for the end meanwhile, the logs are finished and the
program ends with code 4. */
class HangWatch {
public:
    /** @param endRequested  non-zero: the user has asked for the end */
    HangWatch(double timeout_s, const std::atomic<int>& endRequested);
    ~HangWatch();

private:
    void look();
    struct Seen {
        std::uint64_t calls = 0;
        std::chrono::steady_clock::time_point since;
        bool told = false;
    };
    std::chrono::duration<double> timeout_;
    const std::atomic<int>& endRequested_;
    std::vector<Seen> seen_;
    std::atomic<bool> done_{false};
    std::thread thread_;
};

}  // namespace viable
