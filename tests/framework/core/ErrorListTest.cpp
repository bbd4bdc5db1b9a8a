#include "Complaint.h"
#include "core/ErrorList.h"

namespace viable {
namespace {

using detail::ErrorList;

std::string textOf(const ErrorList& errors) {
    try {
        errors.throwIfAny("file");
    } catch (const std::exception& e) {
        return e.what();
    }
    return "";
}

TEST(ErrorList, SeveralAreAListAndThoseOfAListAreTakenOneByOne) {
    ErrorList inner, outer;
    EXPECT_EQ(textOf(inner), "");
    inner.add("file:1:2", "a is wrong", "Mend it");
    EXPECT_EQ(textOf(inner), "file:1:2: a is wrong. Mend it");
    inner.add("file:3:4", "b is wrong");
    EXPECT_TRUE(outer.collect([] {}));
    EXPECT_FALSE(outer.collect([] { throw badInput("file:0:1", "c is wrong"); }));
    for (int twice = 0; twice < 2; ++twice) EXPECT_FALSE(outer.collect([&] { inner.throwIfAny("inner"); }));
    EXPECT_EQ(textOf(outer),
              "file: 3 things are wrong:\n  1. file:0:1: c is wrong\n  2. file:1:2: a is wrong. Mend it\n"
              "  3. file:3:4: b is wrong");
}

TEST(ErrorList, WhatElseIsThrownIsToldWhereNothingIsWrong) {
    ErrorList errors;
    EXPECT_FALSE(errors.collect([] { throw Error(ErrorKind::PluginFailed, "plugin", "threw"); }));
    EXPECT_FALSE(errors.collect([] { throw std::runtime_error("second"); }));
    test::catchError([&] { errors.throwIfAny("file"); }, ErrorKind::PluginFailed);
    errors.add("file:1:2", "a is wrong");
    EXPECT_EQ(textOf(errors), "file:1:2: a is wrong");
}

TEST(ErrorList, MoreThanCanBeReadAreCounted) {
    ErrorList errors;
    for (int i = 0; i < 250; ++i) errors.add("file", std::to_string(i));
    EXPECT_TRUE(errors.isFull());
    test::expectContains(textOf(errors), {"at least 250 things", "... and 150 more"});
}

}  // namespace
}  // namespace viable
