#include "RobotServer.h"

#include "core/Text.h"

namespace viable {

// The robot's own hold, a servo of acceleration: damping and stiffness of a critically damped 3 Hz, and an integral.
constexpr double kDamping = 40.0;        // [1/s]
constexpr double kStiffness = 400.0;     // [1/s^2]
constexpr double kIntegral = 1500.0;     // [1/s^3]
constexpr double kSlow = 0.02;           // [rad/s] from here on it holds the position
constexpr double kSettling_s = 3.0;      // in which the integral finds what the model does not know
constexpr double kTorqueRise_s = 0.025;  // of a motor to its limit, where nothing says how fast its torque may change

static RealPlant& getPlant(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    if (!configured.plugins.realPlant)
        throw badInput("case " + plan.name, "it has no real arm (key `real_plant`) that could be served",
                       "Name a case that has one: --case NAME.");
    if (configured.plugins.realPlant->traits().hasClock)
        throw badInput("case " + plan.name,
                       "its real arm, '" + plan.realPlant->plugin.name + "', is itself a robot elsewhere",
                       "Name a case with a simulated one, such as simbody: --case NAME.");
    return *configured.plugins.realPlant;
}

void BadLine::put(const Packet& packet, std::int64_t now, bool isGood) {
    const auto meets = [&](double share) { return !isGood && happens(share); };
    // Bursts begin as often as makes that share of them.
    const double lose = options_.lose, begins = lose / (lose + options_.burst * (1.0 - lose));
    if (isGood) toLose_ = 0;
    if (toLose_ == 0 && meets(begins)) toLose_ = options_.burst;
    if (toLose_ > 0) {
        --toLose_;
        return;
    }
    for (int copies = meets(options_.duplicate) ? 2 : 1; copies > 0; --copies) {
        Packet one = packet;
        one.due = now + static_cast<std::int64_t>(options_.latency_s / options_.clock * 1e9);
        if (options_.delay > 0)
            one.due += tick_ns_ * static_cast<std::int64_t>(random_() % static_cast<std::uint64_t>(options_.delay + 1));
        if (meets(options_.reorder)) one.due += 2 * tick_ns_;  // after the next one
        if (meets(options_.corrupt) && !one.bytes.empty())
            one.bytes[random_() % one.bytes.size()] ^= static_cast<std::uint8_t>(1u << random_() % 8);
        underWay_.push_back(std::move(one));
    }
}

std::optional<BadLine::Packet> BadLine::take(std::int64_t now) {
    const auto next = std::find_if(underWay_.begin(), underWay_.end(), [&](const Packet& p) { return p.due <= now; });
    if (next == underWay_.end()) return std::nullopt;
    Packet packet = std::move(*next);
    underWay_.erase(next);
    return packet;
}

std::int64_t BadLine::nextDue() const {
    std::int64_t due = std::numeric_limits<std::int64_t>::max();
    for (const Packet& packet : underWay_) due = std::min(due, packet.due);
    return due;
}

RobotServer::RobotServer(std::unique_ptr<ConfiguredCase> configured, const RobotServerOptions& options)
    : configured_(std::move(configured)),
      options_(options),
      plant_(getPlant(*configured_)),
      n_(configured_->plan.robot.size()),
      tick_s_(configured_->plan.tick_s),
      model_(configured_->plan.robot),
      period_ns_(std::llround(tick_s_ / options.clock * 1e9)),
      toHost_(options_, period_ns_, options.seed),
      fromHost_(options_, period_ns_, options.seed + 1) {
    char error[256];
    if (vl_line_open(&line_, options_.address.c_str(), 1, error, sizeof error) != 0)
        throw badInput(options_.address, error,
                       "See that no other robot runs there, or name another address with --listen ADDRESS:PORT, or "
                       "another name with --shm NAME.");
    vl_robot_init(&robot_, n_, tick_s_, vl_random());
    robot_.key = options_.key;
    robot_.most_repeats = options_.mostRepeats;
    JointVector rate = plant_.traits().motorRate;
    if (rate.size() == 0) rate.setConstant(n_, kInfinity);
    rate = rate.array().isFinite().select(rate, configured_->plan.robot.actuation.torqueLimit / kTorqueRise_s);
    if (options_.torqueRate > 0.0) rate.setConstant(options_.torqueRate);
    for (int i = 0; i < n_; ++i)
        if (std::isfinite(rate[i])) robot_.torque_step[i] = rate[i] * tick_s_;
    applied_.setZero(n_);
    holdIntegral_.setZero(n_);
    placeAtStart();
    for (int k = 0; k * tick_s_ < kSettling_s && !hasFault_; ++k) move(VL_HOLD, nullptr);
    settledIntegral_ = holdIntegral_;
    placeAtStart();
    largestStep_ = 0.0;
}

std::string RobotServer::address() const {
    const int port = vl_line_port(&line_);
    return port == 0 ? options_.address
                     : options_.address.substr(0, options_.address.rfind(':') + 1) + std::to_string(port);
}

void RobotServer::tell(const std::string& what) const {
    std::printf("%.3f s: %s\n", static_cast<double>(robot_.tick) * tick_s_, what.c_str());
    std::fflush(stdout);
}

void RobotServer::placeAtStart() {
    const MotionState& start = configured_->plan.start;
    PluginWatch* const watch = configured_->plugins.watches[static_cast<std::size_t>(PluginKind::RealPlant)];
    resetPlugin(plant_, PluginKind::RealPlant, watch, start);
    isBraked_ = hasFault_ = reportsFault_ = false;
    holdPosition_ = start.q;
    isHolding_ = true;
    if (settledIntegral_.size() == n_) holdIntegral_ = settledIntegral_;
    const JointVector held = calcHold();  // it has stood here all the time: its motors hold it
    written_ = held - calcGravityShare();
    vl_robot_note(&robot_, written_.data());
}

/** What the robot adds itself, and the link does not count. */
JointVector RobotServer::calcGravityShare() {
    if (!options_.addsGravity) return JointVector::Zero(n_);
    model_.calcDynamics(plant_.measured().q, JointVector::Zero(n_), dynamics_);
    return dynamics_.gravity;
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
    for (int i = 0; i < n_ && !isHolding_; ++i) {  // or what the model does not know makes it creep on
        const double wanted = -kDamping * state.qd[i];
        if (wanted > limits.lower[i] && wanted < limits.upper[i])
            holdIntegral_[i] -= kStiffness * tick_s_ * state.qd[i];
    }
    acceleration = acceleration.cwiseMax(limits.lower + holdIntegral_).cwiseMin(limits.upper + holdIntegral_);
    return dynamics_.M * acceleration + dynamics_.b;
}

/** Motors that shall give `torque` [Nm]; isOwn: it is not the host's, whose steps are limited already. */
void RobotServer::write(JointVector torque, bool isOwn) {
    const JointVector gravity = calcGravityShare();
    if (isOwn) {
        torque -= gravity;
        vl_robot_note(&robot_, written_.data());  // a torque of this tick may not have come to act
        vl_robot_limit(&robot_, torque.data());
        torque += gravity;
    }
    Eigen::Index joint = 0;
    const double step = (torque - gravity - written_).cwiseAbs().maxCoeff(&joint);
    if (step > largestStep_) {
        largestStep_ = step;
        largestStepJoint_ = static_cast<int>(joint);
    }
    written_ = torque - gravity;
    if (isBraked_ || hasFault_) return;
    const PluginCall call(configured_->plugins.watches[static_cast<std::size_t>(PluginKind::RealPlant)],
                          static_cast<std::int64_t>(robot_.tick));
    if (plant_.advance(torque, applied_) != TickStatus::Ok) hasFault_ = true;
}

void RobotServer::move(vl_mode mode, const double* torque) {
    if (isBraked_ || hasFault_) return write(JointVector::Zero(n_), true);  // the brakes carry the arm
    if (mode == VL_TORQUE && !reportsFault_) {
        write(Eigen::Map<const Eigen::VectorXd>(torque, n_) + calcGravityShare(), false);
        isHolding_ = false;
        holdTick_ = robot_.tick;
        holdBegin_ = plant_.measured().q;
    } else {
        const bool wasHolding = isHolding_;
        write(calcHold(), true);
        if (isHolding_ && !wasHolding)
            tell(detail::format("it has come to rest in %.3f s, %.4f rad on",
                                static_cast<double>(robot_.tick - holdTick_) * tick_s_,
                                (plant_.measured().q - holdBegin_).lpNorm<Eigen::Infinity>()));
    }
}

/** What comes within that time. @param begin  of it, by the robot's clock */
void RobotServer::receive(std::int64_t timeout_ns, std::int64_t begin) {
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    const std::int64_t before = vl_now_ns();
    BadLine::Packet packet;
    for (int i = 0; i < VL_MOST_PACKETS; ++i) {
        const std::size_t size = vl_line_receive(&line_, bytes, i == 0 ? timeout_ns : 0, &packet.peer);
        if (size == 0) break;
        packet.bytes.assign(bytes, bytes + size);
        packet.from = line_.from;
        packet.fromSize = line_.from_size;
        fromHost_.put(packet, timeout_ns > 0 ? std::min(begin + vl_now_ns() - before, begin + timeout_ns) : begin,
                      isLineGood());
    }
}

void RobotServer::poll() {
    receive(0, now_ns_);
    while (const auto packet = fromHost_.take(now_ns_)) {
        const bool hadHost = robot_.has_host;
        vl_robot_receive(&robot_, packet->bytes.data(), packet->bytes.size(), packet->peer);
        if (vl_robot_peer(&robot_) == packet->peer) {
            line_.to = packet->from;
            line_.to_size = packet->fromSize;
        }
        if (robot_.has_host && !hadHost) {
            ++hosts_;
            hostTick_ = robot_.tick;
            if (!options_.stays) placeAtStart();
            tell("a host has come");
        }
    }
    vl_line_fix(&line_, robot_.has_host);
}

void RobotServer::sendDue(std::int64_t now) {
    while (const auto due = toHost_.take(now)) vl_line_send(&line_, due->bytes.data(), due->bytes.size());
}

void RobotServer::sendState() {
    const JointState& measured = plant_.measured();
    const JointVector* external = plant_.externalTorque();
    const JointVector torque = applied_ - calcGravityShare();
    vl_state state{};
    state.time_ns = static_cast<std::int64_t>(static_cast<double>(robot_.tick) * tick_s_ * 1e9);
    state.flags = isBraked_ ? VL_BRAKES : VL_ENABLED;
    if (hasFault_ || reportsFault_) state.flags |= VL_FAULT;
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
    if (!packet.bytes.empty()) toHost_.put(packet, now_ns_, isLineGood());
    sendDue(now_ns_);
}

void RobotServer::fail(bool& flag, const char* what) {
    if (!flag) tell(what);
    flag = true;
}

/** Until then; what is under way goes on meanwhile. */
void RobotServer::awaitTick(std::int64_t next, const std::atomic<int>& stop) {
    while (stop == 0) {
        const std::int64_t since = std::min(vl_now_ns() - begin_ns_, period_ns_ - 1), now = now_ns_ + since;
        if (options_.latency_s > 0.0) sendDue(now);
        const std::int64_t left = next - vl_now_ns();
        if (left <= 0) return;
        if (options_.latency_s > 0.0) {
            receive(std::clamp<std::int64_t>(toHost_.nextDue() - now, 1, left), now);
            continue;
        }
        const timespec until{static_cast<time_t>(next / 1'000'000'000), static_cast<long>(next % 1'000'000'000)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
    }
}

void RobotServer::run(const std::atomic<int>& stop) {
    const auto last = static_cast<std::uint64_t>(std::llround(options_.duration_s / tick_s_));
    double torque[VL_MAX_JOINTS] = {};
    begin_ns_ = vl_now_ns();
    while (stop == 0 && (last == 0 || robot_.tick < last)) {
        const bool hadHost = robot_.has_host, hadLapsed = robot_.has_lapsed, hadFault = hasFault_;
        now_ns_ += period_ns_;
        poll();
        const vl_mode mode = vl_robot_tick(&robot_, torque);
        ticksLapsed_ = robot_.has_lapsed ? ticksLapsed_ + 1 : 0;
        const bool brakes = (options_.brakeAfter > 0 && ticksLapsed_ == options_.brakeAfter) ||
                            (options_.brakeAt_s > 0.0 && sinceHost_s() >= options_.brakeAt_s);
        if (brakes) fail(isBraked_, "its brakes are closed");
        if (options_.faultAt_s > 0.0 && sinceHost_s() >= options_.faultAt_s)
            fail(reportsFault_, "it reports a fault, and holds itself");
        sendState();
        move(mode, torque);
        if (robot_.has_lapsed && !hadLapsed) tell("commands are missing: it holds itself");
        if (hadHost && !robot_.has_host) tell("the host has gone");
        if (hasFault_ && !hadFault) tell("the simulated arm has failed");

        std::int64_t next = begin_ns_ + period_ns_;
        awaitTick(next, stop);
        const std::int64_t now = vl_now_ns();
        if (now > next + period_ns_) {
            ++lateTicks_;
            next = now;
        }
        begin_ns_ = next;
    }
}

std::string RobotServer::describe() const {
    std::string packets;
    for (int i = VL_GOOD; i < VL_RESULTS; ++i)
        if (robot_.counts[i] > 0)
            detail::addItem(packets, std::to_string(robot_.counts[i]) + " " + vl_result_name(vl_result(i)));
    const JointDescription& joint = configured_->plan.robot.joints[largestStepJoint_];
    return "ticks     " + std::to_string(robot_.tick) + ", late " + std::to_string(lateTicks_) + "\nhosts     " +
           std::to_string(hosts_) + "\ncommands  " + (packets.empty() ? "none" : packets) + "\nrepeated  " +
           std::to_string(robot_.repeated) + " ticks; held itself for want of commands " +
           std::to_string(robot_.lapses) + " times\ntorque    largest step " +
           detail::format("%.4g Nm in a tick (%s)\n", largestStep_, joint.name);
}

}  // namespace viable
