#include "core/Memo.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace viable {
namespace {

TEST(Memo, WhatCouldNotBeMadeIsMadeAnewAndOnlyThat) {
    detail::Memo<int> memo(1);
    int made = 0;
    const auto make = [&] { return ++made; };
    EXPECT_THROW(memo.get("a", []() -> int { throw std::runtime_error("no"); }), std::runtime_error);
    EXPECT_EQ(memo.get("a", make), 1);
    EXPECT_EQ(memo.get("a", make), 1);
    // While one fails it is forgotten and made anew: that one stays.
    EXPECT_THROW(memo.get("b",
                          [&]() -> int {
                              memo.get("c", make);
                              EXPECT_EQ(memo.get("b", make), 3);
                              throw std::runtime_error("no");
                          }),
                 std::runtime_error);
    EXPECT_EQ(memo.get("b", make), 3);
}

}  // namespace
}  // namespace viable
