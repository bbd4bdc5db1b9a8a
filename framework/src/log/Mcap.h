#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>

namespace viable::mcap {

/** Record types of https://mcap.dev/spec. */
enum Opcode : std::uint8_t {
    kHeader = 0x01,
    kFooter = 0x02,
    kSchema = 0x03,
    kChannel = 0x04,
    kMessage = 0x05,
    kChunk = 0x06,
    kMessageIndex = 0x07,
    kChunkIndex = 0x08,
    kAttachment = 0x09,
    kAttachmentIndex = 0x0A,
    kStatistics = 0x0B,
    kMetadata = 0x0C,
    kMetadataIndex = 0x0D,
    kSummaryOffset = 0x0E,
    kDataEnd = 0x0F,
};

inline constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
inline constexpr std::size_t kRecordHead = 9;      // opcode, length
inline constexpr std::size_t kFooterContent = 20;  // two offsets, checksum
inline constexpr std::string_view kCdrLittleEndian("\0\1\0\0", 4);

/** Entry of a channel's metadata: its messages are those of LogChannel::isOnChange. Without it (also in logs of before)
each row has a message. */
inline constexpr char kWritten[] = "written", kOnChange[] = "on_change";

/** Appends little-endian values to a buffer. */
class ByteWriter {
public:
    std::string bytes;

    void putU8(std::uint8_t v) { bytes.push_back(static_cast<char>(v)); }
    void putU16(std::uint16_t v) { putInteger(v); }
    void putU32(std::uint32_t v) { putInteger(v); }
    void putU64(std::uint64_t v) { putInteger(v); }
    void putU64(std::initializer_list<std::uint64_t> all) {
        for (const std::uint64_t v : all) putInteger(v);
    }
    void putDouble(double v) {
        std::uint64_t bits;
        std::memcpy(&bits, &v, sizeof(bits));
        putU64(bits);
    }
    void putString(std::string_view s) {
        putU32(static_cast<std::uint32_t>(s.size()));
        bytes += s;
    }
    void putMap(const std::map<std::string, std::string>& map) {
        const std::size_t place = beginLength32();
        for (const auto& [key, value] : map) {
            putString(key);
            putString(value);
        }
        endLength32(place);
    }

    /** A record: its head now, its length at end(). */
    std::size_t begin(Opcode opcode) {
        putU8(opcode);
        putU64(0);
        return bytes.size();
    }
    void end(std::size_t content) { patch<std::uint64_t>(content - 8, bytes.size() - content); }
    std::size_t beginLength32() {
        putU32(0);
        return bytes.size();
    }
    void endLength32(std::size_t content) { patch(content - 4, static_cast<std::uint32_t>(bytes.size() - content)); }

    /** CDR aligns to the value's size, counted from `origin`. */
    void align(std::size_t origin, std::size_t size) {
        while ((bytes.size() - origin) % size != 0) bytes.push_back('\0');
    }

private:
    template <class T>
    static void store(char* to, T v) {
        for (std::size_t i = 0; i < sizeof(T); ++i) to[i] = static_cast<char>(v >> (8 * i) & 0xFF);
    }
    template <class T>
    void putInteger(T v) {
        char raw[sizeof(T)];
        store(raw, v);
        bytes.append(raw, sizeof(T));
    }
    template <class T>
    void patch(std::size_t place, T v) {
        store(&bytes[place], v);
    }
};

/** What is wrong with some bytes, and where: counted from the beginning of the reader's bytes. */
struct BadBytes : std::runtime_error {
    BadBytes(std::size_t at, const std::string& reason) : std::runtime_error(reason), offset(at) {}
    std::size_t offset;
};

/** Takes little-endian values from a buffer; beyond its end throws BadBytes. */
class ByteReader {
public:
    explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

    std::size_t position() const { return position_; }
    std::size_t left() const { return bytes_.size() - position_; }

    std::string_view take(std::uint64_t size) {
        if (size > left())
            throw BadBytes(position_, "needs " + std::to_string(size) + " bytes where only " + std::to_string(left()) +
                                          " are left");
        const std::string_view taken = bytes_.substr(position_, static_cast<std::size_t>(size));
        position_ += taken.size();
        return taken;
    }
    std::uint8_t readU8() { return readInteger<std::uint8_t>(); }
    std::uint16_t readU16() { return readInteger<std::uint16_t>(); }
    std::uint32_t readU32() { return readInteger<std::uint32_t>(); }
    std::uint64_t readU64() { return readInteger<std::uint64_t>(); }
    std::string_view readString() { return take(readU32()); }
    std::map<std::string, std::string> readMap() {
        ByteReader entries(take(readU32()));
        std::map<std::string, std::string> map;
        while (entries.left() > 0) {
            const std::string key(entries.readString());
            map[key] = std::string(entries.readString());
        }
        return map;
    }
    void align(std::size_t size) {
        const std::size_t over = position_ % size;
        if (over != 0) take(size - over);
    }

private:
    template <class T>
    T readInteger() {
        const std::string_view raw = take(sizeof(T));
        T v = 0;
        for (std::size_t i = 0; i < sizeof(T); ++i)
            v = static_cast<T>(v | static_cast<T>(static_cast<T>(static_cast<unsigned char>(raw[i])) << (8 * i)));
        return v;
    }

    std::string_view bytes_;
    std::size_t position_ = 0;
};

/** How the values of a message stand: CDR aligns each to its size and ends texts with a zero, ROS 1 packs them. */
enum class MessageLayout { LittleEndianCdr, BigEndianCdr, Ros1 };

/** Takes the values of a message, what tells its layout left out. */
class MessageReader {
public:
    MessageReader(std::string_view body, MessageLayout layout)
        : in_(body), isAligned_(layout != MessageLayout::Ros1), isBig_(layout == MessageLayout::BigEndianCdr) {}

    std::size_t left() const { return in_.left(); }
    void skip(std::uint64_t size) { in_.take(size); }
    /** Throws BadBytes unless so many bytes are left. */
    void expect(std::uint64_t size) const { ByteReader(in_).take(size); }
    void align(std::size_t size) {
        if (isAligned_) in_.align(size);
    }
    std::uint32_t readU32() {
        align(4);
        const std::uint32_t v = in_.readU32();
        return isBig_ ? __builtin_bswap32(v) : v;
    }
    std::uint64_t readU64() {
        align(8);
        const std::uint64_t v = in_.readU64();
        return isBig_ ? __builtin_bswap64(v) : v;
    }
    double readDouble() {
        const std::uint64_t bits = readU64();
        double v;
        std::memcpy(&v, &bits, sizeof(v));
        return v;
    }
    std::string_view readText() {
        std::string_view text = in_.take(readU32());
        if (isAligned_ && !text.empty() && text.back() == '\0') text.remove_suffix(1);
        return text;
    }

private:
    ByteReader in_;
    bool isAligned_, isBig_;
};

}  // namespace viable::mcap
