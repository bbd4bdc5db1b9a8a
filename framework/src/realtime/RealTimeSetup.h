#pragma once

#include <sched.h>
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace viable {

/** What a thread asks of the system. */
struct RealTimeWish {
    int cpu = -1;       ///< the processor it is to run on; -1: any
    int priority = 80;  ///< of SCHED_FIFO, 1 to 99; 0: none
    bool lockMemory = true;
};

/** What the system has refused. */
struct RealTimeRefusal {
    std::string what;    ///< "memory is not locked"
    std::string why;     ///< "8 MB may be locked (RLIMIT_MEMLOCK), 213 MB are needed"
    std::string remedy;  ///< for a shell, or a sentence

    std::string sentence() const { return what + ": " + why + ". " + remedy; }
};

/** How the memory of the process can be kept from being paged out. */
enum class MemoryLock {
    None,     ///< not at all
    Present,  ///< what it has now; what it takes later is not locked
    All,      ///< all, also what it takes later
};

/** The most that may be locked, and what there is to lock. */
struct MemoryRoom {
    static constexpr std::uint64_t kUnlimited = UINT64_MAX;
    std::uint64_t limit = 0;   ///< RLIMIT_MEMLOCK [byte]; kUnlimited also where the process is exempt from it
    std::uint64_t size = 0;    ///< addresses of the process, touched or not [byte]: these count
    std::uint64_t growth = 0;  ///< by which locked memory may still grow by itself, the main thread's stack [byte]
};

/** All only without a limit: with MCL_FUTURE and a limit, mlockall() succeeds, and whatever takes memory later fails when
the limit is reached, first the stack of the next thread; who waits for that thread then waits for ever. Present where the
process has room under the limit and its main stack has to grow (a locked stack that reaches the limit is a crash). */
MemoryLock decideMemoryLock(const MemoryRoom& room);

/** As the system has it now. Whether the limit is held to is tried: neither being root nor a capability says so in a
container. */
MemoryRoom readMemoryRoom();

/** What has been had, and what not; undone when it is destroyed: policy, processors and memory are those of before. Priority
and processor are those of the thread that entered, lock of memory and malloc's options those of the process. */
class RealTimeState {
public:
    RealTimeState() = default;
    RealTimeState(RealTimeState&& other) noexcept;
    RealTimeState& operator=(RealTimeState&& other) noexcept;
    ~RealTimeState() { leave(); }

    /** It has a priority, and all that was wished for. The file of latencies, which nobody wished for, may be missing. */
    bool isRealTime() const { return held_.isRealTime; }
    /** Of SCHED_FIFO, may be less than wished; 0: none. */
    int priority() const { return held_.priority; }
    /** The only processor it runs on; -1: any. */
    int cpu() const { return held_.cpu; }
    MemoryLock memoryLock() const { return held_.memoryLock; }
    /** /dev/cpu_dma_latency is held at 0: no processor sleeps deeply. */
    bool holdsLatency() const { return held_.latencyFile >= 0; }
    const std::vector<RealTimeRefusal>& refusals() const { return refusals_; }

    /** Gives all back; harmless when called again. */
    void leave();

private:
    friend RealTimeState enterRealTime(const RealTimeWish& wish, const MemoryRoom& room);
    void lockMemory(const MemoryRoom& room);
    void setProcessor(int cpu);
    void setPriority(int priority);
    void holdLatency();
    void refuse(std::string what, std::string why, std::string remedy);

    struct Held {
        bool isRealTime = false;
        int priority = 0, cpu = -1;
        MemoryLock memoryLock = MemoryLock::None;
        int latencyFile = -1;
        pid_t thread = 0;  // 0: nothing to undo
    } held_;
    struct {
        int policy = SCHED_OTHER;
        sched_param parameter{};
        cpu_set_t processors{};
    } before_;
    std::vector<RealTimeRefusal> refusals_;
};

/** Makes the calling thread one of real time, after ALL threads of the process have been started: faults in 256 kB of its
stack, keeps malloc from giving memory back, locks memory as decideMemoryLock() says, ties the thread to the processor, holds
/dev/cpu_dma_latency at 0, and last takes SCHED_FIFO (threads that it starts later do not get it). What is refused is listed,
nothing throws; the thread goes on with the rest. @param room  what may be locked; a test has its own */
RealTimeState enterRealTime(const RealTimeWish& wish, const MemoryRoom& room = readMemoryRoom());

/** By the marks that docker, podman, LXC and Kubernetes leave in /, /run and /proc below `root`. */
bool isInContainer(const std::filesystem::path& root = "/");

/** Remedies, each for one paste into a shell of the user concerned; doctor and enterRealTime() give the same ones. */
namespace remedy {
std::string forPriority(bool isContainer);
std::string forMemory(bool isContainer);
/** @param code  errno of opening /dev/cpu_dma_latency; not ENOENT outside a container: the kernel has none */
std::string forLatencyFile(bool isContainer, int code);
/** For root: without sudo, which may not be there. */
std::string makeForRoot(const std::string& remedy);
}  // namespace remedy

}  // namespace viable
