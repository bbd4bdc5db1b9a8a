#include "SweepPipe.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>

#include <cstdint>
#include <cstring>

#include "core/ChildProcess.h"
#include "core/WholeFile.h"

namespace viable {

bool writeFrame(int pipe, const std::string& message) {
    const std::uint64_t size = message.size();
    std::string bytes(reinterpret_cast<const char*>(&size), sizeof size);
    bytes += message;
    return detail::writeAll(pipe, bytes) == 0;
}

bool FrameReader::fill(int timeout_ms) {
    pollfd wait{pipe_, POLLIN, 0};
    if (isClosed_ || poll(&wait, 1, timeout_ms) <= 0) return false;
    char bytes[1 << 16];
    const ssize_t count = ::read(pipe_, bytes, sizeof bytes);
    if (count < 0 && errno == EINTR) return false;
    if (count <= 0) {
        isClosed_ = true;
        return false;
    }
    buffer_.erase(0, at_);
    at_ = 0;
    buffer_.append(bytes, static_cast<std::size_t>(count));
    return true;
}

std::optional<std::string> FrameReader::take() {
    std::uint64_t size = 0;
    if (buffer_.size() - at_ < sizeof size) return {};
    std::memcpy(&size, buffer_.data() + at_, sizeof size);
    if (buffer_.size() - at_ - sizeof size < size) return {};
    at_ += sizeof size + size;
    return buffer_.substr(at_ - size, size);
}

std::optional<std::string> FrameReader::wait() {
    for (;;) {
        if (std::optional<std::string> message = take()) return message;
        if (isClosed_) return {};
        fill(-1);
    }
}

PipedProcess::PipedProcess(const std::function<void(FrameReader& from, int to)>& live) {
    int down[2], up[2];
    if (pipe2(down, O_CLOEXEC) != 0 || pipe2(up, O_CLOEXEC) != 0)
        throw std::system_error(errno, std::generic_category(), "no pipe for the runs");
    pid_ = detail::forkChild("for the runs");
    if (pid_ == 0) {
        ::close(down[1]);
        ::close(up[0]);
        for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, SIG_IGN);
        FrameReader from(down[0]);
        live(from, up[1]);
        _exit(0);
    }
    ::close(down[0]);
    ::close(up[1]);
    to_ = down[1];
    messages_.emplace(up[0]);
}

PipedProcess::~PipedProcess() {
    kill();
    finish();
}

void PipedProcess::kill() {
    if (pid_ > 0) ::kill(pid_, SIGKILL);
}

bool PipedProcess::hasEnded() {
    if (pid_ <= 0) return true;
    const pid_t done = waitpid(pid_, &status_, WNOHANG);
    if (done == 0 || (done < 0 && errno == EINTR)) return false;
    pid_ = -1;
    return true;
}

void PipedProcess::finish() {
    to_ = -1;
    while (pid_ > 0 && waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
}

}  // namespace viable
