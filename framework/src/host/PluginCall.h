#pragma once

#include <atomic>

#include "host/PluginLoader.h"

namespace viable {

/** What the host found out about a plugin, as the end of a sentence about it: its process crashed, ended itself, or was
ended because it hung; it changed the thread's arithmetic; it handed on what is no decision. */
class PluginFault : public std::runtime_error {
public:
    /** @param remedy  a literal: what the plugin's author can do */
    PluginFault(const std::string& what, const char* remedy) : std::runtime_error(what), remedy_(remedy) {}
    const char* remedy() const { return remedy_; }

private:
    const char* remedy_;
};

/** One plugin of a run, as the host watches it. Must outlive the calls. */
struct PluginWatch {
    explicit PluginWatch(const PluginInfo& plugin);
    explicit PluginWatch(std::string whose) : title(std::move(whose)) {}

    std::string title;  ///< "the filter plugin 'tosbp' (/path/viable_filter_tosbp.so)"
    /** Ticks in which it took memory from the heap, after kWarmUpTicks; see setAllocationCounter. */
    std::int64_t allocatingTicks = 0;
    std::int64_t firstAllocation = -1, lastAllocation = -1;
    /** What it changed of what all of the program shares before the first tick, and when; see ProcessGuard. */
    std::string sharedChange;
    std::string lastWords;  ///< how it failed while it was destroyed, as the end of a sentence
};

/** Ticks at the beginning in which memory may still be taken: libraries fill their caches in them. */
inline constexpr std::int64_t kWarmUpTicks = 10;

// The tick of calls that are in none.
inline constexpr std::int64_t kBeforeFirstTick = -1;
inline constexpr std::int64_t kAfterLastTick = -2;  ///< it is destroyed
inline constexpr std::int64_t kLoading = -3;        ///< its library's start-up code
inline constexpr std::int64_t kMaking = -4;
inline constexpr std::int64_t kConfiguring = -5;
inline constexpr std::int64_t kAsking = -6;  ///< what it guarantees, follows, ...: once, after configure()
inline constexpr std::int64_t kResetting = -7;
inline constexpr std::int64_t kJudging = -8;  ///< of a kind of limit: it judges an arm, outside of the ticks
/** When that is, as in "it crashed while it was made", "in reset()". A literal. */
const char* nameCall(std::int64_t tick);

/** What a thread does inside a plugin, readable by a signal handler and by other threads. */
struct CallSlot {
    std::atomic<bool> taken{false};
    std::atomic<const PluginWatch*> watch{nullptr};  ///< null: no plugin's code runs
    std::atomic<std::int64_t> tick{kBeforeFirstTick};
    std::atomic<std::uint64_t> calls{0};  ///< so far: stands still while a plugin hangs
};

/** Of all threads, the free ones included. */
const std::array<CallSlot, 256>& callSlots();

/** Of this thread; null when all slots were taken. May be called from a signal handler after the thread's first
PluginCall. */
const CallSlot* ownCallSlot();
/** This thread writes into `slot` from now on, which may lie in memory that another process reads. */
void useCallSlot(CallSlot& slot);

/** Files of the plugin libraries that were opened so far, from the first on; null: no more, or no more room. May be read
in a signal handler. */
const std::array<std::atomic<const char*>, 64>& loadedLibraries();
void addLoadedLibrary(const std::string& file);

/** Where the program counts this thread's heap allocations: returns how many there were so far. Null: not counted. */
using AllocationCount = std::int64_t (*)();
void setAllocationCounter(AllocationCount count);
/** What the counter says; 0 without one. */
std::int64_t countAllocations();

/** What to say of a change of arithmetic: a format for printf, its one %s from PluginCall::undoArithmeticChange(). */
inline constexpr char kArithmeticChange[] =
    "it changed the floating point arithmetic of the whole thread (%s; set back)";
std::string formatArithmeticChange(const char* change);

/** Adds what a ProcessGuard told, if anything, to watch.sharedChange. @param when  "loaded", "made" */
void addSharedChange(PluginWatch& watch, const char* when, const std::string& change);
/** The warning that watch.sharedChange, not empty, is worth. */
std::string formatSharedChange(const PluginWatch& watch);

// What the author of a plugin can do.
inline constexpr char kOnThrow[] =
    "reset() and the tick functions must not throw: catch it in the plugin and return a status that says that there is "
    "no result.";
inline constexpr char kOnValues[] =
    "Return one finite number per joint (look for a division by zero or a root of a negative number), or a status that "
    "says that there is none.";
inline constexpr char kOnArithmeticChange[] =
    "Set the modes back before the function returns, and compile without -ffast-math.";

/** Runs a plugin's code; what it throws, in words: "threw: ..."; empty: nothing. */
template <class Work>
std::string describeThrow(const Work& work) {
    try {
        work();
    } catch (const std::exception& e) {
        return std::string("threw: ") + e.what();
    } catch (...) {
        return "threw something other than a std::exception";
    }
    return "";
}

/** Marks that a plugin's code runs, from construction to destruction; may be nested. Watches what it leaves behind.
Real time: no allocation, lock or throw, some ten nanoseconds; the thread's first one sets up its slot. */
class PluginCall {
public:
    /** @param watch  null: not marked, nothing watched */
    PluginCall(PluginWatch* watch, std::int64_t tick) noexcept;
    ~PluginCall();
    PluginCall(const PluginCall&) = delete;
    PluginCall& operator=(const PluginCall&) = delete;

    /** What the call took from the heap does not count: it failed, and is told of for that. */
    void forgetAllocations() noexcept { tick_ = kBeforeFirstTick; }

    /** How the plugin changed the thread's floating point arithmetic since construction, in words; null when it did
    not. Sets it back. */
    const char* undoArithmeticChange() noexcept;

private:
    PluginWatch* watch_;
    std::int64_t tick_;
    const PluginWatch* outerWatch_ = nullptr;
    std::int64_t outerTick_ = kBeforeFirstTick;
    std::int64_t allocations_ = 0;
    std::uint64_t control_;
};

/** Calls reset(); whatever it throws, and a changed arithmetic, becomes an Error (PluginFailed, of a plant's Error its own kind
and words) that names the plugin.
@param watch  null: only its kind is named, and an Error that names it already passes */
void resetPlugin(Plugin& plugin, PluginKind kind, PluginWatch* watch, const MotionState& start);

}  // namespace viable
