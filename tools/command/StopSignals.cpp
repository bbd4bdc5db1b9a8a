#include "StopSignals.h"

#include <signal.h>
#include <unistd.h>

#include "plugin/StopSignal.h"

namespace viable {

namespace {

using detail::stopSignal;

std::atomic<void (*)()> lastAct{nullptr};

void onStopSignal(int signal) {
    int none = 0;
    if (stopSignal.compare_exchange_strong(none, signal)) return;
    if (signal == SIGHUP) return;  // a terminal that closes may tell it twice; nobody asks for haste
    doLastAct();
    _exit(128 + signal);
}

/** Somebody sends it. The one of a write to a closed pipe comes from this process and says nothing but that. */
void onPipeSignal(int signal, siginfo_t* info, void*) {
    if (info->si_pid != getpid()) onStopSignal(signal);
}

bool isIgnored(int signal) {
    struct sigaction action {};
    return sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

void setLastAct(void (*act)()) {
    lastAct = act;
}

void doLastAct() {
    if (const auto act = lastAct.load()) act();
}

const std::atomic<int>& getStopSignal() {
    return stopSignal;
}

const std::atomic<int>& catchStopSignals() {
    struct sigaction action {};
    action.sa_handler = onStopSignal;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
        if (signal != SIGHUP || !isIgnored(SIGHUP)) sigaction(signal, &action, nullptr);
    if (isIgnored(SIGPIPE)) {
        struct sigaction pipe {};
        pipe.sa_sigaction = onPipeSignal;
        pipe.sa_flags = SA_SIGINFO | SA_RESTART;
        sigaction(SIGPIPE, &pipe, nullptr);
    }
    return stopSignal;
}

}  // namespace viable
