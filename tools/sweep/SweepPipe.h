#pragma once

#include <optional>
#include <string>

namespace viable {

/** Writes a message into a pipe, its length first. False: nobody reads there any more. */
bool writeFrame(int pipe, const std::string& message);

/** Takes messages out of a pipe; one that was cut off by the writer's death is never seen. */
class FrameReader {
public:
    FrameReader() = default;
    /** @param pipe  closed by the destructor */
    explicit FrameReader(int pipe) : pipe_(pipe) {}
    ~FrameReader();
    FrameReader(FrameReader&& other) noexcept;
    FrameReader& operator=(FrameReader&& other) noexcept;

    /** Reads what is there, after at most `timeout_ms` (-1: whatever it takes). False: nothing came. */
    bool fill(int timeout_ms);
    std::optional<std::string> take();
    /** Waits for a message; nothing when there will be none. */
    std::optional<std::string> wait();
    bool isClosed() const { return isClosed_; }

private:
    int pipe_ = -1;
    bool isClosed_ = false;
    std::string buffer_;
    std::size_t at_ = 0;  // what lies before was taken
};

}  // namespace viable
