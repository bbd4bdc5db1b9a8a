#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace viable::detail {

/** Numbers beside a report's JSON: little-endian arrays, each from a multiple of 8 bytes on. */
class BinaryBlock {
public:
    /** Appends an array; returns the reference {"at", "n", "type"} that stands in the JSON, the type such as "f32" or "u8". */
    template <class Number>
    nlohmann::json add(const std::vector<Number>& values) {
        static_assert(std::is_floating_point_v<Number> || std::is_unsigned_v<Number>);
        return append(values.data(), values.size(), sizeof(Number), std::is_floating_point_v<Number> ? 'f' : 'u');
    }

    /** All of it, compressed (gzip) and as base64 text. */
    std::string encode() const;

private:
    nlohmann::json append(const void* data, std::size_t count, std::size_t size, char kind);

    std::string bytes_;
};

}  // namespace viable::detail
