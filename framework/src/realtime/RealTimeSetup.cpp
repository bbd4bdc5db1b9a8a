#include "realtime/RealTimeSetup.h"

#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <system_error>
#include <utility>

#include "core/Text.h"
#include "core/WholeFile.h"

namespace viable {

namespace {

constexpr std::size_t kStackToTouch = 256 * 1024;  // a tick of 16 joints with obstacles uses less than 64 kB
constexpr char kLatencyPath[] = "/dev/cpu_dma_latency";

std::string describeError(int code) {
    return strerrordesc_np(code) ? strerrordesc_np(code) : "error " + std::to_string(code);
}

std::string formatMegabytes(std::uint64_t bytes) {
    return detail::format("%.0f MB", static_cast<double>(bytes) / (1024.0 * 1024.0));
}

/** Limits are held to, or not; told by trying on addresses with nothing behind them. */
bool isBeyondLockable(std::uint64_t limit) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    const std::size_t size = static_cast<std::size_t>(limit) / page * page + page;
    void* const memory = mmap(nullptr, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED) return false;
    const bool isLocked = syscall(SYS_mlock2, memory, size, 1 /* MLOCK_ONFAULT */) == 0;
    munmap(memory, size);
    return isLocked;
}

/** Addresses of this process [byte]. */
std::uint64_t readSize() {
    unsigned long long pages = 0;
    if (std::FILE* file = std::fopen("/proc/self/statm", "re")) {
        if (std::fscanf(file, "%llu", &pages) != 1) pages = 0;
        std::fclose(file);
    }
    return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::size_t getStackLeft() {
    pthread_attr_t attributes;
    if (pthread_getattr_np(pthread_self(), &attributes) != 0) return 0;
    void* lowest = nullptr;
    std::size_t size = 0;
    pthread_attr_getstack(&attributes, &lowest, &size);
    pthread_attr_destroy(&attributes);
    return static_cast<std::size_t>(static_cast<char*>(__builtin_frame_address(0)) - static_cast<char*>(lowest));
}

[[gnu::noinline]] void touchStack(std::size_t size) {
    auto* const memory = static_cast<volatile char*>(__builtin_alloca(size));
    for (std::size_t i = 0; i < size; i += 4096) memory[i] = 0;
}

std::string listProcessors(const cpu_set_t& set) {
    std::string list;
    for (int first = 0; first < CPU_SETSIZE; ++first) {
        if (!CPU_ISSET(first, &set)) continue;
        int last = first;
        while (last + 1 < CPU_SETSIZE && CPU_ISSET(last + 1, &set)) ++last;
        detail::addItem(list, std::to_string(first) + (last > first ? "-" + std::to_string(last) : ""), ",");
        first = last;
    }
    return list;
}

}  // namespace

bool isInContainer(const std::filesystem::path& root) {
    std::error_code failed;
    for (const char* mark : {".dockerenv", "run/.containerenv"})
        if (std::filesystem::exists(root / mark, failed)) return true;
    const std::string groups = readWhole(root / "proc/self/cgroup").value_or("");
    for (const char* name : {"docker", "kubepods", "lxc", "libpod"})
        if (groups.find(name) != std::string::npos) return true;
    return false;
}

namespace remedy {

constexpr char kRights[] =
    "# start the container with: docker run --cap-add sys_nice --ulimit rtprio=98 --ulimit memlock=-1";

/** @param limit  as limits.conf has it @param value  of it */
static std::string makeLimit(const std::string& limit, const std::string& value) {
    return "echo \"$(id -un) - " + limit + " " + value + "\" | sudo tee /etc/security/limits.d/90-viable-" + limit +
           ".conf  # then log in again";
}

std::string forPriority(bool isContainer) {
    return isContainer ? kRights : makeLimit("rtprio", "98");
}

std::string forMemory(bool isContainer) {
    return isContainer ? kRights : makeLimit("memlock", "unlimited");
}

std::string forLatencyFile(bool isContainer, int code) {
    if (isContainer && code == EACCES) return "sudo chmod 666 /dev/cpu_dma_latency  # until the container ends";
    if (isContainer) return "# start the container with: docker run --device /dev/cpu_dma_latency";
    return "sudo groupadd -rf realtime && sudo usermod -aG realtime \"$(id -un)\" && echo "
           "'KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"' | sudo tee "
           "/etc/udev/rules.d/90-viable-latency.rules && sudo udevadm control --reload && sudo udevadm trigger "
           "--name-match=cpu_dma_latency  # then log in again";
}

std::string makeForRoot(const std::string& remedy) {
    return detail::replaceAll(remedy, "sudo ", "");
}

}  // namespace remedy

MemoryLock decideMemoryLock(const MemoryRoom& room) {
    if (room.limit == MemoryRoom::kUnlimited) return MemoryLock::All;
    return room.growth <= room.limit && room.size <= room.limit - room.growth ? MemoryLock::Present : MemoryLock::None;
}

MemoryRoom readMemoryRoom() {
    constexpr std::uint64_t kStackAtMost = 64 << 20;  // where the stack has no limit
    MemoryRoom room;
    rlimit lockable{}, stack{};
    getrlimit(RLIMIT_MEMLOCK, &lockable);
    getrlimit(RLIMIT_STACK, &stack);
    room.limit = lockable.rlim_cur == RLIM_INFINITY || isBeyondLockable(lockable.rlim_cur) ? MemoryRoom::kUnlimited
                                                                                           : lockable.rlim_cur;
    room.size = readSize();
    room.growth = std::min<std::uint64_t>(stack.rlim_cur, kStackAtMost);
    return room;
}

void RealTimeState::refuse(std::string what, std::string why, std::string remedy) {
    if (geteuid() == 0) remedy = remedy::makeForRoot(remedy);
    refusals_.push_back({std::move(what), std::move(why), std::move(remedy)});
}

void RealTimeState::lockMemory(const MemoryRoom& room) {
    const MemoryLock lock = decideMemoryLock(room);
    std::string why;
    if (lock == MemoryLock::None) {
        why = formatMegabytes(room.limit) + " may be locked (ulimit -l), and the process has " +
              formatMegabytes(room.size) + " of addresses";
    } else if (mlockall(lock == MemoryLock::All ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) != 0) {
        why = "mlockall: " + describeError(errno);
        munlockall();  // part of it may be locked
    } else {
        held_.memoryLock = lock;
        return;
    }
    refuse("memory is not locked, and may be paged out", why, remedy::forMemory(isInContainer()));
}

void RealTimeState::setProcessor(int cpu) {
    cpu_set_t wanted;
    CPU_ZERO(&wanted);
    if (cpu < CPU_SETSIZE) CPU_SET(cpu, &wanted);
    if (sched_setaffinity(held_.thread, sizeof wanted, &wanted) == 0) {
        held_.cpu = cpu;
        return;
    }
    refuse("the loop is not tied to processor " + std::to_string(cpu),
           "this process may use the processors " + listProcessors(before_.processors),
           "Name one of these, or give it more: taskset, cgroup cpuset, or docker run --cpuset-cpus");
}

void RealTimeState::setPriority(int priority) {
    const auto take = [this](int wanted) {
        sched_param parameter{};
        parameter.sched_priority = wanted;
        if (sched_setscheduler(held_.thread, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameter) != 0) return errno;
        held_.priority = wanted;
        return 0;
    };
    const int code = take(priority);
    if (code == 0) return;
    rlimit limit{};
    getrlimit(RLIMIT_RTPRIO, &limit);
    const std::string wanted = "priority " + std::to_string(priority);
    if (code == EINVAL) {
        refuse("the loop has no real-time priority", wanted + " does not exist", "Choose 1 to 99");
    } else if (limit.rlim_cur > 0 && limit.rlim_cur < 100 && take(static_cast<int>(limit.rlim_cur)) == 0) {
        refuse("the loop has a lower priority than asked for",
               std::to_string(held_.priority) + " is allowed, not " + std::to_string(priority) + " (ulimit -r)",
               remedy::forPriority(isInContainer()));
    } else if (limit.rlim_cur == 0 && geteuid() != 0) {
        refuse("the loop has no real-time priority", "none is allowed to this user (ulimit -r is 0)",
               remedy::forPriority(isInContainer()));
    } else {  // in a container, also for root
        refuse("the loop has no real-time priority", "SCHED_FIFO, " + wanted + ": " + describeError(code),
               remedy::forPriority(true));
    }
}

void RealTimeState::holdLatency() {
    const int file = open(kLatencyPath, O_WRONLY | O_CLOEXEC);
    const std::int32_t none_us = 0;
    if (file >= 0 && write(file, &none_us, sizeof none_us) == static_cast<ssize_t>(sizeof none_us)) {
        held_.latencyFile = file;
        return;
    }
    const int code = errno;
    if (file >= 0) close(file);
    refuse("processors may sleep deeply, and wake late", std::string(kLatencyPath) + ": " + describeError(code),
           remedy::forLatencyFile(isInContainer(), code));
}

RealTimeState enterRealTime(const RealTimeWish& wish, const MemoryRoom& room) {
    RealTimeState state;
    state.held_.thread = static_cast<pid_t>(syscall(SYS_gettid));
    state.before_.policy = sched_getscheduler(state.held_.thread);
    sched_getparam(state.held_.thread, &state.before_.parameter);
    sched_getaffinity(state.held_.thread, sizeof state.before_.processors, &state.before_.processors);
    state.refusals_.reserve(4);

    mallopt(M_TRIM_THRESHOLD, -1);  // freed memory stays ours, faulted in
    mallopt(M_MMAP_MAX, 0);         // and large pieces are not given back one by one
    touchStack(std::min(kStackToTouch, getStackLeft() / 2));
    if (wish.lockMemory) state.lockMemory(room);
    if (wish.cpu >= 0) state.setProcessor(wish.cpu);
    if (wish.priority != 0) state.holdLatency();
    if (wish.priority != 0) state.setPriority(wish.priority);
    state.held_.isRealTime = state.held_.priority > 0 && state.held_.priority == wish.priority &&
                             state.held_.cpu == std::max(wish.cpu, -1) &&
                             (!wish.lockMemory || state.held_.memoryLock != MemoryLock::None);
    return state;
}

void RealTimeState::leave() {
    if (held_.thread == 0) return;
    // Without privileges the mark that its threads do not inherit the priority cannot be taken off again.
    if (held_.priority > 0 && sched_setscheduler(held_.thread, before_.policy, &before_.parameter) != 0)
        sched_setscheduler(held_.thread, before_.policy | SCHED_RESET_ON_FORK, &before_.parameter);
    if (held_.cpu >= 0) sched_setaffinity(held_.thread, sizeof before_.processors, &before_.processors);
    if (held_.memoryLock != MemoryLock::None) munlockall();
    if (held_.latencyFile >= 0) close(held_.latencyFile);
    mallopt(M_TRIM_THRESHOLD, 128 * 1024);  // glibc's own
    mallopt(M_MMAP_MAX, 65536);
    held_ = {};
}

RealTimeState::RealTimeState(RealTimeState&& other) noexcept {
    *this = std::move(other);
}

RealTimeState& RealTimeState::operator=(RealTimeState&& other) noexcept {
    if (this == &other) return *this;
    leave();
    held_ = std::exchange(other.held_, {});
    before_ = other.before_;
    refusals_ = std::move(other.refusals_);
    return *this;
}

}  // namespace viable
