#include "Teleoperation.h"

#include "CaseSupport.h"
#include "CommandBench.h"
#include "live/LiveSession.h"
#include "live/Replay.h"

namespace viable {
namespace {

using State = HandState;
using Refusal = HandRefusal;
using Eigen::Vector3d;

/** The plugin on an Indy7, ticks of 1 ms, a clock that the test advances, and an operator that sends 50 messages a second. */
struct Bench {
    explicit Bench(const std::string& parameters = "space: tool", bool runs = true)
        : source([this] { return now; }), robot(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7")), model(robot) {
        const int n = robot.size();
        start = {robot.home, JointVector::Zero(n), JointVector::Zero(n)};
        startTool = poseOf(start.q);
        const ConfigNode root = parseConfig("command: {" + parameters + "}\n", "experiment.yaml");
        const PluginEntry& entry = testing::openOwnPlugin();
        source.configure({robot, robot.limits, 0.001, 1.0, start, startTool},
                         readParameters(*root.find("command"), entry.parameters, entry.parameterCount, n));
        source.observe(start.q, start.q);
        if (runs) tick();
        hand.joints.setZero(n);
        hand.isTracked = true;
        hand.hand.position = {3.0, 1.0, -2.0};  // anywhere
        hand.hand.orientation = Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5);
    }

    TeleoperationFeed::Status status() { return source.feed()->status(); }
    State state() { return status().state; }

    Pose poseOf(const JointVector& q) {
        Dynamics dynamics;
        model.calcDynamics(q, JointVector::Zero(q.size()), dynamics);
        return dynamics.tool;
    }

    void tick(int count = 1) {
        for (int k = 0; k < count; ++k) {
            now += 0.001;
            time += 0.001;
            ASSERT_EQ(source.sample(time, command), TickStatus::Ok);
            ASSERT_TRUE(command.tool.position.allFinite() && command.q.allFinite());
        }
    }
    /** The message as it is, and the ticks until the next one. @return the state then */
    State send(int ticks = 20) {
        hand.sent_s = now + 1000.0;  // of another clock
        source.feed()->put(hand);
        tick(ticks);
        return state();
    }
    /** The same, the switch being as this. */
    State press(unsigned engagement, int ticks = 20) {
        hand.engagement = engagement;
        return send(ticks);
    }
    /** The same, the hand being so much farther along x [m]. */
    State advance(double way, int ticks = 20) {
        hand.hand.position.x() += way;
        return send(ticks);
    }
    /** The loop stands still, the clock does not. */
    void pause(double seconds) { now += seconds; }

    double now = 5.0, time = 0.0;
    Teleoperation source;
    RobotDescription robot;
    RobotModel model;
    MotionState start;
    Pose startTool;
    HandMessage hand;
    MotionCommand command;
};

void expectSamePose(const Pose& a, const Pose& b, double tolerance = 1e-12) {
    EXPECT_LE((a.position - b.position).norm(), tolerance);
    EXPECT_LE(a.orientation.angularDistance(b.orientation), 1e-7);
}

TEST(Teleoperation, RestsAtTheStartUntilAHandComes) {
    Bench bench;
    bench.tick(100);
    expectSamePose(bench.command.tool, bench.startTool);
    EXPECT_EQ(bench.state(), State::Released);
    bench.send();  // a hand without the switch
    expectSamePose(bench.command.tool, bench.startTool);
    EXPECT_EQ(bench.state(), State::Released);
}

TEST(Teleoperation, EngagingAnywhereMovesNothingAndThenTheToolMovesAsTheHand) {
    Bench bench;
    bench.hand.engagement = 1;
    bench.hand.scale = 0.5;
    EXPECT_EQ(bench.send(), State::Engaged);
    expectSamePose(bench.command.tool, bench.startTool);
    const Pose before = bench.hand.hand;
    for (int k = 0; k < 10; ++k) {
        bench.hand.hand.position += Vector3d(0.02, 0.0, -0.01);
        bench.hand.hand.orientation = Eigen::AngleAxisd(0.05, Vector3d::UnitY()) * bench.hand.hand.orientation;
        bench.send();
    }
    EXPECT_LE(
        (bench.command.tool.position - bench.startTool.position - 0.5 * (bench.hand.hand.position - before.position))
            .norm(),
        1e-12);
    EXPECT_LE((calcTurn(bench.startTool, bench.command.tool) - Vector3d(0.0, 0.5, 0.0)).norm(),
              1e-9);  // not scaled
    EXPECT_TRUE(bench.command.toolTwist.isZero());
}

TEST(Teleoperation, AxesAndPartsOfTheHandAreMapped) {
    Bench bench("axes: [0, 0, -1, -1, 0, 0, 0, 1, 0]");  // as of a headset: x right, y up, z back
    bench.hand.engagement = 7;
    bench.hand.part = HandMessage::Part::Position;
    bench.send();
    bench.hand.hand.position += Vector3d(0.0, 0.05, -0.1);
    bench.hand.hand.orientation = Eigen::AngleAxisd(0.2, Vector3d::UnitY()) * bench.hand.hand.orientation;
    bench.send();
    Vector3d moved = bench.command.tool.position - bench.startTool.position;
    EXPECT_LE((moved - Vector3d(0.1, 0.0, 0.05)).norm(), 1e-12);
    EXPECT_LE(calcTurn(bench.startTool, bench.command.tool).norm(), 1e-7);

    bench.hand.part = HandMessage::Part::Rotation;  // latches anew
    bench.send();
    bench.hand.hand.position += Vector3d(0.05, 0.0, 0.0);
    bench.hand.hand.orientation = Eigen::AngleAxisd(0.2, Vector3d::UnitY()) * bench.hand.hand.orientation;
    bench.send();
    EXPECT_LE((calcTurn(bench.startTool, bench.command.tool) - Vector3d(0.0, 0.0, 0.2)).norm(), 1e-9);
    EXPECT_EQ(moved, bench.command.tool.position - bench.startTool.position);
}

TEST(Teleoperation, AnotherScaleMovesNothing) {
    Bench bench;
    bench.press(1);
    bench.advance(0.1);
    const Pose before = bench.command.tool;
    bench.hand.scale = 5.0;
    bench.send();
    expectSamePose(bench.command.tool, before);
    bench.advance(0.02);
    EXPECT_NEAR(bench.command.tool.position.x() - before.position.x(), 0.1, 1e-12);
}

TEST(Teleoperation, Fault87_ReleasedItRestsWhereTheStopLeavesTheArmAndReengagingNeverJumps) {
    Bench bench;
    bench.press(1);
    for (int k = 0; k < 20; ++k) {
        bench.hand.hand.position.z() += 0.09;  // far out of reach
        bench.send();
    }
    JointVector q = bench.start.q, rest = q;
    q[1] += 0.2;
    rest[1] += 0.25;
    rest[2] = kNan;  // a joint without a stop
    bench.source.observe(q, rest);
    bench.press(0, 1);
    rest[2] = q[2];
    EXPECT_EQ(bench.state(), State::Released);
    expectSamePose(bench.command.tool, bench.poseOf(rest));

    bench.hand.engagement = 2;
    bench.hand.hand.position = {-7.0, 0.0, 2.0};  // somewhere else
    EXPECT_EQ(bench.send(), State::Engaged);
    expectSamePose(bench.command.tool, bench.poseOf(rest));
}

TEST(Teleoperation, Fault62_SilenceIsHeldAfter100msAndOverAfter500ms) {
    Bench bench;
    bench.press(1, 1);
    bench.advance(0.04, 1);
    const Pose followed = bench.command.tool;
    bench.tick(98);
    EXPECT_EQ(bench.state(), State::Engaged);
    expectSamePose(bench.command.tool, followed);
    bench.tick(3);
    EXPECT_EQ(bench.state(), State::Held);
    expectSamePose(bench.command.tool, bench.startTool);  // where the arm was seen
    bench.tick(200);
    EXPECT_EQ(bench.advance(0.5, 1), State::Engaged);  // went on meanwhile; latched anew
    expectSamePose(bench.command.tool, bench.startTool);

    bench.tick(498);
    EXPECT_EQ(bench.state(), State::Held);
    bench.tick(4);
    EXPECT_EQ(bench.state(), State::Refused);
    EXPECT_EQ(bench.status().refusal, Refusal::Silent);
    EXPECT_EQ(bench.send(), State::Refused);  // the switch is still the same
    bench.press(0);
    EXPECT_EQ(bench.press(2), State::Engaged);
}

TEST(Teleoperation, Fault62_OldAndRepeatedMessagesAreDropped) {
    Bench bench;
    bench.press(1);
    bench.advance(0.05);
    const Pose now = bench.command.tool;
    const HandMessage last = bench.hand;
    HandMessage old = last;
    old.sent_s -= 0.01;
    old.hand.position.x() += 0.04;
    bench.source.feed()->put(old);
    bench.tick();
    expectSamePose(bench.command.tool, now);
    for (int k = 0; k < 30; ++k) {  // the same again and again is no sign of life
        bench.source.feed()->put(last);
        bench.tick(20);
    }
    EXPECT_EQ(bench.state(), State::Refused);
    EXPECT_EQ(bench.status().refusal, Refusal::Silent);
}

TEST(Teleoperation, Fault87_WhatCannotBeAHandIsRefusedUntilTheSwitchIsPressedAnew) {
    const double nan = kNan, inf = kInfinity;
    struct Wrong {
        const char* name;
        std::function<void(HandMessage&)> make;
        Refusal refusal;
    };
    const Wrong all[] = {
        {"lost", [](HandMessage& m) { m.isTracked = false; }, Refusal::NotTracked},
        {"teleport", [](HandMessage& m) { m.hand.position.y() += 0.7; }, Refusal::Jump},
        {"flip", [](HandMessage& m) { m.hand.orientation = Eigen::Quaterniond(0.5, 0.5, 0.5, -0.5); }, Refusal::Jump},
        {"nan", [=](HandMessage& m) { m.hand.position.y() = nan; }, Refusal::NotFinite},
        {"inf", [=](HandMessage& m) { m.hand.position.z() = inf; }, Refusal::NotFinite},
        {"no turn", [](HandMessage& m) { m.hand.orientation.coeffs().setZero(); }, Refusal::NotFinite},
        {"nan turn", [=](HandMessage& m) { m.hand.orientation.w() = nan; }, Refusal::NotFinite},
        {"scale", [](HandMessage& m) { m.scale = 5.01; }, Refusal::NotFinite},
        {"nan scale", [=](HandMessage& m) { m.scale = nan; }, Refusal::NotFinite},
        {"far", [](HandMessage& m) { m.hand.position.x() = 1e9; }, Refusal::NotFinite},
    };
    for (const Wrong& wrong : all) {
        SCOPED_TRACE(wrong.name);
        Bench bench;
        bench.press(1);
        bench.advance(0.05);
        const HandMessage good = bench.hand;
        wrong.make(bench.hand);
        EXPECT_EQ(bench.send(1), State::Refused);
        EXPECT_EQ(bench.status().refusal, wrong.refusal);
        expectSamePose(bench.command.tool, bench.startTool);
        bench.hand = good;
        for (int k = 0; k < 5; ++k) bench.send();
        EXPECT_EQ(bench.state(), State::Refused);
        expectSamePose(bench.command.tool, bench.startTool);
        EXPECT_EQ(bench.press(0), State::Released);
        EXPECT_EQ(bench.press(2), State::Engaged);
        expectSamePose(bench.command.tool, bench.startTool);
    }
}

TEST(Teleoperation, HandsAsFastAsPeopleAreFollowedAlsoWhereMessagesAreLost) {
    for (const int ticks : {5, 20, 90}) {
        Bench bench;
        bench.press(1, ticks);
        for (int k = 0; k < 20; ++k) {
            bench.hand.hand.position.x() += 4.5 * 0.001 * ticks;
            bench.send(ticks);
        }
        EXPECT_EQ(bench.state(), State::Engaged) << ticks;
    }
}

TEST(Teleoperation, ASwitchThatWasPressedDuringAPauseCountsForNothing) {
    for (const bool wasEngaged : {true, false}) {
        Bench bench;
        bench.press(wasEngaged ? 1 : 0);
        bench.pause(0.51);
        bench.hand.engagement = 1;
        bench.hand.hand.position.x() += 0.04;
        for (int k = 0; k < 5; ++k) bench.send();
        EXPECT_EQ(bench.state(), State::Refused) << wasEngaged;
        EXPECT_EQ(bench.status().refusal, Refusal::Paused);
        expectSamePose(bench.command.tool, bench.startTool);
        EXPECT_EQ(bench.press(2), State::Engaged);
    }
}

TEST(Teleoperation, ASwitchThatWasPressedBeforeTheStartCountsForNothing) {
    Bench bench("space: tool", false);
    bench.hand.engagement = 1;
    for (int k = 0; k < 5; ++k) {
        bench.send();
        bench.hand.hand.position.x() += 0.02;
        EXPECT_EQ(bench.state(), State::Refused) << k;
    }
    EXPECT_EQ(bench.status().refusal, Refusal::Paused);
    expectSamePose(bench.command.tool, bench.startTool);
    EXPECT_EQ(bench.press(0), State::Released);
    EXPECT_EQ(bench.press(2), State::Engaged);
}

TEST(Teleoperation, ALetGoSwitchIsNoMorePressedHoweverLateThatIsLookedAt) {
    for (const double gap_s : {0.0, 0.2, 0.51, 60.0}) {
        SCOPED_TRACE(gap_s);
        Bench bench;
        bench.press(1);
        EXPECT_EQ(bench.advance(0.04), State::Engaged);
        bench.hand.engagement = 0;
        bench.source.feed()->put(bench.hand);
        bench.pause(gap_s);
        bench.tick();
        EXPECT_EQ(bench.state(), State::Released);
        expectSamePose(bench.command.tool, bench.startTool);
        bench.tick(600);
        EXPECT_EQ(bench.state(), State::Released);
        EXPECT_EQ(bench.status().refusal, Refusal::None);
    }
}

TEST(Teleoperation, Fault62_AMessageOfAPressBeforeThisOneIsDropped) {
    Bench bench;
    bench.press(6);
    const HandMessage old = bench.hand;
    bench.press(0);
    bench.press(7);
    bench.advance(0.04);
    const Pose followed = bench.command.tool;
    HandMessage late = old;
    late.sent_s = bench.hand.sent_s + 0.001;
    late.hand.position.x() -= 0.04;
    for (int k = 0; k < 30; ++k) {  // neither followed nor a sign of life
        bench.source.feed()->put(late);
        late.sent_s += 0.02;
        late.hand.position.x() -= 0.01;
        bench.tick(2);
        EXPECT_EQ(bench.status().engagement, 7u);
    }
    EXPECT_EQ(bench.state(), State::Engaged);
    expectSamePose(bench.command.tool, followed);
    bench.tick(100);
    EXPECT_EQ(bench.state(), State::Held);
    bench.press(0);
    bench.source.feed()->put(late);  // nor after its release
    bench.tick();
    EXPECT_EQ(bench.state(), State::Released);
}

TEST(Teleoperation, MissedTicksAreHeldLikeSilence) {
    Bench bench;
    bench.press(1);
    bench.advance(0.04);
    bench.pause(0.2);
    EXPECT_EQ(bench.advance(0.5, 1), State::Held);
    EXPECT_EQ(bench.send(1), State::Engaged);  // latched anew
    expectSamePose(bench.command.tool, bench.startTool);
}

TEST(Teleoperation, SlidersMoveTheJointsFromWhereTheyAre) {
    Bench bench("space: joint");
    EXPECT_EQ(bench.source.traits().space, MotionCommand::Space::Joint);
    bench.hand.engagement = 1;
    bench.hand.joints[2] = 0.4;  // latched
    bench.send();
    EXPECT_EQ(bench.command.q, bench.start.q);
    bench.hand.joints[2] += 0.1;
    bench.send();
    EXPECT_NEAR(bench.command.q[2], bench.start.q[2] + 0.1, 1e-15);
    EXPECT_TRUE(bench.command.qd.isZero());
    bench.hand.joints.resize(3);
    bench.send();
    EXPECT_EQ(bench.status().refusal, Refusal::NotFinite);
    EXPECT_EQ(bench.command.q, bench.start.q);
}

TEST(Teleoperation, WrongAxesAreToldWithTheirPlace) {
    expectError({"axes is not a rotation", "experiment.yaml:1:"},
                [&] { Bench bench("axes: [1, 0, 0, 0, 1, 0, 0, 0, -1]"); });
}

TEST(Teleoperation, TicksTakeNoMemory) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    Bench bench;
    bench.hand.engagement = 1;
    bench.send();
    const testing::AllocationCounter counter;
    for (int k = 0; k < 50; ++k) {
        bench.hand.engagement = static_cast<std::uint64_t>(k / 10 % 2 == 0 ? k + 1 : 0);
        bench.send();
    }
    EXPECT_EQ(counter.count(), 0);
}

/** Any sequence of any messages: finite commands that never move while the switch is not held. */
TEST(Teleoperation, WhateverComesTheCommandIsFiniteAndStandsWithoutTheSwitch) {
    std::mt19937_64 random(20261125);
    std::uniform_real_distribution<double> step(-0.15, 0.15);
    const double odd[] = {0.0, 1e300, -1e300, kNan, kInfinity};
    Bench bench;
    for (int k = 0; k < 20000; ++k) {
        HandMessage before = bench.hand;
        // Rises, now and then mixed up.
        if (random() % 4 == 0)
            bench.hand.engagement = random() % 3 == 0 ? 0 : static_cast<std::uint64_t>(k) / 4 + random() % 6;
        bench.hand.isTracked = random() % 40 != 0;
        bench.hand.hand.position += Vector3d(step(random), step(random), step(random));
        const bool isOdd = random() % 30 == 0;
        if (isOdd) bench.hand.hand.position[static_cast<Eigen::Index>(random() % 3)] = odd[random() % 5];
        if (random() % 50 == 0) bench.hand.scale = odd[random() % 5];
        const MotionCommand last = bench.command;
        const State was = bench.state();
        bench.send(static_cast<int>(random() % 30) + 1);
        ASSERT_FALSE(HasFatalFailure());
        if (bench.hand.engagement == 0 && was == State::Released && k > 0)
            EXPECT_EQ(bench.command.tool.position, last.tool.position) << k;
        if (!bench.hand.hand.position.allFinite() || bench.hand.hand.position.norm() > 900)
            bench.hand.hand = before.hand;
        if (!bench.hand.hand.position.allFinite()) bench.hand.hand.position.setZero();
        if (!(bench.hand.scale >= 0.1 && bench.hand.scale <= 5.0)) bench.hand.scale = 1.0;
    }
}

TEST(Teleoperation, ALiveArmFollowsAHandComesToRestWithoutItAndTheLogReplays) {
    const test::TemporaryFolder folder;
    const Experiment e = test::readTestExperiment(
        test::kHandLed,
        {"duration_s=60", "limits={velocity_radps: 2*pi/3, acceleration_radps2: 4*pi, jerk_radps3: 12*pi}",
         "command={plugin: teleoperation}"});
    LiveOptions options;
    options.log.file = folder.path() / "hand.mcap";
    LiveSession session(configureCase(e.cases[0]), options);
    ASSERT_TRUE(session.hand());
    TeleoperationFeed& feed = *session.hand();
    session.begin();
    HandMessage hand;
    hand.isTracked = true;
    const auto send = [&] {
        hand.sent_s = feed.now();
        feed.put(hand);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    };
    const auto isEngaged = [&] {
        return feed.status().state == State::Engaged && feed.status().engagement == hand.engagement;
    };
    bool hasArrived = false;
    // A machine that is busy may hold the hand up for so long that it is refused: then once more.
    for (int attempt = 1; attempt <= 20 && !hasArrived; ++attempt) {
        hand.engagement = static_cast<std::uint64_t>(attempt);
        hand.hand.position.setZero();
        for (int k = 0; k < 100 && !isEngaged(); ++k) send();
        const Vector3d goal = feed.status().command.tool.position + Vector3d(0.0, 0.04, -0.04);
        hand.hand.position = {0.0, 0.04, -0.04};
        for (int k = 0; k < 300 && !hasArrived && isEngaged(); ++k) {
            send();
            hasArrived = (session.status().record.tool.position - goal).norm() < 0.002;
        }
    }
    EXPECT_TRUE(hasArrived);
    // Far away, then released on the way there.
    for (int k = 0; k < 25; ++k) {
        hand.hand.position.z() -= 0.01;
        send();
    }
    hand.engagement = 0;
    feed.put(hand);
    const double released_s = session.status().time_s;
    double rested_s = 0.0;
    for (int k = 0; k < 2000 && rested_s == 0.0; ++k) {
        const LiveStatus& now = session.status();
        if (now.time_s > released_s + 0.05 && now.record.nominal.qd.cwiseAbs().maxCoeff() < 1e-3) rested_s = now.time_s;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    RecordProperty("rest_after_ms", static_cast<int>(1000 * (rested_s - released_s)));
    EXPECT_GT(rested_s, 0.0);
    EXPECT_LT(rested_s - released_s, 1.5);
    session.stop(LiveAsker::Page);
    const CaseResult result = session.finish();
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
    EXPECT_FALSE(result.summary.anyLimitBroken());
    EXPECT_EQ(result.live->changes[1].asker, "page");
    const ReplayResult replay = replayLog(options.log.file, test::makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
    EXPECT_EQ(replay.difference, "");
    EXPECT_GT(replay.ticks, 300);
}

TEST(Teleoperation, IsFoundByItsName) {
    EXPECT_NE(dynamic_cast<TeleoperatedCommand*>(loadCommandSource("teleoperation").get()), nullptr);
}

}  // namespace
}  // namespace viable
