#pragma once

#include <atomic>
#include <mutex>
#include <thread>

#include "log/LogWriter.h"

namespace viable {

/** Ticks that a recorder holds unless told otherwise: one second at 1 kHz. */
inline constexpr std::size_t kRecorderCapacity = 1024;

/** Carries ticks from the control loop to a thread that writes them.

Real time: append() copies into a slot made beforehand; no allocation, lock, system call or
exception, and nobody is woken: the writing thread looks by itself every millisecond.
Guarantees: rows arrive complete and in order. After a write error the recorder goes on taking rows
(and counting them as lost), so that the loop never waits for a full disk.
Thread: append() by one thread, finish() by that thread or after it. */
class Recorder {
public:
    /** @param capacity  ticks held at most, at least 1 */
    explicit Recorder(std::unique_ptr<RowWriter> writer, std::size_t capacity = kRecorderCapacity);
    /** finish(), its status unseen. */
    ~Recorder();

    /** Hands over a row. False when the writer is behind by the whole capacity: the row was not
    taken. A simulation then yields and tries again; a real-time loop counts it. Not after finish().
    */
    bool append(const TickRecord& record) noexcept;

    /** A file for the log. It will stand there before the rows that are appended after this call. Not for the tick: it
    allocates and locks. Any thread; not after finish(). */
    void attach(LogAttachment attachment);

    /** Writes what is left, finishes the log and returns how it went. Blocks until then. Later
    calls return the same. */
    LogStatus finish();

    /** For a signal handler of a program that is about to die: all recorders write what was handed over and finish their
    logs. Returns when they have, or after `timeout_s`: true when all logs are whole. What is handed
    over after that is lost. */
    static bool rescueAll(double timeout_s) noexcept;

private:
    void drain();
    void writeAttachments();

    std::unique_ptr<RowWriter> writer_;
    std::vector<TickRecord> slots_;
    // Each side's counter has a cache line of its own; a slot's index is its counter modulo
    // capacity.
    alignas(64) std::atomic<std::size_t> written_{0};  // by append()
    std::size_t knownRead_ = 0;                        // append()'s last look at read_
    alignas(64) std::atomic<std::size_t> read_{0};     // by the writing thread
    alignas(64) std::atomic<bool> stop_{false};
    std::mutex lock_;  // of attachments_, between attach() and the writing thread
    std::vector<LogAttachment> attachments_;
    std::thread thread_;
};

}  // namespace viable
