#include "page/PageServer.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <cctype>
#include <charconv>
#include <cstring>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "core/Text.h"
#include "page/WebSocket.h"

namespace viable {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::system::error_code;
using nlohmann::json;

constexpr char kProtocol[] = "viable.1", kWatch[] = "/watch/";
constexpr std::size_t kTokenBytes = 32, kMaxInvitations = 16, kMaxSessions = 64;
constexpr std::size_t kMaxOfOneViewer = 2, kMaxOfViewers = 64;  // invitations
constexpr std::size_t kMaxTexts = 64;                           // that wait for one viewer
constexpr int kSendBuffer = 65536;                              // what the system keeps for a slow reader

using Acceptor = asio::basic_socket_acceptor<Tcp, asio::io_context::executor_type>;

/** A random word of 256 bits in letters that stand in addresses and headers. */
std::string makeRandomText() {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    unsigned char bytes[kTokenBytes];
    if (RAND_bytes(bytes, sizeof bytes) != 1) throw badInput("--page", "the system gives no random numbers", "");
    std::string secret;
    unsigned bits = 0, have = 0;
    for (const unsigned char byte : bytes) {
        bits = bits << 8 | byte;
        for (have += 8; have >= 6; have -= 6) secret += letters[bits >> (have - 6) & 63];
    }
    return secret + letters[bits << (6 - have) & 63];
}

struct Token {
    std::string text;
    std::string owner;  ///< of an invitation: the session of the viewer that asked for it; empty: the program
};

/** In a time that tells nothing but the length. */
bool isSame(const std::string& secret, std::string_view wanted) {
    return secret.size() == wanted.size() && CRYPTO_memcmp(secret.data(), wanted.data(), wanted.size()) == 0;
}

/** Looks at all of them, in a time that tells nothing. */
bool contains(const std::deque<Token>& secrets, std::string_view wanted, std::size_t& index) {
    bool isFound = false;
    for (std::size_t i = 0; i < secrets.size(); ++i) {
        if (!isSame(secrets[i].text, wanted)) continue;
        isFound = true;
        index = i;
    }
    return isFound;
}

std::string inUrl(const std::string& host) {
    return host.find(':') == std::string::npos ? host : "[" + host + "]";
}

double readDouble(const char* bytes) {
    double value = 0.0;
    std::memcpy(&value, bytes, sizeof value);
    return value;
}

/** Throws Error. */
void listen(Acceptor& acceptor, const PageOptions& options) {
    try {
        const Tcp::endpoint endpoint(asio::ip::make_address(options.address), options.port);
        acceptor.open(endpoint.protocol());
        acceptor.set_option(Tcp::acceptor::reuse_address(true));
        acceptor.bind(endpoint);
        acceptor.listen(PageServer::kMaxConnections);
    } catch (const boost::system::system_error& e) {
        throw badInput("--page " + inUrl(options.address) + ":" + std::to_string(options.port),
                       "the page cannot be opened there: " + e.code().message(),
                       e.code() == boost::system::errc::address_not_available ||
                               e.code() == boost::system::errc::address_family_not_supported ||
                               e.code() == boost::system::errc::invalid_argument
                           ? "Name an address of this computer (not fe80:...), or 0.0.0.0 for all of them."
                           : "Name another port, or port 0 for a free one.");
    }
}

}  // namespace

void readAddress(const std::string& text, PageOptions& options) {
    if (text.empty()) return;
    std::string host, port;
    unsigned char bytes[16];
    bool isWhole = true;
    if (text.front() == '[') {
        const std::size_t end = std::min(text.find(']'), text.size());
        host = text.substr(1, end - 1);
        const std::string rest = text.substr(std::min(end + 1, text.size()));
        isWhole = end < text.size() && ::inet_pton(AF_INET6, host.c_str(), bytes) == 1 &&
                  (rest.empty() || (rest.size() > 1 && rest.front() == ':'));
        if (!rest.empty()) port = rest.substr(1);
    } else if (::inet_pton(AF_INET6, text.c_str(), bytes) == 1) {
        host = text;
    } else if (const std::size_t colon = text.rfind(':'); colon != std::string::npos) {
        host = text.substr(0, colon);
        port = text.substr(colon + 1);
    } else if (text.find_first_not_of("0123456789") == std::string::npos) {
        port = text;
    } else {
        host = text;
    }
    const bool isHost = host.empty() || ::inet_pton(AF_INET, host.c_str(), bytes) == 1 ||
                        ::inet_pton(AF_INET6, host.c_str(), bytes) == 1;
    unsigned number = options.port;
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), number);
    const bool isPort = port.empty() || (error == std::errc() && end == port.data() + port.size() && number < 65536);
    if (!isWhole || !isHost || !isPort || (host.empty() && port.empty()))
        throw badInput(
            "--page", "'" + makePrintable(text) + "' is no address and port",
            "Write 127.0.0.1:8484 (this computer alone), 0.0.0.0:8484 (all networks), [::1]:8484 or a port.");
    if (!host.empty()) options.address = host;
    options.port = static_cast<unsigned short>(number);
}

void requireAddress(const PageOptions& options) {
    asio::io_context io;
    Acceptor acceptor(io);
    listen(acceptor, options);
}

std::vector<std::string> listHosts(const std::string& address) {
    if (address == "127.0.0.1" || address == "::1") return {address, "localhost"};
    if (address != "0.0.0.0" && address != "::") return {address};
    std::vector<std::string> hosts, six, own;
    ifaddrs* all = nullptr;
    if (::getifaddrs(&all) == 0) {
        for (const ifaddrs* one = all; one; one = one->ifa_next) {
            if (!one->ifa_addr || (one->ifa_flags & IFF_UP) == 0) continue;
            char text[INET6_ADDRSTRLEN] = "";
            if (one->ifa_addr->sa_family == AF_INET) {
                ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(one->ifa_addr)->sin_addr, text, sizeof text);
                (std::strncmp(text, "127.", 4) == 0 ? own : hosts).emplace_back(text);
            } else if (one->ifa_addr->sa_family == AF_INET6 && address == "::") {
                const in6_addr& number = reinterpret_cast<const sockaddr_in6*>(one->ifa_addr)->sin6_addr;
                if (IN6_IS_ADDR_LINKLOCAL(&number)) continue;  // no browser calls it: it needs the name of an interface
                ::inet_ntop(AF_INET6, &number, text, sizeof text);
                (IN6_IS_ADDR_LOOPBACK(&number) ? own : six).emplace_back(text);
            }
        }
        ::freeifaddrs(all);
    }
    hosts.insert(hosts.end(), six.begin(), six.end());
    hosts.insert(hosts.end(), own.begin(), own.end());
    char name[256] = "";
    if (::gethostname(name, sizeof name - 1) == 0 && *name != 0) {
        std::string lower = name;
        std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
        hosts.push_back(lower);
        hosts.push_back(lower + ".local");
    }
    hosts.emplace_back("localhost");
    return hosts;
}

bool readHand(const std::string& bytes, int joints, HandMessage& hand, double& echo_s) {
    constexpr std::size_t kNumbers = 10;
    if (bytes.size() != 8 + 8 * (kNumbers + static_cast<std::size_t>(joints))) return false;
    const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
    if (byte(0) != 1 || byte(1) > 3 || byte(2) > 2 || byte(3) != joints) return false;
    std::uint32_t press = 0;
    std::memcpy(&press, bytes.data() + 4, sizeof press);
    const bool isPressed = (byte(1) & 1) != 0;
    if (isPressed && press == 0) return false;
    const auto number = [&](std::size_t i) { return readDouble(bytes.data() + 8 + 8 * i); };
    hand.engagement = isPressed ? press : 0;
    hand.isTracked = (byte(1) & 2) != 0;
    hand.part = static_cast<HandMessage::Part>(byte(2));
    hand.sent_s = number(0);
    echo_s = number(1);
    hand.scale = number(2);
    hand.hand.position = {number(3), number(4), number(5)};
    hand.hand.orientation = Eigen::Quaterniond(number(6), number(7), number(8), number(9));
    hand.joints.resize(joints);
    for (int i = 0; i < joints; ++i) hand.joints[i] = number(kNumbers + static_cast<std::size_t>(i));
    return true;
}

class PageServer::Impl {
public:
    Impl(PageServer& server, PageOptions options, std::shared_ptr<TeleoperationFeed> hand,
         std::function<void(PageWish)> request);
    ~Impl();

    void run();
    /** Lets run() send close frames, and end within kClosing_s. */
    void stop();
    std::string makeAddress(const std::string& owner = {});

private:
    friend class PageServer;
    using Text = std::shared_ptr<const std::string>;
    class Connection;
    class Viewer;
    class Watcher;

    template <class Run>
    void serve(const Run& run);
    void accept();
    void sendClose();
    void sendFrame(const Text& frame);
    void sendText(const Text& text);
    bool admit(std::string_view secret, std::string& session, Token& invitation);
    void restoreToken(Token invitation, const std::string& session);
    void addPolicy();
    void add(Viewer& viewer);
    void remove(Viewer& viewer);
    void take(Viewer& viewer, bool isTakeOver);
    bool endLease(const Viewer& viewer);
    void tellOfLeaving(bool operated);
    void endRecord();
    void tellPeople();
    void onText(Viewer& viewer, const std::string& word);
    void onBinary(Viewer& viewer, const std::string& bytes);
    void releaseHand();

    PageServer& server_;
    const PageOptions options_;
    const std::shared_ptr<TeleoperationFeed> hand_;
    const std::function<void(PageWish)> request_;
    asio::ssl::context tls_{asio::ssl::context::tls_server};
    unsigned short port_ = 0;
    std::vector<std::string> authorities_, origins_, publicAuthorities_;
    std::string page_, policy_;
    const std::string watchSecret_ = makeRandomText();

    std::set<Connection*> connections_;  // before a WebSocket
    std::set<Viewer*> sockets_;          // all
    std::set<Viewer*> viewers_;          // those that were greeted and have not left
    std::set<Watcher*> watchers_;
    Viewer* operator_ = nullptr;
    bool isRecording_ = false;
    std::uint64_t lease_ = 0;
    std::map<std::string, Text> known_;
    int lastViewer_ = 0;
    std::mutex secrets_;  // makeAddress() may be called by any thread
    std::deque<Token> invitations_, sessions_;

    // Its handlers own connections, also those that it drops in the end: these look at the members above.
    asio::io_context io_{1};
    Acceptor acceptor_{io_};
    asio::steady_timer retry_{io_};
};

/** A connection that has its WebSocket. */
class PageServer::Impl::Viewer : public std::enable_shared_from_this<Viewer> {
public:
    /** @param invitation  that it came by: used up when it is in, else given back; without a text: none */
    Viewer(Impl& owner, TlsStream&& stream, std::string session, Token invitation)
        : owner_(owner),
          socket_(std::make_shared<WebSocket>(std::move(stream))),
          session_(std::move(session)),
          invitation_(std::move(invitation)),
          alive_(owner.io_) {
        owner_.sockets_.insert(this);
        ++owner_.server_.counts_.connections;
    }
    ~Viewer() {
        owner_.sockets_.erase(this);
        try {
            owner_.remove(*this);
            if (!invitation_.text.empty()) owner_.restoreToken(std::move(invitation_), session_);
        } catch (const std::exception&) {  // no memory to tell the others
        }
        --owner_.server_.counts_.connections;
    }

    int id = 0;

    void begin(const WebSocket::Request& request) {
        // A goodbye counts at once.
        socket_->onClose([this] { end(); });
        socket_->accept(request, kProtocol, [self = shared_from_this()](error_code error) {
            if (error) return;
            self->invitation_ = {};
            self->owner_.add(*self);
            self->isOpen_ = true;
            self->expectLife();
            self->sendText(std::make_shared<const std::string>(self->makeGreeting()));
            for (const auto& [kind, text] : self->owner_.known_) self->sendText(text);
            self->owner_.tellPeople();
            self->read();
        });
    }

    void sendText(const Text& text) {
        if (!isOpen_ || isFinishing_) return;
        if (texts_.size() >= kMaxTexts) return close();
        texts_.push_back(text);
        write();
    }

    void sendFrame(const Text& frame) {
        if (!isOpen_ || isFinishing_) return;
        if (frame_) ++owner_.server_.counts_.lostFrames;
        frame_ = frame;
        write();
    }

    /** Sends what waits, and a close frame: for how long is the owner's to say. */
    void finish() {
        if (!isOpen_) return close();
        isFinishing_ = true;
        write();
    }

    /** Without a word to a viewer that may not listen. */
    void close() {
        socket_->close();
        disarm(alive_);
    }

    void end() {
        disarm(alive_);
        if (!std::exchange(isOpen_, false)) return;
        try {
            owner_.remove(*this);
        } catch (const std::exception&) {  // of the program, or no memory to tell the others: it is gone all the same
            ++owner_.server_.counts_.refusedRequests;
        }
    }

    /** See WebSocket. */
    void abandon() { socket_->abandon(); }

    const std::string& session() const { return session_; }

private:
    std::string makeGreeting() const { return json{{"hello", 1}, {"you", id}, {"session", session_}}.dump(); }

    void read() {
        socket_->read([self = shared_from_this()](error_code error, const std::string& bytes, bool isText) {
            if (error || !self->isOpen_) return self->end();
            self->expectLife();
            try {
                if (isText)
                    self->owner_.onText(*self, bytes);
                else
                    self->owner_.onBinary(*self, bytes);
            } catch (const std::exception&) {  // whoever is not heard any more must not stay the operator
                ++self->owner_.server_.counts_.refusedMessages;
                self->end();
                return self->close();
            }
            self->read();
        });
    }

    /** A whole message is expected in a while: pings alone, or a message that never ends, are no life. */
    void expectLife() { closeAfter(WebSocket::kAlive_s, alive_, weak_from_this()); }

    void write() {
        if (socket_->isWriting() || !isOpen_) return;
        const bool isText = !texts_.empty();
        if (!isText && !frame_) {
            if (isFinishing_) sendClose();
            return;
        }
        if (isText) {
            now_ = texts_.front();
            texts_.pop_front();
        } else {
            now_ = std::exchange(frame_, nullptr);
        }
        socket_->write(*now_, isText, [self = shared_from_this()](error_code error) {
            if (error) return self->end();
            self->write();
        });
    }

    void sendClose() {
        end();
        socket_->sendClose([self = shared_from_this()] { self->close(); });
    }

    Impl& owner_;
    const std::shared_ptr<WebSocket> socket_;
    const std::string session_;
    Token invitation_;
    asio::steady_timer alive_;
    std::deque<Text> texts_;
    Text frame_, now_;
    bool isOpen_ = false, isFinishing_ = false;
};

/** A connection of a watcher's own program. */
class PageServer::Impl::Watcher : public std::enable_shared_from_this<Watcher> {
public:
    Watcher(Impl& owner, TlsStream&& stream)
        : owner_(owner), socket_(std::make_shared<WebSocket>(std::move(stream))), client_(*owner.options_.channels) {
        owner_.watchers_.insert(this);
        ++owner_.server_.counts_.connections;
        ++owner_.server_.counts_.watchers;
    }
    ~Watcher() {
        owner_.watchers_.erase(this);
        --owner_.server_.counts_.connections;
        --owner_.server_.counts_.watchers;
    }

    void begin(const WebSocket::Request& request, const std::string& protocol) {
        socket_->accept(request, protocol, [self = shared_from_this()](error_code error) {
            if (error) return;
            self->isOpen_ = true;
            self->send(self->owner_.options_.channels->serverInfo());
            self->send(self->owner_.options_.channels->advertisement());
            self->read();
        });
    }

    void show(const TickRecord& record) {
        if (!isOpen_ || !client_.isListening()) return;
        if (!messages_.empty() || isWritingMessage_) {
            ++owner_.server_.counts_.lostFrames;
            return;
        }
        try {
            auto made = client_.makeMessages(record);
            messages_.assign(std::make_move_iterator(made.begin()), std::make_move_iterator(made.end()));
            write();
        } catch (const std::exception&) {  // no memory
            close();
        }
    }

    void close() {
        isOpen_ = false;
        socket_->close();
    }

    /** See WebSocket. */
    void abandon() { socket_->abandon(); }

private:
    void read() {
        socket_->read([self = shared_from_this()](error_code error, const std::string& bytes, bool isText) {
            if (error) return self->end();
            std::string answer = R"({"op": "status", "level": 2, "message": "nothing is taken here"})";
            try {
                if (!isText || !self->client_.onText(bytes, answer)) {
                    ++self->owner_.server_.counts_.refusedMessages;
                    self->send(answer);
                }
            } catch (const std::exception&) {  // no memory
                return self->close();
            }
            self->read();
        });
    }

    void send(const std::string& text) {
        if (texts_.size() >= kMaxTexts) return close();
        texts_.push_back(text);
        write();
    }

    void write() {
        if (socket_->isWriting() || !isOpen_ || (texts_.empty() && messages_.empty())) return;
        const bool isMessage = texts_.empty();
        std::deque<std::string>& queue = isMessage ? messages_ : texts_;
        now_ = std::move(queue.front());
        queue.pop_front();
        socket_->write(now_, !isMessage, [self = shared_from_this()](error_code error) {
            self->isWritingMessage_ = false;
            if (error) return self->end();
            self->write();
        });
        isWritingMessage_ = isMessage;
    }

    void end() { isOpen_ = false; }

    Impl& owner_;
    const std::shared_ptr<WebSocket> socket_;
    FoxgloveClient client_;
    std::deque<std::string> texts_, messages_;
    std::string now_;
    bool isOpen_ = false, isWritingMessage_ = false;
};

/** A connection until its request is answered, or becomes a viewer's. */
class PageServer::Impl::Connection : public std::enable_shared_from_this<Connection> {
public:
    Connection(Impl& owner, TcpSocket&& socket, const asio::ip::address& from)
        : address(from), owner_(owner), stream_(std::move(socket), owner.tls_), patience_(owner.io_) {
        owner_.connections_.insert(this);
        ++owner_.server_.counts_.connections;
        parser_.header_limit(kMaxHeader);
        parser_.body_limit(std::uint64_t{0});
    }
    ~Connection() {
        owner_.connections_.erase(this);
        --owner_.server_.counts_.connections;
    }

    const asio::ip::address address;

    void begin() {
        closeAfter(WebSocket::kHandshake_s, patience_, weak_from_this());  // for all until the answer
        stream_.async_handshake(asio::ssl::stream_base::server, [self = shared_from_this()](error_code error) {
            if (error)
                ++self->owner_.server_.counts_.refusedRequests;
            else
                self->read();
        });
    }

    void close() {
        error_code ignored;
        beast::get_lowest_layer(stream_).close(ignored);
    }

private:
    void read() {
        http::async_read(stream_, buffer_, parser_, [self = shared_from_this()](error_code error, std::size_t) {
            if (error == http::error::header_limit || error == http::error::buffer_overflow)
                return self->answer(http::status::request_header_fields_too_large);
            if (error == http::error::body_limit) return self->answer(http::status::payload_too_large);
            if (error && error.category() == http::make_error_code(http::error::bad_method).category() &&
                error != http::error::end_of_stream && error != http::error::partial_message)
                return self->answer(http::status::bad_request);
            if (error) {
                ++self->owner_.server_.counts_.refusedRequests;
                return;
            }
            self->authorise();
        });
    }

    /** The only value of a field; empty: none, or several. */
    std::string only(http::field field) const {
        const auto [begin, end] = parser_.get().equal_range(field);
        if (begin == end || std::next(begin) != end) return {};
        return std::string(begin->value());
    }

    static bool isOneOf(const std::vector<std::string>& all, const std::string& value) {
        return std::find(all.begin(), all.end(), value) != all.end();
    }

    void authorise() {
        const auto& request = parser_.get();
        if (!isOneOf(owner_.authorities_, only(http::field::host))) return answer(http::status::forbidden);
        if (owner_.options_.channels && request.target().starts_with(kWatch)) return authoriseWatcher();
        const bool isLive = request.target() == "/live";
        const bool hasOrigin = request.count(http::field::origin) > 0;
        if ((isLive || hasOrigin) && !isOneOf(owner_.origins_, only(http::field::origin)))
            return answer(http::status::forbidden);
        if (!isLive && request.target() != "/") return answer(http::status::not_found);
        if (request.method() != http::verb::get) return answer(http::status::method_not_allowed);
        if (!isLive) return answer(http::status::ok);
        if (!websocket::is_upgrade(request) || only(http::field::sec_websocket_version) != "13")
            return answer(http::status::upgrade_required);
        // The browser sends the token where it would name a protocol: "viable.1, TOKEN".
        const std::string protocols = only(http::field::sec_websocket_protocol);
        const std::string prefix = std::string(kProtocol) + ", ";
        if (owner_.sockets_.size() >= kMaxConnections) return answer(http::status::service_unavailable);
        std::string session;
        Token invitation;
        if (protocols.rfind(prefix, 0) != 0 ||
            !owner_.admit(std::string_view(protocols).substr(prefix.size()), session, invitation))
            return answer(http::status::unauthorized);
        std::make_shared<Viewer>(owner_, std::move(stream_), std::move(session), std::move(invitation))->begin(request);
    }

    /** Anyone who knows the secret, from anywhere: see the class. */
    void authoriseWatcher() {
        const auto& request = parser_.get();
        const std::string_view target(request.target().data(), request.target().size());
        if (!isSame(owner_.watchSecret_, target.substr(sizeof kWatch - 1))) return answer(http::status::unauthorized);
        if (owner_.watchers_.size() >= kMaxWatchers) return answer(http::status::service_unavailable);
        if (request.method() != http::verb::get) return answer(http::status::method_not_allowed);
        if (!websocket::is_upgrade(request) || only(http::field::sec_websocket_version) != "13")
            return answer(http::status::upgrade_required);
        const std::string protocol = FoxgloveChannels::choose(only(http::field::sec_websocket_protocol));
        if (protocol.empty()) return answer(http::status::bad_request);
        std::make_shared<Watcher>(owner_, std::move(stream_))->begin(request, protocol);
    }

    void answer(http::status status) {
        response_.version(11);
        response_.result(status);
        response_.set(http::field::server, "viable");
        response_.set(http::field::cache_control, "no-store");
        response_.set("X-Content-Type-Options", "nosniff");
        response_.set("Referrer-Policy", "no-referrer");
        response_.set("Cross-Origin-Opener-Policy", "same-origin");
        response_.set("Cross-Origin-Resource-Policy", "same-origin");
        if (status == http::status::ok) {
            response_.set(http::field::content_type, "text/html; charset=utf-8");
            response_.set("Content-Security-Policy", owner_.policy_);
            response_.body() = {owner_.page_.data(), owner_.page_.size()};
            closeAfter(WebSocket::kAlive_s, patience_, weak_from_this());
        } else {
            ++owner_.server_.counts_.refusedRequests;
            response_.set(http::field::content_type, "text/plain; charset=utf-8");
            text_ = std::string(http::obsolete_reason(status)) + "\n";
            response_.body() = {text_.data(), text_.size()};
        }
        if (status == http::status::upgrade_required) response_.set(http::field::upgrade, "websocket");
        if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET");
        response_.keep_alive(false);
        response_.prepare_payload();
        http::async_write(stream_, response_, [self = shared_from_this()](error_code error, std::size_t) {
            if (error) return;
            self->stream_.async_shutdown([self](error_code) {});
        });
    }

    Impl& owner_;
    TlsStream stream_;
    asio::steady_timer patience_;
    beast::flat_buffer buffer_{kMaxHeader + 1024};
    http::request_parser<http::string_body> parser_;
    std::string text_;
    http::response<http::span_body<const char>> response_;  // of the one page, or of text_
};

PageServer::Impl::Impl(PageServer& server, PageOptions options, std::shared_ptr<TeleoperationFeed> hand,
                       std::function<void(PageWish)> request)
    : server_(server), options_(std::move(options)), hand_(std::move(hand)), request_(std::move(request)) {
    tls_.set_options(asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 |
                     asio::ssl::context::no_tlsv1_1 | asio::ssl::context::no_compression);
    const Certificate& own = options_.certificate;
    tls_.use_certificate_chain(asio::buffer(own.certificate));
    tls_.use_private_key(asio::buffer(own.key), asio::ssl::context::pem);
    listen(acceptor_, options_);
    port_ = acceptor_.local_endpoint().port();
    const std::vector<std::string> hosts = listHosts(options_.address);
    for (const std::string& host : hosts) {
        authorities_.push_back(inUrl(host) + ":" + std::to_string(port_));
        error_code noAddress;
        const auto number = asio::ip::make_address(host, noAddress);
        if (!noAddress && !number.is_loopback()) publicAuthorities_.push_back(authorities_.back());
        if (port_ == 443) authorities_.push_back(inUrl(host));
    }
    if (publicAuthorities_.empty()) publicAuthorities_.push_back(authorities_.front());
    for (const std::string& authority : authorities_) origins_.push_back("https://" + authority);
    addPolicy();
    accept();
}

/** The page as it is served, and the policy that stands in it, too, in a header: with the addresses of its WebSocket, which not all
browsers take for the page's own. */
void PageServer::Impl::addPolicy() {
    constexpr char kConnect[] = "connect-src 'self'", kBegin[] = "http-equiv=\"Content-Security-Policy\" content=\"";
    page_ = options_.page;
    if (const std::size_t at = page_.find(kConnect); at != std::string::npos) {
        std::string sockets;
        for (const std::string& authority : authorities_)
            if (authority.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789.:-") == std::string::npos)
                sockets += " wss://" + authority;  // there is no way to write an IPv6 address
        page_.insert(at + std::strlen(kConnect), sockets);
    }
    policy_ = "frame-ancestors 'none'";
    const std::size_t begin = page_.find(kBegin);
    if (begin == std::string::npos) return;
    const std::size_t from = begin + std::strlen(kBegin);
    policy_ = page_.substr(from, page_.find('"', from) - from) + "; " + policy_;
}

PageServer::Impl::~Impl() {
    const auto abandon = [](auto& all) {
        while (!all.empty()) {
            const auto one = (*all.begin())->shared_from_this();
            all.erase(all.begin());
            one->abandon();
        }
    };
    abandon(sockets_);
    abandon(watchers_);
}

/** @param run  handlers of the context */
template <class Run>
void PageServer::Impl::serve(const Run& run) {
    for (;;) {
        try {
            return run();
        } catch (const std::exception&) {  // of one connection, which has ended with it
            ++server_.counts_.refusedRequests;
        }
    }
}

void PageServer::Impl::run() {
    serve([this] { io_.run(); });
    const auto end = std::chrono::steady_clock::now() + toMilliseconds(kClosing_s);
    io_.restart();
    serve([&] { io_.run_until(end); });  // or until all are gone
    for (Viewer* viewer : sockets_) viewer->end();
}

void PageServer::Impl::stop() {
    asio::post(io_, [this] {  // behind what is to be told before
        io_.stop();           // first: what comes next may run out of memory
        sendClose();
    });
}

void PageServer::Impl::sendClose() {
    error_code ignored;
    acceptor_.close(ignored);
    retry_.cancel();
    for (Connection* connection : std::set(connections_)) connection->close();
    for (Watcher* watcher : std::set(watchers_)) watcher->close();
    for (Viewer* viewer : std::set(sockets_)) viewer->finish();
}

void PageServer::Impl::accept() {
    acceptor_.async_accept([this](error_code error, TcpSocket socket) {
        if (error == asio::error::operation_aborted || !acceptor_.is_open()) return;
        if (error) {  // no descriptors left: later perhaps
            retry_.expires_after(std::chrono::milliseconds(100));
            retry_.async_wait([this](error_code stopped) {
                if (!stopped) accept();
            });
            return;
        }
        try {
            const asio::ip::address address = socket.remote_endpoint(error).address();
            const auto fromThere = std::count_if(connections_.begin(), connections_.end(),
                                                 [&](const Connection* one) { return one->address == address; });
            if (error || connections_.size() >= kMaxStrangers || fromThere >= kMaxPerAddress) {
                ++server_.counts_.refusedRequests;  // closed at once: an answer would need a handshake
            } else {
                socket.set_option(Tcp::no_delay(true), error);
                socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer), error);
                std::make_shared<Connection>(*this, std::move(socket), address)->begin();
            }
        } catch (const std::exception&) {  // there is no memory for one more: others are heard all the same
            ++server_.counts_.refusedRequests;
        }
        accept();
    });
}

/** @param owner  session of the viewer that asks; empty: the program, whose invitations no viewer replaces */
std::string PageServer::Impl::makeAddress(const std::string& owner) {
    std::string secret = makeRandomText();
    const std::string address = "https://" + publicAuthorities_.front() + "/#" + secret;
    const auto dropOldest = [this](std::size_t most, const auto& counts) {
        if (static_cast<std::size_t>(std::count_if(invitations_.begin(), invitations_.end(), counts)) > most)
            invitations_.erase(std::find_if(invitations_.begin(), invitations_.end(), counts));
    };
    const std::lock_guard lock(secrets_);
    invitations_.push_back({std::move(secret), owner});
    dropOldest(owner.empty() ? kMaxInvitations : kMaxOfOneViewer, [&](const Token& one) { return one.owner == owner; });
    dropOldest(kMaxOfViewers, [](const Token& one) { return !one.owner.empty(); });
    return address;
}

/** @param invitation  that was used; it counts no more until it is given back */
bool PageServer::Impl::admit(std::string_view secret, std::string& session, Token& invitation) {
    const std::lock_guard lock(secrets_);
    std::size_t index = 0;
    if (contains(sessions_, secret, index)) {
        session = sessions_[index].text;
        return true;
    }
    if (!contains(invitations_, secret, index)) return false;
    session = makeRandomText();
    sessions_.push_back({session, {}});
    if (sessions_.size() > kMaxSessions) sessions_.pop_front();
    invitation = std::move(invitations_[index]);
    invitations_.erase(invitations_.begin() + static_cast<std::ptrdiff_t>(index));
    return true;
}

/** Whoever came by it did not get in. */
void PageServer::Impl::restoreToken(Token invitation, const std::string& session) {
    const std::lock_guard lock(secrets_);
    sessions_.erase(
        std::remove_if(sessions_.begin(), sessions_.end(), [&](const Token& one) { return one.text == session; }),
        sessions_.end());
    invitations_.push_front(std::move(invitation));
}

void PageServer::Impl::sendFrame(const Text& frame) {
    for (Viewer* viewer : std::set(viewers_)) viewer->sendFrame(frame);
}

void PageServer::Impl::sendText(const Text& text) {
    for (Viewer* viewer : std::set(viewers_)) viewer->sendText(text);
}

void PageServer::Impl::add(Viewer& viewer) {
    viewer.id = ++lastViewer_;
    viewers_.insert(&viewer);
    ++server_.counts_.viewers;
}

void PageServer::Impl::remove(Viewer& viewer) {
    if (viewers_.erase(&viewer) == 0) return;
    const bool operated = endLease(viewer);  // before it counts as gone
    --server_.counts_.viewers;
    tellOfLeaving(operated);
}

/** The newest message is what counts: the hand of an operator who is gone must not be that. */
void PageServer::Impl::releaseHand() {
    if (hand_) hand_->put({});
}

void PageServer::Impl::take(Viewer& viewer, bool isTakeOver) {
    if (!hand_ || operator_ == &viewer || (operator_ && !isTakeOver)) return;
    operator_ = &viewer;
    ++lease_;
    releaseHand();
    tellPeople();
    endRecord();
}

/** @return  it operated */
bool PageServer::Impl::endLease(const Viewer& viewer) {
    if (operator_ != &viewer) return false;
    operator_ = nullptr;
    releaseHand();
    return true;
}

/** All are told, before the program may throw. */
void PageServer::Impl::tellOfLeaving(bool operated) {
    tellPeople();
    if (operated) endRecord();
}

void PageServer::Impl::endRecord() {
    if (std::exchange(isRecording_, false)) request_(PageWish::EndRecord);
}

void PageServer::Impl::tellPeople() {
    json people = {{"people", viewers_.size()}, {"operator", nullptr}};
    if (operator_) people["operator"] = operator_->id;
    sendText(std::make_shared<const std::string>(people.dump()));
}

void PageServer::Impl::onText(Viewer& viewer, const std::string& word) {
    if (word == "alive") return;
    if (word == "pause") return request_(PageWish::Pause);
    if (word == "stop") return request_(PageWish::Stop);
    if (word == "take" || word == "take over") return take(viewer, word != "take");
    if (word == "leave") return tellOfLeaving(endLease(viewer));
    const bool mayOperate = operator_ == &viewer || !hand_;
    if (word == "start" && mayOperate) return request_(PageWish::Start);
    if (word == "record" && mayOperate) {
        isRecording_ = true;
        return request_(PageWish::Record);
    }
    if (word == "end record" && mayOperate) return endRecord();
    if (word == "invite")
        return viewer.sendText(
            std::make_shared<const std::string>(json{{"invitation", makeAddress(viewer.session())}}.dump()));
    if (word == "watch" && options_.channels)
        return viewer.sendText(std::make_shared<const std::string>(json{{"watch", server_.watchAddress()}}.dump()));
    if (!word.empty() && word.front() == '{' && options_.place && mayOperate && options_.place(word)) return;
    ++server_.counts_.refusedMessages;
}

void PageServer::Impl::onBinary(Viewer& viewer, const std::string& bytes) {
    HandMessage hand;
    double echo_s = 0.0;
    if (operator_ != &viewer || !readHand(bytes, options_.joints, hand, echo_s)) {
        ++server_.counts_.refusedMessages;
        return;
    }
    const double age_s = std::abs(hand_->now() - echo_s);
    if (!(age_s <= kOld_s) && hand.engagement != 0) {  // whoever sees the arm so late must not move it
        ++server_.counts_.lateHands;
        if (age_s <= kLate_s) return;
        hand.isTracked = false;
    }
    if (hand.engagement != 0) hand.engagement |= lease_ << 32;
    hand_->put(hand);
    ++server_.counts_.hands;
}

PageServer::PageServer(PageOptions options, std::shared_ptr<TeleoperationFeed> hand,
                       std::function<void(PageWish)> request)
    : impl_(std::make_unique<Impl>(*this, std::move(options), std::move(hand), std::move(request))) {
    sigset_t all, before;  // signals stay with the thread that waits for them
    sigfillset(&all);
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP}) sigdelset(&all, signal);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    thread_ = std::thread([this] { impl_->run(); });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

PageServer::~PageServer() {
    impl_->stop();
    thread_.join();
}

unsigned short PageServer::port() const {
    return impl_->port_;
}
std::string PageServer::makeAddress() {
    return impl_->makeAddress();
}
std::string PageServer::watchAddress() const {
    return impl_->options_.channels ? "wss://" + impl_->publicAuthorities_.front() + kWatch + impl_->watchSecret_ : "";
}
void PageServer::stream(const TickRecord& record) {
    if (counts_.watchers == 0) return;
    asio::post(impl_->io_, [impl = impl_.get(), shared = std::make_shared<const TickRecord>(record)] {
        for (Impl::Watcher* watcher : std::set(impl->watchers_)) watcher->show(*shared);
    });
}
const std::vector<std::string>& PageServer::publicAuthorities() const {
    return impl_->publicAuthorities_;
}
void PageServer::show(std::string frame) {
    asio::post(impl_->io_, [impl = impl_.get(), shared = std::make_shared<const std::string>(std::move(frame))] {
        impl->sendFrame(shared);
    });
}
void PageServer::broadcast(const std::string& kind, std::string message) {
    asio::post(impl_->io_,
               [impl = impl_.get(), kind, shared = std::make_shared<const std::string>(std::move(message))] {
                   impl->known_[kind] = shared;
                   impl->sendText(shared);
               });
}

}  // namespace viable
