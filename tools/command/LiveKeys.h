#pragma once

namespace viable {

/** Single keys from the terminal, without echo and Enter, from construction to destruction; nothing where there is none. What
was typed before is forgotten. The keys that would stop the program in the middle of a motion or freeze its output (Ctrl-Z,
Ctrl-\\, Ctrl-S) do nothing meanwhile. */
class LiveKeys {
public:
    LiveKeys();
    ~LiveKeys();
    LiveKeys(const LiveKeys&) = delete;
    LiveKeys& operator=(const LiveKeys&) = delete;

    /** Standard input is a terminal, and this program in its foreground: in the background a change of it would stop the
    program. */
    static bool areThere();

    bool exist() const { return isTerminal_; }
    /** The next key within so many milliseconds; 0: none, after that time. */
    char wait(int timeout_ms);

private:
    bool isTerminal_ = false, isSet_ = false;
};

}  // namespace viable
