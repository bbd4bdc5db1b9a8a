#pragma once

#include <filesystem>

#include "core/Descriptor.h"
#include "log/Mcap.h"

namespace viable::mcap {

/** Walks the records of an MCAP file, finished or cut off: a file without its end gives every whole chunk that it has.
Checksums are checked; no length in the file is trusted before it is checked. Chunks are opened on the way (none, zstd,
lz4), so that their records come like those outside.

Every failure is an Error (BadInput) with the file, the byte offset and the reason. */
class McapFile {
public:
    /** Opens the file and reads its header. @param remedy  ends the errors about the file's bytes */
    McapFile(const std::filesystem::path& file, std::string remedy);
    McapFile(const McapFile&) = delete;
    McapFile& operator=(const McapFile&) = delete;

    const std::string& library() const { return library_; }  ///< what wrote it, such as "viable 0.1.0"
    /** Does the file have its end? Known from the beginning. */
    bool isComplete() const { return isComplete_; }

    /** Goes to the next record of the data; false at the end of the file, or of what is left of it. */
    bool next();
    /** As next(), but false before the first record that is or can hold a message; next() goes on there. */
    bool nextOfOpening();

    std::uint8_t opcode() const { return opcode_; }              ///< never kHeader, kChunk, kDataEnd, kFooter
    std::string_view content() const { return recordContent_; }  ///< valid up to the next record
    /** Chunks opened so far: the record at hand stands in the last of them, or outside where the file has none. */
    std::uint64_t chunkCount() const { return chunkCount_; }

    /** Calls `take`, which reads content(), and turns its BadBytes (counted from there) into an Error. */
    template <class Take>
    void within(const Take& take) const {
        try {
            take();
        } catch (const BadBytes& e) {
            failInRecord(e.offset, e.what());
        }
    }

    /** Throws the Error for what is wrong at the end of what was read so far. */
    [[noreturn]] void fail(const std::string& reason) const { failAt(position_, reason); }

private:
    [[noreturn]] void failAt(std::uint64_t offset, const std::string& reason) const;
    [[noreturn]] void failInRecord(std::size_t offset, const std::string& reason) const;
    void readAt(std::uint64_t offset, std::uint64_t length, std::string& to) const;
    void findEnd();
    void readHeader();
    bool nextOfFile();
    bool nextOfChunk();
    bool cutOff();
    void addToDataCrc();
    void readChunk();
    void readDataEnd();

    std::string file_, remedy_;
    detail::Descriptor opened_;
    std::uint64_t size_ = 0;
    std::uint64_t dataEnd_ = 0;  // where the data section ends at the latest
    bool isComplete_ = false;
    std::string library_;

    // The record of the file at hand
    std::uint64_t position_ = 0;  // of the one behind it
    std::uint64_t recordOffset_ = 0;
    std::string head_, fileContent_;
    bool isPending_ = false;  // read, not yet given
    bool atEnd_ = false;
    std::uint32_t dataCrc_ = 0;

    // The record given: that one, or one of the chunk
    std::uint8_t opcode_ = 0;
    std::string_view recordContent_;

    std::string chunk_;
    ByteReader chunkReader_{std::string_view()};
    bool isInChunk_ = false;
    std::uint64_t chunkCount_ = 0;
    std::size_t chunkRecord_ = 0;  // offset in the chunk
};

std::uint32_t calcCrc(std::string_view bytes, std::uint32_t crcBefore = 0);

/** Text of a file for a message: in backquotes, at most 40 letters, none that a terminal would obey. */
std::string quote(std::string_view text);

}  // namespace viable::mcap
