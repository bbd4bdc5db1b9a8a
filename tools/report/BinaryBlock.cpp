#include "report/BinaryBlock.h"

#include <zlib.h>

#include <stdexcept>

#include "core/AtOnce.h"

namespace viable::detail {

/** A part of a stream of deflate, from a byte of its own on; it knows of the part before nothing but its end. */
static std::string deflatePart(const char* data, std::size_t size, bool isLast) {
    z_stream stream{};
    if (deflateInit2(&stream, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
        throw std::runtime_error("zlib cannot begin to compress");
    std::string out(deflateBound(&stream, size) + 16, '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data));
    stream.avail_in = static_cast<uInt>(size);
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    const int status = deflate(&stream, isLast ? Z_FINISH : Z_SYNC_FLUSH);
    out.resize(out.size() - stream.avail_out);
    deflateEnd(&stream);
    if (status != (isLast ? Z_STREAM_END : Z_OK)) throw std::runtime_error("zlib cannot compress");
    return out;
}

/** As one member of gzip (RFC 1952), its parts at once; the same for any number of cores. */
static std::string compress(const std::string& bytes) {
    constexpr std::size_t kPart = 1 << 20;
    std::vector<std::string> parts(std::max<std::size_t>(1, (bytes.size() + kPart - 1) / kPart));
    std::vector<uLong> sums(parts.size());
    forEachAtOnce(parts.size(), [&](std::size_t i) {
        const char* data = bytes.data() + i * kPart;
        const std::size_t size = std::min(kPart, bytes.size() - i * kPart);
        parts[i] = deflatePart(data, size, i + 1 == parts.size());
        sums[i] = crc32(0, reinterpret_cast<const Bytef*>(data), static_cast<uInt>(size));
    });
    std::string out("\x1f\x8b\x08\0\0\0\0\0\0\x03", 10);
    uLong sum = 0;
    for (std::size_t i = 0; i < parts.size(); ++i) {
        out += parts[i];
        sum = crc32_combine(sum, sums[i], static_cast<z_off_t>(std::min(kPart, bytes.size() - i * kPart)));
    }
    for (const std::uint64_t number : {std::uint64_t{sum}, std::uint64_t{bytes.size()}})
        for (int byte = 0; byte < 4; ++byte) out += static_cast<char>(number >> 8 * byte & 255);
    return out;
}

static std::string toBase64(const std::string& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    text.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const auto byte = [&](std::size_t k) -> std::uint32_t {
            return k < bytes.size() ? static_cast<unsigned char>(bytes[k]) : 0u;
        };
        const std::uint32_t three = byte(i) << 16 | byte(i + 1) << 8 | byte(i + 2);
        text += digits[three >> 18];
        text += digits[three >> 12 & 63];
        text += i + 1 < bytes.size() ? digits[three >> 6 & 63] : '=';
        text += i + 2 < bytes.size() ? digits[three & 63] : '=';
    }
    return text;
}

nlohmann::json BinaryBlock::append(const void* data, std::size_t count, std::size_t size, char kind) {
    bytes_.resize((bytes_.size() + 7) / 8 * 8);
    const std::size_t at = bytes_.size();
    bytes_.append(static_cast<const char*>(data), count * size);
    return {{"at", at}, {"n", count}, {"type", kind + std::to_string(8 * size)}};
}

std::string BinaryBlock::encode() const {
    return toBase64(compress(bytes_));
}

}  // namespace viable::detail
