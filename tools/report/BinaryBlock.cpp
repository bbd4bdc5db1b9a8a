#include "report/BinaryBlock.h"

#include <zlib.h>

#include <stdexcept>

namespace viable::detail {

namespace {

std::string compress(const std::string& bytes) {
    z_stream stream{};
    constexpr int kGzip = 16;
    if (deflateInit2(&stream, 6, Z_DEFLATED, MAX_WBITS + kGzip, 8, Z_DEFAULT_STRATEGY) != Z_OK)
        throw std::runtime_error("zlib cannot begin to compress");
    std::string out(deflateBound(&stream, bytes.size()), '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    // Counts in zlib are 32 bits wide: in and out in portions.
    std::size_t left = bytes.size(), room = out.size();
    int status = Z_OK;
    while (status == Z_OK) {
        constexpr std::size_t kPortion = 1u << 30;
        const uInt in = static_cast<uInt>(std::min(left, kPortion));
        const uInt space = static_cast<uInt>(std::min(room, kPortion));
        stream.avail_in = in;
        stream.avail_out = space;
        status = deflate(&stream, left == in ? Z_FINISH : Z_NO_FLUSH);
        left -= in - stream.avail_in;
        room -= space - stream.avail_out;
    }
    deflateEnd(&stream);
    if (status != Z_STREAM_END) throw std::runtime_error("zlib cannot compress");
    out.resize(out.size() - room);
    return out;
}

std::string toBase64(const std::string& bytes) {
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

}  // namespace

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
