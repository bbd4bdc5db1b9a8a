#include <cstring>

#include "Properties.h"
#include "Random.h"
#include "viable/link/viable_link_linux.h"

namespace viable {

namespace {

using Packet = std::vector<std::uint8_t>;

constexpr double kTick_s = 0.001;
constexpr std::uint64_t kHostsAddress = 7, kRobotsAddress = 8, kStranger = 9;
constexpr std::size_t kMostRecorded = 400;
/** Ticks: quiet beginning, with a host, without one; most in which a host that calls each 10 ticks gets the robot. */
constexpr int kQuiet = 5, kDriven = 150, kAlone = 50, kCalling = 6000;
/** One arm of so many is attacked over real sockets, by a third one. */
constexpr int kOverUdp = 4;

/** Both ends; over a line of sockets, or without one. */
class Link {
public:
    Link(int joints, const vl_key& key, Random& random, bool isUdp) {
        vl_robot_init(&robot, joints, kTick_s, draw(random));
        robot.key = key;
        if (isUdp) {
            char error[256];
            lines_ = std::make_unique<Lines>();
            if (vl_line_open(&lines_->robot, "127.0.0.1:0", 1, error, sizeof error) != 0) return;
            const std::string address = "127.0.0.1:" + std::to_string(vl_line_port(&lines_->robot));
            if (vl_line_open(&lines_->host, address.c_str(), 0, error, sizeof error) != 0 ||
                vl_line_open(&lines_->strangerToRobot, address.c_str(), 0, error, sizeof error) != 0)
                return;
            const std::string caller = "127.0.0.1:" + std::to_string(vl_line_port(&lines_->host));
            if (vl_line_open(&lines_->strangerToHost, caller.c_str(), 0, error, sizeof error) != 0) return;
        }
        isOpen = true;
        startHost(draw(random));
    }

    void startHost(std::uint64_t number) {
        vl_host_init(&host, robot.joints, kTick_s, number, lines_ ? vl_line_peer(&lines_->host) : kRobotsAddress);
        host.key = robot.key;
    }

    /** A stranger's packet; where there are sockets it comes from his. */
    void attackRobot(const Packet& packet, std::uint64_t from) {
        if (lines_)
            vl_line_send(&lines_->strangerToRobot, packet.data(), packet.size());
        else
            vl_robot_receive(&robot, packet.data(), packet.size(), from);
    }
    void attackHost(const Packet& packet, std::uint64_t from) {
        if (lines_)
            vl_line_send(&lines_->strangerToHost, packet.data(), packet.size());
        else
            vl_host_receive(&host, packet.data(), packet.size(), from, &heard);
    }

    vl_mode tick(double* tau) {
        poll();
        return vl_robot_tick(&robot, tau);
    }

    /** The state goes to whom it is for; what went to the host, else empty. */
    Packet sendState(vl_state state, bool isLost) {
        const bool isHosts = lines_ || vl_robot_peer(&robot) == kHostsAddress;
        Packet packet(VL_MAX_PACKET);
        packet.resize(vl_robot_state(&robot, &state, packet.data()));
        if (packet.empty() || isLost || !isHosts) return {};
        if (lines_) {
            vl_line_send(&lines_->robot, packet.data(), packet.size());
            std::uint8_t bytes[VL_MAX_PACKET + 1];
            std::uint64_t peer = 0;
            while (const std::size_t size = vl_line_receive(&lines_->host, bytes, 0, &peer))
                vl_host_receive(&host, bytes, size, peer, &heard);
        } else {
            vl_host_receive(&host, packet.data(), packet.size(), kRobotsAddress, &heard);
        }
        return packet;
    }
    Packet sendCommand(vl_mode mode, const double* tau, int repeats, bool isLost) {
        Packet packet(VL_MAX_PACKET);
        packet.resize(vl_host_command(&host, mode, tau, repeats, packet.data()));
        if (isLost) return {};
        if (lines_)
            vl_line_send(&lines_->host, packet.data(), packet.size());
        else
            vl_robot_receive(&robot, packet.data(), packet.size(), kHostsAddress);
        poll();
        return packet;
    }
    void poll() {
        if (lines_)
            for (int k = 0; k < 8; ++k) vl_robot_poll(&robot, &lines_->robot);
    }
    bool isUdp() const { return lines_ != nullptr; }

    static std::uint64_t draw(Random& random) {
        return static_cast<std::uint64_t>(random.integer(1, 2000000000)) << 31 ^
               static_cast<std::uint64_t>(random.integer(1, 2000000000));
    }

    vl_robot robot;
    vl_host host;
    vl_state heard{};
    bool isOpen = false;

private:
    struct Lines {
        vl_line robot, host, strangerToRobot, strangerToHost;
        Lines() {
            for (vl_line* line : {&robot, &host, &strangerToRobot, &strangerToHost}) {
                std::memset(line, 0, sizeof *line);
                line->fd = -1;
            }
        }
        ~Lines() {
            for (vl_line* line : {&robot, &host, &strangerToRobot, &strangerToHost}) vl_line_close(line);
        }
    };
    std::unique_ptr<Lines> lines_;
};

/** What strangers may not change; null: it is the same. */
const char* findDifference(const Link& a, const Link& b) {
    const vl_robot &r = a.robot, &s = b.robot;
    if (std::memcmp(r.torque, s.torque, sizeof r.torque) != 0) return "another torque";
    if (r.acts != s.acts || r.has_lapsed != s.has_lapsed || r.lapses != s.lapses || r.repeated != s.repeated)
        return "another mode of the robot";
    if (r.has_host != s.has_host || r.sessions != s.sessions || r.heard_tick != s.heard_tick ||
        r.last_sequence != s.last_sequence)
        return "another session of the robot";
    if (std::memcmp(&r.command, &s.command, sizeof r.command) != 0) return "another command";
    const vl_host &h = a.host, &g = b.host;
    if (h.is_connected != g.is_connected || h.lost != g.lost || h.last_sequence != g.last_sequence || h.sent != g.sent)
        return "another session of the host";
    if (std::memcmp(&a.heard, &b.heard, sizeof a.heard) != 0) return "another state";
    return nullptr;
}

/** Somebody who has recorded what went over the line, in this session and an earlier one with the same key. */
class Stranger {
public:
    Stranger(Random& random, bool hasKey) : random_(random), hasKey_(hasKey) {}

    void record(const Packet& packet, bool isState) {
        std::deque<Packet>& all = isState ? states_ : commands_;
        if (packet.empty()) return;
        all.push_back(packet);
        if (all.size() > kMostRecorded) all.erase(all.begin() + static_cast<std::ptrdiff_t>(kMostRecorded / 2));
    }

    void recordHello(const Packet& packet) { hellos_.push_back(packet); }

    /** To one of the two ends, as from its partner, whose address can be forged, or from elsewhere. */
    void attack(Link& link) {
        const bool toRobot = random_.chance(0.5);
        bool isOwn = false;  // whole packets are no forgery without a key: they must come from elsewhere
        const Packet packet = make(isOwn);
        const bool isForged = (hasKey_ || !isOwn) && random_.chance(0.7);
        if (toRobot)
            link.attackRobot(packet, isForged ? kHostsAddress : kStranger);
        else
            link.attackHost(packet, isForged ? kRobotsAddress : kStranger);
    }

private:
    const Packet& pick() {
        if (random_.chance(0.15)) return hellos_[static_cast<std::size_t>(random_.integer(0, int(hellos_.size()) - 1))];
        const std::deque<Packet>& all = random_.chance(0.5) && !states_.empty() ? states_ : commands_;
        return all[static_cast<std::size_t>(random_.integer(0, static_cast<int>(all.size()) - 1))];
    }
    std::uint8_t byte() { return static_cast<std::uint8_t>(random_.integer(0, 255)); }

    Packet make(bool& isOwn) {
        const int kind = random_.integer(0, 9);
        Packet packet = pick();
        if (kind < 4) {  // as it was
            isOwn = true;
        } else if (kind < 7) {  // some bytes, or a bit, are others
            const Packet original = packet;
            const int changes = random_.integer(1, 8);
            for (int i = 0; i < changes; ++i) {
                std::uint8_t& one = packet[static_cast<std::size_t>(random_.integer(0, int(packet.size()) - 1))];
                one = random_.chance(0.5) ? byte() : static_cast<std::uint8_t>(one ^ 1u << random_.integer(0, 7));
            }
            isOwn = packet == original;
        } else if (kind < 8) {  // another length
            const auto size = static_cast<std::size_t>(random_.integer(0, VL_MAX_PACKET));
            isOwn = size == packet.size();
            packet.resize(size);
        } else if (kind < 9) {  // chance, with a good header or without
            const std::size_t kept = random_.chance(0.5) ? 16 : 0;
            for (std::size_t i = kept; i < packet.size(); ++i) packet[i] = byte();
        } else {  // in form, with another key or, where one is asked for, none
            vl_key key{};
            key.is_set = !hasKey_ || random_.chance(0.5);
            key.k[0] = Link::draw(random_);
            vl_make_tag(packet.data(), packet.size(), &key, packet.data() + packet.size() - VL_TAG_SIZE);
        }
        return packet;
    }

    Random& random_;
    const bool hasKey_;
    std::deque<Packet> states_, commands_, hellos_;
};

}  // namespace

bool checkLink(const Options& options) {
    Run run("link", options);
    std::int64_t torques = 0, ticks = 0;
    Figures calls;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        const int joints = random.integer(1, VL_MAX_JOINTS);
        const bool hasKey = run.arm() % 2 == 0;
        const bool isUdp = run.arm() / 2 % kOverUdp == 0;  // with and without a key
        const vl_key key{hasKey, {Link::draw(random), Link::draw(random)}};
        Stranger stranger(random, hasKey);
        // Two links that are the same to the bit; one of them is attacked. Before that: a session that is recorded.
        Random first(run.seed(), -run.arm()), second(run.seed(), -run.arm());
        Link link(joints, key, first, isUdp), twin(joints, key, second, false);
        if (!link.isOpen) {
            run.fail("no sockets", 0.0);
            break;
        }
        double tau[VL_MAX_JOINTS] = {}, twinTau[VL_MAX_JOINTS] = {}, wanted[VL_MAX_JOINTS] = {};
        vl_state state{};
        const auto exchange = [&](vl_mode mode, int repeats, bool stateLost, bool commandLost) {
            for (int i = 0; i < joints; ++i) {
                state.q[i] = random.uniform(-3.0, 3.0);
                state.qd[i] = random.uniform(-3.0, 3.0);
                state.tau[i] = random.uniform(-50.0, 50.0);
                wanted[i] = random.uniform(-50.0, 50.0);
            }
            const vl_mode acts = link.tick(tau), twinActs = twin.tick(twinTau);
            ++ticks;
            if (acts == VL_TORQUE) ++torques;
            if (acts != twinActs || (acts == VL_TORQUE && std::memcmp(tau, twinTau, sizeof tau) != 0))
                run.fail("another torque acts", 0.0);
            stranger.record(link.sendState(state, stateLost), true);
            twin.sendState(state, stateLost);
            stranger.record(link.sendCommand(mode, wanted, repeats, commandLost), false);
            twin.sendCommand(mode, wanted, repeats, commandLost);
        };
        const auto connect = [&] {
            const std::uint64_t number = Link::draw(random);
            link.startHost(number);
            twin.startHost(number);
            stranger.recordHello(link.sendCommand(VL_HOLD, wanted, 0, false));
            twin.sendCommand(VL_HOLD, wanted, 0, false);
            for (int k = 0; k < kQuiet; ++k) exchange(VL_HOLD, 3, false, false);
        };
        const auto attack = [&] {
            const int packets = random.integer(0, 12);
            for (int i = 0; i < packets; ++i) stranger.attack(link);
            run.addSteps(packets);
        };
        connect();
        for (int k = 0; k < kDriven / 2; ++k) exchange(VL_TORQUE, 3, false, false);
        exchange(VL_STOP, 0, false, false);
        connect();
        for (int k = 0; k < kDriven && run.violations() == 0; ++k) {
            attack();
            const bool holds = (link.heard.flags & VL_LAPSED) || random.chance(0.02);
            exchange(holds ? VL_HOLD : VL_TORQUE, 3, random.chance(0.2), random.chance(0.2));
            if (const char* what = findDifference(link, twin)) run.fail(what, 0.0);
        }
        exchange(VL_STOP, 0, false, false);
        for (int k = 0; k < kAlone && run.violations() == 0; ++k) {  // nobody has it, and nobody gets it by old packets
            attack();
            if (link.tick(tau) != VL_HOLD || link.robot.has_host) run.fail("a recorded packet has the robot", 0.0);
            link.sendState(state, true);
        }
        if (link.isUdp()) continue;  // a flood fills the system's queue, which is nobody's to judge
        link.startHost(Link::draw(random));
        int k = 0;
        std::uint64_t answers = 0;
        for (; k < kCalling && !link.host.is_connected; ++k) {
            attack();
            const std::uint64_t before = link.host.last_sequence;
            if (link.tick(tau) != VL_HOLD) run.fail("a torque acts without a host", 0.0);
            if (!link.sendState(state, false).empty()) ++answers;
            if (link.host.counts[VL_GOOD] > answers) run.fail("the host hears a stranger", 0.0);
            if (k % 10 == 0 || link.host.last_sequence != before) link.sendCommand(VL_HOLD, wanted, 0, false);
        }
        calls.add(k);
        if (!link.host.is_connected) run.fail("the host does not get the robot", k);
    }
    run.print();
    calls.print("ticks until a host that calls each 10 of them gets the robot, amid strangers");
    run.expectShare("ticks in which a torque acts", torques, ticks, 0.3);
    return run.isGood();
}

}  // namespace viable
