#pragma once

#include <mutex>

#include "core/AtOnce.h"

namespace viable {

/** How far a long piece of work is, told to a program that set `show` before. Not in real time. */
struct WorkShare {
    static inline void (*show)(const char* what, double share) = nullptr;
    /** One thread at a time. */
    static void tell(const char* what, double share) {
        if (show) show(what, share);
    }
    /** forEachAtOnce() that tells how much is done, from `begin` on and `own` in all. */
    static void forEachAtOnce(const char* what, std::size_t count, const std::function<void(std::size_t)>& work,
                              std::size_t most = SIZE_MAX, double begin = 0.0, double own = 1.0) {
        std::mutex telling;
        double done = 0.0;
        tell(what, begin);
        detail::forEachAtOnce(
            count,
            [&](std::size_t i) {
                work(i);
                const std::lock_guard<std::mutex> lock(telling);
                tell(what, begin + own * ++done / static_cast<double>(count));
            },
            most);
    }
};

}  // namespace viable
