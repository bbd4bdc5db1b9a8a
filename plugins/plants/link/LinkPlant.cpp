#include "LinkPlant.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "viable/plugin/HostServices.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

/** States over which velocities and torques of the resting arm are averaged. */
constexpr int kRestStates = 20;
constexpr std::int64_t kCallAgain_ns = 10'000'000;
/** Friction at standstill over Coulomb friction, at most. */
constexpr double kBreakaway = 1.5;
/** Stops that are sent at the end: some of them may be lost. */
constexpr int kFarewells = 3;
/** Ticks for which the robot may still hold itself after the first torque was sent, beside those that a packet takes: the
nominal arm moves on meanwhile, and what comes later would have to catch up with it. */
constexpr std::uint64_t kMostHolding = 20;
constexpr std::int64_t kMostWaiting = 512;  // packets taken at once
/** States over which a robot's clock is looked at, and windows in a row that end a run; shares of a tick. */
constexpr int kClockStates = 40, kClockWindows = 3;
/** Ticks by which torques may act later than the file says: the gains have as much to spare. In a run also by half of what the
file says; a single one counts as kMostAge at most. */
constexpr std::int64_t kMostAge = 40;
constexpr std::uint64_t kSpareDelay = 2;
constexpr double kClockOff = 0.25, kClockMeanOff = 0.1;
/** Packets of another version, where no good one came, that are no flipped bits any more. */
constexpr std::uint64_t kOtherVersions = 4;
/** Least tolerance of the torque at rest, for noise of the sensors: a share of the joint's limit, or without one [Nm]. */
constexpr double kRestNoiseShare = 0.02, kRestNoise_Nm = 1.0;

constexpr char kAbsurd[] = "sends states with numbers that are not finite, or that no arm has";
constexpr char kAbsurdRemedy[] =
    "See what its driver writes into q, qd, tau, external and echo, and its units: rad, rad/s and Nm.";

static_assert(kMaxJoints == VL_MAX_JOINTS, "each arm of the framework fits into a packet, and the other way round");

std::int64_t toNanoseconds(double seconds) {
    return static_cast<std::int64_t>(seconds * 1e9);
}

std::string formatShort(double value) {
    return detail::format("%.4g", value);
}

}  // namespace

void ClockWatch::add(std::uint64_t sequence, std::int64_t time_ns) {
    if (sequence_ != 0 && sequence > sequence_) {
        const auto ticks = static_cast<double>(sequence - sequence_);
        const double seconds = 1e-9 * (static_cast<double>(time_ns) - static_cast<double>(time_ns_));
        if (!(std::abs(seconds - ticks * tick_s_) <= kClockOff * ticks * tick_s_)) ++off_;
        ticks_ += ticks;
        seconds_ += seconds;
        if (++states_ == kClockStates) {
            measured_s_ = seconds_ / ticks_;
            const bool isWrong = 2 * off_ > states_ && !(std::abs(measured_s_ - tick_s_) <= kClockMeanOff * tick_s_);
            wrongWindows_ = isWrong ? wrongWindows_ + 1 : 0;
            hasWindow_ = true;
            states_ = off_ = 0;
            ticks_ = seconds_ = 0.0;
        }
    }
    sequence_ = sequence;
    time_ns_ = time_ns;
}

bool ClockWatch::isWrong() const {
    return wrongWindows_ >= kClockWindows;
}

void LinkPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    robot_ = &setup.robot;
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    options_ = parameters.get<LinkPlantOptions>();
    place_ = parameters.place("address");
    if (options_.address.rfind("shm:", 0) != 0) {
        sockaddr_storage address;
        socklen_t size = 0;
        if (vl_parse_address(options_.address.c_str(), &address, &size) != 0)
            throw badInput(place_, "'" + options_.address + "' is no address of a robot",
                           "Write numbers, as 127.0.0.1:47100 or \"[::1]:47100\", or shm:NAME for shared memory.");
    }
    key_ = {};
    char error[256];
    const std::string file = options_.keyFile.string();
    if (!file.empty() && vl_key_from_file(file.c_str(), &key_, error, sizeof error) != 0)
        throw badInput(parameters.place("key_file"), file + ": " + error);

    const JointFriction& friction = setup.robot.actuation.friction;
    if (options_.addsFriction && (friction.coulomb.maxCoeff() > 0.0 || friction.viscous.maxCoeff() > 0.0))
        throw badInput(parameters.place("adds_friction"),
                       "the robot makes up for its friction, but the actuation.yaml of " + setup.robot.name +
                           " has friction, which the robust loop would make up for again",
                       "Write coulomb_Nm: 0 and viscous_Nm: 0 there, and a torque_limit_Nm that is smaller by them; or "
                       "switch it off in the robot and write adds_friction: false.");
    TorqueConvention convention;
    convention.addsGravity = options_.addsGravity;
    motorRate_ = options_.motorRate.expand(n_);
    convention.torqueRate = PerJoint(motorRate_);
    sender_ = std::make_unique<TorqueSender>(setup.robot, convention, tick_s_);
    if (motorRate_.array().isInf().all()) motorRate_.resize(0);
    model_ = std::make_unique<RobotModel>(setup.robot);
    for (JointVector* v : {&external_, &state_.q, &state_.qd, &restVelocities_, &restTorques_}) v->setZero(n_);
}

void LinkPlant::refuse(const std::string& what, const std::string& remedy) const {
    throw badInput(place_, "the robot at " + options_.address + " " + what, remedy);
}

const char* LinkPlant::writePackets() noexcept {
    std::size_t length = 0;
    packets_[0] = '\0';
    for (int i = VL_GOOD; i < VL_RESULTS; ++i) {
        const std::uint64_t count = host_.counts[i];
        if (count == 0 || length >= sizeof packets_) continue;
        const int more = std::snprintf(packets_ + length, sizeof packets_ - length, "%s%llu %s", length ? ", " : "",
                                       static_cast<unsigned long long>(count), vl_result_name(vl_result(i)));
        if (more > 0) length += static_cast<std::size_t>(more);
    }
    return *packets_ ? packets_ : "none";
}

void LinkPlant::refuseIfStopped() const {
    if (isStopRequested()) refuse("was still being called when the user asked for the end", "");
}

void LinkPlant::refuseSilence() const {
    const std::uint64_t* const counts = host_.counts;
    if (counts[VL_OTHER_JOINTS] > 0)
        refuse("has " + std::to_string(host_.other_joints) + " joints, and the arm of the file " + std::to_string(n_),
               "Name the robot that stands there (key `robot`), or call another one.");
    if (counts[VL_OTHER_TICK] > 0)
        refuse("has a tick of " + formatShort(1e-9 * host_.other_tick_ns) + " s, and the file one of " +
                   formatShort(tick_s_) + " s",
               "Write tick_s: " + formatShort(1e-9 * host_.other_tick_ns) + ", or change the robot's.");
    if (counts[VL_OTHER_VERSION] > 0 && counts[VL_GOOD] == 0)
        refuse("speaks version " + std::to_string(host_.other_version) + " of the link, and this is version " +
                   std::to_string(VL_VERSION),
               "Build both sides with the same viable_link.h.");
    if (counts[VL_CORRUPT] > counts[VL_GOOD])
        refuse("sends packets that do not pass the check",
               "Give both sides the same key (key_file), or none to both of them.");
    if (counts[VL_INVALID] > counts[VL_GOOD]) refuse(kAbsurd, kAbsurdRemedy);
    if (counts[VL_GOOD] > 0 && host_.is_connected)
        refuse("does not come to rest: its joints move with up to " +
                   formatShort(restVelocities_.lpNorm<Eigen::Infinity>()) + " rad/s in the mean",
               "A run begins at rest: see what moves the robot, or raise rest_velocity_radps where its sensors are "
               "that noisy.");
    if (counts[VL_GOOD] > 0)
        refuse("sends states but takes no commands", "See what its driver says of the packets that it drops.");
    refuse("does not answer (tried for " + formatShort(options_.connectTimeout_s) + " s)",
           "See that `viable robot` or the robot's driver runs and listens there (`viable robot` without --listen: at "
           "127.0.0.1:47100), with the same version, key and number of joints, and that no other host has it.");
}

/** A robot with shared memory may not be there yet. */
void LinkPlant::open(std::int64_t end_ns) {
    char error[256];
    while (vl_line_open(&line_, options_.address.c_str(), 0, error, sizeof error) != 0) {
        if (vl_now_ns() >= end_ns)
            refuse("cannot be called: " + std::string(error),
                   std::string(error).rfind("another host", 0) == 0
                       ? "End the run that drives it, or wait for its end."
                       : "See that `viable robot` or the robot's driver runs there, as the same user.");
        refuseIfStopped();
        const timespec pause{0, 20'000'000};
        nanosleep(&pause, nullptr);
    }
    isOpen_ = true;
    vl_host_init(&host_, n_, tick_s_, vl_random(), vl_line_peer(&line_));
    host_.key = key_;
}

void LinkPlant::disconnect() noexcept {
    if (!isOpen_) return;
    for (int i = 0; i < kFarewells && host_.session.robot != 0; ++i) send(VL_STOP);
    vl_line_close(&line_);
    isOpen_ = false;
}

void LinkPlant::send(vl_mode mode, const double* torque) {
    std::uint8_t packet[VL_MAX_PACKET];
    const std::size_t size = vl_host_command(&host_, mode, torque, options_.repeats, packet);
    answered_[host_.sent % answered_.size()] = host_.last_sequence;
    if (size > 0) vl_line_send(&line_, packet, size);  // what the system does not take is lost, as on any line
}

bool LinkPlant::receive(std::int64_t timeout_ns) {
    const std::int64_t end = vl_now_ns() + timeout_ns;
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    bool isNew = false;
    for (std::int64_t left = timeout_ns, taken = 0; taken < kMostWaiting; ++taken) {
        std::uint64_t peer = 0;
        const std::size_t size = vl_line_receive(&line_, bytes, isNew ? 0 : left, &peer);
        if (size > 0 && vl_host_receive(&host_, bytes, size, peer, &received_) == VL_GOOD) isNew = true;
        left = end - vl_now_ns();
        if (size == 0 && (isNew || left <= 0)) break;
    }
    return isNew;
}

void LinkPlant::readState() {
    for (int i = 0; i < n_; ++i) {
        state_.q[i] = received_.q[i];
        state_.qd[i] = received_.qd[i];
        external_[i] = received_.external[i];
    }
}

void LinkPlant::awaitRest(std::int64_t end_ns) {
    int states = 0;
    std::uint64_t heard = 0;
    Delays delays{};  // the newest
    std::size_t delayCount = 0;
    JointVector velocities = JointVector::Zero(n_), torques = JointVector::Zero(n_);
    for (;;) {
        const bool isNew = receive(kCallAgain_ns);
        const std::uint64_t* const counts = host_.counts;
        if (!(isNew && host_.is_connected) && vl_now_ns() >= end_ns) refuseSilence();
        refuseIfStopped();
        const bool isOtherVersion = counts[VL_GOOD] == 0 && counts[VL_OTHER_VERSION] >= kOtherVersions;
        if (counts[VL_OTHER_JOINTS] > 0 || counts[VL_OTHER_TICK] > 0 || isOtherVersion) refuseSilence();
        send(VL_HOLD);  // the first of them call it
        if (!isNew || !host_.is_connected) continue;
        mostUnderWay_ = std::max(mostUnderWay_, host_.sent - received_.echo);
        if (received_.echo > heard && heard != 0 && calcAge() >= 0)
            delays[delayCount++ % delays.size()] = static_cast<std::uint64_t>(calcAge());
        heard = received_.echo;
        clock_.add(received_.sequence, received_.time_ns);
        if (clock_.isWrong())
            refuse("says that its tick is " + formatShort(tick_s_) + " s, and its time goes on by " +
                       formatShort(clock_.measured_s()) + " s in each",
                   "Correct the tick in its driver (vl_robot_init()) and here (tick_s), or time_ns in its states: "
                   "nanoseconds of the clock that makes the ticks.");
        for (int i = 0; i < n_; ++i) {
            velocities[i] += received_.qd[i] / kRestStates;
            torques[i] += received_.tau[i] / kRestStates;
        }
        if (++states < kRestStates) continue;
        restVelocities_ = velocities;
        restTorques_ = torques;
        if (velocities.lpNorm<Eigen::Infinity>() <= options_.restVelocity && clock_.isGood())
            return checkDelay(delays, std::min(delayCount, delays.size()));
        if (vl_now_ns() >= end_ns) refuseSilence();
        states = 0;
        velocities.setZero();
        torques.setZero();
    }
}

const char* LinkPlant::findTrouble() const {
    const unsigned flags = received_.flags;
    if (flags & VL_FAULT) return "it reports a fault of its own; find and clear it at the robot";
    if (flags & VL_BRAKES) return "its brakes are closed; see at the robot what closed them";
    if (!(flags & VL_ENABLED)) return "its motors are not enabled; see at the robot what switched them off";
    if (flags & VL_LAPSED)
        return "it missed commands for longer than repeat_ticks, and holds itself; see what kept this program or the "
               "line, or raise repeat_ticks";
    if (((flags & VL_ADDS_GRAVITY) != 0) != options_.addsGravity)
        return "what it adds for gravity is not as adds_gravity says any more; see what changed it at the robot";
    if (((flags & VL_ADDS_FRICTION) != 0) != options_.addsFriction)
        return "what it adds for friction is not as adds_friction says any more; see what changed it at the robot";
    if (options_.measuresExternal && !(flags & VL_HAS_EXTERNAL))
        return "it measures the torque of the surroundings no more; see its sensors, or write external_torque: false";
    return nullptr;
}

std::int64_t LinkPlant::calcAge() const noexcept {
    if (received_.echo == 0 || host_.sent - received_.echo >= answered_.size()) return -1;
    return static_cast<std::int64_t>(received_.sequence - answered_[received_.echo % answered_.size()]);
}

const char* LinkPlant::checkAge() noexcept {
    const std::int64_t age = calcAge();
    ageTicks_ += age < 0 ? kMostAge : std::min(age, kMostAge);  // one pause of this program is no slow line
    if (++ages_ < kClockStates) return nullptr;
    const double mean = static_cast<double>(ageTicks_) / ages_;
    ages_ = 0;
    ageTicks_ = 0;
    if (mean <= options_.delayTicks + std::max<double>(kSpareDelay, 0.5 * options_.delayTicks)) return nullptr;
    std::snprintf(why_, sizeof why_,
                  "its torques answer states of %.1f ticks before in the mean of %d, and the gains reckon with "
                  "delay_ticks: %d; see what the line loses and what slows this computer, or raise delay_ticks",
                  mean, kClockStates, options_.delayTicks);
    return why_;
}

const char* LinkPlant::checkFollowing() noexcept {
    clock_.add(received_.sequence, received_.time_ns);
    if (clock_.isWrong()) {
        std::snprintf(why_, sizeof why_,
                      "it says that its tick is %.4g s, and its time goes on by %.4g s in each; see what slows its "
                      "driver, or correct time_ns in its states",
                      tick_s_, clock_.measured_s());
        return why_;
    }
    if (!hasSent_) return nullptr;
    if (!(received_.flags & VL_HOLDS)) {
        hasFollowed_ = true;
        return checkAge();
    }
    if (hasFollowed_) return "it holds itself and follows no torque any more; see what its driver says";
    if (++holdingTicks_ <= mostUnderWay_ + kMostHolding) return nullptr;
    std::snprintf(why_, sizeof why_,
                  "it takes no torque, %llu ticks after the first one: they are lost, or come later than repeat_ticks: "
                  "%d allows; see the line, or raise repeat_ticks",
                  static_cast<unsigned long long>(holdingTicks_), options_.repeats);
    return why_;
}

void LinkPlant::checkDelay(Delays& ticks, std::size_t count) const {
    if (count == 0)
        refuse("has more than " + std::to_string(answered_.size()) + " commands under way", "See what slows the line.");
    const auto middle = ticks.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(ticks.begin(), middle, ticks.begin() + static_cast<std::ptrdiff_t>(count));
    if (*middle <= static_cast<std::uint64_t>(options_.delayTicks) + kSpareDelay) return;
    refuse("lets a torque act " + std::to_string(*middle) + " ticks after the state that it answers (median of " +
               std::to_string(count) + "), and the file says delay_ticks: " + std::to_string(options_.delayTicks),
           "See what slows the line or this computer, or write delay_ticks: " + std::to_string(*middle) +
               ", which the gains of the robust loop follow.");
}

void LinkPlant::checkRobot(const MotionState& start) {
    const unsigned flags = received_.flags;
    if (flags & VL_FAULT) refuse("reports a fault of its own", "Find and clear it at the robot.");
    if (flags & VL_BRAKES) refuse("has its brakes closed", "Open them at the robot, or see why it closed them.");
    if (!(flags & VL_ENABLED)) refuse("is not enabled", "Switch its motors on and let it follow torques.");
    const auto compareFlag = [&](const char* name, bool says, unsigned flag, const char* what) {
        if (((flags & flag) != 0) == says) return;
        refuse(std::string(says ? "does not make up for " : "makes up for ") + what + " itself, and the file says " +
                   name + (says ? ": true" : ": false"),
               std::string("Write ") + name + (says ? ": false" : ": true") + ", or change the robot's setting.");
    };
    compareFlag("adds_gravity", options_.addsGravity, VL_ADDS_GRAVITY, "gravity");
    compareFlag("adds_friction", options_.addsFriction, VL_ADDS_FRICTION, "friction");
    if (options_.measuresExternal && !(flags & VL_HAS_EXTERNAL))
        refuse("does not measure the torque of the surroundings", "Write external_torque: false.");
    for (int i = 0; i < n_; ++i) {
        if (std::abs(state_.q[i] - start.q[i]) <= options_.startTolerance[i]) continue;
        refuse("does not stand where the file starts: " + robot_->joints[i].name + " is at " +
                   formatShort(state_.q[i]) + ", and the start " + formatShort(start.q[i]),
               "Move the robot there, start where it stands (`viable live --from-here`), or write its pose as the "
               "start: {position_rad: " +
                   detail::formatList(state_.q) +
                   "}. Where it stands there, the order or sign of its joints is another.");
    }
    checkRestTorque();
}

/** The torque of an arm at rest is gravity's, and what friction holds: its size says whether the robot counts gravity, its
signs whether joints are exchanged or turn the other way. */
void LinkPlant::checkRestTorque() {
    if (std::isinf(options_.torqueShare)) return;
    model_->calcDynamics(state_.q, JointVector::Zero(n_), dynamics_);
    const JointVector expected = options_.addsGravity ? JointVector(JointVector::Zero(n_)) : dynamics_.gravity;
    const double largest = dynamics_.gravity.lpNorm<Eigen::Infinity>();
    for (int i = 0; i < n_; ++i) {
        const double held = kBreakaway * robot_->actuation.friction.coulomb[i];
        const double limit = robot_->actuation.torqueLimit[i];
        const double noise = std::isfinite(limit) ? kRestNoiseShare * limit : kRestNoise_Nm;
        const double tolerance = std::max(held + options_.torqueShare * largest, noise);
        if (std::abs(restTorques_[i] + (options_.addsGravity ? dynamics_.gravity[i] : 0.0)) > limit)
            refuse("carries its arm at rest with " + detail::formatList(restTorques_) +
                       " Nm, beyond the torque_limit_Nm " + formatShort(limit) + " of " + robot_->joints[i].name,
                   "Correct the limit in actuation.yaml: with it this arm cannot be held.");
        if (std::abs(restTorques_[i] - expected[i]) <= tolerance) continue;
        const char* const guess =
            options_.addsGravity && (restTorques_ - dynamics_.gravity).norm() < 0.5 * dynamics_.gravity.norm()
                ? "It looks as if the robot did not subtract gravity: write adds_gravity: false, or see its driver. "
            : !options_.addsGravity && restTorques_.norm() < 0.5 * dynamics_.gravity.norm()
                ? "It looks as if the robot added gravity itself: write adds_gravity: true, or see its driver. "
            : (restTorques_ + expected).norm() < 0.5 * expected.norm() ? "It looks as if its signs were reversed. "
                                                                       : "";
        refuse("carries its arm at rest with " + detail::formatList(restTorques_) + " Nm, and the model expects " +
                   detail::formatList(expected) + " Nm" +
                   (options_.addsGravity ? " beside what the robot adds for gravity" : "") + " (" +
                   robot_->joints[i].name + " differs by more than " + formatShort(tolerance) + ")",
               std::string(guess) +
                   "See gravity, the signs and the order of the joints, the robot's mounting and its payload; "
                   "rest_torque_share allows more.");
    }
}

void LinkPlant::reset(const MotionState& start) {
    disconnect();
    isGone_ = hasSent_ = hasFollowed_ = false;
    readSequence_ = mostUnderWay_ = holdingTicks_ = 0;
    ages_ = 0;
    ageTicks_ = 0;
    clock_ = ClockWatch(tick_s_);
    received_ = vl_state{};
    restVelocities_.setZero(n_);
    restTorques_.setZero(n_);
    if (start.qd.lpNorm<Eigen::Infinity>() > 0.0)
        refuse("cannot be taken over in motion, as the start of the file is", "Give no velocity in the start.");
    const std::int64_t end_ns = vl_now_ns() + toNanoseconds(options_.connectTimeout_s);
    try {
        open(end_ns);
        awaitRest(end_ns);
        readState();
        checkRobot(start);
    } catch (...) {
        disconnect();
        throw;
    }
    if (std::isinf(options_.torqueShare))
        sender_->reset(state_.q);  // what it measures is not to be trusted
    else
        sender_->reset(state_.q, restTorques_, options_.blend_s);
}

TickStatus LinkPlant::fail(const char* why) noexcept {
    if (!isGone_) {
        std::snprintf(text_, sizeof text_,
                      "it cannot drive the robot at %.80s any more: %s (packets: %s; ticks without a state: %llu)",
                      options_.address.c_str(), why, writePackets(), static_cast<unsigned long long>(host_.lost));
        isGone_ = true;
        if (isOpen_) send(VL_STOP);  // or it repeats the last torque; does not wait
    }
    explainFault(text_);
    return TickStatus::Faulted;
}

TickStatus LinkPlant::read(std::int64_t& ticksPassed) {
    ticksPassed = 1;
    if (isGone_ || !isOpen_) return fail("it is not connected: no run has begun, or it has ended");
    if (readSequence_ == 0) receive(0);  // what has waited since reset() is old
    const std::uint64_t absurdBefore = host_.counts[VL_INVALID];
    const std::int64_t begin_ns = vl_now_ns();
    if (!receive(toNanoseconds(options_.silenceTimeout_s))) {
        const std::uint64_t absurd = host_.counts[VL_INVALID] - absurdBefore;
        const double waited_s = 1e-9 * static_cast<double>(vl_now_ns() - begin_ns);
        char why[224];
        if (absurd > 0)
            std::snprintf(why, sizeof why,
                          "no usable state has come for %.3g s, but %llu with numbers that are not finite or that no "
                          "arm has; see what its driver writes into q, qd, tau, external and echo",
                          waited_s, static_cast<unsigned long long>(absurd));
        else
            std::snprintf(why, sizeof why, "no state has come for %.3g s; see that it and the line are up",
                          options_.silenceTimeout_s);
        return fail(why);
    }
    readState();
    if (const char* trouble = findTrouble()) return fail(trouble);
    if (const char* trouble = checkFollowing()) return fail(trouble);
    // Until the first read() it has held itself: no tick was missed.
    if (readSequence_ != 0) ticksPassed = static_cast<std::int64_t>(received_.sequence - readSequence_);
    readSequence_ = received_.sequence;
    return TickStatus::Ok;
}

TickStatus LinkPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    if (isGone_ || !isOpen_) return fail("it is not connected: no run has begun, or it has ended");
    JointVector motors = torque;
    const JointVector& sent = sender_->send(state_.q, motors);
    if (!vl_are_plausible(sent.data(), n_, host_.largest_torque))
        return fail("a torque beyond 1e6 Nm was to be sent; see torque_limit_Nm in the robot's actuation.yaml");
    send(VL_TORQUE, sent.data());
    hasSent_ = true;
    applied = motors;
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(
    viable::RealPlant, viable::LinkPlant, "link",
    "A robot in another process or computer, over viable_link.h (UDP or shared memory); its packets make the ticks.",
    viable::LinkPlantOptions)
