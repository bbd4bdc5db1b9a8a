#pragma once

namespace viable {

/** How far a long piece of work is, told to a program that set `show` before. Not in real time; one thread. */
struct WorkShare {
    static inline void (*show)(const char* what, double share) = nullptr;
    static void tell(const char* what, double share) {
        if (show) show(what, share);
    }
};

}  // namespace viable
