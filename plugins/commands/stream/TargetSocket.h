#pragma once

#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "core/Descriptor.h"

namespace viable {

/** The place where targets arrive: a Unix datagram socket NAME.socket in a folder of this user alone, and NAME.json beside
it, which tells programs of the same user how to send: token, space, joints. The folder is $XDG_RUNTIME_DIR/viable, or
/tmp/viable-UID.

A socket of one name is open once per computer, and in a process as long as it lives: what follows a rehearsal goes on where
that was. Threads: one user at a time. */
class TargetSocket {
public:
    using Token = std::array<std::uint8_t, 16>;

    /** The one of this name in this process, opened where it is not yet. Throws Error where another program, or another user
    of this process, has it. */
    static std::shared_ptr<TargetSocket> open(const std::string& name);
    ~TargetSocket();

    static std::filesystem::path findFolder();

    const Token& token() const { return token_; }
    /** Writes NAME.json. @param content  its entries but the token, as JSON without braces. Throws Error */
    void describe(const std::string& content) const;
    /** What lies there is of a time before. */
    void drain() noexcept;

    /** Bytes of the next datagram, of a longer one more than `capacity`; -1: there is none. Real time: no allocation, lock or wait. */
    std::ptrdiff_t receive(void* to, std::size_t capacity) noexcept;
    /** To the sender of that datagram; dropped where it has no abstract address, or does not listen. Real time, likewise. */
    void answer(const void* from, std::size_t size) noexcept;

private:
    explicit TargetSocket(std::filesystem::path base);

    const std::filesystem::path base_;  // without extension
    detail::Descriptor lock_, socket_;
    Token token_{};
    sockaddr_un sender_{};
    socklen_t senderSize_ = 0;
};

}  // namespace viable
