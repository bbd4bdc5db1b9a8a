#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>

namespace viable {

// The context's own executor instead of any, and no timeouts of the stream: half of the work for the compiler.
using Tcp = boost::asio::ip::tcp;
using TcpSocket = boost::asio::basic_stream_socket<Tcp, boost::asio::io_context::executor_type>;
using TlsStream = boost::beast::ssl_stream<TcpSocket>;

inline std::chrono::milliseconds toMilliseconds(double seconds) {
    return std::chrono::milliseconds(std::llround(1e3 * seconds));
}

/** Closes the owner of a timer in a while, unless it is set anew until then, or disarmed. */
template <class Owner>
void closeAfter(double duration_s, boost::asio::steady_timer& timer, std::weak_ptr<Owner> owner) {
    timer.expires_after(toMilliseconds(duration_s));
    timer.async_wait([&timer, owner = std::move(owner)](boost::system::error_code error) {
        const auto self = owner.lock();
        // It may have been set anew when this was on its way already.
        if (!error && self && timer.expiry() <= boost::asio::steady_timer::clock_type::now()) self->close();
    });
}
inline void disarm(boost::asio::steady_timer& timer) {
    timer.expires_at(boost::asio::steady_timer::time_point::max());
}

/** A WebSocket over TLS, the server's end: one reader and one writer at a time. What it is given to do afterwards may own it. Whoever
says nothing for kAlive_s, not even as an answer to a ping, or does not take a message within kWrite_s is cut off.
Each kind of operation exists once, with one type of what follows: for each other one the compiler takes ten seconds more.
Threads: that of the context. */
class WebSocket : public std::enable_shared_from_this<WebSocket> {
public:
    using Request = boost::beast::http::request<boost::beast::http::string_body>;
    using Error = boost::system::error_code;
    static constexpr std::size_t kMaxMessage = 65536;
    static constexpr double kHandshake_s = 2.0, kAlive_s = 10.0, kWrite_s = 5.0;

    explicit WebSocket(TlsStream&& stream);
    ~WebSocket();

    /** Answers a request for it. @param protocol  of the answer */
    void accept(const Request& request, const std::string& protocol, std::function<void(Error)> then);
    /** Called once the other side says goodbye; the rest of that may take as long as it likes. */
    void onClose(std::function<void()> heard);
    /** The next message: its bytes, and whether it is text. */
    void read(std::function<void(Error, const std::string&, bool)> then);
    /** Only while none is being written; where there is no memory to begin, it is closed.
    @param bytes  must live until it is done
    @param then   called with an Error */
    template <class Then>
    void write(const std::string& bytes, bool isText, Then&& then) {
        try {
            begin(bytes, isText, std::forward<Then>(then));
        } catch (...) {
            close();
            throw;
        }
    }
    bool isWriting() const { return isWriting_; }
    void sendClose(std::function<void()> then);
    /** Without a word to someone who may not listen: what goes on ends with an error. */
    void close();
    /** Drops what is under way, for good, once its context runs no more: reader and goodbye own themselves, and may wait for each other
    for ever (Boost 1.74) where half a message or a wrong one comes between. */
    void abandon() { stream_.reset(); }

private:
    using Stream = boost::beast::websocket::stream<TlsStream>;

    static void dropAfter(int turns, std::unique_ptr<Stream> stream);
    void begin(const std::string& bytes, bool isText, std::function<void(Error)> then);

    std::unique_ptr<Stream> stream_;  // null: abandoned
    boost::asio::steady_timer patience_;
    boost::beast::flat_buffer buffer_{kMaxMessage + 1024};
    bool isWriting_ = false;  // for ever, where there was no memory amid its beginning: Beast keeps its lock
};

}  // namespace viable
