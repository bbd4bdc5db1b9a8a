#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "TemporaryFolder.h"

namespace viable::test {

using nlohmann::json;

inline const char* const kPage = "<page><data>@@VIABLE_DATA@@</data><binary>@@VIABLE_BINARY@@</binary>";

inline std::string cutOut(const std::string& text, const std::string& from, const std::string& to) {
    const std::size_t begin = text.find(from) + from.size();
    return text.substr(begin, text.find(to, begin) - begin);
}

inline std::string fromBase64(const std::string& text) {
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string bytes;
    unsigned bits = 0;
    int count = 0;
    for (char c : text) {
        if (c == '=') break;
        const std::size_t digit = digits.find(c);
        if (digit == std::string::npos) throw std::runtime_error("this is not base64");
        bits = bits << 6 | static_cast<unsigned>(digit);
        if ((count += 6) >= 8) bytes += static_cast<char>(bits >> (count -= 8) & 0xff);
    }
    return bytes;
}

inline std::string gunzip(const std::string& bytes) {
    z_stream stream{};
    if (inflateInit2(&stream, 16 + MAX_WBITS) != Z_OK) throw std::runtime_error("zlib");
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    std::string all;
    int status = Z_OK;
    while (status == Z_OK) {
        char part[65536];
        stream.next_out = reinterpret_cast<Bytef*>(part);
        stream.avail_out = sizeof part;
        status = inflate(&stream, Z_NO_FLUSH);
        all.append(part, sizeof part - stream.avail_out);
    }
    inflateEnd(&stream);
    EXPECT_EQ(status, Z_STREAM_END);
    return all;
}

/** A report as a browser would take it apart. */
struct ReadReport {
    explicit ReadReport(const std::filesystem::path& file)
        : text(readFile(file)),
          data(json::parse(cutOut(text, "<data>", "</data>"))),
          bytes(gunzip(fromBase64(cutOut(text, "<binary>", "</binary>")))) {}

    /** The array of a reference of elements `type`. */
    template <class Number>
    std::vector<Number> array(const json& reference, const char* type) const {
        EXPECT_EQ(reference["type"], type);
        std::vector<Number> values(reference["n"].get<std::size_t>());
        const std::size_t at = reference["at"];
        EXPECT_EQ(at % sizeof(Number), 0u);
        if (at + sizeof(Number) * values.size() > bytes.size()) throw std::runtime_error("beyond the block");
        std::memcpy(values.data(), bytes.data() + at, sizeof(Number) * values.size());
        return values;
    }
    std::vector<float> numbers(const json& reference) const { return array<float>(reference, "f32"); }
    std::vector<std::uint16_t> codes(const json& reference) const { return array<std::uint16_t>(reference, "u16"); }
    std::vector<std::uint8_t> letters(const json& reference) const { return array<std::uint8_t>(reference, "u8"); }

    std::string text;
    json data;
    std::string bytes;
};

}  // namespace viable::test
