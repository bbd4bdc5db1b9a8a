#include "core/AtOnce.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <vector>

namespace viable::detail {
namespace {

TEST(AtOnce, CallsEachOnceAndNoMoreAtATimeThanAsked) {
    for (const std::size_t most : {std::size_t{1}, std::size_t{2}, std::size_t{SIZE_MAX}})
        for (const std::size_t count : {0, 1, 2, 1000}) {
            std::vector<int> calls(count, 0);
            std::atomic<std::size_t> running{0};
            std::atomic<bool> isTooMany{false};
            const auto work = [&](std::size_t i) {
                if (++running > most) isTooMany = true;
                ++calls[i];
                --running;
            };
            forEachAtOnce(count, work, most);
            EXPECT_EQ(calls, std::vector<int>(count, 1));
            EXPECT_FALSE(isTooMany);
        }
}

TEST(AtOnce, ThrowsWhatTheFirstOneThrewAndBeginsNoMore) {
    for (int round = 0; round < 100; ++round) {
        std::atomic<int> calls{0};
        std::string thrown;
        try {
            forEachAtOnce(100'000, [&](std::size_t i) {
                ++calls;
                if (i >= 7) throw std::runtime_error(std::to_string(i));
            });
        } catch (const std::runtime_error& e) {
            thrown = e.what();
        }
        EXPECT_EQ(thrown, "7");
        EXPECT_LT(calls, 1000);
    }
}

}  // namespace
}  // namespace viable::detail
