#include "log/Recorder.h"

#include <signal.h>

#include <chrono>
#include <ctime>

namespace viable {

namespace {

/** How long the writing thread sleeps when there is nothing to write. */
constexpr std::chrono::milliseconds kNap(1);

std::atomic<int> unfinished{0};  // recorders whose log has no end yet
std::atomic<bool> rescue{false};

}  // namespace

Recorder::Recorder(std::unique_ptr<RowWriter> writer, std::size_t capacity)
    : writer_(std::move(writer)), slots_(capacity) {
    VIABLE_CHECK(capacity >= 1, "a recorder holds at least one tick");
    // A new thread inherits the mask: signals to the program (Ctrl-C) stay with the other threads,
    // and a file size limit becomes a write error (EFBIG) instead of the end of the program.
    sigset_t blocked, before;
    sigfillset(&blocked);
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP}) sigdelset(&blocked, signal);
    pthread_sigmask(SIG_SETMASK, &blocked, &before);
    ++unfinished;
    try {
        thread_ = std::thread([this] { drain(); });
    } catch (...) {
        --unfinished;
        pthread_sigmask(SIG_SETMASK, &before, nullptr);
        throw;
    }
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

Recorder::~Recorder() {
    finish();
}

bool Recorder::append(const TickRecord& record) noexcept {
    const std::size_t written = written_.load(std::memory_order_relaxed);
    if (written - knownRead_ >= slots_.size()) {
        knownRead_ = read_.load(std::memory_order_acquire);
        if (written - knownRead_ >= slots_.size()) return false;
    }
    slots_[written % slots_.size()] = record;
    written_.store(written + 1, std::memory_order_release);
    return true;
}

void Recorder::drain() {
    for (;;) {
        // Looked at first: what was appended before the stop is seen by the next load.
        const bool stop = stop_.load(std::memory_order_acquire) || rescue.load(std::memory_order_acquire);
        const std::size_t written = written_.load(std::memory_order_acquire);
        std::size_t read = read_.load(std::memory_order_relaxed);
        writeAttachments();  // of rows up to `written` all are there by now
        if (read == written) {
            if (stop) break;
            std::this_thread::sleep_for(kNap);
            continue;
        }
        while (read != written) {
            writer_->append(slots_[read % slots_.size()]);
            read_.store(++read, std::memory_order_release);
        }
    }
    writer_->finish();
    --unfinished;
}

void Recorder::writeAttachments() {
    std::vector<LogAttachment> all;
    {
        const std::lock_guard guard(lock_);
        all.swap(attachments_);
    }
    for (const LogAttachment& attachment : all) writer_->attach(attachment);
}

void Recorder::attach(LogAttachment attachment) {
    const std::lock_guard guard(lock_);
    attachments_.push_back(std::move(attachment));
}

bool Recorder::rescueAll(double timeout_s) noexcept {
    rescue.store(true, std::memory_order_release);
    constexpr double kLook_s = 0.01;
    for (double waited = 0.0; unfinished.load() > 0; waited += kLook_s) {
        if (waited >= timeout_s) return false;
        const timespec nap{0, static_cast<long>(kLook_s * 1e9)};
        nanosleep(&nap, nullptr);
    }
    return true;
}

LogStatus Recorder::finish() {
    if (thread_.joinable()) {
        stop_.store(true, std::memory_order_release);
        thread_.join();
    }
    return writer_->status();
}

}  // namespace viable
