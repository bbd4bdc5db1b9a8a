#include "RobotServer.h"

#include <time.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <utility>

#include "core/Text.h"
#include "host/PluginCall.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

// The robot's own hold, a servo of acceleration: damping and stiffness of a critically damped 3 Hz, and an integral.
constexpr double kDamping = 40.0;     // [1/s]
constexpr double kStiffness = 400.0;  // [1/s^2]
constexpr double kIntegral = 1500.0;  // [1/s^3]
constexpr double kSlow = 0.02;        // [rad/s] from here on it holds the position
constexpr double kSettling_s = 3.0;   // in which the integral finds what the model does not know

RealPlant& getPlant(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    if (!configured.plugins.realPlant)
        throw badInput("case " + plan.name, "it has no real arm (key `real_plant`) that could be served",
                       "Name a case that has one: --case NAME.");
    if (configured.plugins.realPlant->hasClock())
        throw badInput("case " + plan.name,
                       "its real arm, '" + plan.realPlant->plugin.name + "', is itself a robot elsewhere",
                       "Name a case with a simulated one, such as simbody: --case NAME.");
    return *configured.plugins.realPlant;
}

}  // namespace

void BadLine::put(const Packet& packet, std::uint64_t tick) {
    if (happens(options_.lose)) return;
    for (int copies = happens(options_.duplicate) ? 2 : 1; copies > 0; --copies) {
        Packet one = packet;
        one.due = tick;
        if (options_.delay > 0) one.due += random_() % static_cast<std::uint64_t>(options_.delay + 1);
        if (happens(options_.reorder)) one.due += 2;  // after the next one
        if (happens(options_.corrupt) && !one.bytes.empty())
            one.bytes[random_() % one.bytes.size()] ^= static_cast<std::uint8_t>(1u << random_() % 8);
        underWay_.push_back(std::move(one));
    }
}

std::optional<BadLine::Packet> BadLine::take(std::uint64_t tick) {
    const auto next = std::find_if(underWay_.begin(), underWay_.end(), [&](const Packet& p) { return p.due <= tick; });
    if (next == underWay_.end()) return std::nullopt;
    Packet packet = std::move(*next);
    underWay_.erase(next);
    return packet;
}

RobotServer::RobotServer(std::unique_ptr<ConfiguredCase> configured, const RobotServerOptions& options)
    : configured_(std::move(configured)),
      options_(options),
      plant_(getPlant(*configured_)),
      n_(configured_->plan.robot.size()),
      tick_s_(configured_->plan.tick_s),
      model_(configured_->plan.robot),
      toHost_(options_, options.seed),
      fromHost_(options_, options.seed + 1) {
    char error[256];
    if (vl_line_open(&line_, options_.address.c_str(), 1, error, sizeof error) != 0)
        throw badInput(options_.address, error,
                       "Name another address with --listen ADDRESS:PORT, or another name with --shm NAME.");
    vl_robot_init(&robot_, n_, tick_s_, vl_random());
    robot_.key = options_.key;
    robot_.most_repeats = options_.mostRepeats;
    applied_.setZero(n_);
    holdIntegral_.setZero(n_);
    placeAtStart();
    for (int k = 0; k * tick_s_ < kSettling_s && !hasFault_; ++k) move(VL_HOLD, nullptr);
    placeAtStart();
}

RobotServer::~RobotServer() {
    vl_line_close(&line_);
}

std::string RobotServer::address() const {
    const int port = vl_line_port(&line_);
    return port == 0 ? options_.address
                     : options_.address.substr(0, options_.address.rfind(':') + 1) + std::to_string(port);
}

void RobotServer::tell(const char* what) const {
    std::printf("%.3f s: %s\n", static_cast<double>(robot_.tick) * tick_s_, what);
    std::fflush(stdout);
}

void RobotServer::placeAtStart() {
    const MotionState& start = configured_->plan.start;
    PluginWatch* const watch = configured_->plugins.watches[static_cast<std::size_t>(PluginKind::RealPlant)];
    resetPlugin(plant_, PluginKind::RealPlant, watch, start);
    isBraked_ = hasFault_ = false;
    holdPosition_ = start.q;
    isHolding_ = true;
}

/** The torque that brings the arm to rest and holds it [Nm]. */
JointVector RobotServer::calcHold() {
    const JointState& state = plant_.measured();
    model_.calcDynamics(state.q, state.qd, dynamics_);
    if (!isHolding_ && state.qd.lpNorm<Eigen::Infinity>() < kSlow) {
        isHolding_ = true;
        holdPosition_ = state.q;
    }
    JointVector acceleration = -kDamping * state.qd + holdIntegral_;
    if (isHolding_) {
        const JointVector error = holdPosition_ - state.q;
        acceleration += kStiffness * error;
        holdIntegral_ += kIntegral * tick_s_ * error;
    }
    const JointBounds& limits = configured_->plan.limits.acceleration;
    acceleration = acceleration.cwiseMax(limits.lower + holdIntegral_).cwiseMin(limits.upper + holdIntegral_);
    return dynamics_.M * acceleration + dynamics_.b;
}

void RobotServer::move(vl_mode mode, const double* torque) {
    if (isBraked_ || hasFault_) return;
    JointVector motors;
    if (mode == VL_TORQUE) {
        motors = Eigen::Map<const Eigen::VectorXd>(torque, n_);
        if (options_.addsGravity) {
            model_.calcDynamics(plant_.measured().q, JointVector::Zero(n_), dynamics_);
            motors += dynamics_.gravity;
        }
        isHolding_ = false;
    } else {
        motors = calcHold();
    }
    const PluginCall call(configured_->plugins.watches[static_cast<std::size_t>(PluginKind::RealPlant)],
                          static_cast<std::int64_t>(robot_.tick));
    if (plant_.advance(motors, applied_) != TickStatus::Ok) hasFault_ = true;
}

void RobotServer::poll() {
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    for (int i = 0; i < 256; ++i) {
        BadLine::Packet packet;
        const std::size_t size = vl_line_receive(&line_, bytes, 0, &packet.peer);
        if (size == 0) break;
        packet.bytes.assign(bytes, bytes + size);
        packet.from = line_.from;
        packet.fromSize = line_.from_size;
        fromHost_.put(packet, robot_.tick);
    }
    while (const auto packet = fromHost_.take(robot_.tick)) {
        const bool hadHost = robot_.has_host;
        vl_robot_receive(&robot_, packet->bytes.data(), packet->bytes.size(), packet->peer);
        if (vl_robot_peer(&robot_) == packet->peer) {
            line_.to = packet->from;
            line_.to_size = packet->fromSize;
        }
        if (robot_.has_host && !hadHost) {
            ++hosts_;
            placeAtStart();
            tell("a host has come");
        }
    }
}

void RobotServer::sendState() {
    const JointState& measured = plant_.measured();
    const JointVector* external = plant_.externalTorque();
    JointVector torque = applied_;
    if (options_.addsGravity) {
        model_.calcDynamics(measured.q, JointVector::Zero(n_), dynamics_);
        torque -= dynamics_.gravity;
    }
    vl_state state{};
    state.time_ns = static_cast<std::int64_t>(static_cast<double>(robot_.tick) * tick_s_ * 1e9);
    state.flags = isBraked_ ? VL_BRAKES : VL_ENABLED;
    if (hasFault_) state.flags |= VL_FAULT;
    if (options_.addsGravity) state.flags |= VL_ADDS_GRAVITY;
    if (external) state.flags |= VL_HAS_EXTERNAL;
    for (int i = 0; i < n_; ++i) {
        state.q[i] = measured.q[i];
        state.qd[i] = isBraked_ ? 0.0 : measured.qd[i];
        state.tau[i] = torque[i];
        state.external[i] = external ? (*external)[i] : 0.0;
    }
    BadLine::Packet packet;
    packet.bytes.resize(VL_MAX_PACKET);
    packet.bytes.resize(vl_robot_state(&robot_, &state, packet.bytes.data()));
    if (!packet.bytes.empty()) toHost_.put(packet, robot_.tick);
    while (const auto due = toHost_.take(robot_.tick)) vl_line_send(&line_, due->bytes.data(), due->bytes.size());
}

void RobotServer::run(const std::atomic<int>& stop) {
    const auto period = static_cast<std::int64_t>(std::llround(tick_s_ / options_.clock * 1e9));
    const auto last = static_cast<std::uint64_t>(std::llround(options_.duration_s / tick_s_));
    std::int64_t next = vl_now_ns();
    double torque[VL_MAX_JOINTS] = {};
    while (stop == 0 && (last == 0 || robot_.tick < last)) {
        const bool hadHost = robot_.has_host, hadLapsed = robot_.has_lapsed, hadFault = hasFault_;
        poll();
        const vl_mode mode = vl_robot_tick(&robot_, torque);
        ticksLapsed_ = robot_.has_lapsed ? ticksLapsed_ + 1 : 0;
        if (options_.brakeAfter > 0 && ticksLapsed_ == options_.brakeAfter) {
            isBraked_ = true;
            tell("its brakes are closed");
        }
        sendState();
        move(mode, torque);
        if (robot_.has_lapsed && !hadLapsed) tell("commands are missing: it holds itself");
        if (hadHost && !robot_.has_host) tell("the host has gone");
        if (hasFault_ && !hadFault) tell("the simulated arm has failed");

        next += period;
        const std::int64_t now = vl_now_ns();
        if (now > next + period) {
            ++lateTicks_;
            next = now;
        }
        const timespec until{static_cast<time_t>(next / 1'000'000'000), static_cast<long>(next % 1'000'000'000)};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR && stop == 0) {
        }
    }
}

std::string RobotServer::describe() const {
    std::string packets;
    for (int i = VL_GOOD; i < VL_RESULTS; ++i)
        if (robot_.counts[i] > 0)
            detail::addItem(packets, std::to_string(robot_.counts[i]) + " " + vl_result_name(vl_result(i)));
    return "ticks     " + std::to_string(robot_.tick) + ", late " + std::to_string(lateTicks_) + "\nhosts     " +
           std::to_string(hosts_) + "\ncommands  " + (packets.empty() ? "none" : packets) + "\nrepeated  " +
           std::to_string(robot_.repeated) + " ticks; held itself for want of commands " +
           std::to_string(robot_.lapses) + " times\n";
}

}  // namespace viable
