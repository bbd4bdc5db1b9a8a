#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <string>

namespace viable::test {

/** A client that sends any bytes over TLS to this computer, and reads what comes. */
class TlsClient {
public:
    /** @param from  of the addresses of this computer */
    explicit TlsClient(unsigned short port, bool shakesHands = true, const char* from = "127.0.0.1") {
        std::signal(SIGPIPE, SIG_IGN);  // a server that closes is an answer
        socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        ::inet_pton(AF_INET, from, &address.sin_addr);
        if (::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return;
        address.sin_port = htons(port);
        ::inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
        if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return;
        timeval timeout{20, 0};
        ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
        if (!shakesHands) return;
        context_ = SSL_CTX_new(TLS_client_method());
        ssl_ = SSL_new(context_);
        SSL_set_fd(ssl_, socket_);
        SSL_connect(ssl_);
    }
    ~TlsClient() {
        SSL_free(ssl_);
        SSL_CTX_free(context_);
        ::close(socket_);
    }
    TlsClient(const TlsClient&) = delete;
    TlsClient& operator=(const TlsClient&) = delete;

    bool send(const std::string& bytes) {
        return bytes.empty() || SSL_write(ssl_, bytes.data(), static_cast<int>(bytes.size())) > 0;
    }

    /** All that comes until the other side closes, or `enough` bytes. */
    std::string read(std::size_t enough = std::string::npos) {
        std::string all;
        char bytes[16384];
        while (all.size() < enough) {
            const int count = SSL_read(ssl_, bytes, static_cast<int>(std::min(sizeof bytes, enough - all.size())));
            if (count <= 0) break;
            all.append(bytes, static_cast<std::size_t>(count));
        }
        return all;
    }

    /** A head, up to its empty line. */
    std::string readHead() {
        std::string head;
        while (head.size() < 20000 && head.find("\r\n\r\n") == std::string::npos) {
            const std::string one = read(1);
            if (one.empty()) break;
            head += one;
        }
        return head;
    }

    /** True when the other side closes the plain connection within the time. */
    bool isClosedWithin(double seconds) {
        pollfd one{socket_, POLLIN, 0};
        if (::poll(&one, 1, static_cast<int>(1000 * seconds)) <= 0) return false;
        char byte;
        return ::recv(socket_, &byte, 1, MSG_PEEK) <= 0;
    }

private:
    int socket_ = -1;
    SSL_CTX* context_ = nullptr;
    SSL* ssl_ = nullptr;
};

/** A frame of a WebSocket's client, masked with zeros. @param first  FIN, reserved bits and opcode */
inline std::string makeFrame(unsigned char first, const std::string& payload, bool isMasked = true) {
    std::string frame(1, static_cast<char>(first));
    const unsigned char mask = isMasked ? 0x80 : 0;
    if (payload.size() < 126) {
        frame += static_cast<char>(mask | payload.size());
    } else {
        const bool isLong = payload.size() > 65535;
        frame += static_cast<char>(mask | (isLong ? 127 : 126));
        for (int shift = isLong ? 56 : 8; shift >= 0; shift -= 8)
            frame += static_cast<char>(payload.size() >> shift & 0xff);
    }
    if (isMasked) frame += std::string(4, '\0');
    return frame + payload;
}

struct ServerFrame {
    int opcode = -1;  ///< -1: the connection ended
    std::string payload;
    int closeCode() const {
        if (opcode != 8 || payload.size() < 2) return -1;
        return static_cast<unsigned char>(payload[0]) << 8 | static_cast<unsigned char>(payload[1]);
    }
};

inline ServerFrame readFrame(TlsClient& client) {
    const std::string head = client.read(2);
    if (head.size() < 2) return {};
    std::uint64_t size = static_cast<unsigned char>(head[1]) & 0x7f;
    if (size >= 126) {
        const std::string length = client.read(size == 126 ? 2 : 8);
        size = 0;
        for (const char byte : length) size = size << 8 | static_cast<unsigned char>(byte);
    }
    return {head[0] & 0x0f, client.read(size)};
}

}  // namespace viable::test
