#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace viable::detail {

/** SHA-256 (FIPS 180-4) of bytes that come piece by piece. Of our own, so that an embedding program links no cryptography: it
tells files apart, and keeps no secret. */
class Sha256 {
public:
    void add(std::string_view bytes);
    /** Of all that was added, 64 hexadecimal digits in lower case. Once. */
    std::string take();

private:
    void addBlock(const unsigned char* block);

    std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                        0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    std::array<unsigned char, 64> rest_{};  // of the block that is not full
    std::uint64_t size_ = 0;                // [bytes]
};

/** Of a file's bytes. Throws Error (BadInput) when it cannot be read. */
std::string calcSha256(const std::filesystem::path& file);

}  // namespace viable::detail
