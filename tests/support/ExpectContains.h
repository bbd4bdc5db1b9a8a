#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

/** A text says this. */
#define EXPECT_CONTAINS(text, part) \
    EXPECT_NE(std::string(text).find(part), std::string::npos) << "missing: " << (part) << "\nin: " << (text)

namespace viable::test {

/** A text says all of this. */
inline void expectContains(const std::string& text, const std::vector<std::string>& parts) {
    for (const std::string& part : parts)
        EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is missing in:\n" << text;
}

}  // namespace viable::test
