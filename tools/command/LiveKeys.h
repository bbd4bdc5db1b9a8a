#pragma once

#include <termios.h>

namespace viable {

/** Single keys from the terminal, without echo and Enter, from construction to destruction; nothing where standard input is no
terminal. */
class LiveKeys {
public:
    LiveKeys();
    ~LiveKeys();
    LiveKeys(const LiveKeys&) = delete;
    LiveKeys& operator=(const LiveKeys&) = delete;

    bool exist() const { return isTerminal_; }
    /** The next key within so many milliseconds; 0: none, after that time. */
    char wait(int timeout_ms);

private:
    bool isTerminal_ = false;
    termios before_{};
};

}  // namespace viable
