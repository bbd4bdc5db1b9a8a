#include "Stream.h"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "CommandBench.h"

namespace viable {
namespace {

using Verdict = TargetVerdict;

std::string makeName() {
    static int made = 0;
    return "test-" + std::to_string(::getpid()) + "-" + std::to_string(++made);
}

std::string readDescription(const std::string& name) {
    std::stringstream text;
    text << std::ifstream(TargetSocket::findFolder() / (name + ".json")).rdbuf();
    return text.str();
}

/** Another program: sends datagrams, and reads what it is answered. */
class Sender {
public:
    /** @param own  path of its own address; empty: an abstract one */
    explicit Sender(const std::string& name, std::uint64_t id = 7, const std::string& own = "") : id_(id) {
        socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        std::memcpy(address.sun_path, own.c_str(), own.size() + 1);
        EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&address),
                         static_cast<socklen_t>(own.empty() ? sizeof address.sun_family : sizeof address)),
                  0);
        to_.sun_family = AF_UNIX;
        const std::string path = (TargetSocket::findFolder() / (name + ".socket")).string();
        std::memcpy(to_.sun_path, path.c_str(), path.size() + 1);
        token_ = readToken(name);
    }
    ~Sender() { ::close(socket_); }

    TargetMessage make(const std::vector<double>& numbers, std::int64_t sent_ns,
                       TargetMessage::Space space = TargetMessage::Space::Joint) {
        TargetMessage m;
        m.space = space;
        m.token = token_;
        m.sender = id_;
        m.sequence = ++sequence_;
        m.sent_ns = sent_ns;
        m.count = static_cast<std::uint32_t>(numbers.size());
        std::copy(numbers.begin(), numbers.end(), m.numbers.begin());
        return m;
    }
    void sayGoodbye() {
        TargetMessage m = make({}, 0);
        m.kind = TargetMessage::Kind::Goodbye;
        send(m);
    }
    void send(const TargetMessage& m) { sendBytes(&m, kTargetHeader + 8 * m.count); }
    void sendBytes(const void* bytes, std::size_t size) {
        ASSERT_EQ(::sendto(socket_, bytes, size, 0, reinterpret_cast<sockaddr*>(&to_), sizeof to_),
                  static_cast<ssize_t>(size));
    }
    /** The last answer; `count`: how many there were. */
    TargetAnswer readAnswer(int count = 1) {
        TargetAnswer answer;
        for (int k = 0; k < count; ++k)
            EXPECT_EQ(::recv(socket_, &answer, sizeof answer, 0), static_cast<ssize_t>(sizeof answer));
        EXPECT_EQ(::recv(socket_, &answer, 0, MSG_PEEK), -1);
        return answer;
    }

    bool hasAnswer() const {
        char any;
        return ::recv(socket_, &any, sizeof any, MSG_PEEK) >= 0;
    }

private:
    static TargetSocket::Token readToken(const std::string& name) {
        const std::string hex = nlohmann::json::parse(readDescription(name))["token"];
        TargetSocket::Token token{};
        for (std::size_t i = 0; i < token.size(); ++i)
            token[i] = static_cast<std::uint8_t>(std::stoi(hex.substr(2 * i, 2), nullptr, 16));
        return token;
    }

    const std::uint64_t id_;
    std::uint64_t sequence_ = 0;
    int socket_ = -1;
    sockaddr_un to_{};
    TargetSocket::Token token_{};
};

/** The plugin with three joints, ticks of 1 ms, and a clock that the test advances with them. */
struct StreamTest : ::testing::Test {
    void begin(const std::string& parameters = "") {
        bench_.configure(stream_, "name: " + name_ + (parameters.empty() ? "" : ", " + parameters));
        stream_.reset(bench_.start);
        sender_ = std::make_unique<Sender>(name_);
    }
    void tick(int count = 1) {
        for (int k = 0; k < count; ++k) {
            now_ns_ += 1'000'000;
            t_ += 0.001;
            ASSERT_EQ(stream_.sample(t_, command_), TickStatus::Ok);
        }
    }
    /** Sends one and looks at what becomes of it. */
    Verdict send(const TargetMessage& m) {
        sender_->send(m);
        tick();
        return sender_->readAnswer().verdict;
    }
    Verdict sendJoints(const std::vector<double>& q) { return send(sender_->make(q, now_ns_)); }
    void expectAt(const std::vector<double>& q) const {
        ASSERT_EQ(command_.q.size(), 3);
        for (int i = 0; i < 3; ++i) EXPECT_EQ(command_.q[i], q[static_cast<std::size_t>(i)]);
    }

    std::int64_t now_ns_ = 1'000'000'000'000;
    double t_ = 0.0;
    CommandBench bench_;
    const std::string name_ = makeName();
    std::function<void()> atEachMessage_;  // while a tick looks at it; empty: nothing
    Stream stream_{[this] {
        if (atEachMessage_) atEachMessage_();
        return now_ns_;
    }};
    std::unique_ptr<Sender> sender_;
    MotionCommand command_;
};

TEST_F(StreamTest, RestsAtTheStartUntilATargetComesAndAtTheLastOneAfterwards) {
    begin();
    tick(10);
    expectAt({0.1, -0.2, 0.3});
    EXPECT_EQ(sendJoints({0.5, 0.6, 0.7}), Verdict::Taken);
    expectAt({0.5, 0.6, 0.7});
    tick(2000);
    expectAt({0.5, 0.6, 0.7});
    EXPECT_TRUE(command_.qd.isZero(0.0));
    EXPECT_EQ(sendJoints({0.4, 0.5, 0.6}), Verdict::Taken);
    expectAt({0.4, 0.5, 0.6});
}

TEST_F(StreamTest, TheAnswerTellsWhichMessageAndItsAge) {
    begin();
    sender_->send(sender_->make({0, 0, 0}, now_ns_ - 20'000'000));
    tick();
    const TargetAnswer answer = sender_->readAnswer();
    EXPECT_EQ(answer.sequence, 1u);
    EXPECT_NEAR(answer.age_s, 0.021, 1e-9);
}

TEST_F(StreamTest, TheNewestOfSeveralCountsAndAnOlderOneIsDropped) {
    begin();
    const TargetMessage first = sender_->make({0.1, 0, 0}, now_ns_ - 2'000'000);
    sender_->send(first);
    sender_->send(sender_->make({0.2, 0, 0}, now_ns_ - 1'000'000));
    tick();
    EXPECT_EQ(sender_->readAnswer(2).verdict, Verdict::Taken);
    expectAt({0.2, 0, 0});
    EXPECT_EQ(send(first), Verdict::Old);
    expectAt({0.2, 0, 0});
}

TEST_F(StreamTest, LateAndFutureTargetsAreRefused) {
    begin("stale_s: 0.1");
    EXPECT_EQ(send(sender_->make({1, 0, 0}, now_ns_ - 100'000'000)), Verdict::Stale);
    EXPECT_EQ(send(sender_->make({1, 0, 0}, now_ns_ + 60'000'000'000)), Verdict::Stale);
    for (const std::int64_t farthest :
         {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
        sender_->send(sender_->make({1, 0, 0}, farthest));
        tick();
        const TargetAnswer answer = sender_->readAnswer();
        EXPECT_EQ(answer.verdict, Verdict::Stale);
        EXPECT_EQ(answer.age_s<0, farthest> 0) << answer.age_s;
    }
    expectAt({0.1, -0.2, 0.3});
    EXPECT_EQ(send(sender_->make({1, 0, 0}, now_ns_ - 98'000'000)), Verdict::Taken);
    expectAt({1, 0, 0});
}

TEST_F(StreamTest, WhatIsNoTargetIsRefusedWithItsReason) {
    begin();
    TargetMessage m = sender_->make({1, 2, 3}, now_ns_);
    m.token[3] ^= 1;
    EXPECT_EQ(send(m), Verdict::Token);
    EXPECT_EQ(sendJoints({1, 2}), Verdict::Space);
    EXPECT_EQ(send(sender_->make({0, 0, 0, 1, 0, 0, 0}, now_ns_, TargetMessage::Space::Tool)), Verdict::Space);
    EXPECT_EQ(sendJoints({1, std::nan(""), 3}), Verdict::NotFinite);
    EXPECT_EQ(sendJoints({1, INFINITY, 3}), Verdict::NotFinite);
    EXPECT_EQ(sendJoints({1, 1e4, 3}), Verdict::NotFinite);
    for (const std::size_t size : {std::size_t{0}, std::size_t{1}, kTargetHeader, sizeof(TargetMessage)}) {
        const TargetMessage good = sender_->make({1, 2, 3}, now_ns_);
        sender_->sendBytes(&good, size);
        tick();
        EXPECT_EQ(sender_->readAnswer().verdict, Verdict::Malformed) << size;
    }
    m = sender_->make({1, 2, 3}, now_ns_);
    m.version = 2;
    EXPECT_EQ(send(m), Verdict::Malformed);
    m = sender_->make({1, 2, 3}, now_ns_);
    m.kind = static_cast<TargetMessage::Kind>(2);
    EXPECT_EQ(send(m), Verdict::Malformed);
    expectAt({0.1, -0.2, 0.3});
}

TEST_F(StreamTest, RandomBytesMoveNothing) {
    begin();
    std::mt19937 random(11);
    std::array<std::uint8_t, 300> bytes{};
    for (int k = 0; k < 2000; ++k) {
        TargetMessage m = sender_->make({1, 2, 3}, now_ns_);
        std::memcpy(bytes.data(), &m, sizeof m);
        const auto size = random() % bytes.size();
        for (auto& byte : bytes)
            if (k % 2 == 0) byte = static_cast<std::uint8_t>(random());
        if (k % 2 == 1) bytes[8 + random() % 16] ^= static_cast<std::uint8_t>(1 + random() % 255);  // the token
        sender_->sendBytes(bytes.data(), k % 2 == 0 ? size : kTargetHeader + 24);
        tick();
        EXPECT_NE(sender_->readAnswer().verdict, Verdict::Taken);
        expectAt({0.1, -0.2, 0.3});
    }
}

TEST_F(StreamTest, AnotherProgramIsHeardOnceThisOneIsSilent) {
    begin();
    EXPECT_EQ(sendJoints({1, 0, 0}), Verdict::Taken);
    Sender other(name_, 8);
    other.send(other.make({2, 0, 0}, now_ns_));
    tick(400);
    EXPECT_EQ(other.readAnswer().verdict, Verdict::Busy);
    expectAt({1, 0, 0});
    tick(100);
    other.send(other.make({2, 0, 0}, now_ns_));
    tick();
    EXPECT_EQ(other.readAnswer().verdict, Verdict::Taken);
    expectAt({2, 0, 0});
    EXPECT_EQ(sendJoints({3, 0, 0}), Verdict::Busy);
}

TEST_F(StreamTest, AfterAGoodbyeAnotherProgramIsHeardAtOnce) {
    begin();
    EXPECT_EQ(sendJoints({1, 0, 0}), Verdict::Taken);
    Sender other(name_, 8);
    other.sayGoodbye();  // it is not the one who sends: that changes nothing
    tick();
    EXPECT_EQ(other.readAnswer().verdict, Verdict::Busy);
    sender_->send(sender_->make({2, 0, 0}, now_ns_));
    sender_->sayGoodbye();
    other.send(other.make({3, 0, 0}, now_ns_));
    tick();
    EXPECT_EQ(sender_->readAnswer().verdict, Verdict::Taken);  // of the target
    EXPECT_EQ(other.readAnswer().verdict, Verdict::Taken);
    expectAt({3, 0, 0});
    other.sayGoodbye();
    tick(10);
    EXPECT_FALSE(other.hasAnswer());
    expectAt({3, 0, 0});  // it rests there
}

TEST_F(StreamTest, AnswersGoToAbstractAddressesOnly) {
    begin();
    const std::string path = (TargetSocket::findFolder() / (name_ + ".own")).string();
    {
        Sender other(name_, 8, path);
        other.send(other.make({1, 2, 3}, now_ns_));
        tick();
        EXPECT_FALSE(other.hasAnswer());
        expectAt({1, 2, 3});
    }
    std::filesystem::remove(path);
}

TEST_F(StreamTest, InARehearsalNobodyIsInvitedHeardOrAnswered) {
    begin();
    EXPECT_EQ(sendJoints({1, 0, 0}), Verdict::Taken);
    const std::string name = makeName();
    {
        std::ofstream(TargetSocket::findFolder() / (name + ".json")) << "of one that has ended";
        Stream rehearsed([this] { return now_ns_; });
        bench_.configure(rehearsed, "name: " + name);
        rehearsed.beginRehearsal();
        rehearsed.reset(bench_.start);
        EXPECT_EQ(readDescription(name), "");
    }
    const auto configure = [&](Stream& stream) { bench_.configure(stream, "name: " + name); };
    std::unique_ptr<Sender> early;
    {
        Stream run([this] { return now_ns_; });  // makes the token known, which a rehearsal afterwards has, too
        configure(run);
        run.reset(bench_.start);
        early = std::make_unique<Sender>(name);
    }
    {
        Stream rehearsed([this] { return now_ns_; });
        configure(rehearsed);
        rehearsed.beginRehearsal();
        rehearsed.reset(bench_.start);
        early->send(early->make({1, 2, 3}, now_ns_));
        ASSERT_EQ(rehearsed.sample(0.001, command_), TickStatus::Ok);
        expectAt({0.1, -0.2, 0.3});
        EXPECT_FALSE(early->hasAnswer());
    }
    Stream run([this] { return now_ns_; });
    configure(run);
    run.reset(bench_.start);
    ASSERT_EQ(run.sample(0.001, command_), TickStatus::Ok);
    expectAt({0.1, -0.2, 0.3});
    EXPECT_FALSE(early->hasAnswer());
    early->send(early->make({1, 2, 3}, now_ns_));
    ASSERT_EQ(run.sample(0.002, command_), TickStatus::Ok);
    EXPECT_EQ(early->readAnswer().verdict, Verdict::Taken);
    expectAt({1, 2, 3});
}

TEST_F(StreamTest, ToolTargetsArePoses) {
    begin("space: tool");
    tick();
    EXPECT_EQ(command_.space, MotionCommand::Space::Tool);
    EXPECT_EQ(command_.tool.position, bench_.tool.position);
    const auto make = [&](double w) {
        return sender_->make({0.1, 0.2, 0.3, w, 0, 0.6, 0}, now_ns_, TargetMessage::Space::Tool);
    };
    EXPECT_EQ(send(make(0.3)), Verdict::NotFinite);
    EXPECT_EQ(send(make(0.8)), Verdict::Taken);
    EXPECT_EQ(command_.tool.position, Eigen::Vector3d(0.1, 0.2, 0.3));
    EXPECT_NEAR(command_.tool.orientation.angularDistance(Eigen::Quaterniond(0.8, 0, 0.6, 0)), 0.0, 1e-12);
}

TEST_F(StreamTest, BetweenTargetsItInterpolatesWhereAsked) {
    begin("between: interpolate");
    double last = 0.1;
    for (int k = 1; k <= 30; ++k) {  // 0.3 rad/s at 33.3 Hz
        EXPECT_EQ(sendJoints({0.1 + 0.01 * k, 0, 0}), Verdict::Taken);
        for (int i = 0; i < 29; ++i) {
            tick();
            if (k > 5) {
                EXPECT_GT(command_.q[0], last);
                EXPECT_LT(command_.q[0], last + 0.001);
            }
            last = command_.q[0];
        }
    }
    tick(1000);
    EXPECT_NEAR(command_.q[0], 0.4, 1e-12);
}

TEST_F(StreamTest, ManyMessagesTakeNoMoreThanAFewPerTick) {
    begin();
    int sent = 1, seen = 0;
    atEachMessage_ = [&] {  // there is always one more
        ++seen;
        if (sent == 1000) return;
        ++sent;
        sender_->send(sender_->make({0.001 * sent, 0, 0}, now_ns_ - 1000 + sent));
    };
    sender_->send(sender_->make({0.001, 0, 0}, now_ns_));
    tick();
    EXPECT_EQ(seen, Stream::kMostMessages);
    EXPECT_EQ(command_.q[0], 0.001 * Stream::kMostMessages);
    tick();
    EXPECT_EQ(seen, 2 * Stream::kMostMessages);
}

TEST_F(StreamTest, NeitherMessagesNorTicksAllocate) {
    begin("between: extrapolate");
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    std::int64_t allocations = 0;
    for (int k = 0; k < 200; ++k) {
        TargetMessage m = sender_->make({0.001 * k, 0, 0}, now_ns_);
        if (k % 7 == 0) m.token[0] ^= 1;
        sender_->send(m);
        const testing::AllocationCounter counter;
        tick(3);
        allocations += counter.count();
    }
    EXPECT_EQ(allocations, 0);
}

TEST_F(StreamTest, ResetForgetsTargetsThatCameBefore) {
    begin();
    sender_->send(sender_->make({1, 2, 3}, now_ns_));
    stream_.reset(bench_.start);
    tick();
    expectAt({0.1, -0.2, 0.3});
    EXPECT_EQ(sendJoints({1, 2, 3}), Verdict::Taken);
    stream_.reset(bench_.start);
    tick();
    expectAt({0.1, -0.2, 0.3});
}

TEST_F(StreamTest, OneNameIsForOneListener) {
    begin();
    Stream other;
    bench_.configure(other, "name: " + name_);
    expectError({"another case of this run listens under this name", "give each a `name` of its own"},
                ErrorKind::PluginFailed, [&] { other.reset(bench_.start); });
}

TEST_F(StreamTest, AfterItsEndTheNextOneGoesOnWithTheSameToken) {
    const std::string name = makeName();
    std::string first;
    for (int k = 0; k < 2; ++k) {  // as a rehearsal, and then the run
        Stream stream;
        bench_.configure(stream, "name: " + name);
        stream.reset(bench_.start);
        const std::string description = readDescription(name);
        if (k == 0) first = description;
        EXPECT_EQ(description, first);
    }
}

TEST_F(StreamTest, TheDescriptionTellsProgramsHowToSend) {
    begin();
    const nlohmann::json description = nlohmann::json::parse(readDescription(name_));
    EXPECT_EQ(description["space"], "joint");
    EXPECT_EQ(description["version"], 1);
    EXPECT_EQ(description["joints"].size(), 3u);
    EXPECT_EQ(description["token"].get<std::string>().size(), 32u);
    namespace fs = std::filesystem;
    for (const char* ending : {".json", ".socket"})
        EXPECT_EQ(fs::status(TargetSocket::findFolder() / (name_ + ending)).permissions() & fs::perms(077),
                  fs::perms::none);
    EXPECT_EQ(fs::status(TargetSocket::findFolder()).permissions() & fs::perms(077), fs::perms::none);
}

TEST(Stream, ANameMustBeOne) {
    const CommandBench bench;
    for (const char* name : {"../x", "a b", "\"\"", "a/b"})
        expectContains(bench.findComplaint<Stream>(std::string("name: ") + name),
                       {"is no name of a socket", "Write 1 to 40 letters, digits, - or _"});
}

TEST(Stream, AFolderThatOthersCanEnterIsRefused) {
    std::string folder = (std::filesystem::temp_directory_path() / "viable-stream-XXXXXX").string();
    ASSERT_NE(mkdtemp(folder.data()), nullptr);
    const char* const before = std::getenv("XDG_RUNTIME_DIR");
    const std::string kept = before ? before : "";
    setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
    std::filesystem::create_directory(folder + "/viable");
    std::filesystem::permissions(folder + "/viable", std::filesystem::perms(0755));
    const CommandBench bench;
    Stream stream;
    bench.configure(stream, "name: " + makeName());
    expectError({"no folder of this user alone"}, ErrorKind::PluginFailed, [&] { stream.reset(bench.start); });
    before ? setenv("XDG_RUNTIME_DIR", kept.c_str(), 1) : unsetenv("XDG_RUNTIME_DIR");
    std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace viable
