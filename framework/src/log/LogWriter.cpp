#include "log/LogWriter.h"

#include <unistd.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <numeric>
#include <system_error>

#include "core/WholeFile.h"
#include "log/LimitKinds.h"
#include "log/LogMessage.h"

namespace viable {

namespace {

using namespace mcap;

std::string describe(int code) {
    return std::generic_category().message(code);
}

std::uint32_t addToCrc(std::uint32_t crc, std::string_view bytes) {
    return static_cast<std::uint32_t>(crc32_z(crc, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

constexpr char kTaken[] = "the log exists already and is never overwritten";

Error takenName(const std::filesystem::path& file) {
    return badInput(file.string(), kTaken, "Choose another folder or move the old log away");
}

/** A log's file. It has its name from its opening on, so that whoever finds it can read it. */
class FileSink : public LogSink {
public:
    /** @param descriptor  of the new file `part`, which will be `file` */
    FileSink(int descriptor, std::filesystem::path part, std::filesystem::path file)
        : descriptor_(descriptor), part_(std::move(part)), file_(std::move(file)) {}
    ~FileSink() override {
        if (descriptor_ >= 0) ::close(descriptor_);
        if (!part_.empty()) ::unlink(part_.c_str());
    }

    bool write(const void* data, std::size_t size, std::string& error) override {
        if (const int code = detail::writeAll(descriptor_, {static_cast<const char*>(data), size})) {
            error = describe(code);
            return false;
        }
        if (part_.empty()) return true;
        if (const int code = detail::giveName(part_, file_)) {
            error = code == EEXIST ? kTaken : describe(code);
            return false;
        }
        part_.clear();
        return true;
    }

    bool close(std::string& error) override {
        const int descriptor = descriptor_;
        descriptor_ = -1;
        // EINTR: Linux has closed it all the same.
        if (::close(descriptor) == 0 || errno == EINTR) return true;
        error = describe(errno);
        return false;
    }

private:
    int descriptor_;
    std::filesystem::path part_;  // its name until the first write; then empty
    std::filesystem::path file_;
};

struct ChunkEntry {
    std::uint64_t start, end;  // log time [ns]
    std::uint64_t offset, length;
    std::vector<std::uint64_t> indexOffsets;  // by channel
    std::uint64_t indexLength;
    std::uint64_t compressed, uncompressed;
};

struct AttachmentEntry {
    std::uint64_t offset, length, size;
    std::string name, mediaType;
};

constexpr std::string_view kCompression = "zstd";
constexpr int kCompressionLevel = 1;
constexpr char kMetadataName[] = "viable";

}  // namespace

std::unique_ptr<LogSink> createLogFile(const std::filesystem::path& file) {
    std::filesystem::path part;
    const int descriptor = detail::openBeside(file, part);
    if (descriptor >= 0) return std::make_unique<FileSink>(descriptor, part, file);
    if (errno == EEXIST) throw takenName(file);
    throw Error(ErrorKind::LogNotWritten, file.string(), "the log cannot be created: " + describe(errno),
                "Choose a folder that exists and may be written to");
}

struct LogWriter::Impl {
    Impl(std::unique_ptr<LogSink> target, const LogOpening& opening) : sink(std::move(target)), layout(opening.layout) {
        const auto n = layout.jointNames.size();
        VIABLE_CHECK(n >= 1 && n <= static_cast<std::size_t>(kMaxJoints), "a log has 1 to 16 joints");
        for (const LogChannel* channel : listLogChannels())
            if (channel->isLogged(layout)) channels.push_back(channel);
        indices.resize(channels.size());
        counts.resize(channels.size());
        lastBodies.resize(channels.size());
        guard([&] {
            compressor.reset(ZSTD_createCCtx());
            ZSTD_CCtx_setParameter(compressor.get(), ZSTD_c_compressionLevel, kCompressionLevel);
            writeOpening(opening);
        });
    }

    int joints() const { return static_cast<int>(layout.jointNames.size()); }

    /** No exception leaves: memory that ran out ends the log like a full disk. */
    template <class Call>
    void guard(const Call& call) noexcept {
        try {
            call();
        } catch (const std::exception& e) {
            try {
                if (status.ok()) status.error = e.what();
            } catch (...) {
                status.error = "no memory";  // short: kept inside the string
            }
        }
    }

    void send(const std::string& bytes) {
        if (!status.ok()) return;
        if (!sink->write(bytes.data(), bytes.size(), status.error)) {
            if (status.error.empty()) status.error = "unknown write error";
            return;
        }
        dataCrc = addToCrc(dataCrc, bytes);
        status.bytes += bytes.size();
    }

    void putSchemas(ByteWriter& out) const {
        for (std::size_t i = 0; i < channels.size(); ++i) {
            const std::size_t record = out.begin(kSchema);
            out.putU16(static_cast<std::uint16_t>(i + 1));  // 0 means: no schema
            out.putString(channels[i]->getSchema());
            out.putString("ros2msg");
            out.putString(channels[i]->getSchemaText());
            out.end(record);
        }
    }

    void putChannels(ByteWriter& out) const {
        const std::string names =
            nlohmann::json(layout.jointNames).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
        for (std::size_t i = 0; i < channels.size(); ++i) {
            const std::size_t record = out.begin(kChannel);
            out.putU16(static_cast<std::uint16_t>(i));
            out.putU16(static_cast<std::uint16_t>(i + 1));
            out.putString(channels[i]->getTopic());
            out.putString("cdr");
            // The profile ros2 asks for the QoS entry, even when there is nothing to say.
            std::map<std::string, std::string> entries{{"joint_names", names}, {"offered_qos_profiles", ""}};
            if (channels[i]->isOnChange) entries[kWritten] = kOnChange;
            out.putMap(entries);
            out.end(record);
        }
    }

    void writeOpening(const LogOpening& opening) {
        ByteWriter out;
        out.bytes = kMagic;
        std::size_t record = out.begin(kHeader);
        out.putString("ros2");
        out.putString("viable " VIABLE_VERSION);
        out.end(record);

        metadataOffset = out.bytes.size();
        record = out.begin(kMetadata);
        out.putString(kMetadataName);
        std::map<std::string, std::string> metadata = opening.metadata;
        if (const std::string kinds = writeLimitKinds(); !kinds.empty()) metadata[kLimitKindsKey] = kinds;
        out.putMap(metadata);
        out.end(record);
        metadataLength = out.bytes.size() - metadataOffset;

        for (const LogAttachment& attachment : opening.attachments) putAttachment(attachment, out);
        putSchemas(out);
        putChannels(out);
        send(out.bytes);
    }

    /** @param out  will be sent next, from its beginning */
    void putAttachment(const LogAttachment& attachment, ByteWriter& out) {
        const std::size_t begin = out.bytes.size();
        const std::size_t record = out.begin(kAttachment);
        out.putU64(0);  // log time
        out.putU64(0);  // creation time: not told, so that equal runs give equal logs
        out.putString(attachment.name);
        out.putString(attachment.mediaType);
        out.putU64(attachment.data.size());
        out.bytes += attachment.data;
        out.putU32(addToCrc(0, std::string_view(out.bytes).substr(record)));
        out.end(record);
        attachments.push_back({status.bytes + begin, out.bytes.size() - begin, attachment.data.size(), attachment.name,
                               attachment.mediaType});
    }

    void append(const TickRecord& record) {
        const std::uint64_t time = toLogTime(record.time_s);
        if (chunkRows > 0 && (time >= chunkFirst + static_cast<std::uint64_t>(kLongestChunk_s * 1e9) ||
                              time < chunkFirst || chunk.bytes.size() >= kLargestChunk))
            writeChunk();
        if (chunkRows == 0) {
            chunkFirst = chunkStart = chunkEnd = time;
        } else {
            chunkStart = std::min(chunkStart, time);
            chunkEnd = std::max(chunkEnd, time);
        }
        for (std::size_t c = 0; c < channels.size(); ++c) {
            const std::size_t start = chunk.bytes.size();
            const std::size_t message = chunk.begin(kMessage);
            chunk.putU16(static_cast<std::uint16_t>(c));
            chunk.putU32(static_cast<std::uint32_t>(rows - 1));  // sequence
            chunk.putU64({time, time});                          // log time, publish time
            const std::size_t origin = chunk.bytes.size();
            putMessage(*channels[c], record, joints(), chunk);
            chunk.end(message);
            if (channels[c]->isOnChange && isRepeated(c, origin)) {
                chunk.bytes.resize(start);
                continue;
            }
            indices[c].emplace_back(time, start);
        }
        ++chunkRows;
    }

    /** Is the message body from `origin` on, bit by bit, the last one of this chunk? If not, it is from now on. */
    bool isRepeated(std::size_t channel, std::size_t origin) {
        const std::string_view body = std::string_view(chunk.bytes).substr(origin);
        if (chunkRows > 0 && body == lastBodies[channel]) return true;
        lastBodies[channel] = body;
        return false;
    }

    void pack() {
        packed.resize(ZSTD_compressBound(chunk.bytes.size()));
        const std::size_t size =
            ZSTD_compress2(compressor.get(), packed.data(), packed.size(), chunk.bytes.data(), chunk.bytes.size());
        if (ZSTD_isError(size)) throw std::runtime_error(ZSTD_getErrorName(size));
        packed.resize(size);
    }

    void writeChunk() {
        if (chunkRows == 0) return;
        pack();

        ByteWriter& out = outgoing;
        out.bytes.clear();
        ChunkEntry entry{chunkStart, chunkEnd, status.bytes, 0, {}, 0, packed.size(), chunk.bytes.size()};
        const std::size_t record = out.begin(kChunk);
        out.putU64({entry.start, entry.end, entry.uncompressed});
        out.putU32(addToCrc(0, chunk.bytes));
        out.putString(kCompression);
        out.putU64(packed.size());
        out.bytes += packed;
        out.end(record);
        entry.length = out.bytes.size();
        for (std::size_t c = 0; c < channels.size(); ++c) {
            entry.indexOffsets.push_back(entry.offset + out.bytes.size());
            const std::size_t index = out.begin(kMessageIndex);
            out.putU16(static_cast<std::uint16_t>(c));
            const std::size_t list = out.beginLength32();
            for (const auto& [time, offset] : indices[c]) out.putU64({time, offset});
            out.endLength32(list);
            out.end(index);
        }
        entry.indexLength = out.bytes.size() - entry.length;
        send(out.bytes);
        if (status.ok()) {
            startTime = status.rows == 0 ? entry.start : std::min(startTime, entry.start);
            endTime = std::max(endTime, entry.end);
            chunks.push_back(std::move(entry));
            status.rows += chunkRows;
            for (std::size_t c = 0; c < channels.size(); ++c) counts[c] += indices[c].size();
        }
        for (auto& index : indices) index.clear();
        chunk.bytes.clear();
        chunkRows = 0;
    }

    void writeEnd() {
        ByteWriter out;
        std::size_t record = out.begin(kDataEnd);
        out.putU32(dataCrc);
        out.end(record);

        const std::uint64_t base = status.bytes;  // offsets in `out` count from here
        const std::size_t summary = out.bytes.size();
        struct Group {
            Opcode opcode;
            std::size_t start, end;
        };
        std::vector<Group> groups;
        const auto addGroup = [&](Opcode opcode, const auto& put) {
            const std::size_t start = out.bytes.size();
            put();
            if (out.bytes.size() > start) groups.push_back({opcode, start, out.bytes.size()});
        };
        addGroup(kSchema, [&] { putSchemas(out); });
        addGroup(kChannel, [&] { putChannels(out); });
        addGroup(kStatistics, [&] {
            const std::size_t content = out.begin(kStatistics);
            out.putU64(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}));
            out.putU16(static_cast<std::uint16_t>(channels.size()));
            out.putU32(static_cast<std::uint32_t>(channels.size()));
            out.putU32(static_cast<std::uint32_t>(attachments.size()));
            out.putU32(1);
            out.putU32(static_cast<std::uint32_t>(chunks.size()));
            out.putU64({startTime, endTime});
            const std::size_t list = out.beginLength32();
            for (std::size_t c = 0; c < channels.size(); ++c) {
                out.putU16(static_cast<std::uint16_t>(c));
                out.putU64(counts[c]);
            }
            out.endLength32(list);
            out.end(content);
        });
        addGroup(kChunkIndex, [&] {
            for (const ChunkEntry& entry : chunks) {
                const std::size_t content = out.begin(kChunkIndex);
                out.putU64({entry.start, entry.end, entry.offset, entry.length});
                const std::size_t offsets = out.beginLength32();
                for (std::size_t c = 0; c < entry.indexOffsets.size(); ++c) {
                    out.putU16(static_cast<std::uint16_t>(c));
                    out.putU64(entry.indexOffsets[c]);
                }
                out.endLength32(offsets);
                out.putU64(entry.indexLength);
                out.putString(kCompression);
                out.putU64({entry.compressed, entry.uncompressed});
                out.end(content);
            }
        });
        addGroup(kAttachmentIndex, [&] {
            for (const AttachmentEntry& entry : attachments) {
                const std::size_t content = out.begin(kAttachmentIndex);
                out.putU64({entry.offset, entry.length, 0, 0, entry.size});
                out.putString(entry.name);
                out.putString(entry.mediaType);
                out.end(content);
            }
        });
        addGroup(kMetadataIndex, [&] {
            const std::size_t content = out.begin(kMetadataIndex);
            out.putU64({metadataOffset, metadataLength});
            out.putString(kMetadataName);
            out.end(content);
        });
        const std::size_t summaryOffsets = out.bytes.size();
        for (const Group& group : groups) {
            const std::size_t content = out.begin(kSummaryOffset);
            out.putU8(group.opcode);
            out.putU64({base + group.start, group.end - group.start});
            out.end(content);
        }
        record = out.begin(kFooter);
        out.putU64({base + summary, base + summaryOffsets});
        // The checksum covers the footer's head, so its length must stand there already.
        out.putU32(0);
        out.end(record);
        out.bytes.resize(out.bytes.size() - 4);
        out.putU32(addToCrc(0, std::string_view(out.bytes).substr(summary)));
        out.bytes += kMagic;
        send(out.bytes);
    }

    void finish() {
        if (finished) return;
        finished = true;
        guard([&] {
            if (status.ok()) writeChunk();
            if (status.ok()) writeEnd();
        });
        status.lost = rows - status.rows;
        std::string error;
        if (!sink->close(error) && status.ok()) status.error = error.empty() ? "the log could not be closed" : error;
    }

    std::unique_ptr<LogSink> sink;
    LogLayout layout;
    std::vector<const LogChannel*> channels;  // those of this layout; the channel's id is the index
    std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> compressor{nullptr, &ZSTD_freeCCtx};
    LogStatus status;
    bool finished = false;

    ByteWriter chunk;                                                           // messages not yet written
    std::vector<std::vector<std::pair<std::uint64_t, std::uint64_t>>> indices;  // time, offset; by channel
    std::vector<std::uint64_t> counts;                                          // messages written, by channel
    std::vector<std::string> lastBodies;  // of this chunk, by channel; of those written on change alone
    std::uint64_t chunkFirst = 0, chunkStart = 0, chunkEnd = 0;  // [ns]
    std::uint64_t chunkRows = 0;
    std::uint64_t rows = 0;  // appended, the one in work included
    std::string packed;
    ByteWriter outgoing;

    std::uint32_t dataCrc = 0;
    std::uint64_t startTime = 0, endTime = 0;  // [ns]
    std::uint64_t metadataOffset = 0, metadataLength = 0;
    std::vector<ChunkEntry> chunks;
    std::vector<AttachmentEntry> attachments;
};

LogWriter::LogWriter(const std::filesystem::path& file, const LogOpening& opening)
    : LogWriter(createLogFile(file), opening) {
    // Of two runs at once the slower one learns of the other only here.
    if (impl_->status.error == kTaken) throw takenName(file);
}

LogWriter::LogWriter(std::unique_ptr<LogSink> sink, const LogOpening& opening)
    : impl_(std::make_unique<Impl>(std::move(sink), opening)) {}

LogWriter::~LogWriter() = default;

void LogWriter::append(const TickRecord& record) noexcept {
    if (impl_->finished) return;
    ++impl_->rows;
    if (impl_->status.ok()) impl_->guard([&] { impl_->append(record); });
    if (!impl_->status.ok()) impl_->status.lost = impl_->rows - impl_->status.rows;
}

void LogWriter::attach(const LogAttachment& attachment) noexcept {
    if (impl_->finished || !impl_->status.ok()) return;
    impl_->guard([&] {  // between the chunks: before the one that is being filled
        ByteWriter out;
        impl_->putAttachment(attachment, out);
        impl_->send(out.bytes);
    });
}

void LogWriter::finish() noexcept {
    impl_->guard([&] { impl_->finish(); });
}

const LogStatus& LogWriter::status() const {
    return impl_->status;
}

}  // namespace viable
