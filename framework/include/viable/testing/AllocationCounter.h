#pragma once

#include <cstdint>

namespace viable::testing {

/** Counts the heap allocations (malloc, calloc, realloc, new, ...) of the thread that constructed it, from then on. To
use it, link AllocationCounter.cpp (installed in share/viable/testing) into the program. If malloc cannot be replaced
(sanitizers, another C library than glibc) it is not available and counts nothing:

    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    AllocationCounter counter;
    loop.tick(record);
    EXPECT_EQ(counter.count(), 0); */
class AllocationCounter {
public:
    static bool isAvailable();
    static const char* whyNot();

    AllocationCounter() : before_(total()) {}
    std::int64_t count() const { return total() - before_; }

    /** All of the calling thread so far. */
    static std::int64_t total();

private:
    std::int64_t before_;
};

}  // namespace viable::testing
