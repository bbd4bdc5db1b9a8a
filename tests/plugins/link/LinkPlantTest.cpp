// The plant `link` against a robot in a thread of the test, over UDP and shared memory; faults 83 to 86.
#include "LinkPlant.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <time.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "ExpectContains.h"
#include "TemporaryFolder.h"
#include "plugin/FaultExplanation.h"
#include "viable/core/Error.h"
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
    std::atomic<double> firstTorque{std::numeric_limits<double>::quiet_NaN()};  // of the last tick that was driven

private:
    void run() {
        std::int64_t next = vl_now_ns();
        double torque[VL_MAX_JOINTS] = {};
        while (!ends_) {
            if (!isDeaf) vl_robot_poll(&robot, &line_);
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
            out.flags = (mind_.flags | moreFlags | (mind_.addsGravity ? unsigned(VL_ADDS_GRAVITY) : 0u)) & ~lessFlags;
            for (int i = 0; i < 2; ++i) {
                const int from = mind_.exchangesJoints ? 1 - i : i;
                out.q[i] = saysNan ? std::numeric_limits<double>::quiet_NaN() : state_.q[i];
                out.qd[i] = state_.qd[i] + (i == 1 ? mind_.velocity : 0.0);
                out.tau[i] = mind_.torqueFactor * (motors[from] + (mind_.gravityShare - 1.0) * dynamics.gravity[from] -
                                                   (mind_.addsGravity ? dynamics.gravity[from] : 0.0));
                out.external[i] = 0.25 * (i + 1);
            }
            if (!isSilent) vl_robot_send(&robot, &line_, &out);
            next = std::max(next + mind_.period_ns, vl_now_ns() - mind_.period_ns);
            const timespec until{static_cast<time_t>(next / 1'000'000'000), static_cast<long>(next % 1'000'000'000)};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
        }
    }

    const RobotMind mind_;
    const RobotDescription arm_;
    RobotModel model_;
    vl_line line_{};
    JointState state_;
    std::atomic<bool> ends_{false};
    std::thread thread_;
};

void sleepFor(double seconds) {
    const timespec pause{0, static_cast<long>(seconds * 1e9)};
    nanosleep(&pause, nullptr);
}

void expectSays(const std::string& text, const std::string& part) {
    test::expectContains(text, {part});
}

std::string say(const TestRobot& robot, const std::string& more = "", const std::string& silence_s = "1") {
    return "address: \"" + robot.address + "\", silence_timeout_s: " + silence_s +
           (more.find("repeat_ticks") == std::string::npos ? ", repeat_ticks: 1000" : "") +
           (more.find("connect_timeout_s") == std::string::npos ? ", connect_timeout_s: 5" : "") +
           (more.empty() ? "" : ", " + more);
}

/** The text with which a run with this robot is refused. */
std::string refusal(const RobotMind& mind, const std::string& more = "",
                    const std::function<void(const TestRobot&)>& prepare = {}) {
    const PluginBench bench;
    TestRobot robot("udp", mind);
    if (prepare) prepare(robot);
    LinkPlant plant;
    try {
        bench.configure(plant, say(robot, more));
    } catch (const Error& e) {
        EXPECT_EQ(e.kind(), ErrorKind::BadInput);
        EXPECT_NE(std::string(e.what()).find("test.yaml:1"), std::string::npos) << e.what();
        return e.what();
    }
    ADD_FAILURE() << "it was not refused";
    return {};
}

class LinkOver : public ::testing::TestWithParam<const char*> {};

/** Drives joint 0 with 1 rad/s^2 for `ticks`. */
void drive(LinkPlant& plant, RobotModel& model, int ticks) {
    Dynamics dynamics;
    JointVector torque, applied, acceleration = JointVector::Zero(2);
    acceleration[0] = 1.0;
    for (int k = 0; k < ticks; ++k) {
        std::int64_t passed = 0;
        ASSERT_EQ(plant.read(passed), TickStatus::Ok) << detail::takeFaultExplanation();
        ASSERT_GE(passed, 1);
        model.calcDynamics(plant.measured().q, plant.measured().qd, dynamics);
        calcInverseDynamics(dynamics, acceleration, torque);
        ASSERT_EQ(plant.advance(torque, applied), TickStatus::Ok);
        ASSERT_EQ(applied, torque);
    }
}

TEST_P(LinkOver, AnArmIsDrivenAndEachRunBeginsAnew) {
    const PluginBench bench;
    TestRobot robot(GetParam());
    LinkPlant plant;
    bench.configure(plant, say(robot));
    EXPECT_TRUE(plant.hasClock());
    EXPECT_EQ(plant.delayTicks(), 1);
    EXPECT_EQ(plant.externalTorque(), nullptr);
    RobotModel model(bench.setup().robot);
    EXPECT_NEAR((plant.measured().q - bench.state().q).norm(), 0.0, 1e-12);
    drive(plant, model, 300);  // longer, where this thread slept
    EXPECT_GT(plant.measured().qd[0], 0.25);
    EXPECT_NEAR(plant.measured().qd[1], 0.0, 0.1);
    EXPECT_THROW(plant.reset(bench.state()), Error);  // it has moved
    JointVector applied;
    EXPECT_EQ(plant.advance(bench.dynamics().b, applied), TickStatus::Faulted);
    const JointVector home = plant.measured().q;
    plant.reset({home, JointVector::Zero(2), JointVector::Zero(2)});
    drive(plant, model, 20);
}

TEST_P(LinkOver, Fault83TicksThatTheHostSleptAreMissedTicks) {
    const PluginBench bench;
    TestRobot robot(GetParam());
    LinkPlant plant;
    bench.configure(plant, say(robot));
    sleepFor(0.05);  // before the first read() nothing is missed
    std::int64_t passed = 0;
    ASSERT_EQ(plant.read(passed), TickStatus::Ok);
    EXPECT_EQ(passed, 1);
    sleepFor(0.05);
    ASSERT_EQ(plant.read(passed), TickStatus::Ok);
    EXPECT_GE(passed, 20);
}

TEST_P(LinkOver, Fault84ARobotThatIsSilentIsGone) {
    const PluginBench bench;
    TestRobot robot(GetParam());
    LinkPlant plant;
    bench.configure(plant, say(robot, "", "0.5"));
    RobotModel model(bench.setup().robot);
    drive(plant, model, 10);
    robot.isSilent = true;
    const std::int64_t begin = vl_now_ns();
    std::int64_t passed = 0;
    TickStatus status = TickStatus::Ok;
    for (int k = 0; k < 10 && status == TickStatus::Ok; ++k) status = plant.read(passed);
    EXPECT_EQ(status, TickStatus::Faulted);
    EXPECT_GE(vl_now_ns() - begin, 500'000'000);
    const std::string why = detail::takeFaultExplanation();
    expectSays(why,
               "it cannot drive the robot at " + robot.address + " any more: no state has come for 0.5 s (packets: ");
    JointVector applied;
    EXPECT_EQ(plant.advance(bench.dynamics().b, applied), TickStatus::Faulted);
    EXPECT_EQ(plant.read(passed), TickStatus::Faulted);
    EXPECT_EQ(detail::takeFaultExplanation(), why);
}

INSTANTIATE_TEST_SUITE_P(All, LinkOver, ::testing::Values("udp", "shm"),
                         [](const auto& test) { return std::string(test.param); });

TEST(LinkPlant, ATickAllocatesNothing) {
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    const PluginBench bench;
    TestRobot robot("udp");
    LinkPlant plant;
    bench.configure(plant, say(robot));
    JointVector applied;
    std::int64_t passed = 0;
    int okReads = 0, okTorques = 0;
    TickStatus last = TickStatus::Ok;
    const AllocationCounter counter;
    for (int k = 0; k < 100; ++k) {
        okReads += plant.read(passed) == TickStatus::Ok ? 1 : 0;
        plant.measured();
        okTorques += plant.advance(bench.dynamics().gravity, applied) == TickStatus::Ok ? 1 : 0;
    }
    robot.moreFlags = VL_FAULT;
    for (int k = 0; k < 20; ++k) {
        last = plant.read(passed);
        plant.advance(bench.dynamics().gravity, applied);
    }
    EXPECT_EQ(counter.count(), 0);
    EXPECT_EQ(okReads, 100);
    EXPECT_EQ(okTorques, 100);
    EXPECT_EQ(last, TickStatus::Faulted);
}

TEST(LinkPlant, ATorqueThatIsNotFiniteIsNeverSent) {
    const PluginBench bench;
    TestRobot robot("udp");
    LinkPlant plant;
    bench.configure(plant, say(robot));
    std::int64_t passed = 0;
    JointVector applied = JointVector::Constant(2, 5.0), bad = bench.dynamics().gravity;
    bad[1] = std::numeric_limits<double>::quiet_NaN();
    ASSERT_EQ(plant.read(passed), TickStatus::Ok);
    EXPECT_EQ(plant.advance(bad, applied), TickStatus::InvalidInput);
    EXPECT_EQ(applied, JointVector(JointVector::Constant(2, 5.0)));
    EXPECT_EQ(plant.advance(JointVector::Zero(3), applied), TickStatus::InvalidInput);
    sleepFor(0.02);
    EXPECT_TRUE(std::isnan(robot.firstTorque.load()));
    robot.stop();
    EXPECT_EQ(robot.robot.acts, VL_HOLD);
}

TEST(LinkPlant, WhereTheRobotAddsGravityItIsSentTheRest) {
    const PluginBench bench;
    RobotMind mind;
    mind.addsGravity = true;
    TestRobot robot("udp", mind);
    LinkPlant plant;
    bench.configure(plant, say(robot, "adds_gravity: true"));
    std::int64_t passed = 0;
    JointVector applied;
    for (int k = 0; k < 20; ++k) {
        ASSERT_EQ(plant.read(passed), TickStatus::Ok);
        ASSERT_EQ(plant.advance(bench.dynamics().gravity, applied), TickStatus::Ok);
        EXPECT_NEAR((applied - bench.dynamics().gravity).norm(), 0.0, 1e-12);
    }
    EXPECT_NEAR(robot.firstTorque, 0.0, 1e-9);
    EXPECT_NEAR((plant.measured().q - bench.state().q).norm(), 0.0, 1e-9);
}

TEST(LinkPlant, TorquesAreCutAtTheMotorsAndChangeAsFastAsTheRobotAccepts) {
    const PluginBench bench;
    TestRobot robot("udp");
    std::int64_t passed = 0;
    JointVector applied;
    {
        LinkPlant plant;
        bench.configure(plant, say(robot, "motor_rate_Nmps: 1000"));
        ASSERT_EQ(plant.motorRate().size(), 2);
        EXPECT_EQ(plant.motorRate()[0], 1000.0);
        ASSERT_EQ(plant.read(passed), TickStatus::Ok);
        ASSERT_EQ(plant.advance(bench.dynamics().gravity.array() + 50.0, applied), TickStatus::Ok);
        EXPECT_NEAR(applied[0], bench.dynamics().gravity[0] + 1.0, 1e-9);
    }
    LinkPlant other;
    bench.configure(other, say(robot));
    EXPECT_EQ(other.motorRate().size(), 0);
    ASSERT_EQ(other.read(passed), TickStatus::Ok);
    ASSERT_EQ(other.advance(JointVector::Constant(2, 1e5), applied), TickStatus::Ok);
    EXPECT_EQ(applied, bench.setup().robot.actuation.torqueLimit);
}

TEST(LinkPlant, TheTorqueOfTheSurroundingsIsPassedOn) {
    const PluginBench bench;
    RobotMind mind;
    mind.flags = VL_ENABLED | VL_HAS_EXTERNAL;
    TestRobot robot("shm", mind);
    LinkPlant plant;
    bench.configure(plant, say(robot, "external_torque: true"));
    ASSERT_NE(plant.externalTorque(), nullptr);
    std::int64_t passed = 0;
    ASSERT_EQ(plant.read(passed), TickStatus::Ok);
    EXPECT_EQ((*plant.externalTorque())[1], 0.5);
}

TEST(LinkPlant, WithAKeyOnlyWhoKnowsItIsHeard) {
    const PluginBench bench;
    const test::TemporaryFolder folder;
    const std::string file = folder.write("key", "000102030405060708090a0b0c0d0e0f\n");
    const std::string other = folder.write("other", "100102030405060708090a0b0c0d0e0f\n");
    const std::string bad = folder.write("bad", "00010203\n");
    for (const std::string& one : {file, other, bad}) chmod(one.c_str(), 0600);
    RobotMind mind;
    ASSERT_EQ(vl_key_from_hex("000102030405060708090a0b0c0d0e0f", &mind.key), 0);
    {
        TestRobot robot("udp", mind);
        LinkPlant plant;
        bench.configure(plant, say(robot, "key_file: " + file));
        RobotModel model(bench.setup().robot);
        drive(plant, model, 5);
    }
    expectSays(refusal(mind, "connect_timeout_s: 0.3, key_file: " + other), "does not answer (tried for 0.3 s)");
    expectSays(refusal({}, "key_file: " + bad), ": it does not hold a key of 32 hexadecimal digits. Make one:");
    chmod(file.c_str(), 0644);
    expectSays(refusal({}, "key_file: " + file), ": other users can read it (chmod 600)");
}

TEST(LinkPlant, WhatCannotBeCalledIsRefused) {
    const PluginBench bench;
    for (const char* bad : {"localhost:47100", "127.0.0.1", "robot"}) {
        LinkPlant plant;
        try {
            bench.configure(plant, std::string("address: \"") + bad + "\"");
            ADD_FAILURE() << bad;
        } catch (const Error& e) {
            expectSays(e.what(), std::string("'") + bad + "' is no address of a robot. Write numbers");
        }
    }
    for (const char* absent : {"shm:viable-nobody-has-this", "127.0.0.1:9"}) {
        LinkPlant plant;
        try {
            bench.configure(plant, std::string("connect_timeout_s: 0.1, address: \"") + absent + "\"");
            ADD_FAILURE() << absent;
        } catch (const Error& e) {
            expectSays(e.what(), std::string("the robot at ") + absent);
            expectSays(e.what(), "See that `viable robot` or the robot's driver runs");
        }
    }
}

TEST(Fault84, ARobotThatCannotFollowIsRefusedAndInARunEndsIt) {
    RobotMind mind;
    mind.flags = VL_ENABLED | VL_BRAKES;
    expectSays(refusal(mind), "has its brakes closed. Open them at the robot");
    mind.flags = VL_ENABLED | VL_FAULT;
    expectSays(refusal(mind), "reports a fault of its own. Find and clear it");
    mind.flags = 0;
    expectSays(refusal(mind), "is not enabled. Switch its motors on");
    mind = {};
    mind.velocity = 0.5;
    expectSays(refusal(mind, "connect_timeout_s: 3"), "does not come to rest: its joints move with up to 0.5 rad/s");
    const PluginBench bench;
    RobotModel model(bench.setup().robot);
    const auto expectEnd = [&](const std::function<void(TestRobot&)>& change, const std::string& why) {
        TestRobot robot("udp");
        LinkPlant plant;
        bench.configure(plant, say(robot, "repeat_ticks: 200", "0.3"));
        drive(plant, model, 5);
        change(robot);
        std::int64_t passed = 0;
        JointVector applied;
        TickStatus status = TickStatus::Ok;
        for (int k = 0; k < 3000 && status == TickStatus::Ok; ++k) {
            status = plant.read(passed);
            if (status == TickStatus::Ok) plant.advance(bench.dynamics().gravity, applied);
        }
        EXPECT_EQ(status, TickStatus::Faulted) << why;
        expectSays(detail::takeFaultExplanation(), why);
    };
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_BRAKES; }, "its brakes are closed");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_FAULT; }, "it reports a fault of its own");
    expectEnd([](TestRobot& robot) { robot.lessFlags = VL_ENABLED; }, "its motors are not enabled");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_ADDS_GRAVITY; }, "gravity is not as adds_gravity says");
    expectEnd([](TestRobot& robot) { robot.moreFlags = VL_ADDS_FRICTION; }, "friction is not as adds_friction says");
    expectEnd([](TestRobot& robot) { robot.isDeaf = true; }, "it missed commands for longer than repeat_ticks");
    expectEnd([](TestRobot& robot) { robot.saysNan = true; }, " absurd; ticks without a state:");
    expectEnd([](TestRobot& robot) { robot.changesTick = true; }, " other tick; ticks without a state:");
}

/** Its packets make the ticks, whatever another clock says. */
TEST(Fault84, AClockOnePercentFastOrSlowIsFollowed) {
    const PluginBench bench;
    RobotModel model(bench.setup().robot);
    for (const std::int64_t period_ns : {990'000, 1'010'000}) {
        RobotMind mind;
        mind.period_ns = period_ns;
        TestRobot robot("udp", mind);
        LinkPlant plant;
        bench.configure(plant, say(robot));
        drive(plant, model, 1);
        const std::int64_t begin = vl_now_ns();
        drive(plant, model, 100);
        EXPECT_GE(vl_now_ns() - begin, 98 * period_ns);
    }
}

/** As where all answers come too late: the run does not go on beside an arm that nobody drives. */
TEST(Fault83, ARobotThatTakesNoTorqueEndsTheRun) {
    const PluginBench bench;
    TestRobot robot("udp");
    LinkPlant plant;
    bench.configure(plant, say(robot, "repeat_ticks: 0"));
    robot.isDeaf = true;
    TickStatus status = TickStatus::Ok;
    JointVector applied;
    for (int k = 0; k < 1000 && status == TickStatus::Ok; ++k) {
        std::int64_t passed = 0;
        status = plant.read(passed);
        if (status == TickStatus::Ok) plant.advance(bench.dynamics().gravity, applied);
    }
    EXPECT_EQ(status, TickStatus::Faulted);
    expectSays(detail::takeFaultExplanation(), "it takes no torque: they come later than repeat_ticks allows");
}

TEST(Fault83, ARobotOfAnotherSizeOrTickIsRefused) {
    RobotMind mind;
    mind.joints = 3;
    expectSays(refusal(mind), "has 3 joints, and the arm of the file 2. Name the robot that stands there");
    mind = {};
    mind.tick_s = 0.002;
    mind.period_ns = 2'000'000;
    expectSays(refusal(mind), "has a tick of 0.002 s, and the file one of 0.001 s. Write tick_s: 0.002");
}

TEST(Fault85, AnotherConventionOfGravityOrSignsIsRefusedWithTheMeasuredAndTheExpectedTorque) {
    RobotMind mind;
    mind.addsGravity = true;
    expectSays(refusal(mind),
               "makes up for gravity itself, and the file says adds_gravity: false. Write "
               "adds_gravity: true");
    expectSays(refusal({}, "adds_gravity: true"),
               "does not make up for gravity itself, and the file says adds_gravity: true");
    mind.gravityShare = 2.0;  // it says so, but its torques are with gravity
    const std::string with = refusal(mind, "adds_gravity: true");
    expectSays(with, "Nm, and the model expects [0, 0] Nm beside what the robot adds for gravity");
    expectSays(with, "It looks as if the robot did not subtract gravity");
    mind = {};
    mind.gravityShare = 0.0;
    expectSays(refusal(mind), "It looks as if the robot added gravity itself: write adds_gravity: true");
    mind = {};
    mind.torqueFactor = -1.0;
    const std::string reversed = refusal(mind);
    expectSays(reversed, "carries its arm at rest with [");
    expectSays(reversed, "It looks as if its signs were reversed.");
    mind = {};
    mind.exchangesJoints = true;
    expectSays(refusal(mind), "the signs and the order of the joints");
    mind = {};
    mind.away = 0.1;
    const std::string elsewhere = refusal(mind);
    expectSays(elsewhere, "does not stand where the file starts: joint1 is at -0.4, and the start -0.5");
    expectSays(elsewhere, "write its pose as the start: {position_rad: [0.3, -0.4]}");
    mind = {};
    mind.flags |= VL_ADDS_FRICTION;
    expectSays(refusal(mind), "makes up for friction itself, and the file says adds_friction: false");
    expectSays(refusal(mind, "adds_friction: true"), "has friction, which the robust loop would make up for");
    expectSays(refusal({}, "external_torque: true"), "does not measure the torque of the surroundings");
}

}  // namespace
}  // namespace viable
