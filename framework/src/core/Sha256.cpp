#include "core/Sha256.h"

#include <openssl/evp.h>

#include <array>
#include <fstream>

#include "viable/core/Error.h"

namespace viable::detail {

struct Sha256::Context {
    Context() : digest(EVP_MD_CTX_new()) {}
    ~Context() { EVP_MD_CTX_free(digest); }
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;
    EVP_MD_CTX* digest;
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {
    VIABLE_CHECK(context_->digest && EVP_DigestInit_ex(context_->digest, EVP_sha256(), nullptr) == 1,
                 "libcrypto has SHA-256");
}

Sha256::~Sha256() = default;

void Sha256::add(std::string_view bytes) {
    EVP_DigestUpdate(context_->digest, bytes.data(), bytes.size());
}

std::string Sha256::take() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> bytes;
    unsigned size = 0;
    EVP_DigestFinal_ex(context_->digest, bytes.data(), &size);
    std::string digits;
    for (unsigned i = 0; i < size; ++i)
        for (const int half : {bytes[i] >> 4, bytes[i] & 15}) digits += "0123456789abcdef"[half];
    return digits;
}

std::string calcSha256(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    Sha256 hash;
    std::array<char, 1 << 16> block;
    while (stream.read(block.data(), block.size()) || stream.gcount() > 0)
        hash.add({block.data(), static_cast<std::size_t>(stream.gcount())});
    if (!stream.eof()) throw badInput(file.string(), "cannot be read", "Check its permissions.");
    return hash.take();
}

}  // namespace viable::detail
