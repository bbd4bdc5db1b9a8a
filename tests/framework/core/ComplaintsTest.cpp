#include "core/Complaints.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace viable {
namespace {

using detail::Complaints;

std::string textOf(const Complaints& complaints) {
    try {
        complaints.throwIfAny("file");
    } catch (const std::exception& e) {
        return e.what();
    }
    return "";
}

TEST(Complaints, SeveralAreAListAndThoseOfAListAreTakenOneByOne) {
    Complaints inner, outer;
    EXPECT_EQ(textOf(inner), "");
    inner.add("file:1:2", "a is wrong", "Mend it");
    EXPECT_EQ(textOf(inner), "file:1:2: a is wrong. Mend it");
    inner.add("file:3:4", "b is wrong");
    EXPECT_TRUE(outer.gather([] {}));
    EXPECT_FALSE(outer.gather([] { throw badInput("file:0:1", "c is wrong"); }));
    for (int twice = 0; twice < 2; ++twice) EXPECT_FALSE(outer.gather([&] { inner.throwIfAny("inner"); }));
    EXPECT_EQ(textOf(outer),
              "file: 3 things are wrong:\n  1. file:0:1: c is wrong\n  2. file:1:2: a is wrong. Mend it\n"
              "  3. file:3:4: b is wrong");
}

TEST(Complaints, WhatElseIsThrownIsToldWhereNothingIsWrong) {
    Complaints complaints;
    EXPECT_FALSE(complaints.gather([] { throw Error(ErrorKind::PluginFailed, "plugin", "threw"); }));
    EXPECT_FALSE(complaints.gather([] { throw std::runtime_error("second"); }));
    try {
        complaints.throwIfAny("file");
        FAIL();
    } catch (const Error& e) {
        EXPECT_EQ(e.kind(), ErrorKind::PluginFailed);
    }
    complaints.add("file:1:2", "a is wrong");
    EXPECT_EQ(textOf(complaints), "file:1:2: a is wrong");
}

TEST(Complaints, MoreThanCanBeReadAreCounted) {
    Complaints complaints;
    for (int i = 0; i < 250; ++i) complaints.add("file", std::to_string(i));
    EXPECT_TRUE(complaints.isFull());
    EXPECT_NE(textOf(complaints).find("at least 250 things"), std::string::npos);
    EXPECT_NE(textOf(complaints).find("... and 150 more"), std::string::npos);
}

}  // namespace
}  // namespace viable
