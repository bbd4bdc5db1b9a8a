#include "records/McapFile.h"

#include <fcntl.h>
#include <lz4frame.h>
#include <sys/stat.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <system_error>

#include "records/WorkShare.h"
#include "viable/core/Error.h"

namespace viable::mcap {

namespace {

/** Largest chunk accepted, decompressed; the writer's own stay near 1 MiB. [bytes] */
constexpr std::uint64_t kLargestAcceptedChunk = std::uint64_t{64} << 20;
/** Largest record accepted: nothing of a log needs more, and a slip must not take all memory. */
constexpr std::uint64_t kLargestRecord = std::uint64_t{256} << 20;

[[noreturn]] void refuseChunk(const char* reason) {
    throw BadBytes(0, std::string("the chunk cannot be decompressed: ") + reason);
}

void unpackZstd(std::string_view packed, std::string& plain) {
    const std::size_t got = ZSTD_decompress(plain.data(), plain.size(), packed.data(), packed.size());
    if (ZSTD_isError(got)) refuseChunk(ZSTD_getErrorName(got));
    plain.resize(got);
}

/** One frame of the LZ4 frame format. */
void unpackLz4(std::string_view packed, std::string& plain) {
    LZ4F_dctx* made = nullptr;
    if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION))) refuseChunk("no memory");
    const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context(made, &LZ4F_freeDecompressionContext);
    std::size_t taken = 0, given = 0;
    for (;;) {
        std::size_t in = packed.size() - taken, out = plain.size() - given;
        const std::size_t hint =
            LZ4F_decompress(context.get(), plain.data() + given, &out, packed.data() + taken, &in, nullptr);
        if (LZ4F_isError(hint)) refuseChunk(LZ4F_getErrorName(hint));
        taken += in;
        given += out;
        if (hint == 0) break;
        if (in == 0 && out == 0) refuseChunk(given == plain.size() ? "it is longer than it says" : "it is cut off");
    }
    if (taken != packed.size()) refuseChunk("bytes follow its frame");
    plain.resize(given);
}

}  // namespace

std::uint32_t calcCrc(std::string_view bytes, std::uint32_t crcBefore) {
    return static_cast<std::uint32_t>(crc32_z(crcBefore, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string quote(std::string_view text) {
    std::string clean;
    for (const char c : text.substr(0, 40)) clean += c >= ' ' && c < 0x7f ? c : '?';
    return "`" + clean + "`";
}

McapFile::McapFile(const std::filesystem::path& file, std::string remedy)
    : file_(file.string()), remedy_(std::move(remedy)) {
    opened_ = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat info {};
    if (opened_ < 0 || ::fstat(opened_, &info) != 0)
        throw badInput(file_, "the log cannot be opened: " + std::generic_category().message(errno), "Check the path");
    if (!S_ISREG(info.st_mode)) throw badInput(file_, "not a file", "Give a log");
    size_ = static_cast<std::uint64_t>(info.st_size);
    findEnd();
    readHeader();
}

void McapFile::failAt(std::uint64_t offset, const std::string& reason) const {
    throw badInput(file_ + ": byte " + std::to_string(offset), reason, remedy_);
}

void McapFile::failInRecord(std::size_t offset, const std::string& reason) const {
    if (!isInChunk_) failAt(recordOffset_ + kRecordHead + offset, reason);
    failAt(recordOffset_, "in this chunk, record at byte " + std::to_string(chunkRecord_) + ": " + reason);
}

void McapFile::readAt(std::uint64_t offset, std::uint64_t length, std::string& to) const {
    to.resize(static_cast<std::size_t>(length));
    std::size_t got = 0;
    while (got < to.size()) {
        const ssize_t taken = ::pread(opened_, &to[got], to.size() - got, static_cast<off_t>(offset + got));
        if (taken < 0 && errno == EINTR) continue;
        if (taken < 0) failAt(offset + got, "cannot be read: " + std::generic_category().message(errno));
        if (taken == 0) failAt(offset + got, "the file has become shorter while it was read");
        got += static_cast<std::size_t>(taken);
    }
}

/** Looks for footer and closing magic; checks the summary's checksum. */
void McapFile::findEnd() {
    std::string bytes;
    readAt(0, std::min<std::uint64_t>(size_, kMagic.size()), bytes);
    if (bytes != kMagic)
        throw badInput(file_, size_ == 0 ? "the file is empty" : "not an MCAP file of version 0",
                       "Give a log written by `viable run`");
    dataEnd_ = size_;
    constexpr std::uint64_t kTail = kRecordHead + kFooterContent + kMagic.size();
    if (size_ < kMagic.size() + kTail) return;
    readAt(size_ - kTail, kTail, bytes);
    if (std::string_view(bytes).substr(kTail - kMagic.size()) != kMagic) return;

    const std::uint64_t footer = size_ - kTail;
    ByteReader in(bytes);
    const std::uint8_t footerOpcode = in.readU8();
    const std::uint64_t length = in.readU64();
    const std::uint64_t summary = in.readU64();
    in.readU64();
    const std::uint32_t footerCrc = in.readU32();
    if (footerOpcode != kFooter || length != kFooterContent) failAt(footer, "no footer before the end");
    if (summary != 0 && (summary < kMagic.size() || summary > footer))
        failAt(footer, "the summary cannot begin at byte " + std::to_string(summary));
    std::uint32_t crc = 0;
    constexpr std::uint64_t kCovered = kRecordHead + 16;  // the footer up to its checksum
    const std::uint64_t covered = footer + kCovered;
    for (std::uint64_t at = summary == 0 ? footer : summary; at < covered;) {
        const std::uint64_t block = std::min<std::uint64_t>(covered - at, 1 << 20);
        readAt(at, block, bytes);
        crc = calcCrc(bytes, crc);
        at += block;
    }
    if (footerCrc != 0 && crc != footerCrc) failAt(footer, "the summary's checksum differs");
    isComplete_ = true;
    dataEnd_ = summary == 0 ? footer : summary;
}

void McapFile::readHeader() {
    position_ = kMagic.size();
    if (!nextOfFile()) fail("the log ends within its opening and holds no rows");
    if (opcode_ != kHeader) failAt(recordOffset_, "the first record is not a header");
    within([&] {
        ByteReader in(fileContent_);
        in.readString();
        library_ = in.readString();
    });
    dataCrc_ = calcCrc(kMagic);
    addToDataCrc();
}

/** Reads the record at `position_`; false: none is left. */
bool McapFile::nextOfFile() {
    if (atEnd_) return false;
    isInChunk_ = false;
    recordOffset_ = position_;
    if (dataEnd_ - position_ < kRecordHead) return cutOff();
    readAt(position_, kRecordHead, head_);
    ByteReader in(head_);
    opcode_ = in.readU8();
    const std::uint64_t length = in.readU64();
    if (length > dataEnd_ - position_ - kRecordHead) return cutOff();
    if (length > kLargestRecord)
        failAt(position_, "a record of " + std::to_string(length) + " bytes; at most " +
                              std::to_string(kLargestRecord) + " are accepted");
    readAt(position_ + kRecordHead, length, fileContent_);
    recordContent_ = fileContent_;
    position_ += kRecordHead + length;
    return true;
}

bool McapFile::cutOff() {
    atEnd_ = true;
    if (isComplete_) fail("a record runs past the end of the data");
    return false;
}

void McapFile::addToDataCrc() {
    dataCrc_ = calcCrc(fileContent_, calcCrc(head_, dataCrc_));
}

bool McapFile::nextOfOpening() {
    if (isPending_ || !nextOfFile()) return false;
    if (opcode_ == kChunk || opcode_ == kMessage || opcode_ == kDataEnd) {
        isPending_ = true;
        return false;
    }
    addToDataCrc();
    if (opcode_ == kHeader || opcode_ == kFooter) failAt(recordOffset_, "a header or footer among the data");
    return true;
}

bool McapFile::next() {
    const auto tell = [&](double share) { WorkShare::tell(std::filesystem::path(file_).filename().c_str(), share); };
    for (;;) {
        if (isInChunk_ && nextOfChunk()) return true;
        if (nextOfOpening()) return true;
        if (!isPending_) {
            tell(1.0);
            return false;
        }
        isPending_ = false;
        if (opcode_ == kDataEnd) {
            tell(1.0);
            within([&] { readDataEnd(); });
            return false;
        }
        addToDataCrc();
        if (opcode_ == kMessage) return true;
        tell(static_cast<double>(position_) / static_cast<double>(size_));
        within([&] { readChunk(); });
    }
}

/** Goes to the chunk's next record that belongs into one; false: none is left. */
bool McapFile::nextOfChunk() {
    bool isFound = false;
    chunkRecord_ = chunkReader_.position();
    try {
        while (!isFound && chunkReader_.left() > 0) {
            chunkRecord_ = chunkReader_.position();
            opcode_ = chunkReader_.readU8();
            recordContent_ = chunkReader_.take(chunkReader_.readU64());
            isFound = opcode_ == kSchema || opcode_ == kChannel || opcode_ == kMessage;
        }
    } catch (const BadBytes& e) {
        failInRecord(e.offset, e.what());
    }
    return isFound;
}

void McapFile::readDataEnd() {
    const std::uint32_t written = ByteReader(fileContent_).readU32();
    if (written != 0 && written != dataCrc_)
        failAt(recordOffset_, "the checksum of all data differs: something before is damaged");
    atEnd_ = true;
}

void McapFile::readChunk() {
    ByteReader in(fileContent_);
    in.readU64();
    in.readU64();
    const std::uint64_t plain = in.readU64();
    const std::uint32_t crc = in.readU32();
    const std::string_view compression = in.readString();
    const std::string_view packed = in.take(in.readU64());
    if (plain > kLargestAcceptedChunk)
        throw BadBytes(16, "a chunk of " + std::to_string(plain) + " bytes; at most " +
                               std::to_string(kLargestAcceptedChunk) + " are accepted");
    if (compression.empty()) {
        chunk_ = packed;
    } else if (compression == "zstd" || compression == "lz4") {
        chunk_.resize(static_cast<std::size_t>(plain));
        compression == "zstd" ? unpackZstd(packed, chunk_) : unpackLz4(packed, chunk_);
    } else if (compression == "x-viable-columns") {
        throw badInput(file_, "the log was written with `--compact`, which viable reads up to plugin interface 11",
                       "Write it with one of those by `viable export LOG --to mcap FILE`: FILE is a log for this one");
    } else {
        throw BadBytes(
            0, "the chunk is compressed by " + quote(compression) + "; this version reads `zstd`, `lz4` and none");
    }
    if (chunk_.size() != plain)
        throw BadBytes(0,
                       "the chunk has " + std::to_string(chunk_.size()) + " bytes instead of " + std::to_string(plain));
    if (crc != 0 && crc != calcCrc(chunk_)) throw BadBytes(0, "the chunk's checksum differs");
    chunkReader_ = ByteReader(chunk_);
    isInChunk_ = true;
    ++chunkCount_;
}

}  // namespace viable::mcap
