#include <gtest/gtest.h>

#include "core/ErrorParts.h"

namespace viable {
namespace {

TEST(Error, TellsItsPartsAlsoThroughCopies) {
    const auto thrown = [] {
        try {
            throw badInput("file.yaml:3:1: key", "2 is out of range", "Choose 1");
        } catch (const std::runtime_error& e) {
            const Error copy = static_cast<const Error&>(e);
            return copy;
        }
    }();
    EXPECT_STREQ(thrown.what(), "file.yaml:3:1: key: 2 is out of range. Choose 1");
    EXPECT_EQ(getParts(thrown).place, "file.yaml:3:1: key");
    EXPECT_EQ(getParts(thrown).cause, "2 is out of range");
    EXPECT_EQ(getParts(thrown).remedy, "Choose 1");
}

TEST(Error, PartsMayBeEmpty) {
    const Error error(ErrorKind::LogNotWritten, "", "disk full");
    EXPECT_STREQ(error.what(), "disk full");
    EXPECT_EQ(getParts(error).place, "");
    EXPECT_EQ(getParts(error).cause, "disk full");
    EXPECT_EQ(getParts(error).remedy, "");
}

TEST(Error, TextWithAZeroIsCutOffThere) {
    const Error error(ErrorKind::BadInput, std::string("a\0b", 3), "c", "d");
    EXPECT_STREQ(error.what(), "a: c. d");
    EXPECT_EQ(getParts(error).place, "a");
    EXPECT_EQ(getParts(error).cause, "c");
    EXPECT_EQ(getParts(error).remedy, "d");
}

}  // namespace
}  // namespace viable
