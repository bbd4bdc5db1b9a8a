#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace viable::detail {

/** Numbers beside a report's JSON: little-endian arrays, each from a multiple of 8 bytes on. */
class BinaryBlock {
public:
    /** Appends an array; returns the reference {"at", "n", "type"} that stands in the JSON. */
    nlohmann::json add(const std::vector<float>& values);
    nlohmann::json add(const std::vector<double>& values);
    nlohmann::json add(const std::vector<std::uint8_t>& values);
    nlohmann::json add(const std::vector<std::uint16_t>& values);
    nlohmann::json add(const std::vector<std::uint32_t>& values);

    /** All of it, compressed (gzip) and as base64 text. */
    std::string encode() const;

private:
    nlohmann::json append(const void* data, std::size_t count, std::size_t size, const char* type);

    std::string bytes_;
};

}  // namespace viable::detail
