// What the system grants and refuses; fault 27. Each case is a process of its own, with the user and the limits it needs.
#include "realtime/RealTimeSetup.h"

#include <linux/capability.h>
#include <pthread.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <functional>
#include <system_error>
#include <thread>
#include <utility>

#include "ExpectContains.h"

// The library's system calls come by here, which may refuse them.
namespace {
int largestPriority = 0;  // of who may have no higher one; 0: as the system has it
}

extern "C" int sched_setscheduler(pid_t thread, int policy, const sched_param* parameter) noexcept {
    if (largestPriority > 0 && parameter->sched_priority > largestPriority) {
        errno = EPERM;
        return -1;
    }
    return static_cast<int>(syscall(SYS_sched_setscheduler, thread, policy, parameter));
}
extern "C" int getrlimit(__rlimit_resource_t resource, rlimit* limit) noexcept {
    const int code = static_cast<int>(syscall(SYS_prlimit64, 0, resource, nullptr, limit));
    if (code == 0 && resource == RLIMIT_RTPRIO && largestPriority > 0)
        limit->rlim_cur = static_cast<rlim_t>(largestPriority);
    return code;
}

namespace viable::test {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kLocks = false;  // sanitizers replace mlockall() by nothing
#else
constexpr bool kLocks = true;
#endif

constexpr rlim_t kMegabyte = 1024 * 1024;

/** Who a process is: an ordinary user with 8 MB of lockable memory and no priority, or one who may do both. */
enum class User { Ordinary, Privileged };

struct Said {
    bool isPossible = false;
    int status = 0;  // of waitpid
    std::string text;
};

bool become(User user) {
    const rlimit memory{8 * kMegabyte, 8 * kMegabyte}, priority{0, 0};
    setrlimit(RLIMIT_MEMLOCK, &memory);  // where less is allowed already it stays so
    setrlimit(RLIMIT_RTPRIO, &priority);
    if (geteuid() != 0) return user == User::Ordinary;
    if (prctl(PR_SET_KEEPCAPS, 1) != 0 || setgid(65534) != 0 || setuid(65534) != 0) return false;
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    __user_cap_data_struct data[2]{};
    if (user == User::Privileged) data[0].permitted = data[0].effective = 1u << CAP_IPC_LOCK | 1u << CAP_SYS_NICE;
    return syscall(SYS_capset, &header, data) == 0;
}

/** Runs `body` in a process of its own; what it returns. */
Said runAs(User user, const std::function<std::string()>& body) {
    int pipes[2];
    if (pipe(pipes) != 0) return {};
    const pid_t child = fork();
    if (child == 0) {
        alarm(60);  // a dead-lock is a death by SIGALRM
        if (!become(user)) _exit(77);
        const std::string text = body();
        _exit(write(pipes[1], text.data(), text.size()) == static_cast<ssize_t>(text.size()) ? 0 : 1);
    }
    close(pipes[1]);
    Said said;
    char buffer[4096];
    for (ssize_t n; (n = read(pipes[0], buffer, sizeof buffer)) > 0;)
        said.text.append(buffer, static_cast<std::size_t>(n));
    close(pipes[0]);
    waitpid(child, &said.status, 0);
    said.isPossible = !(WIFEXITED(said.status) && WEXITSTATUS(said.status) == 77);
    return said;
}

#define SKIP_WITHOUT_RIGHTS(said) \
    if (!(said).isPossible) GTEST_SKIP() << "only root with CAP_SYS_NICE and CAP_IPC_LOCK can give these rights away"

std::string readStatus(const char* key) {
    std::string found = "?";
    if (std::FILE* file = std::fopen("/proc/self/status", "r")) {
        char line[256];
        while (std::fgets(line, sizeof line, file))
            if (std::strncmp(line, key, std::strlen(key)) == 0) found = line + std::strlen(key) + 1;
        std::fclose(file);
    }
    return found;
}

bool hasLocked() {
    return std::atoll(readStatus("VmLck").c_str()) > 0;
}

/** Policy of the calling thread, without the mark of its children. */
int getPolicy() {
    return sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
}

std::string describe(const RealTimeState& state) {
    const char* const locks[] = {"None", "Present", "All"};
    std::string text = std::string("real time ") + (state.isRealTime() ? "yes" : "no") + ", priority " +
                       std::to_string(state.priority()) + ", policy " + (getPolicy() == SCHED_FIFO ? "FIFO" : "other") +
                       ", lock " + locks[static_cast<int>(state.memoryLock())] +
                       (hasLocked() ? ", locked" : ", unlocked") + "\n";
    for (const RealTimeRefusal& refusal : state.refusals()) text += refusal.sentence() + "\n";
    return text;
}

/** Starts some threads, each of which uses its stack and takes memory; how many did. */
int startThreads(int count) {
    std::atomic<int> done{0};
    std::vector<std::thread> threads;
    try {
        for (int i = 0; i < count; ++i)
            threads.emplace_back([&done] {
                std::vector<char> memory(4 * kMegabyte, 1);
                volatile char stack[128 * 1024];
                for (std::size_t k = 0; k < sizeof stack; k += 4096) stack[k] = memory[k];
                done += getPolicy() == SCHED_OTHER;  // they do not get the loop's priority
            });
    } catch (const std::system_error&) {  // EAGAIN: no stack
    }
    for (std::thread& thread : threads) thread.join();
    return done;
}

/** As `viable live` does it: threads, then real time, and then threads nobody thought of. */
std::string enterBetweenThreads(const RealTimeWish& wish) {
    std::atomic<bool> isOver{false};
    std::thread early([&isOver] {
        while (!isOver) sched_yield();
    });
    const RealTimeState state = enterRealTime(wish);
    const int late = startThreads(6);
    isOver = true;
    early.join();
    return describe(state) + "threads " + std::to_string(late);
}

TEST(RealTimeSetup, MemoryIsLockedForTheFutureOnlyWithoutALimit) {
    constexpr std::uint64_t mega = 1024 * 1024;
    EXPECT_EQ(decideMemoryLock({MemoryRoom::kUnlimited, 300 * mega, 8 * mega}), MemoryLock::All);
    EXPECT_EQ(decideMemoryLock({8 * mega, 300 * mega, 8 * mega}), MemoryLock::None);
    EXPECT_EQ(decideMemoryLock({307 * mega, 300 * mega, 8 * mega}), MemoryLock::None) << "the stack could not grow";
    EXPECT_EQ(decideMemoryLock({308 * mega, 300 * mega, 8 * mega}), MemoryLock::Present);
    EXPECT_EQ(decideMemoryLock({1000000 * mega, 300 * mega, 8 * mega}), MemoryLock::Present);
    EXPECT_EQ(decideMemoryLock({4 * mega, 1 * mega, 8 * mega}), MemoryLock::None) << "less than the stack's growth";
    EXPECT_EQ(decideMemoryLock({0, 300 * mega, 8 * mega}), MemoryLock::None);
}

TEST(Fault27, With8MegabytesOfLockableMemoryNothingDeadlocksAndTheRefusalsHaveRemedies) {
    const Said said = runAs(User::Ordinary, [] {
        const bool hasFile = access("/dev/cpu_dma_latency", W_OK) == 0;
        const std::string text = enterBetweenThreads({});
        const bool isRefused =
            text.find("may sleep deeply, and wake late: /dev/cpu_dma_latency: ") != std::string::npos;
        return text + (hasFile != isRefused ? ", file told" : ", file not told");
    });
    SKIP_WITHOUT_RIGHTS(said);
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text,
                   {"real time no, priority 0, policy other, lock None, unlocked\n",
                    "memory is not locked, and may be paged out: 8 MB may be locked (ulimit -l), and the process has ",
                    "the loop has no real-time priority: none is allowed to this user (ulimit -r is 0). ",
                    remedy::forMemory(isInContainer()), remedy::forPriority(isInContainer()), "threads 6, file told"});
}

TEST(RealTimeSetup, AnOrdinaryUserWithTheLimitsHasAllOfIt) {
    const Said said = runAs(User::Privileged, [] { return enterBetweenThreads({}); });
    SKIP_WITHOUT_RIGHTS(said);
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text,
                   {"real time yes, priority 80, policy FIFO, lock All", kLocks ? ", locked" : "", "threads 6"});
}

TEST(RealTimeSetup, UnderALimitThatSufficesThePresentIsLockedAndThreadsStartAfterIt) {
    const Said said = runAs(User::Privileged, [] {
        MemoryRoom room = readMemoryRoom();
        const bool isExempt = room.limit == MemoryRoom::kUnlimited;  // 8 MB, but not for this one
        room.limit = room.size + room.growth;
        const RealTimeState state = enterRealTime({}, room);
        return describe(state) + "threads " + std::to_string(startThreads(20)) + (isExempt ? ", exempt" : ", limited");
    });
    SKIP_WITHOUT_RIGHTS(said);
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text, {"real time yes, priority 80, policy FIFO, lock Present", kLocks ? ", locked" : "",
                               "threads 20, exempt"});
}

TEST(RealTimeSetup, AsMuchPriorityAsIsAllowedIsTaken) {
    const Said said = runAs(User::Privileged, [] {
        largestPriority = 10;
        return describe(enterRealTime({}));
    });
    SKIP_WITHOUT_RIGHTS(said);
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text, {"real time no, priority 10, policy FIFO",
                               "the loop has a lower priority than asked for: 10 is allowed, not 80 (ulimit -r). "});
}

TEST(RealTimeSetup, WhatIsImpossibleIsRefusedWithWhatIsPossible) {
    const Said said = runAs(User::Ordinary, [] {
        RealTimeWish wish;
        wish.cpu = 5000;
        wish.priority = 100;
        wish.lockMemory = false;
        return describe(enterRealTime(wish));
    });
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text, {"real time no, priority 0, policy other, lock None",
                               "the loop is not tied to processor 5000: this process may use the processors ",
                               "the loop has no real-time priority: priority 100 does not exist. Choose 1 to 99"});
}

TEST(RealTimeSetup, AllIsGivenBack) {
    const Said said = runAs(User::Privileged, [] {
        cpu_set_t before, now;
        sched_getaffinity(0, sizeof before, &before);
        RealTimeWish wish;
        for (wish.cpu = 0; !CPU_ISSET(wish.cpu, &before);) ++wish.cpu;
        std::string text;
        {
            RealTimeState first = enterRealTime(wish);
            const RealTimeState state = std::move(first);  // and the one that it was moved from gives nothing back
            first.leave();
            sched_getaffinity(0, sizeof now, &now);
            text += describe(state) + (CPU_COUNT(&now) == 1 && state.cpu() == wish.cpu ? "tied\n" : "not tied\n");
        }
        sched_getaffinity(0, sizeof now, &now);
        text += getPolicy() == SCHED_OTHER && !hasLocked() && CPU_EQUAL(&before, &now) ? "given back" : "kept";
        return text;
    });
    SKIP_WITHOUT_RIGHTS(said);
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text, {"real time yes", "\ntied\ngiven back"});
}

TEST(RealTimeSetup, AWishWithoutPriorityIsNotRealTime) {
    const Said said = runAs(User::Ordinary, [] {
        RealTimeWish wish;
        wish.priority = 0;
        wish.lockMemory = false;
        return describe(enterRealTime(wish));
    });
    ASSERT_EQ(said.status, 0) << said.text;
    expectContains(said.text, {"real time no, priority 0, policy other, lock None"});
}

}  // namespace
}  // namespace viable::test
