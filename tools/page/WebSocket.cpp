#include "page/WebSocket.h"

#include <boost/asio/post.hpp>
#include <boost/beast/core/buffers_to_string.hpp>

namespace viable {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;

WebSocket::WebSocket(TlsStream&& stream)
    : stream_(std::make_unique<Stream>(std::move(stream))), patience_(stream_->get_executor()) {}

WebSocket::~WebSocket() {
    if (!stream_) return;
    close();
    // Its own last ping, which owns nothing, looks at it some turns longer: at most five.
    constexpr int kTurns = 10;
    try {
        boost::asio::post(stream_->get_executor(),
                          [stream = stream_.get()] { dropAfter(kTurns, std::unique_ptr<Stream>(stream)); });
    } catch (const std::exception&) {  // no memory: never, rather than too early
    }
    static_cast<void>(stream_.release());
}

void WebSocket::accept(const Request& request, const std::string& protocol, std::function<void(Error)> then) {
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = toMilliseconds(kHandshake_s);
    timeout.idle_timeout = toMilliseconds(kAlive_s);
    timeout.keep_alive_pings = true;
    stream_->set_option(timeout);
    stream_->set_option(websocket::stream_base::decorator([protocol](websocket::response_type& response) {
        response.set(http::field::server, "viable");
        response.set(http::field::sec_websocket_protocol, protocol);
    }));
    stream_->read_message_max(kMaxMessage);
    stream_->auto_fragment(false);
    stream_->async_accept(request, std::move(then));
}

void WebSocket::onClose(std::function<void()> heard) {
    stream_->control_callback([heard = std::move(heard)](websocket::frame_type kind, beast::string_view) {
        if (kind == websocket::frame_type::close) heard();
    });
}

void WebSocket::read(std::function<void(Error, const std::string&, bool)> then) {
    stream_->async_read(buffer_, [self = shared_from_this(), then = std::move(then)](Error error, std::size_t) {
        std::string bytes;
        if (!error) bytes = beast::buffers_to_string(self->buffer_.data());
        self->buffer_.consume(self->buffer_.size());
        then(error, bytes, self->stream_->got_text());
    });
}

void WebSocket::begin(const std::string& bytes, bool isText, std::function<void(Error)> then) {
    closeAfter(kWrite_s, patience_, weak_from_this());
    isWriting_ = true;
    stream_->text(isText);
    stream_->async_write(boost::asio::buffer(bytes),
                         [self = shared_from_this(), then = std::move(then)](Error error, std::size_t) {
                             self->isWriting_ = false;
                             disarm(self->patience_);
                             then(error);
                         });
}

void WebSocket::sendClose(std::function<void()> then) {
    stream_->async_close(websocket::close_code::going_away, [then = std::move(then)](Error) { then(); });
}

void WebSocket::close() {
    Error ignored;
    beast::get_lowest_layer(*stream_).close(ignored);
    disarm(patience_);
}

void WebSocket::dropAfter(int turns, std::unique_ptr<Stream> stream) {
    if (turns == 0) return;
    const auto executor = stream->get_executor();
    boost::asio::post(executor,
                      [turns, stream = std::move(stream)]() mutable { dropAfter(turns - 1, std::move(stream)); });
}

}  // namespace viable
