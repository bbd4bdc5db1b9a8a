// The link between host and robot (viable_link.h): codec, state machines, transports; faults 83, 84 and 86.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>

#include <atomic>
#include <cstdint>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "Effort.h"
#include "viable/link/viable_link_linux.h"

namespace viable::test {
namespace {

constexpr int kJoints = 7;
constexpr double kTick_s = 0.001;
constexpr std::uint64_t kHostsAddress = 77, kRobotsAddress = 11, kStranger = 99;

using Packet = std::vector<std::uint8_t>;

vl_key makeKey(std::uint64_t first = 1) {
    return {1, {first, 2}};
}

vl_state makeState(std::mt19937_64& random) {
    vl_state s{};
    std::uniform_real_distribution<double> number(-10.0, 10.0);
    s.sequence = random();
    s.echo = random();
    s.time_ns = static_cast<std::int64_t>(random());
    s.flags = static_cast<unsigned>(random() & 0xff);
    s.joints = 1 + static_cast<int>(random() % VL_MAX_JOINTS);
    s.tick_ns = static_cast<std::uint32_t>(random());
    for (int i = 0; i < s.joints; ++i) {
        s.q[i] = number(random);
        s.qd[i] = number(random);
        s.tau[i] = number(random);
        s.external[i] = number(random);
    }
    return s;
}

std::string toHex(const std::uint8_t* bytes, int size) {
    std::string text;
    for (int i = 0; i < size; ++i) {
        char digits[3];
        std::snprintf(digits, sizeof digits, "%02x", bytes[i]);
        text += digits;
    }
    return text;
}

// --- Check sums ---------------------------------------------------------------------------------

TEST(Link, CheckSumIsThatOfIeee802) {
    EXPECT_EQ(vl_crc32(reinterpret_cast<const std::uint8_t*>("123456789"), 9), 0xcbf43926u);  // its check value
    EXPECT_EQ(vl_crc32(nullptr, 0), 0u);
}

/** Vectors: 64 bit from the paper of SipHash (Aumasson and Bernstein 2012, appendix A) and the first of the reference code's
vectors.h; 128 bit the first of its vectors_sip128. Key 00 01 ... 0f, message 00 01 ...; `openssl mac -macopt
hexkey:000102030405060708090a0b0c0d0e0f -macopt size:16 -in FILE SipHash` gives the same. */
TEST(Link, KeyedCheckSumIsSipHash24) {
    vl_key key{};
    ASSERT_EQ(vl_key_from_hex("000102030405060708090A0b0c0d0e0f\n", &key), 0);
    std::uint8_t message[64], out[16];
    for (int i = 0; i < 64; ++i) message[i] = static_cast<std::uint8_t>(i);
    vl_siphash(&key, message, 15, out, 8);
    EXPECT_EQ(vl_get(out, 8), 0xa129ca6149be45e5u);
    vl_siphash(&key, message, 0, out, 8);
    EXPECT_EQ(toHex(out, 8), "310e0edd47db6f72");
    const char* const expected[] = {"a3817f04ba25a8e66df67214c7550293", "da87c1d86b99af44347659119b22fc45",
                                    "8177228da4a45dc7fca38bdef60affe4"};
    for (std::size_t size = 0; size < 3; ++size) {
        vl_siphash(&key, message, size, out, 16);
        EXPECT_EQ(toHex(out, 16), expected[size]) << size;
    }
    for (const char* wrong : {"", "0001", "000102030405060708090a0b0c0d0e0g", "000102030405060708090a0b0c0d0e0f0"})
        EXPECT_EQ(vl_key_from_hex(wrong, &key), -1) << wrong;
}

// --- Codec --------------------------------------------------------------------------------------

TEST(Link, PacketsComeOutAsTheyWentIn) {
    std::mt19937_64 random(1);
    std::uint8_t packet[VL_MAX_PACKET];
    for (int k = 0; k < 2000; ++k) {
        const vl_key key = k % 2 ? makeKey(random()) : vl_key{};
        const vl_state sent = makeState(random);
        const vl_session session{random(), random()};
        const std::size_t size = vl_encode_state(packet, &sent, session, &key);
        ASSERT_LE(size, sizeof packet);
        vl_state got{};
        vl_session gotSession{};
        ASSERT_EQ(vl_decode_state(packet, size, &key, &got, &gotSession), VL_GOOD);
        ASSERT_EQ(std::memcmp(&got, &sent, sizeof sent), 0);
        ASSERT_EQ(gotSession.host, session.host);
        ASSERT_EQ(gotSession.robot, session.robot);

        vl_command command{
            random(),     random(), static_cast<vl_mode>(random() % 3), static_cast<int>(random() % 65536), sent.joints,
            sent.tick_ns, {}};
        for (int i = 0; i < command.joints; ++i) command.tau[i] = sent.tau[i];
        vl_command gotCommand{};
        const std::size_t commandSize = vl_encode_command(packet, &command, session, &key);
        ASSERT_EQ(vl_decode_command(packet, commandSize, &key, &gotCommand, &gotSession), VL_GOOD);
        ASSERT_EQ(gotCommand.sequence, command.sequence);
        ASSERT_EQ(gotCommand.echo, command.echo);
        ASSERT_EQ(gotCommand.mode, command.mode);
        ASSERT_EQ(gotCommand.repeats, command.repeats);
        ASSERT_EQ(std::memcmp(gotCommand.tau, command.tau, sizeof command.tau), 0);
        EXPECT_EQ(vl_decode_state(packet, commandSize, &key, &got, &gotSession), VL_OTHER_SESSION);  // the other kind
    }
}

/** The bytes of a packet are those that the header's comment gives, on any machine. */
TEST(Link, LayoutIsAsWritten) {
    const vl_command command{0x0102030405060708, 3, VL_TORQUE, 5, 1, 1000000, {1.0}};
    std::uint8_t packet[VL_MAX_PACKET];
    const vl_key none{};
    ASSERT_EQ(vl_encode_command(packet, &command, {0x10, 0x20}, &none), 80u);
    EXPECT_EQ(toHex(packet, 64),
              "764c4e4b"
              "01"
              "02"
              "01"
              "01"
              "5000"
              "0500"
              "40420f00"
              "1000000000000000"
              "2000000000000000"
              "0807060504030201"
              "0300000000000000"
              "0000000000000000"
              "000000000000f03f");
    EXPECT_EQ(vl_get(packet + 64, 4), vl_crc32(packet, 64));
    EXPECT_EQ(toHex(packet + 68, 12), std::string(24, '0'));
}

// --- State machines -----------------------------------------------------------------------------

/** Host and robot without a line between them. */
struct Pair {
    explicit Pair(const vl_key& key = {}, std::uint64_t hostNumber = 1234, std::uint64_t robotNumber = 4711) {
        vl_robot_init(&robot, kJoints, kTick_s, robotNumber);
        vl_host_init(&host, kJoints, kTick_s, hostNumber, kRobotsAddress);
        robot.key = host.key = key;
    }
    vl_mode tick() {
        state.flags = VL_ENABLED;
        return vl_robot_tick(&robot, torque);
    }
    Packet makeState() {
        Packet packet(VL_MAX_PACKET);
        packet.resize(vl_robot_state(&robot, &state, packet.data()));
        return packet;
    }
    Packet makeCommand(vl_mode mode, double value = 0.0, int repeats = 3) {
        return makeCommand(mode, std::vector<double>(kJoints, value), repeats);
    }
    Packet makeCommand(vl_mode mode, const std::vector<double>& tau, int repeats = 3) {
        Packet packet(VL_MAX_PACKET);
        packet.resize(vl_host_command(&host, mode, tau.data(), repeats, packet.data()));
        return packet;
    }
    vl_result give(const Packet& packet, std::uint64_t peer = kHostsAddress) {
        return vl_robot_receive(&robot, packet.data(), packet.size(), peer);
    }
    vl_result take(const Packet& packet, std::uint64_t peer = kRobotsAddress) {
        return vl_host_receive(&host, packet.data(), packet.size(), peer, &heard);
    }
    /** A tick of both sides in which nothing is lost. */
    vl_mode exchange(vl_mode mode, double value = 0.0) {
        const vl_mode acts = tick();
        EXPECT_EQ(take(makeState()), VL_GOOD);
        EXPECT_EQ(give(makeCommand(mode, value)), VL_GOOD);
        return acts;
    }
    void connect() {
        tick();
        ASSERT_TRUE(makeState().empty());
        ASSERT_EQ(give(makeCommand(VL_HOLD)), VL_GOOD);  // hello
        for (int k = 0; k < 3; ++k) exchange(VL_HOLD);
        ASSERT_TRUE(host.is_connected);
        ASSERT_TRUE(robot.has_host);
    }

    /** Ticks until the two are connected, at most `most`; in each `call` comes first, with their number so far. */
    template <class Call>
    int callAmongStrangers(int most, const Call& call) {
        int ticks = 0;
        for (; ticks < most && !host.is_connected; ++ticks) {
            call(ticks);
            EXPECT_EQ(tick(), VL_HOLD);
            const bool isHosts = vl_robot_peer(&robot) == kHostsAddress;
            const Packet answer = makeState();
            if (!answer.empty() && isHosts && take(answer) == VL_GOOD) give(makeCommand(VL_HOLD));
        }
        return ticks;
    }

    vl_robot robot;
    vl_host host;
    vl_state state{}, heard{};
    double torque[VL_MAX_JOINTS] = {};
};

TEST(Link, TorquesActInTheTickAfterTheStateThatTheyAnswer) {
    for (const vl_key& key : {vl_key{}, makeKey()}) {
        Pair pair(key);
        pair.connect();
        EXPECT_EQ(pair.exchange(VL_TORQUE, 1.0), VL_HOLD);
        for (int k = 2; k < 100; ++k) {
            EXPECT_EQ(pair.exchange(VL_TORQUE, k), VL_TORQUE);
            EXPECT_EQ(pair.torque[kJoints - 1], k - 1.0);
            EXPECT_EQ(pair.heard.flags & (VL_HOLDS | VL_LAPSED), 0u);
        }
        EXPECT_EQ(pair.robot.repeated, 0u);
        EXPECT_EQ(pair.host.lost, 0u);
        EXPECT_EQ(pair.give(pair.makeCommand(VL_STOP)), VL_GOOD);
        EXPECT_EQ(pair.tick(), VL_HOLD);
        EXPECT_FALSE(pair.robot.has_host);
        EXPECT_TRUE(pair.makeState().empty());
    }
}

TEST(Link, TheRobotCutsTorquesAtItsLimit) {
    Pair pair;
    pair.connect();
    pair.robot.torque_limit[2] = 5.0;
    pair.exchange(VL_TORQUE, -30.0);
    EXPECT_EQ(pair.tick(), VL_TORQUE);
    EXPECT_EQ(pair.torque[2], -5.0);
    EXPECT_EQ(pair.torque[3], -30.0);
}

TEST(Fault83, MissingTorquesAreRepeatedAsLongAsAllowedAndThenTheRobotHolds) {
    Pair pair;
    pair.connect();
    pair.exchange(VL_TORQUE, 1.0);
    for (int k = 0; k < 4; ++k) EXPECT_EQ(pair.tick(), VL_TORQUE) << k;  // once, and 3 times again
    EXPECT_EQ(pair.robot.repeated, 3u);
    EXPECT_EQ(pair.tick(), VL_HOLD);
    EXPECT_EQ(pair.robot.lapses, 1u);
    EXPECT_EQ(pair.take(pair.makeState()), VL_GOOD);
    EXPECT_EQ(pair.host.lost, 4u);
    EXPECT_EQ(pair.heard.flags & (VL_HOLDS | VL_LAPSED), unsigned(VL_HOLDS | VL_LAPSED));
    // New torques do not act before a hold.
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 2.0)), VL_GOOD);
    EXPECT_EQ(pair.tick(), VL_HOLD);
    pair.exchange(VL_HOLD);
    pair.exchange(VL_TORQUE, 3.0);
    EXPECT_EQ(pair.tick(), VL_TORQUE);
    EXPECT_EQ(pair.torque[0], 3.0);
}

TEST(Fault83, LateTorquesActNoLongerThanPunctualOnes) {
    Pair pair;
    pair.connect();
    pair.exchange(VL_TORQUE, 1.0);
    pair.tick();
    pair.take(pair.makeState());
    const Packet late = pair.makeCommand(VL_TORQUE, 2.0);           // may act in the 4 ticks after this one
    for (int k = 0; k < 3; ++k) EXPECT_EQ(pair.tick(), VL_TORQUE);  // the first one, repeated
    EXPECT_EQ(pair.give(late), VL_GOOD);
    EXPECT_EQ(pair.tick(), VL_TORQUE);
    EXPECT_EQ(pair.torque[0], 2.0);
    EXPECT_EQ(pair.tick(), VL_HOLD);
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 3.0)), VL_OLD);  // answers a state of long ago
}

TEST(Fault83, WhatIsNotTheNextPacketOfTheOtherSideIsDroppedAndCounted) {
    Pair pair(makeKey());
    pair.connect();
    pair.tick();
    const Packet state = pair.makeState();
    EXPECT_EQ(pair.take(state, kStranger), VL_OTHER_SESSION);
    EXPECT_EQ(pair.take(state), VL_GOOD);
    EXPECT_EQ(pair.take(state), VL_DUPLICATE);
    pair.tick();
    const Packet skipped = pair.makeState();
    pair.tick();
    EXPECT_EQ(pair.take(pair.makeState()), VL_GOOD);
    EXPECT_EQ(pair.host.lost, 1u);
    EXPECT_EQ(pair.take(skipped), VL_OLD);

    const Packet first = pair.makeCommand(VL_TORQUE, 1.0), second = pair.makeCommand(VL_TORQUE, 2.0);
    EXPECT_EQ(pair.give(second, kStranger), VL_OTHER_SESSION);
    EXPECT_EQ(pair.give(second), VL_GOOD);
    EXPECT_EQ(pair.give(second), VL_DUPLICATE);
    EXPECT_EQ(pair.give(first), VL_OLD);
    Packet other = first;
    other[4] = VL_VERSION + 1;
    EXPECT_EQ(pair.give(other), VL_OTHER_VERSION);
    other = first;
    other.resize(other.size() - 1);
    EXPECT_EQ(pair.give(other), VL_OTHER_SIZE);
    other = first;
    other.back() ^= 1;
    EXPECT_EQ(pair.give(other), VL_CORRUPT);
    EXPECT_EQ(pair.give(Packet{1, 2, 3}), VL_OTHER_SESSION);
    EXPECT_EQ(pair.give(Packet(VL_MAX_PACKET + 1, 0)), VL_OTHER_SESSION);
    pair.host.joints = 6;
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 1.0)), VL_OTHER_JOINTS);
    pair.host.joints = kJoints;
    pair.host.tick_ns *= 2;
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 1.0)), VL_OTHER_TICK);
    pair.host.tick_ns /= 2;
    pair.host.last_sequence += 100;  // answers a state that was never sent
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 1.0)), VL_INVALID);
    for (int result = VL_GOOD + 1; result < VL_RESULTS; ++result)
        EXPECT_EQ(pair.robot.counts[result], result == VL_OTHER_SESSION ? 3u : 1u) << vl_result_name(vl_result(result));
    EXPECT_EQ(pair.tick(), VL_TORQUE);
    EXPECT_EQ(pair.torque[0], 2.0);
}

TEST(Fault83, NumbersThatNoArmHasAreDroppedAndNoneIsSent) {
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
    Pair pair;
    pair.connect();
    for (const double bad : {nan, infinity, -infinity, 1e7, -1e300}) {
        for (double* number : {&pair.state.q[0], &pair.state.qd[kJoints - 1], &pair.state.tau[3]}) {
            pair.tick();
            *number = bad;
            EXPECT_EQ(pair.take(pair.makeState()), VL_INVALID) << bad;
            *number = 0.0;
        }
        EXPECT_TRUE(pair.makeCommand(VL_TORQUE, bad).empty()) << bad;
        pair.tick();
        EXPECT_EQ(pair.take(pair.makeState()), VL_GOOD);
        Packet command(VL_MAX_PACKET);
        vl_command made{pair.host.sent + 1, pair.robot.tick, VL_TORQUE, 0, kJoints, pair.robot.tick_ns, {}};
        made.tau[6] = bad;
        command.resize(vl_encode_command(command.data(), &made, pair.host.session, &pair.host.key));
        EXPECT_EQ(pair.give(command), VL_INVALID) << bad;
        EXPECT_EQ(pair.tick(), VL_HOLD);
    }
    pair.state.external[0] = nan;  // not measured, and so not looked at
    pair.tick();
    EXPECT_EQ(pair.take(pair.makeState()), VL_GOOD);
}

TEST(Link, OneHostAtATimeUntilItStopsOrFallsSilent) {
    Pair pair, other({}, 999);
    pair.connect();
    EXPECT_EQ(pair.give(other.makeCommand(VL_HOLD), kStranger), VL_OTHER_SESSION);
    EXPECT_EQ(pair.give(other.makeCommand(VL_HOLD)), VL_OTHER_SESSION);  // not from the same address either
    for (std::uint32_t k = 0; k <= pair.robot.release_ticks; ++k) pair.tick();
    EXPECT_EQ(pair.give(other.makeCommand(VL_HOLD), kStranger), VL_GOOD);
    EXPECT_EQ(vl_robot_peer(&pair.robot), kStranger);
    pair.tick();
    const Packet state = pair.makeState();
    EXPECT_EQ(other.take(state), VL_GOOD);
    EXPECT_EQ(pair.take(state), VL_OTHER_SESSION);
    EXPECT_EQ(pair.give(other.makeCommand(VL_HOLD), kStranger), VL_GOOD);
    EXPECT_TRUE(pair.robot.has_host);
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 1.0)), VL_OTHER_SESSION);  // the first host has lost it
}

/** What was recorded of one session is of no use in any later one, with the same key, host and robot. */
TEST(Link, RecordedPacketsOfAnotherSessionDoNothing) {
    Pair pair(makeKey());
    std::vector<Packet> commands, states;
    commands.push_back(pair.makeCommand(VL_HOLD));
    pair.tick();
    pair.give(commands.back());
    for (int k = 0; k < 50; ++k) {
        pair.tick();
        states.push_back(pair.makeState());
        pair.take(states.back());
        commands.push_back(pair.makeCommand(k < 5 ? VL_HOLD : VL_TORQUE, 9.0));
        pair.give(commands.back());
    }
    ASSERT_EQ(pair.tick(), VL_TORQUE);
    pair.give(pair.makeCommand(VL_STOP));
    for (int k = 0; k < 50; ++k) {  // the recorded host alone, from the address that it had
        const vl_result result = pair.give(commands[static_cast<std::size_t>(k)]);
        EXPECT_EQ(result, k == 0 ? VL_GOOD : VL_OLD);  // hello is answered, once and with a new number
        EXPECT_EQ(pair.makeState().empty(), k > 0);
        EXPECT_EQ(pair.tick(), VL_HOLD);
        EXPECT_FALSE(pair.robot.has_host);
    }
    EXPECT_EQ(pair.give(commands.back(), kStranger), VL_OTHER_SESSION);
    Pair again(makeKey(), 5678);  // another host hears recorded states
    for (const Packet& state : states) EXPECT_EQ(again.take(state), VL_OTHER_SESSION);
    Pair stranger(makeKey(3));
    EXPECT_EQ(pair.give(stranger.makeCommand(VL_HOLD)), VL_CORRUPT);
    Pair open;
    EXPECT_EQ(pair.give(open.makeCommand(VL_HOLD)), VL_CORRUPT);
}

/** Nobody has the robot before a command of its session was judged. */
TEST(Link, ASessionBeginsWithAGoodAndRecentHold) {
    Pair pair(makeKey());
    const auto hello = [&] {
        EXPECT_EQ(pair.give(pair.makeCommand(VL_HOLD)), VL_GOOD);
        pair.tick();
        EXPECT_EQ(pair.take(pair.makeState()), VL_GOOD);
        EXPECT_TRUE(pair.makeState().empty());  // answered once
    };
    pair.tick();
    pair.host.last_sequence = 0;
    hello();
    const auto expectUnclaimed = [&](const Packet& packet, vl_result result) {
        EXPECT_EQ(pair.give(packet), result);
        EXPECT_FALSE(pair.robot.has_host);
        EXPECT_EQ(vl_robot_peer(&pair.robot), 0u);
        EXPECT_EQ(pair.tick(), VL_HOLD);
    };
    expectUnclaimed(pair.makeCommand(VL_TORQUE, 1.0), VL_OTHER_SESSION);
    expectUnclaimed(pair.makeCommand(VL_STOP), VL_OTHER_SESSION);
    pair.host.last_sequence += 1000;
    expectUnclaimed(pair.makeCommand(VL_HOLD), VL_INVALID);
    pair.host.last_sequence -= 1000;
    pair.host.joints = 6;
    expectUnclaimed(pair.makeCommand(VL_HOLD), VL_OTHER_JOINTS);
    pair.host.joints = kJoints;
    ++pair.host.session.robot;
    expectUnclaimed(pair.makeCommand(VL_HOLD), VL_OTHER_SESSION);
    --pair.host.session.robot;
    const Packet keptBack = pair.makeCommand(VL_HOLD);
    EXPECT_EQ(pair.give(keptBack, kStranger), VL_OTHER_SESSION);  // the number is another caller's
    for (std::uint32_t k = 0; k <= pair.robot.release_ticks; ++k) pair.tick();
    expectUnclaimed(keptBack, VL_OLD);
    vl_host_init(&pair.host, kJoints, kTick_s, 4321, kRobotsAddress);
    pair.host.key = makeKey();
    pair.connect();
}

/** A stranger who has recorded hello sends it in each tick, a hundred times as often as the host calls. */
TEST(Link, AHelloThatIsReplayedTakesNothingFromTheHost) {
    Pair recorded(makeKey());
    const Packet hello = recorded.makeCommand(VL_HOLD);
    int slowest = 0;
    for (std::uint64_t number = 1; number <= 50; ++number) {
        Pair pair(makeKey(), 2 * number, 100 + number);
        const int ticks = pair.callAmongStrangers(3000, [&](int tick) {
            for (int i = 0; i < 10; ++i)
                EXPECT_EQ(pair.give(hello, i % 2 ? kStranger : kHostsAddress),
                          pair.robot.has_host ? VL_OTHER_SESSION : VL_GOOD);
            if (tick % 10 == 0) pair.give(pair.makeCommand(VL_HOLD));
        });
        slowest = std::max(slowest, ticks);
        ASSERT_TRUE(pair.host.is_connected);
        pair.exchange(VL_TORQUE, 1.0);
        EXPECT_EQ(pair.give(hello, kStranger), VL_OTHER_SESSION);
        EXPECT_EQ(pair.tick(), VL_TORQUE);
    }
    EXPECT_LT(slowest, 1500);  // of 11 callers one is answered: 1500 ticks are 150 calls, missed all once in 1e6
}

/** A stranger fills each tick with hellos from one address, each of another session, while a host that calls each 10 ticks is heard
once among them. */
TEST(Link, AFloodOfHellosFromOneAddressKeepsNoHostAway) {
    std::mt19937_64 random(7);
    int slowest = 0, all = 0;
    for (std::uint64_t number = 1; number <= 50; ++number) {
        Pair pair({}, 2 * number, 100 + number), stranger;
        const int ticks = pair.callAmongStrangers(20000, [&](int tick) {
            const auto at = static_cast<int>(random() % 63);
            for (int i = 0; i < 63; ++i) {
                if (i == at && tick % 10 == 0) pair.give(pair.makeCommand(VL_HOLD));
                vl_host_init(&stranger.host, kJoints, kTick_s, random(), kRobotsAddress);
                pair.give(stranger.makeCommand(VL_HOLD), kStranger);
            }
        });
        slowest = std::max(slowest, ticks);
        all += ticks;
    }
    std::printf("  connected after %d ticks in the mean, %d at most\n", all / 50, slowest);
    EXPECT_LT(slowest, 300);  // one of two addresses is answered: 300 ticks are 30 calls, missed all once in 1e9
}

/** Whatever comes, is lost or comes late: from one tick to the next no torque changes by more than torque_step, nor into the
robot's own hold, out of it, and through nonsense of its own. */
TEST(Fault83, NoTorqueStepsFartherThanTheRobotAllows) {
    std::mt19937_64 random(static_cast<std::uint64_t>(getSeed(4)));
    std::uniform_real_distribution<double> number(-60.0, 60.0), share(0.0, 1.0);
    const double step = 0.75, limit = 50.0;
    Pair pair;
    std::fill(pair.robot.torque_step, pair.robot.torque_step + kJoints, step);
    std::fill(pair.robot.torque_limit, pair.robot.torque_limit + kJoints, limit);
    const std::vector<double> weight(kJoints, 20.0);
    vl_robot_note(&pair.robot, weight.data());
    pair.connect();
    std::vector<double> last = weight, hostWants(kJoints, 20.0);
    Packet late;
    int driven = 0, held = 0, lapses = 0;
    double largest = 0.0;
    for (int k = 0; k < countOf(50000); ++k) {
        std::vector<double> tau(kJoints, 0.0);
        vl_mode mode = vl_robot_tick(&pair.robot, tau.data());
        if (mode == VL_TORQUE) {
            ++driven;
        } else {
            ++held;
            for (double& one : tau)
                one = share(random) < 0.02 ? std::numeric_limits<double>::quiet_NaN() : number(random);
            vl_robot_limit(&pair.robot, tau.data());
        }
        for (std::size_t i = 0; i < kJoints; ++i) {
            ASSERT_TRUE(std::isfinite(tau[i]));
            ASSERT_LE(std::abs(tau[i]), limit);
            largest = std::max(largest, std::abs(tau[i] - last[i]));
        }
        last = tau;
        const bool wasLapsed = pair.heard.flags & VL_LAPSED;
        pair.take(pair.makeState());
        if (!wasLapsed && (pair.heard.flags & VL_LAPSED)) ++lapses;
        // The host keeps the rate itself, and goes on while its packets are lost; or jumps.
        const bool jumps = share(random) < 0.1;
        for (double& one : hostWants) one = jumps ? number(random) : one + step * (2.0 * share(random) - 1.0);
        const bool holds = (pair.heard.flags & VL_LAPSED) || share(random) < 0.01;
        const Packet packet = pair.makeCommand(holds ? VL_HOLD : VL_TORQUE, hostWants);
        const double fate = share(random);
        if (fate < 0.4) pair.give(packet);
        if (fate > 0.4 && fate < 0.6) late = packet;
        if (fate > 0.9 && !late.empty()) pair.give(late);
    }
    EXPECT_LE(largest, step * (1.0 + 1e-12));
    EXPECT_GT(largest, 0.999 * step);
    EXPECT_GT(driven, countOf(5000));
    EXPECT_GT(held, countOf(500));
    EXPECT_GT(lapses, countOf(100));
}

TEST(Fault84, ARobotThatStartedAnewIsAnotherOne) {
    Pair pair;
    pair.connect();
    pair.exchange(VL_TORQUE, 1.0);
    vl_robot_init(&pair.robot, kJoints, kTick_s, 4712);
    pair.tick();
    EXPECT_EQ(pair.give(pair.makeCommand(VL_TORQUE, 1.0)), VL_OTHER_SESSION);
    EXPECT_TRUE(pair.makeState().empty());
    EXPECT_EQ(pair.tick(), VL_HOLD);
}

/** 1e5 packets, each a good one with 1 to 8 bytes changed, cut off, longer, or nothing but chance: whatever the other bytes
are, nothing acts. */
TEST(Fault83, AHundredThousandMutatedPacketsChangeNothing) {
    std::mt19937_64 random(static_cast<std::uint64_t>(getSeed(1)));
    for (const vl_key& key : {vl_key{}, makeKey()}) {
        Pair pair(key);
        pair.connect();
        pair.exchange(VL_TORQUE, 1.0);
        pair.tick();
        const Packet goodState = pair.makeState();
        ASSERT_EQ(pair.take(goodState), VL_GOOD);
        pair.tick();
        const Packet nextState = pair.makeState(), command = pair.makeCommand(VL_TORQUE, 2.0, 50);
        const vl_robot robot = pair.robot;
        const vl_host host = pair.host;
        const vl_state heard = pair.heard;
        for (int k = 0; k < 50000; ++k) {
            const bool isCommand = k % 2;
            Packet packet = isCommand ? command : nextState;
            const Packet original = packet;
            const auto kind = random() % 4;
            if (kind == 0) packet.resize(random() % packet.size());
            if (kind == 1) packet.resize(random() % (VL_MAX_PACKET + 2));
            if (kind == 1)
                for (std::uint8_t& byte : packet) byte = static_cast<std::uint8_t>(random());
            for (std::uint64_t changes = kind > 1 ? 1 + random() % 8 : 0; changes > 0; --changes)
                packet[random() % packet.size()] = static_cast<std::uint8_t>(random());
            if (packet == original) continue;
            ASSERT_NE(isCommand ? pair.give(packet) : pair.take(packet), VL_GOOD) << k;
        }
        std::memcpy(pair.robot.counts, robot.counts, sizeof robot.counts);
        std::memcpy(pair.host.counts, host.counts, sizeof host.counts);
        pair.host.other_version = host.other_version;
        EXPECT_EQ(std::memcmp(&pair.robot, &robot, sizeof robot), 0);
        EXPECT_EQ(std::memcmp(&pair.host, &host, sizeof host), 0);
        EXPECT_EQ(std::memcmp(&pair.heard, &heard, sizeof heard), 0);
        EXPECT_EQ(pair.give(command), VL_GOOD);
        EXPECT_EQ(pair.take(nextState), VL_GOOD);
    }
}

/** A line that loses, delays, doubles and reorders, for 20 s of ticks: the torque that acts is never older than allowed, and
every tick that the host has not heard of is counted as lost. */
TEST(Fault83, OnABadLineNoTorqueIsOlderThanAllowed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(getSeed(2)));
    Pair pair;
    pair.connect();
    std::vector<std::pair<std::uint64_t, Packet>> toHost, toRobot;  // when, what
    std::uint64_t good = 0;
    const std::uint64_t begin = pair.host.last_sequence, lostBefore = pair.host.lost;
    const auto post = [&](std::vector<std::pair<std::uint64_t, Packet>>& line, const Packet& packet) {
        if (random() % 10 == 0) return;
        const int copies = random() % 10 == 0 ? 2 : 1;
        for (int i = 0; i < copies; ++i)
            line.emplace_back(pair.robot.tick + (random() % 5 == 0 ? random() % 8 : 0), packet);
    };
    const auto deliver = [&](std::vector<std::pair<std::uint64_t, Packet>>& line, const auto& use) {
        for (std::size_t i = 0; i < line.size();)
            if (line[i].first <= pair.robot.tick) {
                const Packet packet = line[i].second;
                line.erase(line.begin() + static_cast<std::ptrdiff_t>(i));
                use(packet);
            } else {
                ++i;
            }
    };
    std::uint64_t torqueTicks = 0;
    for (int k = 0; k < 20000; ++k) {
        deliver(toRobot, [&](const Packet& packet) { pair.give(packet); });
        if (pair.tick() == VL_TORQUE) {
            ++torqueTicks;
            // Commands carry the tick that they answer.
            const auto answered = static_cast<std::uint64_t>(pair.torque[0]);
            ASSERT_GE(pair.robot.tick, answered + 1);
            ASSERT_LE(pair.robot.tick, answered + 1 + 3);
        }
        post(toHost, pair.makeState());
        bool isNew = false;
        deliver(toHost, [&](const Packet& packet) {
            if (pair.take(packet) != VL_GOOD) return;
            ++good;
            isNew = true;
        });
        if (isNew)
            post(toRobot, pair.heard.flags & VL_LAPSED
                              ? pair.makeCommand(VL_HOLD)
                              : pair.makeCommand(VL_TORQUE, static_cast<double>(pair.host.last_sequence)));
    }
    EXPECT_GT(torqueTicks, 10000u);
    EXPECT_GT(pair.robot.counts[VL_OLD] + pair.robot.counts[VL_DUPLICATE], 100u);
    EXPECT_EQ(pair.host.last_sequence - begin, good + pair.host.lost - lostBefore);
}

// --- Transports ---------------------------------------------------------------------------------

/** A name of shared memory that no other test has. */
std::string makeName() {
    static std::atomic<int> count{0};
    return "shm:viable-test-" + std::to_string(getpid()) + "-" + std::to_string(++count);
}

struct Line {
    Line(const std::string& address, bool isRobot) {
        EXPECT_EQ(vl_line_open(&line, address.c_str(), isRobot, error, sizeof error), 0) << error;
    }
    ~Line() { vl_line_close(&line); }
    Line(const Line&) = delete;
    Line& operator=(const Line&) = delete;
    vl_line line;
    char error[256] = "";
};

/** A line that cannot be opened: what is said. */
std::string refuseLine(const std::string& address, bool isRobot) {
    vl_line line;
    char error[256] = "";
    EXPECT_EQ(vl_line_open(&line, address.c_str(), isRobot, error, sizeof error), -1) << address;
    return error;
}

/** The next good state; zeros where none comes in time. */
vl_state hear(vl_host& host, Line& line, std::int64_t timeout_ns) {
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    std::uint64_t peer = 0;
    vl_state heard{};
    while (const std::size_t size = vl_line_receive(&line.line, bytes, timeout_ns, &peer))
        if (vl_host_receive(&host, bytes, size, peer, &heard) == VL_GOOD) break;
    return heard;
}

std::string localhost(const vl_line& line) {
    return "127.0.0.1:" + std::to_string(vl_line_port(&line));
}

/** Connects over a line and exchanges torques, in lock step. */
void exchangeOver(const std::string& address) {
    Line robotEnd(address, true);
    const std::string called = address.rfind("shm:", 0) == 0 ? address
                                                             : address.substr(0, address.rfind(':') + 1) +
                                                                   std::to_string(vl_line_port(&robotEnd.line));
    Line hostEnd(called, false);
    vl_robot robot;
    vl_robot_init(&robot, kJoints, kTick_s, vl_random());
    vl_host host;
    vl_host_init(&host, kJoints, kTick_s, vl_random(), vl_line_peer(&hostEnd.line));
    double torque[VL_MAX_JOINTS] = {}, wanted[VL_MAX_JOINTS] = {};
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    int driven = 0;
    for (int k = 0; k < 100; ++k) {
        vl_robot_poll(&robot, &robotEnd.line);
        if (vl_robot_tick(&robot, torque) == VL_TORQUE) ++driven;
        vl_state state{};
        state.q[0] = k;
        vl_robot_send(&robot, &robotEnd.line, &state);
        const vl_state heard = hear(host, hostEnd, k > 2 ? 1'000'000'000 : 0);
        if (k > 2) EXPECT_EQ(heard.q[0], k);
        wanted[0] = k;
        const std::size_t size = vl_host_command(&host, k > 10 ? VL_TORQUE : VL_HOLD, wanted, 3, bytes);
        EXPECT_EQ(vl_line_send(&hostEnd.line, bytes, size), 0);
    }
    EXPECT_EQ(driven, 88);
    EXPECT_EQ(host.lost, 0u);
    const std::int64_t begin = vl_now_ns();  // nothing more comes: it waits as long as it is told
    std::uint64_t peer = 0;
    EXPECT_EQ(vl_line_receive(&hostEnd.line, bytes, 20'000'000, &peer), 0u);
    EXPECT_GE(vl_now_ns() - begin, 20'000'000);
}

TEST(LinkLine, Udp) {
    exchangeOver("127.0.0.1:0");
}
TEST(LinkLine, Udp6) {
    vl_line line;
    char error[256];
    if (vl_line_open(&line, "[::1]:0", 1, error, sizeof error) != 0) GTEST_SKIP() << "no IPv6 here: " << error;
    vl_line_close(&line);
    exchangeOver("[::1]:0");
}
TEST(LinkLine, SharedMemory) {
    exchangeOver(makeName());
}

TEST(LinkLine, AddressesAreNumbersOnly) {
    sockaddr_storage address;
    socklen_t size = 0;
    for (const char* good : {"127.0.0.1:0", "10.0.0.2:65535", "[::1]:47100", "[fe80::1]:1"})
        EXPECT_EQ(vl_parse_address(good, &address, &size), 0) << good;
    for (const char* bad : {"", ":", "localhost:1", "127.0.0.1", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1",
                            "127.0.0.1:1x", "::1:1", "[::1:1", "[]:1", "[127.0.0.1]:1", "1.2.3:4", ":47100"})
        EXPECT_EQ(vl_parse_address(bad, &address, &size), -1) << bad;
    EXPECT_EQ(refuseLine("localhost:1", false).find("an address is numeric"), 0u);
    refuseLine("shm:a/b", false);
    EXPECT_EQ(refuseLine(makeName(), false).find("there is no robot"), 0u);
}

TEST(LinkLine, OneRobotPerAddress) {
    const std::string name = makeName();
    const Line first(name, true);
    EXPECT_EQ(refuseLine(name, true), "another robot has this shared memory");
    const Line udp("127.0.0.1:0", true);
    EXPECT_EQ(refuseLine(localhost(udp.line), true).find("this address cannot be listened at"), 0u);
}

TEST(LinkLine, PacketsOfStrangersAndEmptyOnesAreTold) {
    const Line robotEnd("127.0.0.1:0", true);
    const std::string called = localhost(robotEnd.line);
    Line one(called, false), two(called, false);
    vl_line robotLine = robotEnd.line;
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    const Packet longer(2000, 1);
    vl_line_send(&one.line, longer.data(), longer.size());
    vl_line_send(&two.line, longer.data(), 0);
    std::uint64_t first = 0, second = 0;
    EXPECT_EQ(vl_line_receive(&robotLine, bytes, 1'000'000'000, &first), std::size_t(VL_MAX_PACKET + 1));
    EXPECT_EQ(vl_line_receive(&robotLine, bytes, 1'000'000'000, &second), 1u);
    EXPECT_NE(first, second);
    EXPECT_NE(first, 0u);
}

void killAndWait(pid_t pid) {
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
}

/** A writer that is killed 200 times, at any moment or, every other time, in mid-packet: the reader never takes half a packet,
waits no longer than it is told, and hears the next writer, who finds the place free. */
TEST(Fault86, AKilledWriterOfSharedMemoryLeavesNothingBehind) {
    const std::string name = makeName();
    Line robotEnd(name, true);
    std::mt19937_64 random(3);
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    int half[2], heard[2];
    ASSERT_EQ(pipe(half), 0);
    ASSERT_EQ(pipe(heard), 0);
    for (int round = 0; round < 200; ++round) {
        const bool diesInMidPacket = round % 2 == 1;
        const int whole = 10 + static_cast<int>(random() % 100);
        const pid_t writer = fork();
        if (writer == 0) {
            vl_line line;
            char error[256];
            if (vl_line_open(&line, name.c_str(), 0, error, sizeof error) != 0) _exit(1);
            char x = 0;
            fcntl(heard[0], F_SETFL, O_NONBLOCK);
            for (int k = 0; !diesInMidPacket || k < whole || read(heard[0], &x, 1) != 1; ++k) {
                const Packet packet(static_cast<std::size_t>(100 + k % 3 * 100), static_cast<std::uint8_t>(k % 252));
                vl_line_send(&line, packet.data(), packet.size());  // each of one byte's value, of its own size
            }
            vl_mailbox* const box = &line.shared->command;  // as vl_mailbox_write() does, up to its middle
            __atomic_store_n(&box->number, box->number | 1u, __ATOMIC_SEQ_CST);
            __atomic_store_n(&box->size, 300u, __ATOMIC_SEQ_CST);
            __atomic_store_n(&box->words[0], UINT64_C(0x0123456789abcdef), __ATOMIC_SEQ_CST);
            if (write(half[1], "x", 1) != 1) _exit(1);
            for (;;) pause();
        }
        struct Killed {  // also where the test ends early
            const pid_t pid;
            ~Killed() { killAndWait(pid); }
        } const killed{writer};
        const std::int64_t begin = vl_now_ns();
        const std::int64_t end = begin + 500'000 + static_cast<std::int64_t>(random() % 2'000'000);
        std::uint64_t peer = 0;
        for (int now = 0; vl_now_ns() < end || now == 0;) {
            ASSERT_LT(vl_now_ns() - begin, 10'000'000'000) << "the next writer is not heard";
            const std::size_t size = vl_line_receive(&robotEnd.line, bytes, 100'000, &peer);
            if (size == 0) continue;
            ++now;
            ASSERT_EQ(size, 100u + bytes[0] % 3 * 100u);
            for (std::size_t i = 1; i < size; ++i) ASSERT_EQ(bytes[i], bytes[0]);
        }
        if (diesInMidPacket) {
            char x = 'x';
            ASSERT_EQ(write(heard[1], &x, 1), 1);
            ASSERT_EQ(read(half[0], &x, 1), 1);
        }
        kill(writer, SIGKILL);
        siginfo_t status{};  // it stays to be waited for, so that `killed` hits nobody else
        ASSERT_EQ(waitid(P_PID, static_cast<id_t>(writer), &status, WEXITED | WNOWAIT), 0);
        ASSERT_EQ(status.si_code, CLD_KILLED);
        if (diesInMidPacket) {
            ASSERT_EQ(robotEnd.line.shared->command.number & 1u, 1u);
            const std::int64_t before = vl_now_ns();
            EXPECT_EQ(vl_line_receive(&robotEnd.line, bytes, 1'000'000, &peer), 0u);
            ASSERT_LT(vl_now_ns() - before, 1'000'000'000);
        }
    }
    for (const int end : {half[0], half[1], heard[0], heard[1]}) close(end);
}

/** Starts a process that holds this end of a line until it is killed. */
pid_t startHolder(const std::string& name, bool isRobot) {
    int ready[2];
    EXPECT_EQ(pipe(ready), 0);
    const pid_t pid = fork();
    if (pid == 0) {
        vl_line line;
        char error[256];
        const char ok = vl_line_open(&line, name.c_str(), isRobot, error, sizeof error) == 0 ? 'y' : 'n';
        if (write(ready[1], &ok, 1) != 1) _exit(1);
        for (;;) pause();
    }
    char ok = 'n';
    EXPECT_EQ(read(ready[0], &ok, 1), 1);
    EXPECT_EQ(ok, 'y');
    for (const int end : ready) close(end);
    return pid;
}

/** One host at a time over shared memory, too; a killed one does not keep the robot. */
TEST(Fault86, AKilledHostGivesTheSharedMemoryToTheNextOne) {
    const std::string name = makeName();
    const Line robotEnd(name, true);
    const pid_t host = startHolder(name, false);
    EXPECT_EQ(refuseLine(name, false), "another host has this robot");
    killAndWait(host);
    const Line next(name, false);
}

TEST(LinkLine, SharedMemoryThatOthersCanWriteToOrThatNoRobotHasIsRefused) {
    const std::string name = makeName(), file = "/" + name.substr(4);
    for (const mode_t mode : {0620, 0602, 0666}) {
        const int fd = shm_open(file.c_str(), O_RDWR | O_CREAT, 0600);
        ASSERT_GE(fd, 0);
        ASSERT_EQ(fchmod(fd, mode), 0);
        for (const bool isRobot : {false, true})
            EXPECT_EQ(refuseLine(name, isRobot),
                      "other users can write to this shared memory: remove it from /dev/shm, or take another name");
        close(fd);
        shm_unlink(file.c_str());
    }
    if (geteuid() == 0) {  // who else can give a file away?
        const int fd = shm_open(file.c_str(), O_RDWR | O_CREAT, 0600);
        ASSERT_EQ(fchown(fd, 65534, 65534), 0);
        for (const bool isRobot : {false, true})
            EXPECT_EQ(refuseLine(name, isRobot).find("another user owns this shared memory: run both"), 0u);
        close(fd);
        shm_unlink(file.c_str());
    }
    {  // what a killed robot left
        const int fd = shm_open(file.c_str(), O_RDWR | O_CREAT, 0600);
        ASSERT_EQ(ftruncate(fd, sizeof(vl_shared)), 0);
        close(fd);
        EXPECT_EQ(refuseLine(name, false), "there is no robot: the one that had this shared memory is gone");
    }
    exchangeOver(name);
    EXPECT_EQ(shm_open(file.c_str(), O_RDWR, 0600), -1);  // removed at its end
}

/** Robots that come and go under one name: whoever has opened it can be found by hosts. */
TEST(LinkLine, ARobotThatComesWhileAnotherOneGoesIsFound) {
    const std::string name = makeName();
    std::atomic<int> lost{0};
    const auto work = [&] {
        char error[256];
        for (int served = 0; served < 500;) {  // however long another one has it
            vl_line robot, host;
            if (vl_line_open(&robot, name.c_str(), 1, error, sizeof error) != 0) continue;
            ++served;
            if (vl_line_open(&host, name.c_str(), 0, error, sizeof error) == 0)
                vl_line_close(&host);
            else
                ++lost;
            vl_line_close(&robot);
        }
    };
    std::thread one(work), two(work);
    one.join();
    two.join();
    EXPECT_EQ(lost, 0);
}

/** While a robot has a host, packets of others do not even reach it; and afterwards the next one does. */
TEST(LinkLine, AFloodOfStrangersTakesNoTimeFromARobotThatHasAHost) {
    const Line robotEnd("127.0.0.1:0", true);
    const std::string called = localhost(robotEnd.line);
    vl_line robotLine = robotEnd.line;
    const Line stranger(called, false);
    vl_line strangerLine = stranger.line;
    vl_robot robot;
    vl_robot_init(&robot, kJoints, kTick_s, vl_random());
    double torque[VL_MAX_JOINTS] = {}, wanted[VL_MAX_JOINTS] = {};
    std::uint8_t bytes[VL_MAX_PACKET + 1];
    for (int round = 0; round < 2; ++round) {
        Line hostEnd(called, false);
        vl_host host;
        vl_host_init(&host, kJoints, kTick_s, vl_random(), vl_line_peer(&hostEnd.line));
        for (int k = 0; k < 60; ++k) {
            const Packet nonsense(100, static_cast<std::uint8_t>(k));
            if (k > 10)
                for (int i = 0; i < 400; ++i) vl_line_send(&strangerLine, nonsense.data(), nonsense.size());
            const std::uint64_t foreign = robot.counts[VL_OTHER_SESSION];
            vl_robot_poll(&robot, &robotLine);
            EXPECT_LE(robot.counts[VL_OTHER_SESSION] - foreign, std::uint64_t(VL_MOST_PACKETS));
            if (k > 12) EXPECT_EQ(robot.counts[VL_OTHER_SESSION], foreign);
            if (vl_robot_tick(&robot, torque) == VL_TORQUE) {
                EXPECT_EQ(torque[0], k - 1);
            } else {
                ASSERT_LT(k, 8);
            }
            vl_state state{};
            vl_robot_send(&robot, &robotLine, &state);
            hear(host, hostEnd, k > 2 ? 1'000'000'000 : 0);
            wanted[0] = k;
            const vl_mode mode = k > 5 ? VL_TORQUE : VL_HOLD;
            vl_line_send(&hostEnd.line, bytes, vl_host_command(&host, mode, wanted, 0, bytes));
        }
        ASSERT_TRUE(robot.has_host);
        EXPECT_EQ(localhost(robotLine), called);
        vl_line_send(&hostEnd.line, bytes, vl_host_command(&host, VL_STOP, wanted, 0, bytes));
        vl_robot_poll(&robot, &robotLine);
        EXPECT_FALSE(robot.has_host);
        vl_robot_tick(&robot, torque);
    }
}

TEST(Fault86, AKilledRobotGivesItsSharedMemoryToTheNextOne) {
    const std::string name = makeName();
    killAndWait(startHolder(name, true));
    exchangeOver(name);
}

}  // namespace
}  // namespace viable::test
