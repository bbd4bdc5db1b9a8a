#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <set>
#include <vector>

namespace viable {

/** From now on a crash (SIGSEGV, abort, ...) and a call of exit() inside a plugin are answered with a message that names
the plugin and its tick; the logs are finished first, and the program ends with code 4. A crash elsewhere ends the
program by its signal, as ever. Does nothing in sanitizer builds, which tell more themselves.
@param folder  of the run, for the message */
void installCrashHandler(const std::filesystem::path& folder);

/** Gives the calling thread a stack for signal handlers, so that even a plugin that has used up the stack is named. */
void prepareThreadForCrash();

/** Has heap allocations inside plugins counted, where malloc can be replaced (see AllocationCounter). */
void countPluginAllocations();

/** Tells, once each, of plugins that do not come back from a call. One thread. */
class HangWatch {
public:
    /** Call it now and then. When the user has asked for the end and a plugin stands in its way, the logs are finished
    and the program ends with code 4. */
    void look(bool endRequested);

private:
    struct Seen {
        std::uint64_t calls = 0;
        std::chrono::steady_clock::time_point since;
        bool told = false;
    };
    std::vector<Seen> seen_;
};

}  // namespace viable
