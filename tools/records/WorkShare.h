#pragma once

#include <algorithm>
#include <atomic>

#include "core/AtOnce.h"

namespace viable {

/** How far a long piece of work is, told to a program that set `show` before, in the thread that set it. Not in real time. */
struct WorkShare {
    static inline thread_local void (*show)(const char* what, double share) = nullptr;
    static void tell(const char* what, double share) {
        if (show) show(what, share);
    }
    /** forEachAtOnce() that tells how much is done, from `begin` on and `own` in all. */
    static void forEachAtOnce(const char* what, std::size_t count, const std::function<void(std::size_t)>& work,
                              std::size_t most = SIZE_MAX, double begin = 0.0, double own = 1.0) {
        std::atomic<std::size_t> done{0};
        tell(what, begin);
        const auto workAndTell = [&](std::size_t i) {
            work(i);
            tell(what, begin + own * static_cast<double>(++done) / static_cast<double>(count));
        };
        detail::forEachAtOnce(count, workAndTell, std::min(most, detail::countCores()));
        tell(what, begin + own);
    }
};

}  // namespace viable
