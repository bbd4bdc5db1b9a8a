#pragma once

#include <sys/types.h>

#include <functional>
#include <optional>
#include <string>

#include "core/Descriptor.h"

namespace viable {

/** Writes a message into a pipe, its length first. False: nobody reads there any more. */
bool writeFrame(int pipe, const std::string& message);

/** Takes messages out of a pipe; one that was cut off by the writer's death is never seen. */
class FrameReader {
public:
    /** @param pipe  closed by the destructor */
    explicit FrameReader(int pipe) : pipe_(pipe) {}

    /** Reads what is there, after at most `timeout_ms` (-1: whatever it takes). False: nothing came. */
    bool fill(int timeout_ms);
    std::optional<std::string> take();
    /** Waits for a message; nothing when there will be none. */
    std::optional<std::string> wait();
    bool isClosed() const { return isClosed_; }

private:
    const detail::Descriptor pipe_;
    bool isClosed_ = false;
    std::string buffer_;
    std::size_t at_ = 0;  // what lies before was taken
};

/** A process forked from this one, which ends with it, and the pipes between the two. It ignores the signals by which
users end programs: the process that made it decides when to end. */
class PipedProcess {
public:
    /** @param live  the whole life of the new process, which reads messages `from` this one and writes its own `to` it.
    Throws std::system_error where there can be no process or pipe. */
    explicit PipedProcess(const std::function<void(FrameReader& from, int to)>& live);
    /** Kills it. */
    ~PipedProcess();

    /** Messages that it wrote. */
    FrameReader& messages() { return *messages_; }
    /** False: it reads no more. */
    bool send(const std::string& message) { return writeFrame(to_, message); }
    /** Does not wait for its death. */
    void kill();
    bool hasEnded();
    /** Closes its input and waits for its end. */
    void finish();
    /** How it ended, as from waitpid(). */
    int status() const { return status_; }

private:
    pid_t pid_ = -1;  // -1: ended
    detail::Descriptor to_;
    std::optional<FrameReader> messages_;
    int status_ = 0;
};

}  // namespace viable
