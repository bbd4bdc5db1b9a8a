#include "doctor/MachineMeasure.h"

#include <linux/futex.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cstring>

#include "core/ChildProcess.h"
#include "core/Descriptor.h"
#include "realtime/TickPacer.h"
#include "records/WorkShare.h"

namespace viable {

namespace {

constexpr int kPatience_ms = 100;
constexpr std::int64_t kWarmUp = 10;  // ticks
constexpr double kTurn_s = 1.0;

[[noreturn]] void failWith(const char* what) {
    throw std::system_error(errno, std::generic_category(), what);
}

/** Words that two processes share, each the number of the last ping. */
struct SharedWords {
    std::atomic<std::uint32_t> request{0}, answer{0}, ready{0};
};

void wakeReader(std::atomic<std::uint32_t>& word) {
    syscall(SYS_futex, &word, FUTEX_WAKE, 1, nullptr, nullptr, 0);
}

/** Sleeps while the word is `old`. False when it still is after the timeout. */
bool awaitChange(std::atomic<std::uint32_t>& word, std::uint32_t old, int patience_ms) {
    const std::int64_t end_ns = TickPacer::readClock_ns() + 1'000'000LL * patience_ms;
    while (word.load(std::memory_order_acquire) == old) {
        const std::int64_t left_ns = end_ns - TickPacer::readClock_ns();
        if (left_ns <= 0) return false;
        const timespec wait{static_cast<time_t>(left_ns / 1'000'000'000), static_cast<long>(left_ns % 1'000'000'000)};
        syscall(SYS_futex, &word, FUTEX_WAIT, old, &wait, nullptr, 0);
    }
    return true;
}

/** Two sockets on this machine that speak to each other only. */
class UdpPair {
public:
    UdpPair() {
        std::array<sockaddr_in, 2> own{};
        for (std::size_t i = 0; i < 2; ++i) {
            ends_[i] = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
            if (ends_[i] < 0) failWith("no UDP socket");
            own[i].sin_family = AF_INET;
            own[i].sin_addr.s_addr = htonl(INADDR_LOOPBACK);
            socklen_t length = sizeof own[i];
            auto* const address = reinterpret_cast<sockaddr*>(&own[i]);
            if (bind(ends_[i], address, length) != 0 || getsockname(ends_[i], address, &length) != 0)
                failWith("no UDP port on 127.0.0.1");
        }
        for (std::size_t i = 0; i < 2; ++i)
            if (connect(ends_[i], reinterpret_cast<sockaddr*>(&own[1 - i]), sizeof own[i]) != 0)
                failWith("no way from 127.0.0.1 to itself");
    }
    int near() const { return ends_[0]; }
    int far() const { return ends_[1]; }

private:
    std::array<detail::Descriptor, 2> ends_;
};

using Packet = std::array<char, 512>;

/** The two processes that answer, until it is destroyed. */
class Echoes {
public:
    /** @param wish  of theirs; none where they are to have no priority */
    explicit Echoes(const RealTimeWish* wish) : Echoes() {  // from here on its destructor ends those that have started
        start(wish, [this] { answerUdp(); });
        start(wish, [this] { answerSharedMemory(); });
        for (std::uint32_t ready; (ready = words_->ready.load()) < 2;)
            if (!awaitChange(words_->ready, ready, 10'000)) {
                errno = ETIMEDOUT;
                failWith("the processes that are to answer did not start");
            }
    }
    ~Echoes() {
        for (std::size_t i = 0; i < started_; ++i) {
            kill(children_[i], SIGKILL);
            while (waitpid(children_[i], nullptr, 0) < 0 && errno == EINTR) {
            }
        }
    }

    bool pingUdp(std::uint32_t number) {
        Packet packet{};
        std::memcpy(packet.data(), &number, sizeof number);
        if (send(sockets_.near(), packet.data(), packet.size(), 0) < 0) return false;
        const std::int64_t end_ns = TickPacer::readClock_ns() + 1'000'000LL * kPatience_ms;
        for (std::int64_t left_ns; (left_ns = end_ns - TickPacer::readClock_ns()) > 0;) {
            pollfd ready{sockets_.near(), POLLIN, 0};
            poll(&ready, 1, static_cast<int>(1 + left_ns / 1'000'000));
            std::uint32_t answered = 0;
            if (recv(sockets_.near(), packet.data(), packet.size(), MSG_DONTWAIT) < 0) continue;
            std::memcpy(&answered, packet.data(), sizeof answered);
            if (answered == number) return true;  // else that of a ping given up
        }
        return false;
    }
    bool pingSharedMemory(std::uint32_t number) {
        words_->request.store(number, std::memory_order_release);
        wakeReader(words_->request);
        for (std::uint32_t answer; (answer = words_->answer.load(std::memory_order_acquire)) != number;)
            if (!awaitChange(words_->answer, answer, kPatience_ms)) return false;
        return true;
    }

private:
    Echoes() : words_(detail::makeSharedObject<SharedWords>()) {}
    template <class Answer>
    void start(const RealTimeWish* wish, Answer&& answer) {
        const pid_t child = detail::forkChild("that answers");
        if (child == 0) {
            RealTimeState state;
            if (wish) state = enterRealTime(*wish);
            words_->ready.fetch_add(1);
            wakeReader(words_->ready);
            answer();
        }
        children_[started_++] = child;
    }
    [[noreturn]] void answerUdp() {
        Packet packet;
        for (;;) {
            const ssize_t size = recv(sockets_.far(), packet.data(), packet.size(), 0);
            if (size > 0 && send(sockets_.far(), packet.data(), static_cast<std::size_t>(size), 0) < 0) continue;
        }
    }
    [[noreturn]] void answerSharedMemory() {
        for (std::uint32_t seen = 0;;) {
            if (!awaitChange(words_->request, seen, 1'000'000)) continue;
            seen = words_->request.load(std::memory_order_acquire);
            words_->answer.store(seen, std::memory_order_release);
            wakeReader(words_->answer);
        }
    }

    detail::SharedObject<SharedWords> words_;
    UdpPair sockets_;
    std::array<pid_t, 2> children_{};
    std::size_t started_ = 0;
};

/** The same in every tick, some 20 us: each step needs the one before. */
[[gnu::noinline]] double compute(double x) {
    for (int k = 0; k < 12'000; ++k) x = 0.999 * x + 1e-3;
    return x;
}

void runTurn(double duration_s, double tick_s, Echoes& echoes, LoopTimes& times) {
    const auto last = static_cast<std::int64_t>(std::llround(duration_s / tick_s)) + kWarmUp;
    volatile double sink = 0.5;
    TickPacer pacer(tick_s);
    pacer.start();
    std::int64_t tick = 0;
    for (std::uint32_t number = 1; tick < last;) {
        const WakeUp wakeUp = pacer.wait();
        if (wakeUp.isInterrupted) continue;
        const std::int64_t before = tick;
        tick = wakeUp.tick;
        const std::int64_t begin_ns = TickPacer::readClock_ns();
        sink = compute(sink);
        const std::int64_t worked_ns = TickPacer::readClock_ns();
        const bool isUdp = number % 2 == 0;
        const bool isAnswered = isUdp ? echoes.pingUdp(number) : echoes.pingSharedMemory(number);
        const std::int64_t answered_ns = TickPacer::readClock_ns();
        ++number;
        if (tick <= kWarmUp) continue;
        const std::int64_t passed = tick - std::max(before, kWarmUp);
        const std::int64_t nth = times.ticks += passed;
        times.missed += passed - 1;
        if (wakeUp.hasSlept) times.wakeUp.add(wakeUp.lateness_ns, nth);
        times.work.add(worked_ns - begin_ns, nth);
        if (isAnswered)
            (isUdp ? times.udp : times.sharedMemory).add(answered_ns - worked_ns, nth);
        else
            ++times.lost;
    }
}

}  // namespace

Measurement measureMachine(const MeasureWish& wish) {
    Measurement measurement;
    measurement.duration_s = wish.duration_s;
    measurement.tick_s = wish.tick_s;
    {
        const RealTimeState state = enterRealTime(wish.realTime);
        measurement.grantedPriority = state.priority();
        measurement.cpu = state.cpu();
        measurement.memoryLock = state.memoryLock();
        measurement.holdsLatency = state.holdsLatency();
        measurement.refusals = state.refusals();
    }
    const bool hasPriority = measurement.grantedPriority > 0;
    RealTimeWish anywhere = wish.realTime;  // the answering processes: not on the loop's own processor
    anywhere.cpu = -1;
    const int settings = hasPriority ? 2 : 1;
    const int turns = std::max(1, static_cast<int>(std::lround(wish.duration_s / (settings * kTurn_s))));
    const double turn_s = wish.duration_s / (settings * turns);
    for (int turn = 0; turn < turns; ++turn) {
        const auto tell = [&](double more) { WorkShare::tell("measuring", (turn + more) / turns); };
        tell(0.0);
        {
            Echoes echoes(nullptr);
            runTurn(turn_s, wish.tick_s, echoes, measurement.plain);
        }
        tell(hasPriority ? 0.5 : 1.0);
        if (!hasPriority) continue;
        Echoes echoes(&anywhere);
        const RealTimeState state = enterRealTime(wish.realTime);
        runTurn(turn_s, wish.tick_s, echoes, measurement.priority);
        tell(1.0);
    }
    return measurement;
}

}  // namespace viable
