#include "Waypoints.h"

#include "CommandBench.h"
#include "Joints.h"

namespace viable::test {
namespace {

const char* const kThreePoints = "points: [[0.5, 0, 1, 2], [1.0, 1, 0, -2], [2.0, 3, 0.5, 0]]";

TEST(Waypoints, ComplainsAboutPointsWithTheirPlace) {
    const CommandBench bench;
    auto complaint = [&](const char* text) { return bench.findComplaint<Waypoints>(text); };

    expectContains(
        complaint("points: [[0, 1, 2, 3], [1, 1, 2]]"),
        {"experiment.yaml:1:", "command.points[1]: ", "the row has 3 numbers, but it needs 4", "3 joints of bench"});

    expectContains(
        complaint("points: [[0, 1, 2, 3], [1, 1, 2, 3], [1, 4, 5, 6]]"),
        {"command.points[2]: the time 1 s is not later than that of the row before, 1 s", "Times must increase"});

    EXPECT_CONTAINS(complaint("points: [[0, 1, 2, 3], [-1, 1, 2, 3]]"),
                    "command.points[1]: the time -1 s is before the start");
    EXPECT_NE(complaint("points: []"), "");
    EXPECT_NE(complaint("interpolation: hold"), "");
    EXPECT_CONTAINS(complaint("points: [[0, 1, 2, 3]], interpolation: cubic"), "cubic");
    EXPECT_CONTAINS(complaint("points: [[0, 1, 2, .nan]]"), "points");
    EXPECT_EQ(complaint("points: [[0, 1, 2, 3]]"), "");
}

TEST(Waypoints, ComplainsAboutAPeriodThatCannotBe) {
    const CommandBench bench;
    auto complaint = [&](const std::string& text) {
        return bench.findComplaint<Waypoints>(kThreePoints + (", " + text));
    };
    EXPECT_CONTAINS(complaint("repeat_s: 1.5"), "command.repeat_s: repeat_s = 1.5 s ends before the last point at 2 s");
    EXPECT_CONTAINS(complaint("repeat_s: -1"), "repeat_s");
    EXPECT_EQ(complaint("repeat_s: 2.0"), "");  // 0.5 s are left for the way back

    const std::string jump = "points: [[0, 0, 0, 0], [1, 1, 1, 1]], repeat_s: 1, interpolation: ";
    EXPECT_CONTAINS(bench.findComplaint<Waypoints>(jump + "smooth"), "first and last point differ");
    EXPECT_CONTAINS(bench.findComplaint<Waypoints>(jump + "linear"), "choose interpolation: hold");
    EXPECT_EQ(bench.findComplaint<Waypoints>(jump + "hold"), "");
}

TEST(Waypoints, HoldJumpsAtThePoints) {
    const CommandBench bench;
    Configured<Waypoints> source(bench, kThreePoints + std::string(", interpolation: hold"));
    EXPECT_EQ(source.traits().space, MotionCommand::Space::Joint);
    const std::pair<double, JointVector> expected[] = {
        {0.0, joints(0, 1, 2)},  {0.499, joints(0, 1, 2)},  {0.5, joints(0, 1, 2)},   {0.999, joints(0, 1, 2)},
        {1.0, joints(1, 0, -2)}, {1.999, joints(1, 0, -2)}, {2.0, joints(3, 0.5, 0)}, {1e6, joints(3, 0.5, 0)},
    };
    for (const auto& [t, q] : expected) {
        const MotionCommand command = sampleAt(source, t);
        EXPECT_EQ(command.space, MotionCommand::Space::Joint);
        EXPECT_EQ(command.q, q) << t;
        EXPECT_EQ(command.qd, joints(0, 0, 0)) << t;
    }
}

TEST(Waypoints, AJumpComesInItsOwnTickDespiteRounding) {
    const CommandBench bench;
    for (int tick = 1; tick < 3000; tick += 7) {
        char text[120];
        std::snprintf(text, sizeof text, "points: [[0, 0, 0, 0], [%d.%03d, 1, 1, 1]], interpolation: hold", tick / 1000,
                      tick % 1000);
        Configured<Waypoints> source(bench, text);
        EXPECT_EQ(sampleAt(source, (tick - 1) * 0.001).q[0], 0.0) << tick;
        EXPECT_EQ(sampleAt(source, tick * 0.001).q[0], 1.0) << tick;
    }
}

TEST(Waypoints, LinearRunsStraight) {
    const CommandBench bench;
    Configured<Waypoints> source(bench, kThreePoints + std::string(", interpolation: linear"));
    EXPECT_EQ(sampleAt(source, 0.2).q, joints(0, 1, 2));
    EXPECT_EQ(sampleAt(source, 0.2).qd, joints(0, 0, 0));
    MotionCommand command = sampleAt(source, 0.75);
    EXPECT_LE((command.q - joints(0.5, 0.5, 0)).norm(), 1e-14);
    EXPECT_LE((command.qd - joints(2, -2, -8)).norm(), 1e-14);
    command = sampleAt(source, 1.0);  // the corner belongs to the piece to come
    EXPECT_LE((command.q - joints(1, 0, -2)).norm(), 1e-14);
    EXPECT_LE((command.qd - joints(2, 0.5, 2)).norm(), 1e-14);
    EXPECT_EQ(sampleAt(source, 2.5).qd, joints(0, 0, 0));
}

TEST(Waypoints, SmoothIsAtRestInEveryPointAndContinuousBetween) {
    const CommandBench bench;
    Configured<Waypoints> source(bench, kThreePoints + std::string(", interpolation: smooth, repeat_s: 3"));
    for (double t : {0.5, 1.0, 2.0, 3.5, 4.0, 5.0}) EXPECT_LE(sampleAt(source, t).qd.norm(), 1e-12) << t;
    EXPECT_LE((sampleAt(source, 1.0).q - joints(1, 0, -2)).norm(), 1e-12);
    EXPECT_LE((sampleAt(source, 5.0).q - joints(3, 0.5, 0)).norm(), 1e-12);

    // Longest way 4 rad in 0.5 s: |qdd| <= 5.7735 * 4 / 0.5^2 = 92.4 rad/s^2, |jerk| <= 60 * 4 /
    // 0.5^3 = 1920 rad/s^3; the other joints add to the norm.
    JointVector lastQ = sampleAt(source, 0.0).q, lastQd = sampleAt(source, 0.0).qd;
    for (int k = 1; k < 9000; ++k) {
        const MotionCommand now = sampleAt(source, k * 1e-3);
        EXPECT_LE((now.qd - lastQd).cwiseAbs().maxCoeff(), 92.4e-3) << k;
        EXPECT_LE((now.q - lastQ - 0.5e-3 * (now.qd + lastQd)).cwiseAbs().maxCoeff(),
                  1920e-9 / 12 * 1.01)
            << k;  // the trapezoidal rule's error bound
        lastQ = now.q;
        lastQd = now.qd;
    }
}

TEST(Waypoints, RepeatsWithItsPeriod) {
    const CommandBench bench;
    for (const char* how : {"hold", "linear", "smooth"}) {
        Configured<Waypoints> source(bench, kThreePoints + std::string(", repeat_s: 3, interpolation: ") + how);
        for (double t = 0.5; t < 3.4; t += 0.0137)
            for (int round = 1; round < 4; ++round) {
                EXPECT_LE((sampleAt(source, t).q - sampleAt(source, t + 3.0 * round).q).norm(), 1e-9)
                    << how << " " << t;
                EXPECT_LE((sampleAt(source, t).qd - sampleAt(source, t + 3.0 * round).qd).norm(), 1e-9)
                    << how << " " << t;
            }
        EXPECT_EQ(sampleAt(source, 0.1).q, joints(0, 1, 2));  // first round: waits there
    }
}

TEST(Waypoints, AddsTheStartOfThisRunWhenRelative) {
    const CommandBench bench;
    Configured<Waypoints> source(bench, "points: [[0, 0, 0, 0], [1, 1, 2, 3]], relative_to_start: true");
    EXPECT_EQ(sampleAt(source, 0.0).q, bench.start.q);
    EXPECT_LE((sampleAt(source, 1.0).q - bench.start.q - joints(1, 2, 3)).norm(), 1e-15);

    MotionState other = bench.start;
    other.q = joints(-1, 0, 1);
    source.reset(other);
    EXPECT_EQ(sampleAt(source, 0.0).q, other.q);

    other.q[1] = std::nan("");
    source.reset(other);
    MotionCommand command;
    EXPECT_EQ(source.sample(0.0, command), TickStatus::Faulted);
    EXPECT_EQ(command.q.size(), 0);  // not written
    source.reset(bench.start);
    EXPECT_EQ(sampleAt(source, 0.0).q, bench.start.q);
}

TEST(Waypoints, RefusesTimesThatAreNone) {
    const CommandBench bench;
    Configured<Waypoints> source(bench, kThreePoints);
    MotionCommand command;
    for (double t : {-1.0, std::nan(""), HUGE_VAL}) EXPECT_EQ(source.sample(t, command), TickStatus::InvalidInput);
    EXPECT_EQ(command.q.size(), 0);  // not written
    EXPECT_EQ(source.sample(1.0, command), TickStatus::Ok);
}

TEST(Waypoints, DoesNotAllocate) {
    const CommandBench bench;
    for (const char* how : {"hold", "linear", "smooth"}) {
        SCOPED_TRACE(how);
        Configured<Waypoints> source(bench, kThreePoints + std::string(", repeat_s: 3, interpolation: ") + how);
        expectNoAllocation(bench, source, 7000);
    }
}

TEST(Waypoints, GivesTheSameThroughTheLoaderAndAfterAReset) {
    const CommandBench bench;
    expectSameAsLibrary<Waypoints>(bench, "waypoints", 2.5,
                                   [&](CommandSource& source) { bench.configure(source, kThreePoints); });
}

}  // namespace
}  // namespace viable::test
