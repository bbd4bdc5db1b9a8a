#include <nlohmann/json.hpp>

#include "CaseSupport.h"
#include "environment/CollisionChecker.h"
#include "live/LiveSession.h"
#include "live/Replay.h"
#include "records/LogReader.h"

namespace viable::test {
namespace {

using nlohmann::json;

/** An arm that keeps clear of a far shelf, and of a moving ball, so that all kinds of an index are there. */
const std::vector<std::string> kBesideAShelf = {
    "filter={plugin: whole_arm_braking}",
    "environment={safety_distance_m: 0.02, obstacles: {shelf: {box: [0.1, 0.1, 0.1], at: {xyz: [-1.5, 0, 0.5]}}, "
    "far: {sphere: 0.1, path: [{time_s: 0, xyz: [0, 2, 1]}, {time_s: 5, xyz: [0, -2, 3]}]}}}"};

TEST(PlacedObstacles, AMessageIsTakenWholeOrNotAtAll) {
    const auto box =
        PlacedObstacles::read(R"({"place": 3, "box": [0.1, 0.2, 0.3], "at": [1, -2, 0.5], "turn": [0, 0, 0, 1]})");
    ASSERT_TRUE(box && box->solid);
    EXPECT_EQ(box->place, 2);
    EXPECT_EQ(box->solid->name, "placed 3");
    EXPECT_EQ(box->solid->kind, Solid::Kind::Box);
    EXPECT_EQ(box->solid->size, Eigen::Vector3d(0.1, 0.2, 0.3));
    EXPECT_EQ(box->solid->pose.translation(), Eigen::Vector3d(1, -2, 0.5));
    EXPECT_NEAR(box->solid->pose.linear()(0, 0), -1.0, 1e-15);
    const auto ball = PlacedObstacles::read(R"({"place": 8, "ball": 0.05, "at": [0, 0, 0]})");
    ASSERT_TRUE(ball && ball->solid);
    EXPECT_EQ(ball->solid->radius, 0.05);
    const auto none = PlacedObstacles::read(R"({"place": 1})");
    ASSERT_TRUE(none);
    EXPECT_FALSE(none->solid);
    const auto expectRefused = [](const std::vector<std::string>& texts) {
        for (const std::string& text : texts) EXPECT_FALSE(PlacedObstacles::read(text)) << text;
    };
    expectRefused({"", "{", "null", "[]", "3", "{}", std::string(500, '[')});
    expectRefused(
        {R"({"place": 0})", R"({"place": 9})", R"({"place": 1.5})", R"({"place": "1"})", R"({"place": 1e300})"});
    expectRefused({R"({"ball": 0.1, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 0.1})",
                   R"({"place": 1, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 0, 0]})",
                   R"({"place": 1, "ball": 0, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": -1, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 5.1, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": true, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 1e999, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": NaN, "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 1e999]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 11]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, null]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 0], "turn": [1, 0, 0, 0]})",
                   R"({"place": 1, "ball": 0.1, "box": [1, 1, 1], "at": [0, 0, 0]})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 0], "name": "<script>"})",
                   R"({"place": 1, "box": [1, 1], "at": [0, 0, 0]})",
                   R"({"place": 1, "box": [1, 1, 0], "at": [0, 0, 0]})",
                   R"({"place": 1, "box": [1, 1, 1], "at": [0, 0, 0], "turn": [0, 0, 0, 0]})",
                   R"({"place": 1, "box": [1, 1, 1], "at": [0, 0, 0], "turn": [2, 0, 0, 0]})",
                   R"({"place": 1} {"place": 2})",
                   R"({"place": 1, "ball": 0.1, "at": [0, 0, 0]})" + std::string(600, ' ')});
}

TEST(PlacedObstacles, AVersionIsTheSameAfterALog) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> anywhere(-10.0, 10.0);
    PlacedObstacles::Version version;
    version.stamp_s = 0.1 + 0.2;
    for (int place = 1; place <= PlacedObstacles::kMost; ++place) {
        const Eigen::Quaterniond turn =
            Eigen::Quaterniond(anywhere(random), anywhere(random), anywhere(random), 1.0).normalized();
        const json message = {{"place", place},
                              {"box", {0.1 + 0.01 * place, 1.0 / 3.0, 2.0}},
                              {"at", {anywhere(random), anywhere(random), anywhere(random)}},
                              {"turn", {turn.w(), turn.x(), turn.y(), turn.z()}}};
        version.all.push_back(PlacedObstacles::read(message.dump()).value());
    }
    const auto again = PlacedObstacles::readVersion(PlacedObstacles::write(version), "log");
    EXPECT_EQ(again.stamp_s, version.stamp_s);
    ASSERT_EQ(again.all.size(), version.all.size());
    for (std::size_t k = 0; k < again.all.size(); ++k) {
        EXPECT_EQ(again.all[k].solid->pose.matrix(), version.all[k].solid->pose.matrix());
        EXPECT_EQ(again.all[k].solid->size, version.all[k].solid->size);
    }
    for (const char* wrong :
         {"", "{}", R"({"stamp_s": 1, "placed": [{"place": 1}]})", R"({"stamp_s": "1", "placed": []})"})
        expectError({"my log"}, [&] { PlacedObstacles::readVersion(wrong, "my log"); });
}

TEST(PlacedObstacles, AFilterThatKeepsClearOfNothingTakesNone) {
    for (const std::vector<std::string>& overrides :
         {std::vector<std::string>{"filter={plugin: certified_braking}"},
          std::vector<std::string>{kBesideAShelf[1], "filter={plugin: certified_braking}"},
          std::vector<std::string>{"filter={plugin: whole_arm_braking}"}}) {
        const Experiment e = readTestExperiment(kTeleoperation, overrides);
        LiveSession session(configureCase(e.cases[0]), {});
        EXPECT_EQ(session.placed(), nullptr) << overrides.front();
    }
}

/** What was done to the arm, and what it did, in simulated time. */
struct Drive {
    Drive() : experiment(readTestExperiment(kTeleoperation, kBesideAShelf)) {
        CaseLog log;
        log.file = folder / "A.mcap";
        log.isLive = true;
        log.moreObstacles = PlacedObstacles::listNames();
        running = std::make_unique<RunningCase>(configureCase(experiment.cases[0]), log, false);
        placed =
            std::make_unique<PlacedObstacles>(running->configured(), *running->configured().feed, running->recorder());
    }
    /** @param act  every 16 ms, with the time and the last tick */
    void run(double duration_s, const std::function<void(double, const TickRecord&)>& act) {
        ControlLoop& loop = running->loop();
        TickRecord& record = running->record();
        for (std::int64_t k = 0; !running->isStopOver(); ++k) {
            if (k > 0 && k % 16 == 0) {
                act(loop.time(), record);
                if (placed->look(loop.time())) ++versions;
            }
            if (loop.time() >= duration_s && !loop.isStopping()) loop.requestStop(StopReason::Requested, "it is over");
            loop.tick(record);
            PlacedObstacles::renumber(*running->configured().feed->view().surroundings,
                                      *experiment.cases[0].environment, record.reports[LimitKind::Clearance]);
            running->count();
            while (!running->recorder()->append(record)) std::this_thread::yield();
        }
        result = running->finish(true);
        LogReader reader(folder / "A.mcap");
        TickRecord row;
        while (reader.read(row)) rows.push_back(row);
        for (const LogAttachment& attachment : reader.attachments())
            if (attachment.name.rfind(PlacedObstacles::kAttachment, 0) == 0)
                logged.push_back(PlacedObstacles::readVersion(attachment.data, attachment.name));
    }
    /** The version that the filter went by in a row; null: the file's surroundings. */
    const PlacedObstacles::Version* find(const TickRecord& row) const {
        for (const auto& version : logged)
            if (std::abs(row.time_s - row.reports[LimitKind::Clearance].age_s - version.stamp_s) < 1e-4)
                return &version;
        return nullptr;
    }

    TemporaryFolder folder;
    const Experiment experiment;
    std::unique_ptr<RunningCase> running;
    std::unique_ptr<PlacedObstacles> placed;
    std::optional<CaseResult> result;
    std::vector<TickRecord> rows;
    std::vector<PlacedObstacles::Version> logged;
    int versions = 0;
};

void expectStoppedAsAsked(const CaseResult& result) {
    EXPECT_EQ(result.stopReason, StopReason::Requested) << result.stopMessage;
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        EXPECT_EQ(result.summary.ticksOutside(kind), 0) << getName(kind, LimitSide::Upper);
}

std::string ballAt(int place, double radius, const Eigen::Vector3d& at) {
    return json{{"place", place}, {"ball", radius}, {"at", {at.x(), at.y(), at.z()}}}.dump();
}

/** The arm never comes nearer to anything than the safety distance, or than what the stop that it had in store when a version
came was about to: what is put too near is no fault of the arm's, and what comes after is. */
void expectNothingAvoidable(const Drive& drive) {
    const CasePlan& plan = drive.experiment.cases[0];
    const PlacedObstacles::Version* version = nullptr;
    std::unique_ptr<CollisionChecker> checker;
    double allowed = plan.environment->safetyDistance_m;
    std::size_t judged = 0;
    for (std::size_t k = 0; k < drive.rows.size(); ++k) {
        const TickRecord& row = drive.rows[k];
        if (row.braking || row.missed) continue;  // the age that it told last goes on
        const auto* now = drive.find(row);
        if (k == 0 || now != version) {
            version = now;
            Environment environment = *plan.environment;
            if (now)
                for (const auto& one : now->all) environment.solids.push_back(*one.solid);
            checker = std::make_unique<CollisionChecker>(plan.robot, *plan.geometry, environment);
            allowed = std::min(plan.environment->safetyDistance_m, row.reports[LimitKind::Clearance].margin);
        }
        // Depths in a solid are no lower bounds: balls and capsules measure them differently.
        if (k % 5 != 0 || allowed <= 0.0) continue;  // the judge takes its time
        ++judged;
        EXPECT_GE(checker->findContact(row.nominal.q, row.time_s, 0.5).distance, allowed - 1e-6) << row.time_s;
    }
    EXPECT_GT(judged, drive.rows.size() / 20);
}

void expectSameAgain(const Drive& drive) {
    const ReplayResult again = replayLog(drive.folder / "A.mcap", makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
    EXPECT_EQ(again.difference, "");
    EXPECT_EQ(again.ticks, static_cast<std::int64_t>(drive.rows.size()));
}

TEST(PlacedObstacles, WhatIsDraggedAroundAMovingArmIsKeptClearOfAndReplaysToTheBit) {
    Drive drive;
    drive.run(3.0, [&](double t, const TickRecord& now) {
        const Eigen::Vector3d tool = now.tool.position;
        // Before the arm, as seen from its base: a ball that swings from side to side, and a box that comes, goes, and comes again.
        const double outwards = std::atan2(tool.y(), tool.x()), angle = outwards + 1.2 * std::sin(3.0 * t);
        drive.placed->request(ballAt(1, 0.05,
                                     tool + (0.17 - 0.05 * std::pow(std::sin(2.0 * t), 2)) *
                                                Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.0)));
        json box = {{"place", 8}};
        if (std::fmod(t, 1.0) < 0.7) {
            const double away = 0.5 - 0.4 * std::fmod(t, 1.0);
            box["box"] = {0.1, 0.1, 0.05};
            box["at"] = {tool.x() + away * std::cos(outwards), tool.y() + away * std::sin(outwards), tool.z() - 0.1};
        }
        drive.placed->request(box.dump());
    });
    expectStoppedAsAsked(*drive.result);
    EXPECT_GT(drive.versions, 50);
    EXPECT_EQ(drive.logged.size(), static_cast<std::size_t>(drive.versions));
    bool nearPlaced = false, held = false;
    for (const TickRecord& row : drive.rows) {
        ASSERT_LT(row.reports[LimitKind::Clearance].other, static_cast<int>(drive.result->obstacles.size()));
        if (row.reports[LimitKind::Clearance].other >= 2) nearPlaced = true;
        for (const JointIntervention& joint : row.joints) held |= joint.limit == LimitKind::Clearance;
    }
    EXPECT_TRUE(nearPlaced);
    EXPECT_TRUE(held);
    EXPECT_EQ(drive.result->obstacles.at(1), "far");
    EXPECT_EQ(drive.result->obstacles.at(2), "placed 1");
    EXPECT_EQ(drive.result->obstacles.size(), 10u);
    expectNothingAvoidable(drive);
    expectSameAgain(drive);

    // Without them the same commands give another run.
    LogReader reader(drive.folder / "A.mcap");
    LogOpening opening{reader.layout(), reader.metadata(), {reader.attachments().front()}};
    LogWriter writer(drive.folder / "B.mcap", opening);
    for (const TickRecord& row : drive.rows) writer.append(row);
    writer.finish();
    EXPECT_NE(replayLog(drive.folder / "B.mcap", makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"}).difference, "");
}

TEST(PlacedObstacles, WhatIsPutIntoTheArmBrakesItAndIsNamedUntilItIsTakenAway) {
    Drive drive;
    bool isPut = false, isGone = false;
    drive.run(3.5, [&](double t, const TickRecord& now) {
        if (t > 1.0 && !isPut) isPut = drive.placed->request(ballAt(5, 0.1, now.tool.position));
        if (t > 2.5 && !isGone) isGone = drive.placed->request(R"({"place": 5})");
    });
    expectStoppedAsAsked(*drive.result);
    ASSERT_EQ(drive.logged.size(), 2u);
    int during = 0, held = 0;
    double least = 0.0;
    bool movesAgain = false;
    for (const TickRecord& row : drive.rows) {
        const auto* version = drive.find(row);
        if (row.braking) continue;
        if (version == &drive.logged[0]) {
            ++during;
            least = std::min(least, row.reports[LimitKind::Clearance].margin);
            EXPECT_EQ(row.reports[LimitKind::Clearance].other, 2 + 4);
            for (const JointIntervention& joint : row.joints)
                if (joint.limit == LimitKind::Clearance) {
                    ++held;
                    break;
                }
        }
        movesAgain |= version == &drive.logged[1] && row.nominal.qd.cwiseAbs().maxCoeff() > 0.05;
    }
    EXPECT_GT(during, 1000);
    EXPECT_LT(least, -0.05);
    EXPECT_GT(held, during / 10);
    EXPECT_TRUE(movesAgain);
    expectNothingAvoidable(drive);
    expectSameAgain(drive);
}

TEST(PlacedObstacles, OfALiveArmReplayToTheBitWhateverTheClockDoes) {
    const Experiment e = readTestExperiment(kTeleoperation, kBesideAShelf);
    const TemporaryFolder folder;
    LiveOptions options;
    options.realTime = {-1, 0, false};
    options.duration_s = 1.0;
    options.log.file = folder / "A.mcap";
    LiveSession session(configureCase(e.cases[0]), options);
    ASSERT_NE(session.placed(), nullptr);
    session.begin();
    int versions = 0;
    while (!session.hasEnded()) {
        const LiveStatus& status = session.status();
        if (status.record.nominal.q.size() > 0) {
            const Eigen::Vector3d aside(0.3 * std::cos(5.0 * status.time_s), 0.3 * std::sin(5.0 * status.time_s), 0.0);
            session.placed()->request(ballAt(1, 0.05, status.record.tool.position + aside));
            if (session.placed()->look(status.time_s)) ++versions;
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    const CaseResult result = session.finish();
    EXPECT_GT(versions, 0);
    EXPECT_EQ(result.obstacles.size(), 10u);
    if (result.live->lostRows > 0) GTEST_SKIP() << "a disk that is too slow lost rows";
    const ReplayResult again = replayLog(folder / "A.mcap", makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
    EXPECT_EQ(again.difference, "");
    EXPECT_EQ(again.ticks, static_cast<std::int64_t>(result.logRows));
}

}  // namespace
}  // namespace viable::test
