#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace viable::test {

/** How hard tests with many tries try, from the environment's VIABLE_EFFORT: 1 is usual, 0.02 is what sanitizers get
(CMakePresets.json), 100 is a long run by hand. */
inline double getEffort() {
    static const double effort = [] {
        const char* const text = std::getenv("VIABLE_EFFORT");
        if (text == nullptr) return 1.0;
        char* end = nullptr;
        const double value = std::strtod(text, &end);
        if (end == text || *end != '\0' || !(value > 0.0) || !std::isfinite(value)) {
            std::fprintf(stderr, "VIABLE_EFFORT is \"%s\": give a number above 0; 1 is usual\n", text);
            std::exit(2);
        }
        return value;
    }();
    return effort;
}

/** The usual number of tries, or of what must come of them, times the effort; at least 1. */
inline int countOf(int usual) {
    return static_cast<int>(std::clamp(usual * getEffort(), 1.0, 2e9));
}

/** VIABLE_SEED of the environment, for another series of random tries. */
inline long getSeed(long usual) {
    const char* const text = std::getenv("VIABLE_SEED");
    return text ? std::strtol(text, nullptr, 10) : usual;
}

}  // namespace viable::test
