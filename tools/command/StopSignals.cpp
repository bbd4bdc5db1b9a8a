#include "StopSignals.h"

#include <signal.h>
#include <unistd.h>

namespace viable {

namespace {

std::atomic<int> stopSignal{0};

void onStopSignal(int signal) {
    if (stopSignal.exchange(signal) != 0) _exit(128 + signal);
}

bool isIgnored(int signal) {
    struct sigaction action {};
    return sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

const std::atomic<int>& getStopSignal() {
    return stopSignal;
}

const std::atomic<int>& catchStopSignals() {
    struct sigaction action {};
    action.sa_handler = onStopSignal;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
        if (signal != SIGHUP || !isIgnored(SIGHUP)) sigaction(signal, &action, nullptr);
    return stopSignal;
}

}  // namespace viable
