#include "LiveKeys.h"

#include <poll.h>
#include <unistd.h>

namespace viable {

LiveKeys::LiveKeys() {
    // In the background a change of the terminal would stop the program.
    if (::isatty(STDIN_FILENO) == 0 || ::tcgetpgrp(STDIN_FILENO) != ::getpgrp()) return;
    if (::tcgetattr(STDIN_FILENO, &before_) != 0) return;
    termios now = before_;
    now.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    now.c_cc[VMIN] = 0;
    now.c_cc[VTIME] = 0;
    isTerminal_ = ::tcsetattr(STDIN_FILENO, TCSANOW, &now) == 0;
}

LiveKeys::~LiveKeys() {
    if (isTerminal_) ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
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
