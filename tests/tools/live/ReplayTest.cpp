#include "live/Replay.h"

#include "CaseSupport.h"
#include "records/LogReader.h"

namespace viable::test {
namespace {

namespace fs = std::filesystem;

ReplayResult replay(const fs::path& log) {
    return replayLog(log, makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
}

CaseResult record(const fs::path& log, const char* yaml, const std::vector<std::string>& overrides,
                  const std::atomic<int>* stop = nullptr) {
    RunOptions options;
    options.log = log;
    options.stopRequest = stop;
    return runFirstCase(yaml, overrides, options);
}

/** The log once more, with what `change` makes of its rows; false: the row is left out. */
void rewrite(const fs::path& from, const fs::path& to, const std::function<bool(std::int64_t, TickRecord&)>& change) {
    LogReader reader(from);
    LogOpening opening{reader.layout(), reader.metadata(), reader.attachments()};
    LogWriter writer(to, opening);
    TickRecord row;
    for (std::int64_t k = 0; reader.read(row); ++k)
        if (change(k, row)) writer.append(row);
    writer.finish();
    ASSERT_TRUE(writer.status().ok()) << writer.status().error;
}

TEST(Replay, GivesTheSameBitsOfAnyFilterAndPlant) {
    const TemporaryFolder folder;
    int number = 0;
    for (const std::vector<std::string>& overrides : std::vector<std::vector<std::string>>{
             {"filter={plugin: certified_braking}"},
             {"filter={plugin: tovzbp}", "missed_ticks=[{at_s: 0.3, count: 7}]"},
             {"filter={plugin: pass_through}", "real_plant={plugin: simbody, friction: robot, delay_ticks: 2}",
              "robust_loop={plugin: nric}"},
             {"filter={plugin: certified_braking}", "stream={rate_hz: 30, jitter: 0.3}"}}) {
        const fs::path log = folder / (std::to_string(++number) + ".mcap");
        const CaseResult result = record(log, kTeleoperation, overrides);
        const ReplayResult again = replay(log);
        EXPECT_EQ(again.difference, "") << overrides.front();
        EXPECT_EQ(again.ticks, result.logRows);
        EXPECT_EQ(again.caseName, "A");
    }
}

TEST(Replay, KnowsAStopThatWasAskedForFromOneThatCameOfItself) {
    const TemporaryFolder folder;
    const std::atomic<int> stop{1};
    record(folder / "asked.mcap", kOneJoint, {}, &stop);
    const CaseResult failed =
        record(folder / "failed.mcap", kTeleoperation, {"filter={plugin: throwing_tick, after_ticks: 400}"});
    EXPECT_EQ(failed.stopReason, StopReason::FilterFailed);
    for (const char* name : {"asked.mcap", "failed.mcap"}) {
        const ReplayResult again = replay(folder / name);
        EXPECT_EQ(again.difference, "") << name;
        EXPECT_GT(again.ticks, 0) << name;
    }
}

TEST(Replay, NamesTheFirstFigureThatDiffers) {
    const TemporaryFolder folder;
    record(folder / "A.mcap", kTeleoperation, {"filter={plugin: certified_braking}"});
    rewrite(folder / "A.mcap", folder / "B.mcap", [](std::int64_t k, TickRecord& row) {
        if (k == 321) row.filterTorque[2] = std::nextafter(row.filterTorque[2], 1e9);
        if (k == 700) row.desiredTorque[0] += 1.0;
        return true;
    });
    expectContains(replay(folder / "B.mcap").difference,
                   {"at 0.3210 s (tick 321) filter.", ".tau_Nm is ", " in the log and ", " in the replay"});
    // A reading that was another has another torque of the robust loop.
    rewrite(folder / "A.mcap", folder / "C.mcap", [](std::int64_t k, TickRecord& row) {
        if (k == 500) row.real.q[1] += 1e-9;
        return true;
    });
    expectContains(replay(folder / "C.mcap").difference, {"at 0.5000 s (tick 500) robust."});
}

TEST(Replay, OfALogWithoutAllItsTicksIsRefused) {
    const TemporaryFolder folder;
    record(folder / "A.mcap", kOneJoint, {});
    rewrite(folder / "A.mcap", folder / "B.mcap", [](std::int64_t k, TickRecord&) { return k != 77; });
    expectError({"B.mcap", "the next row is of 0.0780 s, and 0.0770 s is expected", "every tick from the first one"},
                [&] { replay(folder / "B.mcap"); });
    rewrite(folder / "A.mcap", folder / "C.mcap", [](std::int64_t k, TickRecord&) { return k >= 500; });
    expectError({"0.5000 s, and 0.0000 s is expected"}, [&] { replay(folder / "C.mcap"); });
}

TEST(Replay, OfSomethingElseIsRefusedWithTheReason) {
    const TemporaryFolder folder;
    expectError({"none.mcap"}, [&] { replay(folder / "none.mcap"); });
    record(folder / "A.mcap", kOneJoint, {"duration_s=0.05"});
    LogReader reader(folder / "A.mcap");
    LogWriter writer(folder / "B.mcap", {reader.layout(), reader.metadata(), {}});
    writer.finish();
    expectError({"carries no experiment.yaml"}, [&] { replay(folder / "B.mcap"); });
}

}  // namespace
}  // namespace viable::test
