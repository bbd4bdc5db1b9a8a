#include "LiveKeys.h"

#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include "StopSignals.h"

namespace viable {

namespace {

termios shellsOwn{};

void restoreTerminal() {
    ::tcsetattr(STDIN_FILENO, TCSANOW, &shellsOwn);
}

}  // namespace

bool LiveKeys::areThere() {
    return ::isatty(STDIN_FILENO) != 0 && ::tcgetpgrp(STDIN_FILENO) == ::getpgrp();
}

LiveKeys::LiveKeys() {
    if (!areThere() || ::tcgetattr(STDIN_FILENO, &shellsOwn) != 0) return;
    termios now = shellsOwn;
    now.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    now.c_iflag &= ~static_cast<tcflag_t>(IXON);
    now.c_cc[VMIN] = 0;
    now.c_cc[VTIME] = 0;
    now.c_cc[VSUSP] = now.c_cc[VQUIT] = _POSIX_VDISABLE;
    setLastAct(restoreTerminal);
    isTerminal_ = isSet_ = ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &now) == 0;
    if (!isSet_) setLastAct(nullptr);
}

LiveKeys::~LiveKeys() {
    if (!isSet_) return;
    setLastAct(nullptr);
    restoreTerminal();
}

char LiveKeys::wait(int timeout_ms) {
    pollfd input{isTerminal_ ? STDIN_FILENO : -1, POLLIN, 0};
    if (::poll(&input, 1, timeout_ms) <= 0) return 0;  // a signal ends the waiting, too
    char key = 0;
    if (::read(STDIN_FILENO, &key, 1) == 1) return key;
    isTerminal_ = false;  // it is gone
    return 0;
}

}  // namespace viable
