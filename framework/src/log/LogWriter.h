#pragma once

#include "viable/log/TickRecord.h"

namespace viable {

/** What all rows of a log have in common. */
struct LogLayout {
    std::vector<std::string> jointNames;  ///< 1 to kMaxJoints
    MotionCommand::Space commandSpace = MotionCommand::Space::Joint;
    bool hasRealPlant = false;       ///< real, actual, robust and motor are logged only then
    bool hasExternalTorque = false;  ///< TickRecord::externalTorque is there, and logged
    LimitSet limits;                 ///< of the whole arm: the kinds whose TickRecord::reports are logged
    bool isLive = false;             ///< a run in real time: pauses, takes and the time between ticks are logged
    bool hasContact = false;         ///< TickRecord::contact is there, and logged
    bool hasTouch = false;           ///< TickRecord::touch is logged
};

/** A file carried inside a log. */
struct LogAttachment {
    std::string name;       ///< such as "experiment.yaml"
    std::string mediaType;  ///< such as "application/yaml"
    std::string data;
};

/** What a log says before its first row. */
struct LogOpening {
    LogLayout layout;
    std::map<std::string, std::string> metadata;  ///< versions, seeds, plugin paths, ...
    std::vector<LogAttachment> attachments;       ///< the resolved experiment file, ...
};

/** How far the writing of a log came. */
struct LogStatus {
    std::uint64_t rows = 0;   ///< rows in chunks handed over to the system without an error
    std::uint64_t lost = 0;   ///< rows appended after or with the first error: not in the file
    std::uint64_t bytes = 0;  ///< bytes handed over without an error
    std::string error;        ///< the first error, empty when there was none
    bool ok() const { return error.empty(); }
};

/** Takes the rows of a log. Thread: one caller at a time; not for the tick (see Recorder). */
class RowWriter {
public:
    virtual ~RowWriter() = default;
    virtual void append(const TickRecord& record) noexcept = 0;
    /** Writes what is left and closes. Later calls do nothing. */
    virtual void finish() noexcept = 0;
    virtual const LogStatus& status() const = 0;
    /** A file that goes with the rows from here on; it stands in the log before the first of them. */
    virtual void attach(const LogAttachment& attachment) noexcept = 0;
};

/** Where a log's bytes go. Tests put a failing or slow one in its place. */
class LogSink {
public:
    virtual ~LogSink() = default;
    /** Takes all bytes, in order. Returns false and a reason when not all of them were taken. */
    virtual bool write(const void* data, std::size_t size, std::string& error) = 0;
    /** Called once, after the last write. */
    virtual bool close(std::string& error) = 0;
};

/** A new file, which gets its name when it has taken the first write (a log's opening): whoever finds it,
even of a program that was killed, can read it. Throws Error: BadInput when something of that name exists
already (it is never overwritten), LogNotWritten when it cannot be created. */
std::unique_ptr<LogSink> createLogFile(const std::filesystem::path& file);

/** Chunks are closed after this much of logged time or this much data, whichever comes first: a
crash loses at most one. */
inline constexpr double kLongestChunk_s = 0.1;
inline constexpr std::size_t kLargestChunk = 1 << 20;  // [bytes, before compression]

/** Writes a run's log as an MCAP file (https://mcap.dev/spec, version 0): one channel per source
("/nominal", "/real", "/filter", ...), messages of ROS 2 types described in the file itself (ros2msg
schemas, CDR data), chunks compressed by Zstandard with checksums, index and statistics at the end. Log time is
the tick's time in ns from 0. A channel of LogChannel::isOnChange has a message in the first row of each chunk and
where a value changes.

Guarantees: after construction no error throws; the first one is kept in status() and nothing more
is written after it. Every finished chunk is handed to the system with one write, so a killed
program loses at most the last chunk; there is no fsync, so a power cut loses what the system had
not stored yet. */
class LogWriter : public RowWriter {
public:
    /** Creates the file (see createLogFile) and writes the opening. */
    LogWriter(const std::filesystem::path& file, const LogOpening& opening);
    LogWriter(std::unique_ptr<LogSink> sink, const LogOpening& opening);
    /** Without finish() the file stays as a killed program would leave it. */
    ~LogWriter() override;

    void append(const TickRecord& record) noexcept override;
    void attach(const LogAttachment& attachment) noexcept override;
    /** The last chunk, summary and footer. */
    void finish() noexcept override;
    const LogStatus& status() const override;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
