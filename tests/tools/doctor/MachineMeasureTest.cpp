#include "doctor/MachineMeasure.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

// The library's sockets come by here, which may refuse them.
namespace {
int socketsLeft = -1;  // -1: as many as the system gives
}

extern "C" int socket(int domain, int type, int protocol) noexcept {
    if (socketsLeft >= 0 && --socketsLeft < 0) {
        socketsLeft = 0;
        errno = EMFILE;
        return -1;
    }
    return static_cast<int>(syscall(SYS_socket, domain, type, protocol));
}

namespace viable {
namespace {

/** Each tick that was seen is in every histogram that it belongs to. */
void expectWhole(const LoopTimes& times, std::int64_t ticks) {
    EXPECT_GE(times.ticks, ticks);
    const std::int64_t seen = times.ticks - times.missed;
    EXPECT_GT(seen, 0);
    EXPECT_EQ(times.work.count(), seen);
    EXPECT_EQ(times.udp.count() + times.sharedMemory.count() + times.lost, seen);
    EXPECT_LE(times.wakeUp.count(), seen);
    EXPECT_GT(times.udp.count() + times.sharedMemory.count(), 0);
    EXPECT_GT(times.work.smallest_ns(), 0);
    EXPECT_LE(times.work.worstTick(), times.ticks);
}

TEST(MachineMeasure, CountsEveryTickOfBothHalvesAndLeavesNothingBehind) {
    MeasureWish wish;
    wish.duration_s = 0.4;
    wish.tick_s = 0.002;
    const Measurement measured = measureMachine(wish);
    expectWhole(measured.plain, measured.grantedPriority > 0 ? 100 : 200);
    if (measured.grantedPriority > 0)
        expectWhole(measured.priority, 100);
    else
        EXPECT_EQ(measured.priority.ticks, 0);
    EXPECT_EQ(measured.grantedPriority == wish.realTime.priority && measured.memoryLock != MemoryLock::None &&
                  measured.holdsLatency,
              measured.refusals.empty());
    EXPECT_EQ(sched_getscheduler(0) & ~SCHED_RESET_ON_FORK, SCHED_OTHER);
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
    EXPECT_EQ(errno, ECHILD) << "a process is left";
}

TEST(MachineMeasure, WithoutSocketsItSaysSoAndLeavesNothingBehind) {
    socketsLeft = 1;
    MeasureWish wish;
    wish.duration_s = 0.1;
    std::string trouble;
    try {
        measureMachine(wish);
    } catch (const std::system_error& e) {
        trouble = e.what();
    }
    socketsLeft = -1;
    EXPECT_EQ(trouble, "no UDP socket: Too many open files");
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
}

}  // namespace
}  // namespace viable
