#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace viable::detail {

/** SHA-256 of bytes that come piece by piece (libcrypto). */
class Sha256 {
public:
    Sha256();
    ~Sha256();
    Sha256(const Sha256&) = delete;
    Sha256& operator=(const Sha256&) = delete;

    void add(std::string_view bytes);
    /** Of all that was added, 64 hexadecimal digits in lower case. Once. */
    std::string take();

private:
    struct Context;
    std::unique_ptr<Context> context_;
};

/** Of a file's bytes. Throws Error (BadInput) when it cannot be read. */
std::string calcSha256(const std::filesystem::path& file);

}  // namespace viable::detail
