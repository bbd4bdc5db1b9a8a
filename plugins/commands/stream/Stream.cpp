#include "Stream.h"

#include <algorithm>
#include <cmath>
#include <ctime>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct StreamPluginOptions {
    MotionCommand::Space space = MotionCommand::Space::Joint;
    std::string name = "stream";
    BetweenSamples between = BetweenSamples::Hold;
    double stale_s = 0.1;

    template <class V>
    void describe(V& v) {
        v(space, "space", "joint|tool", "What the targets are: joint positions, or poses of the tool.");
        v(name, "name", "Of the socket, for programs: viable.Stream(NAME). Letters, digits, - and _.");
        v(between, "between", "hold|interpolate|extrapolate",
          "The command between two targets: the last one, straight to it within a period, or on as the last two went.");
        v(stale_s, "stale_s", "s", "A target that is older than this when it comes is refused.").above(0).upTo(10);
    }
};

constexpr double kLargest = 1e3;  // [rad, m]: farther is no arm's
constexpr double kFromFuture_s = 0.01;

std::int64_t readMonotonicClock() {
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

/** Of doubles: whoever sends may write any number, and a difference of integers may overflow. */
double calcAge_s(const TargetMessage& m, std::int64_t now_ns) {
    return 1e-9 * (static_cast<double>(now_ns) - static_cast<double>(m.sent_ns));
}

/** In a time that does not depend on how much of it is right. */
bool isSame(const TargetSocket::Token& a, const TargetSocket::Token& b) {
    unsigned different = 0;
    for (std::size_t i = 0; i < a.size(); ++i) different |= a[i] ^ b[i];
    return different == 0;
}

std::string quote(const std::string& text) {
    std::string quoted = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') quoted += '\\';
        quoted += c;
    }
    return quoted + "\"";
}

bool isNameOfFile(const std::string& name) {
    return !name.empty() && name.size() <= 40 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' || c == '_';
    });
}

}  // namespace

Stream::Stream(std::function<std::int64_t()> clock) : clock_(clock ? std::move(clock) : readMonotonicClock) {}

void Stream::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<StreamPluginOptions>();
    first_.space = options.space;
    first_.tool = setup.startTool;
    name_ = options.name;
    if (!isNameOfFile(name_))
        throw badInput(parameters.place("name"), "`" + name_ + "` is no name of a socket",
                       "Write 1 to 40 letters, digits, - or _.");
    receiver_ = CommandReceiver(options.between);
    stale_ns_ = std::llround(1e9 * options.stale_s);
    std::string joints;
    for (const std::string& joint : setup.robot.jointNames()) joints += (joints.empty() ? "" : ", ") + quote(joint);
    description_ = "\"version\": " + std::to_string(TargetMessage::kVersion) +
                   ", \"space\": " + (isTool() ? "\"tool\"" : "\"joint\"") +
                   ", \"stale_s\": " + std::to_string(1e-9 * double(stale_ns_)) + ", \"joints\": [" + joints + "]";
}

void Stream::reset(const MotionState& start) {
    first_.q = start.q;
    first_.qd.setZero(n_);
    target_ = first_;
    receiver_.reset(first_);
    sender_ = 0;
    sent_ns_ = received_ns_ = 0;
    const bool isFirst = !socket_;
    if (isFirst) socket_ = TargetSocket::open(name_);
    socket_->drain();
    if (isFirst && !isRehearsal_) socket_->describe(description_);
}

TickStatus Stream::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t) || !socket_) return TickStatus::InvalidInput;
    bool isNew = false;
    TargetMessage message;
    for (int k = 0; k < kMostMessages && !isRehearsal_; ++k) {
        const std::ptrdiff_t size = socket_->receive(&message, sizeof message);
        if (size < 0) break;
        const std::int64_t now_ns = clock_();
        TargetAnswer answer;
        answer.verdict = checkTarget(message, size, now_ns);
        if (answer.verdict == TargetVerdict::Taken && message.kind == TargetMessage::Kind::Goodbye) {
            sender_ = 0;
            continue;
        }
        if (answer.verdict == TargetVerdict::Taken) {
            take(message);
            received_ns_ = now_ns;
            isNew = true;
        }
        if (answer.verdict != TargetVerdict::Malformed) {
            answer.sequence = message.sequence;
            answer.age_s = calcAge_s(message, now_ns);
        }
        socket_->answer(&answer, sizeof answer);
    }
    if (isNew) receiver_.take(t, target_);
    receiver_.calc(t, out);
    return TickStatus::Ok;
}

TargetVerdict Stream::checkTarget(const TargetMessage& m, std::ptrdiff_t size, std::int64_t now_ns) const {
    if (size < static_cast<std::ptrdiff_t>(kTargetHeader) || m.magic != TargetMessage::kMagic ||
        m.version != TargetMessage::kVersion || m.sender == 0 || m.kind > TargetMessage::Kind::Goodbye ||
        m.count > kMaxJoints || size != static_cast<std::ptrdiff_t>(kTargetHeader + 8 * m.count))
        return TargetVerdict::Malformed;
    if (!isSame(m.token, socket_->token())) return TargetVerdict::Token;
    const bool isMine = m.sender == sender_;
    if (sender_ != 0 && !isMine && 1e-9 * static_cast<double>(now_ns - received_ns_) < kSilent_s)
        return TargetVerdict::Busy;
    if (m.kind == TargetMessage::Kind::Goodbye) return TargetVerdict::Taken;
    if (m.space != (isTool() ? TargetMessage::Space::Tool : TargetMessage::Space::Joint) ||
        static_cast<int>(m.count) != (isTool() ? TargetMessage::kToolNumbers : n_))
        return TargetVerdict::Space;
    for (std::uint32_t i = 0; i < m.count; ++i)
        if (!(std::abs(m.numbers[i]) < kLargest)) return TargetVerdict::NotFinite;
    if (isTool()) {
        const double norm = Eigen::Vector4d(m.numbers.data() + 3).norm();
        if (!(norm > 0.9 && norm < 1.1)) return TargetVerdict::NotFinite;
    }
    if (isMine && m.sent_ns <= sent_ns_) return TargetVerdict::Old;
    // A wrong clock: a time that is not yet would make each later one an old one.
    const double age_s = calcAge_s(m, now_ns);
    if (!(age_s <= 1e-9 * static_cast<double>(stale_ns_) && age_s >= -kFromFuture_s)) return TargetVerdict::Stale;
    return TargetVerdict::Taken;
}

void Stream::take(const TargetMessage& m) {
    sender_ = m.sender;
    sent_ns_ = m.sent_ns;
    if (!isTool()) {
        target_.q = Eigen::Map<const Eigen::VectorXd>(m.numbers.data(), n_);
        return;
    }
    const double* const x = m.numbers.data();
    target_.tool.position = Eigen::Vector3d(x);
    target_.tool.orientation = Eigen::Quaterniond(x[3], x[4], x[5], x[6]).normalized();
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::Stream, "stream",
              "Targets from another program of this computer, such as one in Python, over a local socket.",
              viable::StreamPluginOptions)
