#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace viable::test {

/** A text says all of this. */
inline void expectContains(const std::string& text, const std::vector<std::string>& parts) {
    for (const std::string& part : parts)
        EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is missing in:\n" << text;
}

}  // namespace viable::test
