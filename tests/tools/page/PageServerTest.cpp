#include "page/PageServer.h"
#include "page/WebSocket.h"

#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>

#include <boost/version.hpp>
#include <nlohmann/json.hpp>
#include <numeric>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "TlsClient.h"
#include "core/WholeFile.h"
#include "live/PlacedObstacles.h"

namespace viable::test {
namespace {

using nlohmann::json;

constexpr unsigned char kText = 0x81, kBinary = 0x82;

template <class Condition>
bool await(const Condition& condition, double timeout_s = 10.0) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
    while (!condition()) {
        if (std::chrono::steady_clock::now() > end) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return true;
}

const Certificate& certificate() {
    static const TemporaryFolder folder;
    static const Certificate own = readOrMakeCertificate(folder.path() / "keys", {"localhost", "127.0.0.1", "::1"});
    return own;
}

/** A server with a hand, and clients of it. */
struct PageServerTest : ::testing::Test {
    PageServerTest()
        : feed_(std::make_shared<TeleoperationFeed>()), server_(makeOptions(), feed_, [this](PageWish wish) {
              if (throws_) throw std::runtime_error("of the program");
              ++wishes_[static_cast<int>(wish)];
          }) {}

    PageOptions makeOptions() {
        PageOptions options;
        options.channels = channels_;
        options.place = [this](const std::string& message) {
            const bool isOne = PlacedObstacles::read(message).has_value();
            places_ += isOne ? 1 : 0;
            return isOne;
        };
        options.certificate = certificate();
        options.page = "<!doctype html><title>page</title>";
        return options;
    }

    std::string host() const { return "127.0.0.1:" + std::to_string(server_.port()); }
    std::string origin() const { return "https://" + host(); }
    std::string token() {
        const std::string address = server_.makeAddress();
        return address.substr(address.find('#') + 1);
    }

    int countWishes() const { return std::accumulate(wishes_.begin(), wishes_.end(), 0); }

    /** The status of the answer to a request; 0: none. */
    static int statusOf(const std::string& answer) {
        return answer.rfind("HTTP/1.1 ", 0) == 0 ? std::atoi(answer.c_str() + 9) : 0;
    }
    std::string ask(const std::string& request) {
        TlsClient client(server_.port());
        client.send(request);
        return client.read();
    }
    int statusFor(const std::string& request) { return statusOf(ask(request)); }
    std::string get(const std::string& target, const std::string& fields) {
        return "GET " + target + " HTTP/1.1\r\n" + fields + "\r\n";
    }
    std::string getSocket(const std::string& target, const std::string& protocol, const std::string& origin,
                          const std::string& host) {
        return get(target, "Host: " + host + "\r\n" + (origin.empty() ? "" : "Origin: " + origin + "\r\n") +
                               "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                               "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: " +
                               protocol + "\r\n");
    }
    std::string upgrade(const std::string& token, const std::string& origin, const std::string& host) {
        return getSocket("/live", "viable.1" + (token.empty() ? "" : ", " + token), origin, host);
    }
    /** The same of the head alone: a socket stays open behind it. */
    int statusOfHead(const std::string& request) {
        TlsClient client(server_.port());
        client.send(request);
        return statusOf(client.readHead());
    }
    int statusOfUpgrade(const std::string& token, const std::string& origin, const std::string& host) {
        return statusOfHead(upgrade(token, origin, host));
    }

    /** A viewer, after its greeting. */
    std::unique_ptr<TlsClient> join(json* greeting = nullptr) {
        auto client = std::make_unique<TlsClient>(server_.port());
        client->send(upgrade(token(), origin(), host()));
        EXPECT_EQ(statusOf(client->readHead()), 101);
        const ServerFrame hello = readFrame(*client);
        EXPECT_EQ(hello.opcode, 1);
        const json read = json::parse(hello.payload);
        EXPECT_EQ(read["hello"], 1);
        if (greeting) *greeting = read;
        EXPECT_EQ(readFrame(*client).opcode, 1);  // the people
        return client;
    }

    std::unique_ptr<PageServer> makeServer() {
        return std::make_unique<PageServer>(makeOptions(), feed_, [](PageWish) {});
    }
    /** Asks a server of its own to let a viewer in. */
    void knock(PageServer& server, TlsClient& client) {
        const std::string there = "127.0.0.1:" + std::to_string(server.port());
        const std::string address = server.makeAddress();
        client.send(upgrade(address.substr(address.find('#') + 1), "https://" + there, there));
    }
    /** The same; it is let in, and greeted. */
    void enter(PageServer& server, TlsClient& client, int greetings = 0) {
        knock(server, client);
        ASSERT_EQ(statusOf(client.readHead()), 101);
        for (; greetings > 0; --greetings) ASSERT_EQ(readFrame(client).opcode, 1);
    }

    /** [s] */
    static double calcSince(std::chrono::steady_clock::time_point begin) {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    }

    /** How long a server's end takes [s]. @param meanwhile  what the viewers do */
    static double timeEnd(
        std::unique_ptr<PageServer>& server, const std::function<void()>& meanwhile = [] {}) {
        const auto begin = std::chrono::steady_clock::now();
        std::thread end([&] { server.reset(); });
        meanwhile();
        end.join();
        return calcSince(begin);
    }

    /** What comes until the connection ends. */
    static int readCloseCode(TlsClient& client) {
        for (;;) {
            const ServerFrame frame = readFrame(client);
            if (frame.opcode == 8) return frame.closeCode();
            if (frame.opcode < 0) return -1;
        }
    }

    std::string makeHand(std::uint32_t press, double echo_s, double x = 0.0) const {
        std::string bytes = {1, static_cast<char>(press != 0 ? 3 : 2), 0, 0};
        bytes.append(reinterpret_cast<const char*>(&press), 4);
        const double numbers[] = {feed_->now(), echo_s, 1.0, x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
        bytes.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
        return bytes;
    }

    /** A row at 1.5 s of an arm with two joints. */
    static TickRecord makeRow() {
        TickRecord row;
        row.time_s = 1.5;
        row.nominal.q = row.nominal.qd = row.nominal.qdd = row.nominal.jerk = JointVector::Constant(2, 0.25);
        return row;
    }
    std::string secret() const {
        const std::string address = server_.watchAddress();
        return address.substr(address.rfind('/') + 1);
    }
    std::string watch(const std::string& secret, const std::string& protocol, const std::string& origin,
                      const std::string& host) {
        return getSocket("/watch/" + secret, protocol, origin, host);
    }
    int statusOfWatch(const std::string& secret, const std::string& protocol, const std::string& origin,
                      const std::string& host) {
        return statusOfHead(watch(secret, protocol, origin, host));
    }

    const std::shared_ptr<const FoxgloveChannels> channels_ = std::make_shared<const FoxgloveChannels>(
        LogLayout{
            {"one", "two"}, MotionCommand::Space::Joint, true, false, {LimitKind::Clearance, LimitKind::Speed}, true},
        "arm");
    std::atomic<int> places_{0};
    std::shared_ptr<TeleoperationFeed> feed_;
    std::array<std::atomic<int>, 5> wishes_{};  // by PageWish
    std::atomic<bool> throws_{false};
    PageServer server_;
};

TEST_F(PageServerTest, GivesThePageAndNothingElse) {
    const std::string answer = ask(get("/", "Host: " + host() + "\r\n"));
    EXPECT_EQ(statusOf(answer), 200);
    expectContains(answer, {"\r\n\r\n<!doctype html><title>page</title>",
                            "Content-Security-Policy: frame-ancestors 'none'\r\n", "X-Content-Type-Options: nosniff"});
    const std::string good = "Host: " + host() + "\r\n";
    for (const char* target : {"/index.html", "/../etc/passwd", "/live/", "/?a", "//", "*"})
        EXPECT_EQ(statusFor(get(target, good)), 404) << target;
    for (const char* method : {"POST", "HEAD", "PUT", "OPTIONS", "DELETE"})
        EXPECT_EQ(statusFor(std::string(method) + " / HTTP/1.1\r\n" + good + "\r\n"), 405) << method;
    EXPECT_EQ(statusFor("POST / HTTP/1.1\r\n" + good + "Content-Length: 5\r\n\r\nhello"), 413);
    EXPECT_EQ(statusFor("nonsense\r\n\r\n"), 400);
    EXPECT_EQ(statusFor("GET / HTTP/9.9\r\n\r\n"), 400);
    EXPECT_EQ(statusFor(get("/live", good + "Origin: " + origin() + "\r\n")), 426);
}

TEST_F(PageServerTest, ThePolicyOfThePageStandsInItsHeaderAndNamesItsSockets) {
    PageOptions options = makeOptions();
    options.page =
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; connect-src 'self'\"><title>page";
    PageServer server(options, feed_, [](PageWish) {});
    const std::string port = std::to_string(server.port());
    TlsClient client(server.port());
    client.send(get("/", "Host: 127.0.0.1:" + port + "\r\n"));
    const std::string answer = client.read();
    const std::string policy =
        "default-src 'none'; connect-src 'self' wss://127.0.0.1:" + port + " wss://localhost:" + port;
    expectContains(answer, {"\r\nContent-Security-Policy: " + policy + "; frame-ancestors 'none'\r\n",
                            "content=\"" + policy + "\"><title>page"});
}

TEST_F(PageServerTest, Fault65_OnlyTheOwnOriginGetsASocket) {
    const std::string port = std::to_string(server_.port());
    for (const std::string& wrong :
         std::vector<std::string>{"", "null", "https://localhost:" + port + ".evil.tld", "https://evil.tld",
                                  "http://" + host(), "https://127.0.0.1", origin() + ".evil.tld",
                                  "https://evil.tld/" + host(), origin() + "/", origin() + "\r\nOrigin: " + origin()})
        EXPECT_EQ(statusOfUpgrade(token(), wrong, host()), 403) << wrong;
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\nOrigin: https://evil.tld\r\n")), 403);
    EXPECT_EQ(statusOfUpgrade(token(), origin(), host()), 101);
    EXPECT_EQ(statusOfUpgrade(token(), "https://localhost:" + port, "localhost:" + port), 101);
}

TEST_F(PageServerTest, Fault66_OnlyTheOwnNameIsAnswered) {
    for (const std::string& wrong :
         {"evil.tld:" + std::to_string(server_.port()), std::string("evil.tld"), std::string("127.0.0.1"),
          "localhost." + host(), host() + "@evil.tld", std::string()}) {
        EXPECT_EQ(statusFor(get("/", "Host: " + wrong + "\r\n")), 403) << wrong;
        EXPECT_EQ(statusOfUpgrade(token(), origin(), wrong), 403) << wrong;
    }
    EXPECT_EQ(statusFor("GET / HTTP/1.1\r\n\r\n"), 403);
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\nHost: evil.tld\r\n")), 403);
    EXPECT_EQ(listHosts("127.0.0.1"), (std::vector<std::string>{"127.0.0.1", "localhost"}));
}

TEST_F(PageServerTest, Fault67_ATokenLetsOneBrowserInOnce) {
    EXPECT_EQ(statusOfUpgrade("", origin(), host()), 401);
    EXPECT_EQ(statusOfUpgrade("x", origin(), host()), 401);
    std::string almost = token();
    almost.back() = almost.back() == 'A' ? 'B' : 'A';
    EXPECT_EQ(statusOfUpgrade(almost, origin(), host()), 401);
    const std::string good = token();
    EXPECT_EQ(good.size(), 43u);
    EXPECT_EQ(statusOfUpgrade(good, origin(), host()), 101);
    EXPECT_EQ(statusOfUpgrade(good, origin(), host()), 401);
    EXPECT_NE(token(), token());

    json greeting;
    auto viewer = join(&greeting);
    viewer.reset();
    const std::string session = greeting["session"];
    EXPECT_EQ(statusOfUpgrade(session, origin(), host()), 101);
    EXPECT_EQ(statusOfUpgrade(session, origin(), host()), 101);  // until the program ends
    for (int k = 0; k < 17; ++k) (void)server_.makeAddress();
    EXPECT_EQ(statusOfUpgrade(token(), origin(), host()), 101);
}

TEST_F(PageServerTest, Fault68_WhatIsNoWebSocketIsClosedWithItsCode) {
    struct Wrong {
        const char* name;
        std::string bytes;
        int code;
    };
    std::string huge = makeFrame(kBinary, "").substr(0, 1) + static_cast<char>(0xff) + std::string(1, '\x7f') +
                       std::string(7, '\xff') + std::string(4, '\0');
    const Wrong all[] = {
        {"message of 64 kB and one byte", makeFrame(kBinary, std::string(65537, 'a')), 1009},
        {"length 2^63 - 1", huge, 1009},
        {"two fragments that are too long",
         makeFrame(0x02, std::string(40000, 'a')) + makeFrame(0x80, std::string(40000, 'a')), 1009},
        {"unmasked", makeFrame(kText, "alive", false), 1002},
        {"compressed", makeFrame(0xc1, "alive"), 1002},
        {"reserved opcode", makeFrame(0x83, "alive"), 1002},
        {"continuation of nothing", makeFrame(0x80, "alive"), 1002},
        {"new message within one", makeFrame(0x01, "a") + makeFrame(kText, "b"), 1002},
        {"fragmented ping", makeFrame(0x09, "a"), 1002},
        {"long ping", makeFrame(0x89, std::string(126, 'a')), 1002},
        {"bad UTF-8", makeFrame(kText, "\xc3\x28"), 1007},
        {"cut UTF-8", makeFrame(kText, "\xe2\x82"), 1007},
        {"closed with one byte", makeFrame(0x88, "a"), 1002},
    };
    for (const Wrong& wrong : all) {
        SCOPED_TRACE(wrong.name);
        auto viewer = join();
        viewer->send(wrong.bytes);
        EXPECT_EQ(readCloseCode(*viewer), wrong.code);
    }
    EXPECT_TRUE(await([&] { return server_.counts().viewers == 0; }));
    EXPECT_EQ(server_.counts().hands, 0);
}

TEST_F(PageServerTest, Fault68_ALongHeaderIsRefused) {
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\nX: " + std::string(5000, 'a') + "\r\n")), 431);
    std::string many = "Host: " + host() + "\r\n";
    for (int k = 0; k < 1000; ++k) many += "A: b\r\n";
    EXPECT_EQ(statusFor(get("/", many)), 431);
}

TEST_F(PageServerTest, Fault68_WhoDoesNotSpeakIsCutOff) {
    const auto begin = std::chrono::steady_clock::now();
    TlsClient silent(server_.port(), false);  // no handshake
    TlsClient slow(server_.port());
    slow.send("GET / HTTP/1.1\r\nHost: ");
    std::thread drip([&] {
        for (int k = 0; k < 100 && slow.send("a"); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    });
    EXPECT_TRUE(silent.isClosedWithin(4.0));
    EXPECT_EQ(statusOf(slow.read()), 0);
    const double took_s = calcSince(begin);
    EXPECT_GT(took_s, 0.9 * WebSocket::kHandshake_s);
    EXPECT_LT(took_s, WebSocket::kHandshake_s + 2.0);
    drip.join();
    EXPECT_TRUE(await([&] { return server_.counts().connections == 0; }));
}

TEST_F(PageServerTest, Fault68_SixteenViewersAndNoMore) {
    std::vector<std::unique_ptr<TlsClient>> viewers;
    for (int k = 0; k < PageServer::kMaxConnections; ++k) viewers.push_back(join());
    EXPECT_EQ(server_.counts().viewers, PageServer::kMaxConnections);
    const std::string spare = token();
    for (int k = 0; k < 20; ++k) EXPECT_EQ(statusOfUpgrade(spare, origin(), host()), 503);
    EXPECT_EQ(server_.counts().viewers, PageServer::kMaxConnections);
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\n")), 200);
    viewers.pop_back();
    EXPECT_TRUE(await([&] { return server_.counts().connections < PageServer::kMaxConnections; }));
    EXPECT_EQ(statusOfUpgrade(spare, origin(), host()), 101);  // it was not used up
}

TEST_F(PageServerTest, Fault68_StrangersTakeNoViewersPlace) {
    auto viewer = join();
    EXPECT_TRUE(await([&] { return server_.counts().connections == 1; }));
    std::vector<std::unique_ptr<TlsClient>> unauthenticated;
    const auto add = [&](const char* from) {
        unauthenticated.push_back(std::make_unique<TlsClient>(server_.port(), false, from));
    };
    for (const char* from : {"127.0.0.1", "127.0.0.2"}) {
        for (int k = 0; k < PageServer::kMaxPerAddress; ++k) add(from);
        for (int k = 0; k < 5; ++k) {  // of one address
            TlsClient more(server_.port(), false, from);
            EXPECT_TRUE(more.isClosedWithin(1.0));
        }
    }
    for (int k = 0; k < 5; ++k) {  // in all
        TlsClient more(server_.port(), false, "127.0.0.3");
        EXPECT_TRUE(more.isClosedWithin(1.0));
    }
    EXPECT_EQ(server_.counts().connections, 1 + PageServer::kMaxStrangers);
    viewer->send(makeFrame(kText, "pause"));  // is heard all the same
    EXPECT_TRUE(await([&] { return wishes_[1] == 1; }));
    EXPECT_TRUE(await([&] { return server_.counts().connections == 1; }));  // by their time
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\n")), 200);
}

TEST_F(PageServerTest, Fault70_WhoReadsNothingIsCutOffThoughItSpeaks) {
    auto viewer = join();
    const std::string frame(60000, 'f');
    const auto begin = std::chrono::steady_clock::now();
    const auto isGone = [&] {
        server_.show(frame);
        viewer->send(makeFrame(kText, "alive"));
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        return server_.counts().viewers == 0;
    };
    EXPECT_TRUE(await(isGone, 2.0 * WebSocket::kWrite_s));
    EXPECT_GE(calcSince(begin), WebSocket::kWrite_s);
}

TEST_F(PageServerTest, ItEndsAtOnceWhateverItsClientsDo) {
    for (int round = 0; round < 40; ++round) {
        SCOPED_TRACE(round);
        auto server = makeServer();
        TlsClient silent(server->port(), false);  // in its handshake
        TlsClient slow(server->port());
        slow.send("GET / HTTP/1.1\r\nHost: ");
        TlsClient in(server->port()), leaving(server->port(), true, "127.0.0.2"), coming(server->port());
        for (TlsClient* one : {&in, &leaving}) enter(*server, *one);
        leaving.send(makeFrame(0x88, ""));
        knock(*server, coming);
        std::this_thread::sleep_for(std::chrono::microseconds(50 * round));  // its WebSocket is perhaps under way
        EXPECT_LT(timeEnd(server), 1.0);
    }
}

TEST_F(PageServerTest, TheEndLetsOutWhatWasToldAndShownLast) {
    for (const bool answers : {true, false}) {
        SCOPED_TRACE(answers);
        auto server = makeServer();
        TlsClient viewer(server->port());
        enter(*server, viewer, 2);
        server->broadcast("event", "{\"event\":\"stopped\"}");
        server->show(std::string(60000, 'l'));
        const double took_s = timeEnd(server, [&] {
            EXPECT_EQ(readFrame(viewer).payload, "{\"event\":\"stopped\"}");
            EXPECT_EQ(readFrame(viewer).payload.size(), 60000u);
            EXPECT_EQ(readCloseCode(viewer), 1001);
            if (!answers) return;
            viewer.send(makeFrame(kText, "take"));  // heard no more
            viewer.send(makeFrame(0x88, "\x03\xe9"));
            EXPECT_EQ(readCloseCode(viewer), -1);
        });
        EXPECT_GE(took_s, answers ? 0.0 : PageServer::kClosing_s);
        EXPECT_LT(took_s, PageServer::kClosing_s + 1.0);
    }
}

// Goodbye and reader of Boost 1.74 then wait for each other.
TEST_F(PageServerTest, TheEndComesThoughAMessageGoesWrongWithinTheGoodbye) {
    auto server = makeServer();
    TlsClient viewer(server->port());
    enter(*server, viewer, 2);
    const std::string message = makeFrame(kText, std::string(50, 'a') + "\xff\xff");  // no UTF-8
    viewer.send(message.substr(0, 30));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    const double took_s = timeEnd(server, [&] {
        EXPECT_EQ(readCloseCode(viewer), 1001);
        viewer.send(message.substr(30));
    });
    EXPECT_GE(took_s, BOOST_VERSION == 107400 ? PageServer::kClosing_s : 0.0);  // they did wait
    EXPECT_LT(took_s, PageServer::kClosing_s + 1.0);
}

TEST_F(PageServerTest, TheEndComesThoughAViewerReadsNothingAndAsksOn) {
    for (const unsigned char last : {0x89, 0x88, 0x81, 0x83}) {  // ping, close, text, none that there is
        SCOPED_TRACE(static_cast<int>(last));
        auto server = makeServer();
        TlsClient viewer(server->port());
        knock(*server, viewer);
        ASSERT_TRUE(await([&] {  // its write is stalled
            server->show(std::string(60000, 's'));
            return server->counts().lostFrames > 50;
        }));
        viewer.send(makeFrame(last, "ab"));
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        const double took_s = timeEnd(server);
        EXPECT_GE(took_s, last == 0x88 ? 0.0 : PageServer::kClosing_s);  // it may take up its goodbye until then
        EXPECT_LT(took_s, PageServer::kClosing_s + 1.0);
    }
}

// What was received before the end is still read on by the goodbye, when its time is over.
TEST_F(PageServerTest, TheEndComesThoughAViewerSendsOn) {
    const std::string message = makeFrame(kBinary, std::string(60000, 'm'));
    for (int round = 0; round < 10; ++round) {
        auto server = makeServer();
        TlsClient viewer(server->port());
        enter(*server, viewer);
        std::atomic<bool> isOver{false};
        std::thread flood([&] {
            while (!isOver && viewer.send(message)) {
            }
        });
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        const double took_s = timeEnd(server);
        isOver = true;
        flood.join();
        EXPECT_LT(took_s, PageServer::kClosing_s + 1.0);
    }
}

TEST_F(PageServerTest, TheEndIsToldToAllThoughTheProgramThrows) {
    for (int operating = 0; operating < 3; ++operating) {  // in which order they are told is not known
        SCOPED_TRACE(operating);
        std::atomic<bool> records{false}, throws{false};
        auto server = std::make_unique<PageServer>(makeOptions(), feed_, [&](PageWish wish) {
            if (wish == PageWish::Record) records = true;
            if (wish != PageWish::EndRecord) return;
            throws = true;
            throw std::runtime_error("no recording");
        });
        std::vector<std::unique_ptr<TlsClient>> viewers;
        for (int i = 0; i < 3; ++i) {
            TlsClient& viewer = *viewers.emplace_back(std::make_unique<TlsClient>(server->port()));
            enter(*server, viewer);
            if (i != operating) continue;
            viewer.send(makeFrame(kText, "take"));
            viewer.send(makeFrame(kText, "record"));
        }
        ASSERT_TRUE(await([&] { return records && server->counts().viewers == 3; }));
        timeEnd(server, [&] {
            for (const auto& viewer : viewers) EXPECT_EQ(readCloseCode(*viewer), 1001);
        });
        EXPECT_TRUE(throws);
    }
}

TEST_F(PageServerTest, WhatTheProgramThrowsEndsOneConnectionAndNoOther) {
    auto other = join();
    auto viewer = join();
    readFrame(*other);
    viewer->send(makeFrame(kText, "take"));
    viewer->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    ASSERT_TRUE(await([&] { return feed_->take().message.engagement != 0; }));
    throws_ = true;
    viewer->send(makeFrame(kText, "pause"));
    EXPECT_TRUE(await([&] { return server_.counts().viewers == 1; }));
    EXPECT_EQ(feed_->take().message.engagement, 0u);  // the operator is gone, and the hand
    throws_ = false;
    other->send(makeFrame(kText, "take"));
    other->send(makeFrame(kText, "start"));
    EXPECT_TRUE(await([&] { return wishes_[0] == 1; }));
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\n")), 200);
    auto next = join();
    EXPECT_TRUE(await([&] { return server_.counts().viewers == 2; }));
}

TEST_F(PageServerTest, Fault67_ATokenCountsUntilItsBrowserIsIn) {
    const std::string good = token();
    const auto knock = [&](const std::string& key) {
        std::string request = upgrade(good, origin(), host());
        const std::string line = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
        return statusOfHead(request.replace(request.find(line), line.size(), key));
    };
    EXPECT_EQ(knock(""), 400);
    EXPECT_TRUE(await([&] { return server_.counts().connections == 0; }));
    EXPECT_EQ(knock("Sec-WebSocket-Key: " + std::string(40, 'a') + "\r\n"), 400);
    EXPECT_TRUE(await([&] { return server_.counts().connections == 0; }));
    EXPECT_EQ(statusOfUpgrade(good, origin(), host()), 101);
    EXPECT_EQ(statusOfUpgrade(good, origin(), host()), 401);
}

TEST_F(PageServerTest, Fault67_AViewersInvitationsReplaceItsOwnAlone) {
    const std::string first = token();  // of the program
    auto operating = join();
    auto watching = join();
    readFrame(*operating);
    const auto ask = [](TlsClient& viewer) {
        viewer.send(makeFrame(kText, "invite"));
        const std::string address = json::parse(readFrame(viewer).payload)["invitation"];
        return address.substr(address.find('#') + 1);
    };
    const std::string others = ask(*operating);
    std::vector<std::string> all;
    for (int k = 0; k < 100; ++k) all.push_back(ask(*watching));
    EXPECT_EQ(statusOfUpgrade(all[97], origin(), host()), 401);
    for (const std::string& good : {first, others, all[98], all[99]})
        EXPECT_EQ(statusOfUpgrade(good, origin(), host()), 101);
}

TEST_F(PageServerTest, Fault68_AMessageThatNeverEndsIsNoLife) {
    auto viewer = join();
    viewer->send(makeFrame(0x01, ""));
    std::thread flood([&] {
        std::string many;
        for (int k = 0; k < 200; ++k) many += makeFrame(0x00, "");
        while (viewer->send(many)) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    });
    EXPECT_TRUE(await([&] { return server_.counts().viewers == 0; }, WebSocket::kAlive_s + 5.0));
    flood.join();
}

TEST_F(PageServerTest, Fault69_MessagesThatMeanNothingAreCountedAndDoNothing) {
    auto viewer = join();
    const std::string words[] = {
        "", "Stop", "stop ", "{\"stop\": true}", "[1e999, NaN]", std::string(30000, '['), "take over\n", "null"};
    for (const std::string& word : words) viewer->send(makeFrame(kText, word));
    std::string hand = makeHand(1, feed_->now());
    for (const std::string& bytes : {std::string(), hand.substr(1), hand + "a", std::string(64000, '\xff')})
        viewer->send(makeFrame(kBinary, bytes));
    viewer->send(makeFrame(kBinary, hand));  // no operator
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages == 13; })) << server_.counts().refusedMessages;
    EXPECT_EQ(countWishes(), 0);
    EXPECT_EQ(server_.counts().hands, 0);
    viewer->send(makeFrame(kText, "pause"));  // still there
    EXPECT_TRUE(await([&] { return wishes_[1] == 1; }));
}

/** VIABLE_FUZZ_FRAMES=1000000 for the long mode. */
long countFuzzFrames() {
    const char* wanted = std::getenv("VIABLE_FUZZ_FRAMES");
    return wanted ? std::atol(wanted) : 3000;
}

/** Three of them at most, sometimes none. */
void changeBytes(std::string& bytes, std::mt19937_64& random) {
    for (std::uint64_t left = random() % 4; left > 0 && !bytes.empty(); --left)
        bytes[random() % bytes.size()] = static_cast<char>(random());
}

TEST_F(PageServerTest, Fault69_RandomBytesNeitherMoveNorStopAnything) {
    constexpr std::size_t kAtOnce = 32768;
    const long frames = countFuzzFrames();
    std::mt19937_64 random(68);
    const std::string hand = makeHand(1, feed_->now()), place = R"({"place": 3, "ball": 0.1, "at": [0.5, 0, 0.25]})";
    // Whatever length a broken head tells, if it is one that is taken, it ends in here.
    std::string filler;
    while (filler.size() < WebSocket::kMaxMessage + 1024) filler += makeFrame(kText, "alive");
    long sent = 0;
    int connections = 0;
    while (sent < frames) {
        auto viewer = join();
        ++connections;
        std::string batch = makeFrame(kText, "take over");
        bool isBroken = false;
        while (sent < frames && !isBroken) {
            const std::uint64_t kind = random() % 4;
            std::string bytes = kind == 0 ? place : kind == 1 ? hand : std::string(random() % 300, '\0');
            changeBytes(bytes, random);
            const unsigned char first = kind == 1 || kind == 2 ? kBinary : kText;
            if (first == kText)
                for (char& c : bytes)
                    if (static_cast<unsigned char>(c) < 32 || static_cast<unsigned char>(c) > 126)
                        c = static_cast<char>(32 + (c & 63));
            std::string frame = makeFrame(first, bytes);
            isBroken = random() % 300 == 0;
            if (isBroken) frame[random() % std::min<std::size_t>(frame.size(), 8)] ^= static_cast<char>(random());
            batch += frame;
            ++sent;
            if (batch.size() < kAtOnce && !isBroken && sent < frames) continue;
            if (!viewer->send(batch)) break;
            batch.clear();
        }
        // Whoever goes with answers unread takes back what the other side has not read yet: an answer first.
        viewer->send((isBroken ? filler : "") + makeFrame(kText, "invite"));
        for (ServerFrame answer; answer.payload.find("invitation") == std::string::npos;) {
            answer = readFrame(*viewer);
            if (answer.opcode < 0 || answer.opcode == 8) break;
        }
    }
    EXPECT_EQ(countWishes(), 0);
    EXPECT_EQ(statusFor(get("/", "Host: " + host() + "\r\n")), 200);
    // What was looked at: most frames are sound, and what is in them is not.
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages > frames / 2; }))
        << server_.counts().refusedMessages;
    EXPECT_GT(server_.counts().hands + server_.counts().lateHands, 0);
    EXPECT_GT(places_, 0);
    EXPECT_LT(connections, frames / 100 + 10);
    RecordProperty("refused", std::to_string(server_.counts().refusedMessages));
}

TEST_F(PageServerTest, Fault69_ASubscriptionIsTakenWholeOrNotAtAll) {
    FoxgloveClient client(*channels_);
    std::string answer;
    for (const char* wrong :
         {"",
          "{",
          "[]",
          "null",
          "{}",
          R"({"op": 3})",
          R"({"op": "publish"})",
          R"({"op": "subscribe"})",
          R"({"op": "subscribe", "subscriptions": {}})",
          R"({"op": "subscribe", "subscriptions": [3]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 1}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 0}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 4294967296, "channelId": 0}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 1.5, "channelId": 0}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 0}, {"id": 1, "channelId": 1}]})",
          R"({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 0}, {"id": 2, "channelId": 99}]})",
          R"({"op": "unsubscribe"})",
          R"({"op": "unsubscribe", "subscriptionIds": [1]})",
          R"({"op": "setParameters", "parameters": []})",
          R"({"op": "advertise", "channels": []})"}) {
        EXPECT_FALSE(client.onText(wrong, answer)) << wrong;
        EXPECT_EQ(json::parse(answer)["op"], "status");
        EXPECT_FALSE(client.isListening()) << wrong;
    }
    std::string many = R"({"op": "subscribe", "subscriptions": [)";
    for (std::size_t k = 0; k <= FoxgloveClient::kMostSubscriptions; ++k)
        many += (k == 0 ? "" : ",") + json{{"id", k}, {"channelId", 0}}.dump();
    EXPECT_FALSE(client.onText(many + "]}", answer));
    EXPECT_FALSE(client.isListening());

    const std::string good =
        R"({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 0}, {"id": 8, "channelId": 1}]})";
    ASSERT_TRUE(client.onText(good, answer)) << answer;
    EXPECT_EQ(client.makeMessages(makeRow()).size(), 2u);
    EXPECT_FALSE(client.onText(R"({"op": "unsubscribe", "subscriptionIds": [7, 9]})", answer));
    EXPECT_EQ(client.makeMessages(makeRow()).size(), 2u);
    EXPECT_TRUE(client.onText(R"({"op": "unsubscribe", "subscriptionIds": [7, 8]})", answer));
    EXPECT_FALSE(client.isListening());

    std::mt19937_64 random(69);
    for (long k = 0; k < countFuzzFrames(); ++k) {
        std::string bytes = random() % 2 == 0 ? good : std::string(R"({"op": "unsubscribe", "subscriptionIds": [7]})");
        changeBytes(bytes, random);
        client.onText(bytes, answer);
    }
    EXPECT_LE(client.makeMessages(makeRow()).size(), FoxgloveClient::kMostSubscriptions);
}

TEST_F(PageServerTest, Fault65_TheSecretOfAnAddressLetsAProgramWatchFromAnywhere) {
    const std::string protocol = "foxglove.websocket.v1";
    EXPECT_EQ(statusOfWatch(secret(), protocol, "", host()), 101);
    for (const char* anywhere : {"null", "file://", "https://app.foxglove.dev", "http://localhost:8080"})
        EXPECT_EQ(statusOfWatch(secret(), protocol, anywhere, host()), 101) << anywhere;
    EXPECT_EQ(statusOfWatch(secret(), "foxglove.sdk.v1, " + protocol, "", host()), 101);
    EXPECT_EQ(statusOfWatch(secret(), "foxglove.sdk.v1", "", host()), 101);
    for (const char* other : {"viable.1", "foxglove", "foxglove.websocket.v10", ","})
        EXPECT_EQ(statusOfWatch(secret(), other, "", host()), 400) << other;
    std::string almost = secret();
    almost.back() = almost.back() == 'A' ? 'B' : 'A';
    for (const std::string& wrong : {std::string(), std::string("x"), almost, secret() + "a", secret() + "/", token()})
        EXPECT_EQ(statusOfWatch(wrong, protocol, "", host()), 401) << wrong;
    EXPECT_EQ(statusOfWatch(secret(), protocol, "", "evil.tld:" + std::to_string(server_.port())), 403);
    EXPECT_EQ(statusFor(get("/watch/" + secret(), "Host: " + host() + "\r\n")), 426);
    // It is no secret of the page's.
    EXPECT_EQ(statusOfUpgrade(secret(), origin(), host()), 401);
}

TEST_F(PageServerTest, AWatcherSeesTheChannelsOfTheLogAndMovesNothing) {
    TlsClient client(server_.port());
    client.send(watch(secret(), "foxglove.websocket.v1", "", host()));
    const std::string head = client.readHead();
    ASSERT_EQ(statusOf(head), 101);
    EXPECT_CONTAINS(head, "Sec-WebSocket-Protocol: foxglove.websocket.v1");
    EXPECT_EQ(json::parse(readFrame(client).payload)["op"], "serverInfo");
    const json advertised = json::parse(readFrame(client).payload);
    ASSERT_EQ(advertised["op"], "advertise");
    ASSERT_EQ(advertised["channels"].size(), channels_->size());
    json subscriptions = json::array();
    for (const json& channel : advertised["channels"])
        subscriptions.push_back({{"id", 100 + channel["id"].get<int>()}, {"channelId", channel["id"]}});
    server_.stream(makeRow());  // nobody listens yet
    client.send(makeFrame(kText, json{{"op", "subscribe"}, {"subscriptions", subscriptions}}.dump()));
    client.send(makeFrame(kBinary, makeHand(1, feed_->now())));
    for (const char* word : {"stop", "pause", "take over", "start", "record", "alive"})
        client.send(makeFrame(kText, word));
    for (int k = 0; k < 7; ++k) {
        const ServerFrame refusal = readFrame(client);
        ASSERT_EQ(refusal.opcode, 1);
        EXPECT_EQ(json::parse(refusal.payload)["op"], "status");
    }
    EXPECT_EQ(countWishes(), 0);
    EXPECT_EQ(server_.counts().hands, 0);
    EXPECT_EQ(server_.counts().watchers, 1);
    EXPECT_EQ(server_.counts().viewers, 0);

    server_.stream(makeRow());
    for (std::size_t k = 0; k < channels_->size(); ++k) {
        const ServerFrame frame = readFrame(client);
        ASSERT_EQ(frame.opcode, 2);
        ASSERT_GT(frame.payload.size(), 13u);
        EXPECT_EQ(frame.payload[0], 1);
        EXPECT_EQ(static_cast<unsigned char>(frame.payload[1]), 100 + k);
        std::uint64_t time = 0;
        std::memcpy(&time, frame.payload.data() + 5, sizeof time);
        EXPECT_EQ(time, 1500000000u);
        EXPECT_EQ(frame.payload.substr(13), channels_->encode(k, makeRow()));
    }
    client.send(makeFrame(kText, R"({"op": "unsubscribe", "subscriptionIds": [99]})"));
    EXPECT_EQ(readFrame(client).opcode, 1);
    json ids = json::array();
    for (std::size_t k = 0; k < channels_->size(); ++k) ids.push_back(100 + k);
    client.send(makeFrame(kText, json{{"op", "unsubscribe"}, {"subscriptionIds", ids}}.dump()));
    client.send(makeFrame(kText, "x"));
    EXPECT_EQ(readFrame(client).opcode, 1);
    server_.stream(makeRow());
    client.send(makeFrame(kText, "x"));
    EXPECT_EQ(readFrame(client).opcode, 1);  // and no row before it
}

TEST_F(PageServerTest, AnObstacleIsPutByTheOperatorAlone) {
    auto one = join(), two = join();
    const std::string good = R"({"place": 1, "ball": 0.1, "at": [0, 0, 1]})";
    one->send(makeFrame(kText, good));
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages == 1; }));
    one->send(makeFrame(kText, "take"));
    two->send(makeFrame(kText, good));
    one->send(makeFrame(kText, R"({"place": 1, "ball": 0.1, "at": [0, 0]})"));
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages == 3; }));
    EXPECT_EQ(places_, 0);
    one->send(makeFrame(kText, good));
    EXPECT_TRUE(await([&] { return places_ == 1; }));
}

TEST(PageHand, IsReadWholeOrNotAtAll) {
    HandMessage hand;
    double echo_s = 0.0;
    std::string bytes = {1, 3, 2, 2, 7, 0, 0, 0};
    const double numbers[] = {1.5, 2.5, 0.5, 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0, -1.0, 4.0};
    bytes.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
    ASSERT_TRUE(readHand(bytes, 2, hand, echo_s));
    EXPECT_EQ(hand.engagement, 7u);
    EXPECT_TRUE(hand.isTracked);
    EXPECT_EQ(hand.part, HandMessage::Part::Rotation);
    EXPECT_EQ(hand.sent_s, 1.5);
    EXPECT_EQ(echo_s, 2.5);
    EXPECT_EQ(hand.scale, 0.5);
    EXPECT_EQ(hand.hand.position, Eigen::Vector3d(0.1, 0.2, 0.3));
    EXPECT_EQ(hand.hand.orientation.w(), 1.0);
    EXPECT_EQ(hand.joints[1], 4.0);
    EXPECT_FALSE(readHand(bytes, 0, hand, echo_s));
    for (const auto& [place, value] : {std::pair<int, char>{0, 2}, {1, 4}, {2, 3}, {3, 3}}) {
        std::string wrong = bytes;
        wrong[static_cast<std::size_t>(place)] = value;
        EXPECT_FALSE(readHand(wrong, 2, hand, echo_s)) << place;
    }
    bytes[4] = 0;  // pressed without a press
    EXPECT_FALSE(readHand(bytes, 2, hand, echo_s));
}

TEST_F(PageServerTest, Fault63_OneOperatorAndAnotherByTakingOver) {
    json first, second;
    auto one = join(&first);
    auto two = join(&second);
    one->send(makeFrame(kText, "take"));
    one->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    EXPECT_TRUE(await([&] { return server_.counts().hands == 1; }));
    two->send(makeFrame(kText, "take"));  // too late
    const std::uint64_t engagement = feed_->take().message.engagement;
    EXPECT_NE(engagement, 0u);
    two->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    two->send(makeFrame(kText, "start"));
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages == 2; }));
    EXPECT_EQ(wishes_[0], 0);

    two->send(makeFrame(kText, "take over"));
    EXPECT_TRUE(await([&] { return feed_->take().message.engagement == 0; }));  // the first one's hand is released
    one->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    EXPECT_TRUE(await([&] { return server_.counts().refusedMessages == 3; }));
    EXPECT_EQ(feed_->take().message.engagement, 0u);
    two->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    EXPECT_TRUE(await([&] { return feed_->take().message.engagement != 0; }));
    EXPECT_NE(feed_->take().message.engagement, engagement);  // the same press of another one is another engagement
    two->send(makeFrame(kText, "start"));
    one->send(makeFrame(kText, "stop"));  // anyone may
    EXPECT_TRUE(await([&] { return wishes_[0] == 1 && wishes_[2] == 1; }));
}

TEST_F(PageServerTest, TheOperatorAloneRecordsAndNoLongerThanHeOperates) {
    const auto count = [this](PageWish wish) -> int { return wishes_[static_cast<std::size_t>(wish)]; };
    auto one = join();
    auto two = join();
    one->send(makeFrame(kText, "take"));
    two->send(makeFrame(kText, "record"));
    two->send(makeFrame(kText, "end record"));
    ASSERT_TRUE(await([&] { return server_.counts().refusedMessages == 2; }));
    one->send(makeFrame(kText, "record"));
    EXPECT_TRUE(await([&] { return count(PageWish::Record) == 1; }));
    EXPECT_EQ(count(PageWish::EndRecord), 0);
    one->send(makeFrame(kText, "end record"));
    EXPECT_TRUE(await([&] { return count(PageWish::EndRecord) == 1; }));
    one->send(makeFrame(kText, "leave"));  // nothing is recorded
    one->send(makeFrame(kText, "take"));
    one->send(makeFrame(kText, "record"));
    EXPECT_TRUE(await([&] { return count(PageWish::Record) == 2; }));
    EXPECT_EQ(count(PageWish::EndRecord), 1);
    two->send(makeFrame(kText, "take over"));
    EXPECT_TRUE(await([&] { return count(PageWish::EndRecord) == 2; }));
    two->send(makeFrame(kText, "record"));
    EXPECT_TRUE(await([&] { return count(PageWish::Record) == 3; }));
    two.reset();
    EXPECT_TRUE(await([&] { return count(PageWish::EndRecord) == 3; }));
    EXPECT_EQ(countWishes(), 6);
}

TEST_F(PageServerTest, Fault64_TheHandIsReleasedWithTheConnection) {
    for (const bool sendClose : {true, false}) {
        auto viewer = join();
        viewer->send(makeFrame(kText, "take"));
        viewer->send(makeFrame(kBinary, makeHand(1, feed_->now())));
        ASSERT_TRUE(await([&] { return feed_->take().message.engagement != 0; }));
        const auto begin = std::chrono::steady_clock::now();
        if (sendClose) viewer->send(makeFrame(0x88, ""));
        if (!sendClose) viewer.reset();
        EXPECT_TRUE(await([&] { return feed_->take().message.engagement == 0; }, 0.2));
        RecordProperty(sendClose ? "closed_ms" : "gone_ms", std::to_string(1000 * calcSince(begin)));
    }
}

/** A cable that is pulled: nothing comes, no end either. That the hand is refused as Silent is the command's part. */
TEST_F(PageServerTest, Fault64_WhoIsCutOffWithoutAWordIsGoneAfterAWhile) {
    auto viewer = join();
    viewer->send(makeFrame(kText, "take"));
    const auto begin = std::chrono::steady_clock::now();
    viewer->send(makeFrame(kBinary, makeHand(1, feed_->now())));
    ASSERT_TRUE(await([&] { return feed_->take().message.engagement != 0; }));
    const std::uint64_t number = feed_->take().number;
    std::this_thread::sleep_for(std::chrono::duration<double>(2.0 * TeleoperationFeed::kSilent_s));
    EXPECT_EQ(feed_->take().number, number);  // nobody makes up what was not said: the silence is seen
    EXPECT_GE(feed_->now() - feed_->take().received_s, TeleoperationFeed::kSilent_s);
    EXPECT_TRUE(await([&] { return server_.counts().viewers == 0; }, WebSocket::kAlive_s + 2.0));
    EXPECT_GT(calcSince(begin), 0.9 * WebSocket::kAlive_s);
    EXPECT_EQ(feed_->take().message.engagement, 0u);
    auto next = join();  // the lease is free
    next->send(makeFrame(kText, "take"));
    next->send(makeFrame(kText, "start"));
    EXPECT_TRUE(await([&] { return wishes_[0] == 1; }));
}

TEST_F(PageServerTest, Fault62_AHandThatSeesTheArmTooLateDoesNotCount) {
    auto viewer = join();
    viewer->send(makeFrame(kText, "take"));
    int late = 0;
    viewer->send(makeFrame(kBinary, makeHand(1, feed_->now() - 0.25)));  // not followed
    EXPECT_TRUE(await([&] { return server_.counts().lateHands == 1; }));
    EXPECT_EQ(feed_->take().message.engagement, 0u);
    for (const double echo_s : {feed_->now() - PageServer::kLate_s - 0.1, feed_->now() + 10.0, kNan, 0.0}) {
        viewer->send(makeFrame(kBinary, makeHand(1, echo_s)));
        ++late;
        EXPECT_TRUE(await([&] { return server_.counts().hands == late; }));
        EXPECT_FALSE(feed_->take().message.isTracked);  // its engagement is over
    }
    EXPECT_EQ(server_.counts().lateHands, 5);
    viewer->send(makeFrame(kBinary, makeHand(2, feed_->now() - 0.1)));
    EXPECT_TRUE(await([&] { return feed_->take().message.isTracked; }));
    EXPECT_NE(feed_->take().message.engagement, 0u);
    EXPECT_EQ(server_.counts().lateHands, 5);
    viewer->send(makeFrame(kBinary, makeHand(0, 0.0)));  // letting go always counts
    EXPECT_TRUE(await([&] { return feed_->take().message.engagement == 0; }));
}

TEST_F(PageServerTest, Fault70_WhoReadsSlowlyLosesFramesAndNobodyWaits) {
    auto slow = join();
    auto quick = join();
    readFrame(*slow);  // of the second viewer
    const std::string frame(20000, 'f');
    int read = 0;
    std::atomic<bool> isOver{false};
    std::thread reader([&] {
        while (!isOver) {
            const ServerFrame one = readFrame(*quick);
            if (one.opcode < 0) break;
            if (one.opcode == 2) {
                EXPECT_EQ(one.payload.size(), frame.size());
                ++read;
            }
        }
    });
    double slowest_s = 0.0;
    constexpr int kFrames = 500;
    for (int k = 0; k < kFrames; ++k) {
        const auto begin = std::chrono::steady_clock::now();
        server_.show(frame);
        slowest_s = std::max(slowest_s, calcSince(begin));
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    EXPECT_TRUE(await([&] { return server_.counts().lostFrames > 100; }));
    EXPECT_LT(slowest_s, 0.05);
    isOver = true;
    server_.show(frame);
    reader.join();
    // The count is of both: what the quick one has not got was lost of it.
    EXPECT_GE(read, kFrames - kFrames / 10);
    EXPECT_GT(server_.counts().lostFrames - (kFrames + 1 - read), 100);
}

TEST_F(PageServerTest, WhatIsToldIsKnownToWhoComesLater) {
    server_.broadcast("state", "{\"a\":1}");
    server_.broadcast("state", "{\"a\":2}");
    TlsClient viewer(server_.port());
    viewer.send(upgrade(token(), origin(), host()));
    EXPECT_EQ(statusOf(viewer.readHead()), 101);
    EXPECT_EQ(json::parse(readFrame(viewer).payload)["hello"], 1);
    EXPECT_EQ(readFrame(viewer).payload, "{\"a\":2}");
    EXPECT_EQ(json::parse(readFrame(viewer).payload)["people"], 1);
    viewer.send(makeFrame(kText, "invite"));
    const std::string address = json::parse(readFrame(viewer).payload)["invitation"];
    EXPECT_EQ(address.rfind(origin() + "/#", 0), 0u) << address;
    EXPECT_EQ(statusOfUpgrade(address.substr(address.find('#') + 1), origin(), host()), 101);
}

TEST_F(PageServerTest, APortInUseIsToldWithARemedy) {
    PageOptions options = makeOptions();
    options.port = server_.port();
    expectError({"Name another port"}, [&] { PageServer second(options, nullptr, [](PageWish) {}); });
}

TEST(PageAddress, IsReadInAllItsForms) {
    const auto read = [](const char* text) {
        PageOptions options;
        options.port = 8484;
        readAddress(text, options);
        return options.address + " " + std::to_string(options.port);
    };
    EXPECT_EQ(read(""), "127.0.0.1 8484");
    EXPECT_EQ(read("9000"), "127.0.0.1 9000");
    EXPECT_EQ(read(":9000"), "127.0.0.1 9000");
    EXPECT_EQ(read("0.0.0.0:9000"), "0.0.0.0 9000");
    EXPECT_EQ(read("192.168.1.2"), "192.168.1.2 8484");
    EXPECT_EQ(read("[::1]:80"), "::1 80");
    EXPECT_EQ(read("[::1]"), "::1 8484");
    EXPECT_EQ(read("::1"), "::1 8484");
    EXPECT_EQ(read("::"), ":: 8484");
    EXPECT_EQ(read("fd00::2:9000"), "fd00::2:9000 8484");
    for (const char* wrong :
         {"arm.yaml", "1.2.3", "127.0.0.1:99999", "127.0.0.1:8x", "[::1", ":", "localhost:80", "[::1]9000", "[::1]evil",
          "[::1]:", "[::1]:80x", "[::1]]:80", "[]:80", "[]", "[127.0.0.1]:80", "::1]:80", "[", "1::2::3"})
        EXPECT_THROW(read(wrong), Error) << wrong;
}

TEST(PageAddress, NamesOfThisComputerAreThoseThatABrowserCanCall) {
    for (const char* all : {"::", "0.0.0.0"}) {
        const std::vector<std::string> hosts = listHosts(all);
        int last = 0;  // IPv4, IPv6, of this computer alone, names
        for (const std::string& host : hosts) {
            SCOPED_TRACE(host);
            EXPECT_NE(host.rfind("fe80:", 0), 0u);
            const bool isSix = host.find(':') != std::string::npos;
            const bool isFour = host.find_first_not_of("0123456789.") == std::string::npos;
            const bool isOwn = host == "::1" || (isFour && host.rfind("127.", 0) == 0);
            const int kind = isOwn ? 2 : isFour ? 0 : isSix ? 1 : 3;
            EXPECT_GE(kind, last);
            last = kind;
            EXPECT_FALSE(isSix && std::string(all) == "0.0.0.0");
        }
        EXPECT_EQ(hosts.back(), "localhost");
        EXPECT_NE(std::find(hosts.begin(), hosts.end(), "127.0.0.1"), hosts.end());
    }
}

/** Makes a stored certificate one of yesterday. */
void letExpire(const std::filesystem::path& keys) {
    BIO* text = BIO_new_file((keys / "page_certificate.pem").c_str(), "r");
    X509* x = PEM_read_bio_X509(text, nullptr, nullptr, nullptr);
    BIO_free(text);
    text = BIO_new_file((keys / "page_key.pem").c_str(), "r");
    EVP_PKEY* key = PEM_read_bio_PrivateKey(text, nullptr, nullptr, nullptr);
    BIO_free(text);
    X509_gmtime_adj(X509_getm_notAfter(x), -3600);
    EXPECT_NE(X509_sign(x, key, EVP_sha256()), 0);
    text = BIO_new_file((keys / "page_certificate.pem").c_str(), "w");
    EXPECT_EQ(PEM_write_bio_X509(text, x), 1);
    BIO_free(text);
    X509_free(x);
    EVP_PKEY_free(key);
}

TEST(PageCertificate, OfAllThatStartAtOnceIsTheSame) {
    const TemporaryFolder folder;
    for (int round = 0; round < 10; ++round) {
        const std::filesystem::path keys = folder.path() / std::to_string(round);
        std::vector<Certificate> got(8);
        std::vector<std::thread> all;
        for (Certificate& one : got)
            all.emplace_back([&] { one = readOrMakeCertificate(keys, {"localhost", "127.0.0.1"}); });
        for (std::thread& one : all) one.join();
        for (const Certificate& one : got) EXPECT_EQ(one.fingerprint, got[0].fingerprint);
        EXPECT_FALSE(std::filesystem::exists(keys / "page_key.pem.part"));
    }
}

TEST(PageCertificate, IsMadeAnewOfTheSameKeyWhereItDoesNotCountOrLacksAName) {
    const TemporaryFolder folder;
    const std::filesystem::path keys = folder.path() / "keys";
    const Certificate first = readOrMakeCertificate(keys, {"localhost", "127.0.0.1"});
    const Certificate wider = readOrMakeCertificate(keys, {"localhost", "192.168.1.2", "arm.local", "fd00::2"});
    EXPECT_EQ(wider.key, first.key);
    EXPECT_NE(wider.fingerprint, first.fingerprint);
    for (const std::vector<std::string>& names :
         {std::vector<std::string>{"localhost", "127.0.0.1"}, {"fd00::2"}, {"arm.local"}, {"192.168.1.2"}})
        EXPECT_EQ(readOrMakeCertificate(keys, names).fingerprint, wider.fingerprint);
    letExpire(keys);
    const Certificate renewed = readOrMakeCertificate(keys, {"localhost"});
    EXPECT_EQ(renewed.key, first.key);
    EXPECT_NE(renewed.fingerprint, wider.fingerprint);
    EXPECT_EQ(readOrMakeCertificate(keys, {"localhost", "arm.local"}).fingerprint, renewed.fingerprint);
}

TEST(PageCertificate, FilesThatOthersCouldHavePutThereAreRefused) {
    const TemporaryFolder folder;
    const std::filesystem::path keys = folder.path() / "keys", key = keys / "page_key.pem";
    const auto read = [&] { return readOrMakeCertificate(keys, {"localhost"}); };
    const Certificate first = read();
    std::filesystem::create_hard_link(key, folder.path() / "second");
    EXPECT_THROW(read(), Error);
    std::filesystem::remove(folder.path() / "second");
    EXPECT_EQ(read().fingerprint, first.fingerprint);
    std::filesystem::rename(key, folder.path() / "key");
    std::filesystem::create_symlink(folder.path() / "key", key);
    EXPECT_THROW(read(), Error);
    std::filesystem::remove(key);
    std::filesystem::create_directory(key);
    EXPECT_THROW(read(), Error);
    std::filesystem::remove(key);
    std::filesystem::rename(folder.path() / "key", key);
    ASSERT_EQ(::chmod(keys.c_str(), 0777), 0);
    EXPECT_THROW(read(), Error);
    ASSERT_EQ(::chmod(keys.c_str(), 0700), 0);
    EXPECT_EQ(read().fingerprint, first.fingerprint);
    if (::geteuid() != 0) return;  // only root can give a file away
    ASSERT_EQ(::chown(key.c_str(), 65534, 65534), 0);
    EXPECT_THROW(read(), Error);
}

TEST(PageCertificate, IsMadeOnceAndItsKeyIsForNobodyElse) {
    const TemporaryFolder folder;
    const std::filesystem::path keys = folder.path() / "a" / "viable";
    const Certificate first = readOrMakeCertificate(keys, {"localhost", "127.0.0.1"});
    const Certificate second = readOrMakeCertificate(keys, {"localhost", "127.0.0.1"});
    EXPECT_EQ(first.key, second.key);
    EXPECT_EQ(first.fingerprint, second.fingerprint);
    EXPECT_EQ(first.fingerprint.size(), 95u);
    struct ::stat status {};
    ASSERT_EQ(::stat((keys / "page_key.pem").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0600u);
    ASSERT_EQ(::stat(keys.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0700u);

    ASSERT_EQ(::chmod((keys / "page_key.pem").c_str(), 0640), 0);
    EXPECT_THROW(readOrMakeCertificate(keys, {"localhost"}), Error);
    ASSERT_EQ(::chmod((keys / "page_key.pem").c_str(), 0600), 0);
    replaceFile(keys / "page_certificate.pem", "damaged");
    EXPECT_THROW(readOrMakeCertificate(keys, {"localhost"}), Error);
}

}  // namespace
}  // namespace viable::test
