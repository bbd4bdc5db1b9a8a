#pragma once

#include <algorithm>
#include <string>

namespace viable::detail {

/** Whether a byte of UTF-8 begins a character. */
inline bool beginsCharacter(char byte) {
    return (static_cast<unsigned char>(byte) & 0xc0) != 0x80;
}

inline std::size_t countCharacters(const std::string& text) {
    return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), beginsCharacter));
}

/** In at most `most` characters, the middle left out: "the first 1~e last 10". */
inline std::string shorten(const std::string& text, std::size_t most) {
    const std::size_t all = countCharacters(text), last = most / 2 - 1, first = most - 1 - last;
    if (all <= most) return text;
    std::string shorter;
    std::size_t k = 0;  // characters up to this one
    for (const char byte : text) {
        k += beginsCharacter(byte);
        if (k <= first || k > all - last)
            shorter += byte;
        else if (k == first + 1 && beginsCharacter(byte))
            shorter += '~';
    }
    return shorter;
}

}  // namespace viable::detail
