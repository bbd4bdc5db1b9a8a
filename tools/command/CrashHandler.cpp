#include "CrashHandler.h"

#include <dlfcn.h>
#include <execinfo.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "StopSignals.h"
#include "core/ChildProcess.h"
#include "host/PluginCall.h"
#include "log/Recorder.h"
#include "viable/testing/AllocationCounter.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define VIABLE_PROGRAM_SANITIZED 1
#else
#define VIABLE_PROGRAM_SANITIZED 0
#endif

namespace viable {

namespace {

/** How long a dying program waits for its logs. */
constexpr double kRescue_s = 3.0;
/** How long a plugin may stay in one call before the user is told. */
constexpr std::chrono::seconds kHang{10};
constexpr std::chrono::milliseconds kLook{50};

char runFolder[4096] = "";
char runClaim[sizeof runFolder + sizeof kClaim] = "";
std::atomic<const char*> stage{nullptr};
std::atomic<PluginsRun> pluginsRun{PluginsRun::Here};
std::atomic<pid_t> dying{0};  // the thread that tells of a failure and ends the program
std::atomic<int> endCode{static_cast<int>(ErrorKind::PluginFailed)};
std::atomic<pid_t> owner{0};  // the process whose crashes are answered
std::terminate_handler usualTerminate = nullptr;

// Where to speak, if not to the terminal (see tellCrashTo).
char* sink = nullptr;
std::size_t sinkLeft = 0;

/** All that a signal handler may use to speak. */
void say(const char* text) {
    if (sink) {
        const std::size_t size = std::min(std::strlen(text), sinkLeft);
        std::memcpy(sink, text, size);
        sink += size;
        *sink = '\0';
        sinkLeft -= size;
        return;
    }
    for (std::size_t left = std::strlen(text); left > 0;) {
        const ssize_t written = write(STDERR_FILENO, text, left);
        if (written <= 0) return;
        text += written;
        left -= static_cast<std::size_t>(written);
    }
}

void say(std::int64_t number) {
    char digits[24];
    char* begin = digits + sizeof digits - 1;
    *begin = '\0';
    do {
        *--begin = static_cast<char>('0' + number % 10);
        number /= 10;
    } while (number > 0);
    say(begin);
}

bool isOwner() {
    return getpid() == owner;
}

template <class First, class Second, class... More>
void say(First first, Second second, More... more) {
    say(first);
    say(second);
    (say(more), ...);
}

/** "viable: the filter plugin 'x' (/path/x.so) <what> in its tick 12" */
void sayWho(const PluginWatch& watch, const char* what, std::int64_t tick) {
    if (!sink) say("\nviable: ");
    say(watch.title.c_str(), what);
    if (tick < 0)
        say(" ", nameCall(tick));
    else
        say(" in tick ", tick);
}

/** False: another thread, or this one, does so already. */
bool tryClaimEnd() {
    pid_t none = 0;
    return dying.compare_exchange_strong(none, gettid());
}

/** Returns in the first thread that asks: it tells what failed, and ends the program. */
void claimEnd() {
    if (tryClaimEnd()) return;
    if (dying == gettid()) {  // it failed once more while it told of the first time
        if (*runFolder) unlink(runClaim);
        _exit(endCode);
    }
    for (;;) pause();  // the first one's account is enough
}

/** The plugin whose code this thread runs; null: none. */
const PluginWatch* findCulprit(std::int64_t& tick) {
    const CallSlot* slot = ownCallSlot();
    if (!slot) return nullptr;
    tick = slot->tick.load();
    // Isolated, only a library's start-up code runs here; the rest of the call is the host's.
    return pluginsRun == PluginsRun::Isolated && tick != kLoading ? nullptr : slot->watch.load();
}

[[noreturn]] void endProgram(int code) {
    endCode = code;
    if (sink) _exit(code);
    doLastAct();
    const bool whole = Recorder::rescueAll(kRescue_s);
    if (*runFolder) unlink(runClaim);
    if (*runFolder && rmdir(runFolder) == 0) *runFolder = '\0';  // nothing was written yet
    if (*runFolder && whole && pluginsRun == PluginsRun::NoMore)
        say("The logs in ", runFolder, " are complete. `viable report ", runFolder, "` shows them. ");
    else if (*runFolder && whole)
        say("The logs in ", runFolder, " end there and are complete; there is no summary. `viable report ", runFolder,
            "` shows them. ");
    else if (*runFolder)
        say("Not every log in ", runFolder, " could be finished; `viable recover LOG` saves them. ");
    if (pluginsRun == PluginsRun::Here)
        say("With `viable run --isolate` such a plugin runs in a process of its own: the arm is braked, and the run "
            "gives its account. ");
    say("`gdb --args viable run ...` shows the line.\n");
    _exit(code);
}

[[noreturn]] void endAfterPlugin() {
    say(". ");
    endProgram(static_cast<int>(ErrorKind::PluginFailed));
}

/** The first plugin library whose code is on the stack of this thread; null: none. */
const char* findLibraryOnStack() {
    void* frames[64];
    const int count = backtrace(frames, 64);
    for (int i = 0; i < count; ++i) {
        Dl_info info;
        if (dladdr(frames[i], &info) == 0 || !info.dli_fname) continue;
        for (const auto& entry : loadedLibraries()) {
            const char* const library = entry.load();
            if (!library) break;
            if (std::strcmp(library, info.dli_fname) == 0) return library;
        }
    }
    return nullptr;
}

/** Its path; a sweep's tables are the same wherever it lies. */
void sayLibrary(const char* library) {
    const char* const name = std::strrchr(library, '/');
    say(sink && name ? name + 1 : library);
}

/** Something failed, and this thread is in no plugin's call. */
[[noreturn]] void endOutsideOfCalls() {
    if (const char* const now = stage) say(" ", now);
    const bool isViables = pluginsRun != PluginsRun::Here || !loadedLibraries().front().load();
    endCode = isViables ? kUnexpected : static_cast<int>(ErrorKind::PluginFailed);
    if (!loadedLibraries().front().load()) {
        say(". No plugin was loaded: this is a fault of viable. Please report it.\n");
        _exit(kUnexpected);
    }
    if (const char* const library = findLibraryOnStack()) {
        say(", outside of the calls of plugins, in a thread that runs code of ");
        sayLibrary(library);
        endAfterPlugin();
    }
    if (isViables) {
        say(pluginsRun == PluginsRun::Isolated
                ? ". Each plugin runs in a process of its own: this is a fault of viable. Please report it. "
                : ". All cases have ended, and no plugin is called any more: this is a fault of viable, unless a "
                  "plugin damaged memory before. Please report it. ");
        endProgram(kUnexpected);
    }
    say(", outside of the calls of plugins. A plugin may have damaged memory before, or a thread of its own has "
        "failed");
    if (sink) endAfterPlugin();
    say(". Suspects are all that are loaded: ");
    const char* separator = "";
    for (const auto& entry : loadedLibraries()) {
        const char* const library = entry.load();
        if (!library) break;
        say(separator);
        sayLibrary(library);
        separator = ", ";
    }
    endAfterPlugin();
}

/** Claims the end and says what ended the program; false where no plugin was called. */
bool claimEndAndSay(const char* ofPlugin, const char* otherwise) {
    claimEnd();
    std::int64_t tick = 0;
    const PluginWatch* watch = findCulprit(tick);
    if (watch)
        sayWho(*watch, ofPlugin, tick);
    else
        say(otherwise);
    return watch != nullptr;
}

void onCrash(int signal) {
    if (!isOwner()) {
        ::signal(signal, SIG_DFL);
        raise(signal);
        return;
    }
    const bool isPlugins = claimEndAndSay(" crashed", sink ? "crashed" : "\nviable: crashed");
    const char* name = sigdescr_np(signal);
    say(": signal ", signal, " (", name ? name : "unknown", ")");
    if (!isPlugins) endOutsideOfCalls();
    endAfterPlugin();
}

/** std::terminate(): an exception left a thread or a noexcept function. */
void onTerminate() {
    if (!isOwner()) usualTerminate();
    const bool isPlugins = claimEndAndSay(
        " called std::terminate()", sink ? "std::terminate() was called" : "\nviable: std::terminate() was called");
    if (std::current_exception()) {
        say(": an exception that nobody catches: ");
        try {
            throw;
        } catch (const std::exception& e) {
            say(e.what());
        } catch (...) {
            say("something other than a std::exception");
        }
    }
    if (!isPlugins) endOutsideOfCalls();
    endAfterPlugin();
}

void onExit() {
    if (!isOwner()) return;
    if (dying != 0) claimEnd();  // another thread ends the program, and its code says why
    std::int64_t tick = 0;
    const PluginWatch* watch = findCulprit(tick);
    if (!watch) return;
    claimEnd();
    sayWho(*watch, " called exit()", tick);
    endAfterPlugin();
}

}  // namespace

void prepareThreadForCrash() {
    if (VIABLE_PROGRAM_SANITIZED) return;  // sanitizers have signal stacks of their own
    alignas(16) static thread_local char memory[1 << 16];
    stack_t stack{};
    stack.ss_sp = memory;
    stack.ss_size = sizeof memory;
    sigaltstack(&stack, nullptr);
}

void installCrashHandler(const std::filesystem::path& folder) {
    if (VIABLE_PROGRAM_SANITIZED) return;
    std::snprintf(runFolder, sizeof runFolder, "%s", folder.c_str());
    std::snprintf(runClaim, sizeof runClaim, "%s/%s", runFolder, kClaim);
    prepareThreadForCrash();
    struct sigaction action {};
    action.sa_handler = onCrash;
    action.sa_flags = SA_ONSTACK | SA_NODEFER;  // a crash in the handler is seen, too
    for (int signal : detail::kCrashSignals) sigaction(signal, &action, nullptr);
    owner = getpid();
    static const bool once = [] {
        usualTerminate = std::set_terminate(onTerminate);
        void* frame = nullptr;
        backtrace(&frame, 1);  // loads what it needs now, not in a crash
        return std::atexit(onExit) == 0 && std::at_quick_exit(onExit) == 0;
    }();
    static_cast<void>(once);
}

void tellStage(const char* what, PluginsRun where) {
    stage = what;
    pluginsRun = where;
}

void tellCrashTo(char* text, std::size_t capacity) {
    sink = text;
    sinkLeft = capacity - 1;
}

void endWhenMemoryRunsOut() {
    std::set_new_handler([] {
        claimEndAndSay(" asked for memory and there was none left,", "memory ran out, outside of the calls of plugins");
        endAfterPlugin();
    });
}

void countPluginAllocations() {
    if (testing::AllocationCounter::isAvailable())
        setAllocationCounter([] { return testing::AllocationCounter::total(); });
}

HangWatch::HangWatch(double timeout_s, const std::atomic<int>& endRequested)
    : timeout_(timeout_s), endRequested_(endRequested), seen_(callSlots().size()) {
    thread_ = std::thread([this] {
        while (!done_) {
            std::this_thread::sleep_for(kLook);
            look();
        }
    });
}

HangWatch::~HangWatch() {
    done_ = true;
    thread_.join();
}

void HangWatch::look() {
    const auto now = std::chrono::steady_clock::now();
    for (std::size_t i = 0; i < seen_.size(); ++i) {
        const CallSlot& slot = callSlots()[i];
        const std::uint64_t calls = slot.calls.load();
        const PluginWatch* watch = slot.watch.load();
        if (calls != seen_[i].calls || !watch) {
            seen_[i] = {calls, now, false};
            continue;
        }
        const std::chrono::duration<double> waited = now - seen_[i].since;
        const std::int64_t tick = slot.tick.load();
        if ((waited > timeout_ || (endRequested_ != 0 && waited > kHang)) && tryClaimEnd()) {
            sayWho(*watch, " has not come back", tick);
            endAfterPlugin();
        }
        if (waited < kHang || seen_[i].told) continue;
        seen_[i].told = true;
        sayWho(*watch, " has not come back", tick);
        say(" for 10 s. Ctrl-C ends the program; `viable run --isolate` ends such a plugin by itself and brakes the "
            "arm.\n");
    }
}

}  // namespace viable
