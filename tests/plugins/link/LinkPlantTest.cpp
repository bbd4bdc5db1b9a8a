// The plant `link` against a robot in a thread of the test, over UDP and shared memory; faults 83 to 86.
#include "LinkPlant.h"

#include <signal.h>
#include <sys/stat.h>
#include <time.h>

#include <cmath>
#include <functional>
#include <thread>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "plugin/FaultExplanation.h"
#include "plugin/StopSignal.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/PluginBench.h"

namespace viable {
namespace {

using testing::AllocationCounter;
using testing::PluginBench;

/** What a robot of the tests is like; what is not said is as the bench's arm. */
struct RobotMind {
    int joints = 2;
    double tick_s = 0.001;
    vl_key key{};
    bool addsGravity = false;
    unsigned flags = VL_ENABLED;
    double torqueFactor = 1.0, gravityShare = 1.0;  // of what it measures
    bool exchangesJoints = false;
    double away = 0.0, velocity = 0.0;  // of joint 1 at rest
    std::int64_t period_ns = 1'000'000;
    /** A tick begins when the last state was answered, as long as there is a host: what the machine does besides changes
    nothing. False: by the clock, each period. */
    bool isInStep = true;
    std::int64_t counted_ns = 1'000'000;         // per tick in its time stamps; 0: what the clock says
    std::function<void(std::uint8_t*)> spoil{};  // its packets
    std::uint64_t latency = 0;                   // of commands [ticks]
};

/** The bench's arm in a thread of its own: moved by torques, held as by a vice without them. */
class TestRobot {
public:
    explicit TestRobot(const std::string& transport, const RobotMind& mind = {})
        : mind_(mind), arm_(testing::makeTwoLinkArm()), model_(arm_) {
        char error[256];
        static std::atomic<int> count{0};
        const std::string name = "shm:viable-link-" + std::to_string(getpid()) + "-" + std::to_string(++count);
        EXPECT_EQ(vl_line_open(&line_, transport == "udp" ? "127.0.0.1:0" : name.c_str(), 1, error, sizeof error), 0)
            << error;
        address = transport == "udp" ? "127.0.0.1:" + std::to_string(vl_line_port(&line_)) : name;
        vl_robot_init(&robot, mind_.joints, mind_.tick_s, vl_random());
        robot.key = mind_.key;
        robot.most_repeats = 10000;
        counted_ns = mind_.counted_ns;
        state_ = {arm_.home, JointVector::Zero(2)};
        state_.q[1] += mind_.away;
        thread_ = std::thread([this] { run(); });
    }
    ~TestRobot() { stop(); }
    TestRobot(const TestRobot&) = delete;
    TestRobot& operator=(const TestRobot&) = delete;

    void stop() {
        ends_ = true;
        if (!thread_.joinable()) return;
        thread_.join();
        vl_line_close(&line_);
    }

    std::string address;
    vl_robot robot;  // to be read after stop()
    std::atomic<unsigned> moreFlags{0}, lessFlags{0};
    std::atomic<bool> isSilent{false}, isDeaf{false}, saysNan{false}, changesTick{false};
    std::atomic<std::int64_t> counted_ns{0};
    std::atomic<double> firstTorque{std::numeric_limits<double>::quiet_NaN()};  // of the last tick that was driven

private:
    void poll(std::int64_t timeout_ns) {
        std::uint8_t bytes[VL_MAX_PACKET + 1];
        std::uint64_t peer = 0;
        while (const std::size_t size = vl_line_receive(&line_, bytes, timeout_ns, &peer)) {
            underWay_.push_back({robot.tick + mind_.latency, peer, line_.from, line_.from_size, {bytes, bytes + size}});
            timeout_ns = 0;
        }
        while (!underWay_.empty() && underWay_.front().due <= robot.tick) {
            const Command& next = underWay_.front();
            vl_robot_receive(&robot, next.bytes.data(), next.bytes.size(), next.peer);
            if (vl_robot_peer(&robot) == next.peer) {
                line_.to = next.from;
                line_.to_size = next.fromSize;
            }
            underWay_.pop_front();
        }
    }

    void awaitTick(std::int64_t& next) {
        if (mind_.isInStep && !isDeaf) {
            const std::uint64_t heard = robot.counts[VL_GOOD];
            const std::int64_t end = vl_now_ns() + (robot.acts == VL_TORQUE ? 5'000'000'000 : 10'000'000);
            while (!ends_ && !isDeaf && robot.counts[VL_GOOD] == heard && vl_now_ns() < end) poll(1'000'000);
            return;
        }
        next = std::max(next + mind_.period_ns, vl_now_ns() - mind_.period_ns);
        const timespec until{static_cast<time_t>(next / 1'000'000'000), static_cast<long>(next % 1'000'000'000)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
        if (!isDeaf) poll(0);
    }

    void run() {
        std::int64_t next = vl_now_ns();
        double torque[VL_MAX_JOINTS] = {};
        std::int64_t time_ns = 0;
        while (!ends_) {
            Dynamics dynamics;
            model_.calcDynamics(state_.q, state_.qd, dynamics);
            JointVector motors = dynamics.gravity;
            if (vl_robot_tick(&robot, torque) == VL_TORQUE) {
                for (int i = 0; i < 2; ++i) motors[i] = torque[i] + (mind_.addsGravity ? dynamics.gravity[i] : 0.0);
                firstTorque = torque[0];
                JointVector acceleration;
                calcForwardDynamics(dynamics, motors, acceleration);
                state_.qd += mind_.tick_s * acceleration;
                state_.q += mind_.tick_s * state_.qd;
            } else {
                state_.qd.setZero();
            }
            if (changesTick) robot.tick_ns = 2'000'000;
            vl_state out{};
            time_ns += counted_ns;
            out.time_ns = counted_ns == 0 ? vl_now_ns() : time_ns;
            out.flags = (mind_.flags | moreFlags | (mind_.addsGravity ? unsigned(VL_ADDS_GRAVITY) : 0u)) & ~lessFlags;
            for (int i = 0; i < 2; ++i) {
                const int from = mind_.exchangesJoints ? 1 - i : i;
                out.q[i] = saysNan ? std::numeric_limits<double>::quiet_NaN() : state_.q[i];
                out.qd[i] = state_.qd[i] + (i == 1 ? mind_.velocity : 0.0);
                out.tau[i] = mind_.torqueFactor * (motors[from] + (mind_.gravityShare - 1.0) * dynamics.gravity[from] -
                                                   (mind_.addsGravity ? dynamics.gravity[from] : 0.0));
            }
            out.external[0] = static_cast<double>(robot.tick);
            out.external[1] = 0.5;
            std::uint8_t packet[VL_MAX_PACKET];
            const std::size_t size = isSilent ? 0 : vl_robot_state(&robot, &out, packet);
            if (size > 0 && mind_.spoil) mind_.spoil(packet);
            if (size > 0) vl_line_send(&line_, packet, size);
            awaitTick(next);
        }
    }

    struct Command {
        std::uint64_t due, peer;
        sockaddr_storage from;
        socklen_t fromSize;
        std::vector<std::uint8_t> bytes;
    };
    const RobotMind mind_;
    const RobotDescription arm_;
    RobotModel model_;
    vl_line line_{};
    JointState state_;
    std::deque<Command> underWay_;
    std::atomic<bool> ends_{false};
    std::thread thread_;
};

/** A robot that differs in this. */
template <class T, class Value>
RobotMind makeMind(T RobotMind::*part, const Value& value, RobotMind mind = {}) {
    mind.*part = value;
    return mind;
}

/** One that lives by the clock. */
const RobotMind kClocked = makeMind(&RobotMind::isInStep, false);

void sleepFor(double seconds) {
    const timespec pause{0, static_cast<long>(seconds * 1e9)};
    nanosleep(&pause, nullptr);
}

std::string say(const TestRobot& robot, const std::string& more = "", const std::string& silence_s = "1") {
    return "address: \"" + robot.address + "\", silence_timeout_s: " + silence_s +
           (more.find("repeat_ticks") == std::string::npos ? ", repeat_ticks: 1000" : "") +
           (more.find("connect_timeout_s") == std::string::npos ? ", connect_timeout_s: 5" : "") +
           (more.empty() ? "" : ", " + more);
}

/** The text with which a run with this robot is refused. */
std::string refusal(const RobotMind& mind, const std::string& more = "") {
    const PluginBench bench;
    TestRobot robot("udp", mind);
    LinkPlant plant;
    const std::string told = test::catchError([&] { bench.configure(plant, say(robot, more)); });
    test::expectContains(told, {"test.yaml:1"});
    return told;
}

/** A robot and the plant that has called it. */
struct Linked {
    explicit Linked(const std::string& transport = "udp", const RobotMind& mind = {}, const std::string& more = "",
                    const std::string& silence_s = "1")
        : robot(transport, mind) {
        bench.configure(plant, say(robot, more, silence_s));
    }

    /** Drives joint 0 with 1 rad/s^2 for `ticks`. */
    void drive(int ticks) {
        Dynamics dynamics;
        JointVector torque;
        const JointVector acceleration = JointVector::Unit(2, 0);
        for (int k = 0; k < ticks; ++k) {
            ASSERT_EQ(plant.read(passed), TickStatus::Ok) << detail::readFaultExplanation();
            ASSERT_GE(passed, 1);
            model.calcDynamics(plant.measured().q, plant.measured().qd, dynamics);
            calcInverseDynamics(dynamics, acceleration, torque);
            ASSERT_EQ(plant.advance(torque, applied), TickStatus::Ok);
            ASSERT_LT((applied - torque).cwiseAbs().maxCoeff(), 1e-9);  // what it held is the model's but for rounding
        }
    }
    /** A tick in which the arm is carried; a torque is sent where the reading is good. @return how the reading ended */
    TickStatus carry() {
        const TickStatus status = plant.read(passed);
        if (status == TickStatus::Ok) plant.advance(bench.dynamics().gravity, applied);
        return status;
    }

    const PluginBench bench;
    TestRobot robot;
    LinkPlant plant;
    RobotModel model{bench.setup().robot};
    std::int64_t passed = 0;
    JointVector applied;
};

class LinkOver : public ::testing::TestWithParam<const char*> {};

TEST_P(LinkOver, AnArmIsDrivenAndEachRunBeginsAnew) {
    Linked arm(GetParam());
    const PluginBench& bench = arm.bench;
    LinkPlant& plant = arm.plant;
    EXPECT_TRUE(plant.traits().hasClock);
    EXPECT_EQ(plant.traits().delayTicks, 1);
    EXPECT_EQ(plant.externalTorque(), nullptr);
    EXPECT_NEAR((plant.measured().q - bench.state().q).norm(), 0.0, 1e-12);
    arm.drive(300);  // 299 of its torques have acted when the last state was read, a tick late each
    EXPECT_NEAR(plant.measured().qd[0], 0.298, 3e-3);
    EXPECT_NEAR(plant.measured().qd[1], 0.0, 3e-3);
    EXPECT_NEAR(plant.measured().q[0] - bench.state().q[0], 0.5 * 0.298 * 0.298, 1e-3);
    EXPECT_THROW(plant.reset(bench.state()), Error);  // it has moved
    EXPECT_EQ(plant.advance(bench.dynamics().b, arm.applied), TickStatus::Faulted);
    const JointVector home = plant.measured().q;
    plant.reset({home, JointVector::Zero(2), JointVector::Zero(2)});
    arm.drive(20);
}

/** Exactly those, by the robot's own numbers, which these states bear as a torque. */
TEST_P(LinkOver, Fault83TicksThatTheHostSleptAreMissedTicks) {
    Linked arm(GetParam(), makeMind(&RobotMind::flags, VL_ENABLED | VL_HAS_EXTERNAL, kClocked),
               "external_torque: true");
    sleepFor(0.05);  // before the first read() nothing is missed
    ASSERT_EQ(arm.plant.read(arm.passed), TickStatus::Ok);
    EXPECT_EQ(arm.passed, 1);
    for (const double pause_s : {0.05, 0.002, 0.3, 0.0}) {
        const double before = (*arm.plant.externalTorque())[0];
        sleepFor(pause_s);
        ASSERT_EQ(arm.plant.read(arm.passed), TickStatus::Ok);
        EXPECT_EQ(static_cast<double>(arm.passed), (*arm.plant.externalTorque())[0] - before);
        EXPECT_GE(static_cast<double>(arm.passed), 1e3 * pause_s / 20.0);  // it did tick, on any machine
    }
}

TEST_P(LinkOver, Fault84ARobotThatIsSilentIsGone) {
    Linked arm(GetParam(), {}, "", "0.5");
    LinkPlant& plant = arm.plant;
    arm.drive(10);
    arm.robot.isSilent = true;
    const std::int64_t begin = vl_now_ns();
    TickStatus status = TickStatus::Ok;
    for (int k = 0; k < 10 && status == TickStatus::Ok; ++k) status = plant.read(arm.passed);
    EXPECT_EQ(status, TickStatus::Faulted);
    EXPECT_GE(vl_now_ns() - begin, 500'000'000);
    const std::string why = detail::readFaultExplanation();
    EXPECT_CONTAINS(why, "it cannot drive the robot at " + arm.robot.address +
                             " any more: no state has come for 0.5 s; see that it and the line are up (packets: ");
    EXPECT_EQ(plant.advance(arm.bench.dynamics().b, arm.applied), TickStatus::Faulted);
    EXPECT_EQ(plant.read(arm.passed), TickStatus::Faulted);
    EXPECT_EQ(detail::readFaultExplanation(), why);
}

INSTANTIATE_TEST_SUITE_P(All, LinkOver, ::testing::Values("udp", "shm"),
                         [](const auto& test) { return std::string(test.param); });

TEST(LinkPlant, ATickAllocatesNothing) {
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    Linked arm;
    LinkPlant& plant = arm.plant;
    const JointVector gravity = arm.bench.dynamics().gravity;
    int okReads = 0, okTorques = 0;
    TickStatus last = TickStatus::Ok;
    const AllocationCounter counter;
    for (int k = 0; k < 100; ++k) {
        okReads += plant.read(arm.passed) == TickStatus::Ok ? 1 : 0;
        plant.measured();
        okTorques += plant.advance(gravity, arm.applied) == TickStatus::Ok ? 1 : 0;
    }
    arm.robot.moreFlags = VL_FAULT;
    for (int k = 0; k < 20; ++k) {
        last = plant.read(arm.passed);
        plant.advance(gravity, arm.applied);
    }
    EXPECT_EQ(counter.count(), 0);
    EXPECT_EQ(okReads, 100);
    EXPECT_EQ(okTorques, 100);
    EXPECT_EQ(last, TickStatus::Faulted);
}

TEST(LinkPlant, ATorqueThatIsNotFiniteIsNeverSent) {
    Linked arm;
    JointVector applied = JointVector::Constant(2, 5.0), bad = arm.bench.dynamics().gravity;
    bad[1] = std::numeric_limits<double>::quiet_NaN();
    ASSERT_EQ(arm.plant.read(arm.passed), TickStatus::Ok);
    EXPECT_EQ(arm.plant.advance(bad, applied), TickStatus::InvalidInput);
    EXPECT_EQ(applied, JointVector(JointVector::Constant(2, 5.0)));
    EXPECT_EQ(arm.plant.advance(JointVector::Zero(3), applied), TickStatus::InvalidInput);
    sleepFor(0.02);
    EXPECT_TRUE(std::isnan(arm.robot.firstTorque.load()));
    arm.robot.stop();
    EXPECT_EQ(arm.robot.robot.acts, VL_HOLD);
}

TEST(LinkPlant, WhereTheRobotAddsGravityItIsSentTheRest) {
    Linked arm("udp", makeMind(&RobotMind::addsGravity, true), "adds_gravity: true");
    Dynamics dynamics;
    for (int k = 0; k < 20; ++k) {
        ASSERT_EQ(arm.plant.read(arm.passed), TickStatus::Ok);
        arm.model.calcDynamics(arm.plant.measured().q, JointVector::Zero(2), dynamics);
        const JointVector wanted = dynamics.gravity + JointVector::Constant(2, 0.5);
        ASSERT_EQ(arm.plant.advance(wanted, arm.applied), TickStatus::Ok);
        EXPECT_NEAR((arm.applied - wanted).norm(), 0.0, 1e-12);
    }
    EXPECT_NEAR(arm.robot.firstTorque, 0.5, 1e-9);
    const JointVector moved = arm.plant.measured().q - arm.bench.state().q;
    EXPECT_GT(moved.norm(), 1e-6);  // by these 0.5 Nm
    EXPECT_LT(moved.norm(), 0.01);
}

TEST(LinkPlant, TorquesAreCutAtTheMotorsAndChangeAsFastAsTheRobotAccepts) {
    const PluginBench bench;
    TestRobot robot("udp");
    std::int64_t passed = 0;
    JointVector applied;
    {
        LinkPlant plant;
        bench.configure(plant, say(robot, "motor_rate_Nmps: 1000"));
        ASSERT_EQ(plant.traits().motorRate.size(), 2);
        EXPECT_EQ(plant.traits().motorRate[0], 1000.0);
        ASSERT_EQ(plant.read(passed), TickStatus::Ok);
        ASSERT_EQ(plant.advance(bench.dynamics().gravity.array() + 50.0, applied), TickStatus::Ok);
        EXPECT_NEAR(applied[0], bench.dynamics().gravity[0] + 1.0, 1e-9);
    }
    LinkPlant other;
    bench.configure(other, say(robot));
    EXPECT_EQ(other.traits().motorRate.size(), 0);
    ASSERT_EQ(other.read(passed), TickStatus::Ok);
    ASSERT_EQ(other.advance(JointVector::Constant(2, 1e5), applied), TickStatus::Ok);
    EXPECT_EQ(applied, bench.setup().robot.actuation.torqueLimit);
}

TEST(LinkPlant, TheTorqueOfTheSurroundingsIsPassedOn) {
    Linked arm("shm", makeMind(&RobotMind::flags, VL_ENABLED | VL_HAS_EXTERNAL), "external_torque: true");
    ASSERT_NE(arm.plant.externalTorque(), nullptr);
    ASSERT_EQ(arm.plant.read(arm.passed), TickStatus::Ok);
    EXPECT_EQ((*arm.plant.externalTorque())[1], 0.5);
}

TEST(LinkPlant, WithAKeyOnlyWhoKnowsItIsHeard) {
    const test::TemporaryFolder folder;
    const std::string file = folder.write("key", "000102030405060708090a0b0c0d0e0f\n");
    const std::string other = folder.write("other", "100102030405060708090a0b0c0d0e0f\n");
    const std::string bad = folder.write("bad", "00010203\n");
    for (const std::string& one : {file, other, bad}) chmod(one.c_str(), 0600);
    RobotMind mind;
    ASSERT_EQ(vl_key_from_hex("000102030405060708090a0b0c0d0e0f", &mind.key), 0);
    Linked("udp", mind, "key_file: " + file).drive(5);
    EXPECT_CONTAINS(refusal(mind, "connect_timeout_s: 0.3, key_file: " + other), "does not answer (tried for 0.3 s)");
    EXPECT_CONTAINS(refusal({}, "key_file: " + bad),
                    ": it does not hold a key of 32 hexadecimal digits; make one: (umask 077;");
    for (const char* mode : {"644", "640", "620", "602"}) {
        chmod(file.c_str(), static_cast<mode_t>(std::strtol(mode, nullptr, 8)));
        EXPECT_CONTAINS(
            refusal({}, "key_file: " + file),
            ": other users can read or write it (mode " + std::string(mode) + "); if nobody did: chmod 600 " + file);
    }
}

TEST(LinkPlant, ARobotThatSendsNoNumbersIsNotOneThatIsSilent) {
    const PluginBench bench;
    TestRobot robot("udp");
    robot.saysNan = true;
    LinkPlant plant;
    EXPECT_CONTAINS(test::catchError([&] { bench.configure(plant, say(robot, "connect_timeout_s: 0.3")); }),
                    "sends states with numbers that are not finite, or that no arm has. See what its driver");
}

TEST(LinkPlant, WhatCannotBeCalledIsRefused) {
    const PluginBench bench;
    for (const char* bad : {"localhost:47100", "127.0.0.1", "robot"}) {
        LinkPlant plant;
        EXPECT_CONTAINS(test::catchError([&] { bench.configure(plant, std::string("address: \"") + bad + "\""); }),
                        std::string("'") + bad + "' is no address of a robot. Write numbers");
    }
    for (const char* absent : {"shm:viable-nobody-has-this", "127.0.0.1:9"}) {
        LinkPlant plant;
        const std::string told = test::catchError(
            [&] { bench.configure(plant, std::string("connect_timeout_s: 0.1, address: \"") + absent + "\""); });
        EXPECT_CONTAINS(told, std::string("the robot at ") + absent);
        EXPECT_CONTAINS(told, "See that `viable robot` or the robot's driver runs");
    }
}

TEST(Fault84, ARobotThatCannotFollowIsRefusedAndInARunEndsIt) {
    const std::pair<int, const char*> refused[] = {
        {VL_ENABLED | VL_BRAKES, "has its brakes closed. Open them at the robot"},
        {VL_ENABLED | VL_FAULT, "reports a fault of its own. Find and clear it"},
        {0, "is not enabled. Switch its motors on"}};
    for (const auto& [flags, why] : refused) EXPECT_CONTAINS(refusal(makeMind(&RobotMind::flags, flags)), why);
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::velocity, 0.5), "connect_timeout_s: 3"),
                    "does not come to rest: its joints move with up to 0.5 rad/s");
    /** Within so many ticks; the robot is then told to stop. */
    const auto expectEnd = [&](const std::function<void(TestRobot&)>& change, const std::string& why, int ticks = 3,
                               const std::string& more = "repeat_ticks: 200") {
        Linked arm("udp", makeMind(&RobotMind::flags, VL_ENABLED | VL_HAS_EXTERNAL), more, "0.3");
        TestRobot& robot = arm.robot;
        arm.drive(5);
        change(robot);
        TickStatus status = TickStatus::Ok;
        int k = 0;
        for (; k < 3000 && status == TickStatus::Ok; ++k) status = arm.carry();
        EXPECT_EQ(status, TickStatus::Faulted) << why;
        EXPECT_LE(k, ticks) << why;
        EXPECT_CONTAINS(detail::readFaultExplanation(), why);
        robot.isDeaf = false;
        sleepFor(0.05);
        robot.stop();
        if (robot.changesTick) return;  // it hears nobody any more
        EXPECT_EQ(robot.robot.acts, VL_STOP) << why;
        EXPECT_FALSE(robot.robot.has_host) << why;
    };
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_BRAKES; },
              "its brakes are closed; see at the robot what closed them");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_FAULT; },
              "it reports a fault of its own; find and clear it at the robot");
    expectEnd([](TestRobot& robot) { robot.lessFlags = VL_ENABLED; },
              "its motors are not enabled; see at the robot what switched them off");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_ADDS_GRAVITY; },
              "gravity is not as adds_gravity says any more");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_ADDS_FRICTION; },
              "friction is not as adds_friction says any more");
    expectEnd([](TestRobot& robot) { robot.lessFlags = VL_HAS_EXTERNAL; },
              "it measures the torque of the surroundings no more", 3, "repeat_ticks: 200, external_torque: true");
    expectEnd(
        [](TestRobot& robot) { robot.isDeaf = true; },
        "it missed commands for longer than repeat_ticks, and holds itself; see what kept this program or the line", 13,
        "repeat_ticks: 10");
    // Late ones that it may repeat so long are no loop any more.
    expectEnd([](TestRobot& robot) { robot.isDeaf = true; },
              " ticks before in the mean of 40, and the gains reckon with delay_ticks: 1", 80, "repeat_ticks: 1000");
    expectEnd([](TestRobot& robot) { robot.saysNan = true; }, " absurd; ticks without a state:");
    expectEnd([](TestRobot& robot) { robot.saysNan = true; },
              " s, but 1 with numbers that are not finite or that no arm has; see what its driver writes into q");
    expectEnd([](TestRobot& robot) { robot.changesTick = true; }, " other tick; ticks without a state:");
    expectEnd([](TestRobot& robot) { robot.counted_ns = 2'000'000; },
              "it says that its tick is 0.001 s, and its time goes on by 0.002 s in each", 200);
    expectEnd([](TestRobot& robot) { robot.counted_ns = -1'000'000; },
              "it says that its tick is 0.001 s, and its time goes on by -0.001 s in each", 200);
}

TEST(Fault84, ATickThatIsNotThatOfItsClockIsRefusedWithBoth) {
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::counted_ns, 2'000'000)),
                    "says that its tick is 0.001 s, and its time goes on by 0.002 s in each. Correct the tick");
    const RobotMind mind = makeMind(&RobotMind::period_ns, 2'000'000, makeMind(&RobotMind::counted_ns, 0, kClocked));
    // Here the computer's clock makes the ticks, and the median of some of them is no round number.
    const std::string why = refusal(mind), said = "says that its tick is 0.001 s, and its time goes on by ";
    ASSERT_NE(why.find(said), std::string::npos) << why;
    EXPECT_NEAR(std::strtod(why.c_str() + why.find(said) + said.size(), nullptr), 0.002, 2e-4) << why;
    // Beyond what a clock may differ; 1 % is tried below.
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::counted_ns, 1'250'001)), "its time goes on by 0.00125 s in each");
    // Late in one tick of four, and otherwise in time: that is no other tick.
    RobotMind late;
    int sent = 0;
    late.spoil = [&sent](std::uint8_t* packet) {
        if (++sent % 4 != 0) return;
        vl_put(packet + 48, vl_get(packet + 48, 8) + 900'000, 8);
        const std::size_t size = vl_packet_size(VL_IS_STATE, 2);
        const vl_key none{};
        vl_make_tag(packet, size, &none, packet + size - VL_TAG_SIZE);
    };
    Linked("udp", late).drive(200);
}

/** 10 ticks to the robot, where the gains reckon with one. */
TEST(Fault83, ALineThatIsSlowerThanTheFileSaysIsRefused) {
    const RobotMind mind = makeMind(&RobotMind::latency, 10, kClocked);
    const std::string why = refusal(mind);
    EXPECT_CONTAINS(why, "ticks after the state that it answers (median of ");
    EXPECT_CONTAINS(
        why, "and the file says delay_ticks: 1. See what slows the line or this computer, or write delay_ticks: 1");
    Linked arm("udp", mind, "delay_ticks: 11");
    arm.drive(50);
    EXPECT_GT(arm.plant.measured().qd[0], 0.01);
}

/** Its packets make the ticks, whatever another clock says. */
TEST(Fault84, AClockOnePercentFastOrSlowIsFollowed) {
    for (const std::int64_t period_ns : {990'000, 1'010'000}) {
        RobotMind mind = kClocked;
        mind.period_ns = mind.counted_ns = period_ns;
        Linked arm("udp", mind);
        arm.drive(1);
        const std::int64_t begin = vl_now_ns();
        arm.drive(100);
        EXPECT_GE(vl_now_ns() - begin, 98 * period_ns);
    }
}

/** As where all answers come too late: the run does not go on beside an arm that nobody drives, and would have to catch up
with the nominal one in a jump. */
TEST(Fault83, ARobotThatTakesNoTorqueEndsTheRunBeforeTheArmsAreApart) {
    Linked arm("udp", kClocked, "repeat_ticks: 1000");
    arm.robot.isDeaf = true;
    TickStatus status = TickStatus::Ok;
    int torques = 0;
    for (; torques < 1000 && status == TickStatus::Ok; ++torques) status = arm.carry();
    EXPECT_EQ(status, TickStatus::Faulted);
    EXPECT_LE(torques, 40);
    EXPECT_CONTAINS(detail::readFaultExplanation(),
                    "ticks after the first one: they are lost, or come later than repeat_ticks: 1000 allows");
}

TEST(Fault83, ARobotOfAnotherVersionIsRefused) {
    RobotMind mind;
    mind.spoil = [](std::uint8_t* packet) { packet[4] = VL_VERSION + 1; };
    EXPECT_CONTAINS(refusal(mind),
                    "speaks version 2 of the link, and this is version 1. Build both sides with the same");
    mind.spoil = [n = 0](std::uint8_t* packet) mutable {  // three of them are bits that flipped on the line
        if (++n <= 3) packet[4] = VL_VERSION + 1;
    };
    const Linked arm("udp", mind);
}

/** Ctrl-C while the robot is called. */
TEST(LinkPlant, TheCallEndsSoonWhenTheUserAsksForIt) {
    for (const char* absent : {"shm:viable-nobody-has-this", "127.0.0.1:9"}) {
        const PluginBench bench;
        LinkPlant plant;
        std::thread user([] {
            sleepFor(0.1);
            detail::stopSignal = SIGINT;
        });
        const std::int64_t begin = vl_now_ns();
        EXPECT_CONTAINS(test::catchError([&] {
                            bench.configure(plant, std::string("connect_timeout_s: 20, address: \"") + absent + "\"");
                        }),
                        "was still being called when the user asked for the end");
        user.join();
        detail::stopSignal = 0;
        EXPECT_LT(vl_now_ns() - begin, 300'000'000);
    }
}

TEST(Fault83, ARobotOfAnotherSizeOrTickIsRefused) {
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::joints, 3)),
                    "has 3 joints, and the arm of the file 2. Name the robot that stands there");
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::counted_ns, 2'000'000, makeMind(&RobotMind::tick_s, 0.002))),
                    "has a tick of 0.002 s, and the file one of 0.001 s. Write tick_s: 0.002");
}

TEST(Fault85, AnotherConventionOfGravityOrSignsIsRefusedWithTheMeasuredAndTheExpectedTorque) {
    RobotMind mind = makeMind(&RobotMind::addsGravity, true);
    EXPECT_CONTAINS(refusal(mind),
                    "makes up for gravity itself, and the file says adds_gravity: false. Write adds_gravity: true");
    EXPECT_CONTAINS(refusal({}, "adds_gravity: true"),
                    "does not make up for gravity itself, and the file says adds_gravity: true");
    mind.gravityShare = 2.0;  // it says so, but its torques are with gravity
    test::expectContains(refusal(mind, "adds_gravity: true"),
                         {"Nm, and the model expects [0, 0] Nm beside what the robot adds for gravity",
                          "It looks as if the robot did not subtract gravity"});
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::gravityShare, 0.0)),
                    "It looks as if the robot added gravity itself: write adds_gravity: true");
    test::expectContains(refusal(makeMind(&RobotMind::torqueFactor, -1.0)),
                         {"carries its arm at rest with [", "It looks as if its signs were reversed."});
    EXPECT_CONTAINS(refusal(makeMind(&RobotMind::exchangesJoints, true)), "the signs and the order of the joints");
    test::expectContains(refusal(makeMind(&RobotMind::away, 0.1)),
                         {"does not stand where the file starts: joint1 is at -0.4, and the start -0.5",
                          "write its pose as the start: {position_rad: [0.3, -0.4]}"});
    mind = makeMind(&RobotMind::flags, VL_ENABLED | VL_ADDS_FRICTION);
    EXPECT_CONTAINS(refusal(mind), "makes up for friction itself, and the file says adds_friction: false");
    EXPECT_CONTAINS(refusal(mind, "adds_friction: true"), "has friction, which the robust loop would make up for");
    EXPECT_CONTAINS(refusal({}, "external_torque: true"), "does not measure the torque of the surroundings");
}

}  // namespace
}  // namespace viable
