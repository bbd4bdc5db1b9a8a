#include "core/AtOnce.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <thread>
#include <vector>

namespace viable::detail {

std::size_t countCores() {
    cpu_set_t cores;
    if (sched_getaffinity(0, sizeof cores, &cores) == 0) return static_cast<std::size_t>(CPU_COUNT(&cores));
    static const std::size_t all = std::thread::hardware_concurrency();  // takes long to find
    return all;
}

void forEachAtOnce(std::size_t count, const std::function<void(std::size_t)>& work, std::size_t threads) {
    std::vector<std::exception_ptr> errors(count);
    std::atomic<std::size_t> next{0};
    std::atomic<bool> hasFailed{false};
    const auto run = [&] {
        for (std::size_t i; !hasFailed && (i = next++) < count;) {
            try {
                work(i);
            } catch (...) {
                errors[i] = std::current_exception();
                hasFailed = true;
            }
        }
    };
    std::vector<std::thread> others;
    threads = std::min(threads, count);
    others.reserve(threads);
    try {
        while (others.size() + 1 < threads) others.emplace_back(run);
    } catch (const std::exception&) {  // fewer threads do it, too
    }
    run();
    for (std::thread& thread : others) thread.join();
    const auto first = std::find_if(errors.begin(), errors.end(), [](const auto& error) { return error != nullptr; });
    if (first != errors.end()) std::rethrow_exception(*first);
}

}  // namespace viable::detail
