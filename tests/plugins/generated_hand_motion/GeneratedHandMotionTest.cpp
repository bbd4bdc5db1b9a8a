#include "GeneratedHandMotion.h"

#include <random>

#include "CommandBench.h"

namespace viable {
namespace {

TEST(GeneratedHandMotion, ComplainsAboutNumbersThatDoNotFit) {
    const CommandBench bench;
    auto complaint = [&](const char* text) { return bench.findComplaint<GeneratedHandMotion>(text); };
    expectContains(complaint("fastest_s: 2, slowest_s: 1"),
                   {"experiment.yaml:1:", "command.slowest_s: slowest_s = 1 s is shorter than fastest_s = 2 s"});
    EXPECT_CONTAINS(complaint("reach_m: [0.1, 0.2]"), "reach_m");
    EXPECT_CONTAINS(complaint("reach_m: [0.1, 0.2, -0.1]"), "reach_m");
    EXPECT_CONTAINS(complaint("rotation_rad: 4"), "rotation_rad");
    EXPECT_CONTAINS(complaint("seed: -1"), "seed");
    EXPECT_CONTAINS(complaint("top_speed_mps: 0"), "top_speed_mps");
    EXPECT_CONTAINS(complaint("tremor: 1"), "tremor");
    EXPECT_EQ(complaint("top_speed_mps: .inf"), "");
    EXPECT_EQ(complaint("fastest_s: 1, slowest_s: 1, pause_s: 0"), "");

    const CommandBench endless(1e6);
    EXPECT_CONTAINS(endless.findComplaint<GeneratedHandMotion>("fastest_s: 0.1"),
                    "command.fastest_s: a run of 1e+06 s may need more than 1e+06 reaches");
}

TEST(GeneratedHandMotion, BeginsExactlyAtTheStartPoseAtRest) {
    const CommandBench bench;
    for (int seed = 0; seed < 20; ++seed) {
        Configured<GeneratedHandMotion> source(bench, "seed: " + std::to_string(seed));
        EXPECT_EQ(source.traits().space, MotionCommand::Space::Tool);
        const MotionCommand command = sampleAt(source, 0.0);
        EXPECT_EQ(command.tool.position, bench.tool.position);
        EXPECT_EQ(command.tool.orientation.coeffs(), bench.tool.orientation.coeffs());
        EXPECT_EQ(command.toolTwist, Vector6::Zero());
    }
}

TEST(GeneratedHandMotion, IsSmoothAndStrongWithTheDefaults) {
    const CommandBench bench(60.0);
    for (const char* seed : {"seed: 1", "seed: 2", "seed: 3"}) {
        Configured<GeneratedHandMotion> source(bench, seed);
        // Tremor: 0.5 mrad at up to 12 Hz changes its acceleration by up to 0.21 krad/s^3.
        const MotionExtremes found = expectSmoothMotion(source, 60.0, 1.0);
        EXPECT_GT(found.reach, 0.15) << seed;
        EXPECT_LT(found.reach, 0.245 + 0.001) << seed;  // corner of the box, and tremor
        EXPECT_GT(found.turn, 0.4) << seed;
        EXPECT_LT(found.turn, 0.5 + 0.001) << seed;
        EXPECT_GT(found.speed, 0.8) << seed;
        EXPECT_LT(found.speed, 1.5 + 0.05) << seed;
        EXPECT_GT(found.turnRate, 1.5) << seed;
        // 5.7735 way / time^2 with the shortest time that top speed leaves, and tremor.
        EXPECT_LT(found.speedJump, 0.020) << seed;
        EXPECT_LT(found.turnRateJump, 0.040) << seed;
    }
}

TEST(GeneratedHandMotion, StaysSmoothAtLargeRotations) {
    const CommandBench bench(30.0);
    Configured<GeneratedHandMotion> source(bench, "rotation_rad: 3, fastest_s: 1, tremor_m: 0, tremor_rad: 0");
    const MotionExtremes found = expectSmoothMotion(source, 30.0, 1.0);
    EXPECT_GT(found.turn, 2.0);
    EXPECT_LE(found.turn, 3.0);
}

TEST(GeneratedHandMotion, RestsInPausesAndKeepsTheReachPerAxis) {
    const CommandBench bench(60.0);
    Configured<GeneratedHandMotion> source(bench, "reach_m: [0.1, 0, 0.3], pause_s: 1, tremor_m: 0, tremor_rad: 0");
    double largest[3] = {};
    int ticksAtRest = 0;
    for (int k = 0; k < 60000; ++k) {
        const MotionCommand now = sampleAt(source, k * 1e-3);
        for (int axis = 0; axis < 3; ++axis)
            largest[axis] = std::max(largest[axis], std::abs(now.tool.position[axis] - bench.tool.position[axis]));
        if (now.toolTwist.isZero(0.0)) ++ticksAtRest;
    }
    EXPECT_GT(largest[0], 0.07);
    EXPECT_LE(largest[0], 0.1 + 1e-15);
    EXPECT_EQ(largest[1], 0.0);
    EXPECT_GT(largest[2], 0.22);
    EXPECT_LE(largest[2], 0.3 + 1e-15);
    // Pauses are half a second in the mean, reaches 1.1 s.
    EXPECT_GT(ticksAtRest, 60000 / 6);
    EXPECT_LT(ticksAtRest, 60000 / 2);
}

TEST(GeneratedHandMotion, TremorIsBoundedAndBetween8And12Hertz) {
    const CommandBench bench(20.0);
    Configured<GeneratedHandMotion> source(bench,
                                           "reach_m: [0, 0, 0], rotation_rad: 0, tremor_m: 0.002, tremor_rad: 0");
    double largest = 0.0, early = 0.0;
    int crossings = 0;
    double last = 0.0;
    for (int k = 0; k < 20000; ++k) {
        const Eigen::Vector3d offset = sampleAt(source, k * 1e-3).tool.position - bench.tool.position;
        largest = std::max(largest, offset.cwiseAbs().maxCoeff());
        if (k < 200) early = std::max(early, offset.cwiseAbs().maxCoeff());
        if (k >= 1000 && offset.x() * last < 0.0) ++crossings;
        last = offset.x();
    }
    EXPECT_LE(largest, 0.002);
    EXPECT_GT(largest, 0.001);
    EXPECT_LT(early, 0.058 * 0.002);  // minimum-jerk share at 0.2 s
    const double frequency = crossings / 2.0 / 19.0;
    EXPECT_GT(frequency, 7.5);
    EXPECT_LT(frequency, 12.5);
}

TEST(GeneratedHandMotion, IsAFunctionOfSeedAndTimeAlone) {
    const CommandBench bench(30.0), longer(300.0);
    Configured<GeneratedHandMotion> first(bench, "seed: 5"), again(bench, "seed: 5"), other(bench, "seed: 6");
    Configured<GeneratedHandMotion> inLongRun(longer, "seed: 5");
    Configured<GeneratedHandMotion> withoutTremor(bench, "seed: 5, tremor_m: 0, tremor_rad: 0");
    double difference = 0.0;
    for (double t = 0.0; t < 30.0; t += 0.0123) {
        const MotionCommand command = sampleAt(first, t);
        expectSame(command, sampleAt(inLongRun, t));
        difference = std::max(difference, (command.tool.position - sampleAt(other, t).tool.position).norm());
        EXPECT_LE((command.tool.position - sampleAt(withoutTremor, t).tool.position).cwiseAbs().maxCoeff(),
                  0.0001 + 1e-12);
    }
    EXPECT_GT(difference, 0.1);
    // Any order of times, and after a reset, the same again.
    for (double t : {29.0, 3.0, 17.5, 0.0}) expectSame(sampleAt(again, t), sampleAt(first, t));
    again.reset(bench.start);
    for (double t : {0.0, 3.0, 17.5, 29.0}) expectSame(sampleAt(again, t), sampleAt(first, t));
}

TEST(GeneratedHandMotion, DrawsTheSameNumbersOnEveryMachine) {
    // mt19937_64 and seed_seq are fixed by the C++ standard; the mapping to doubles is ours. The
    // first target, worked out here from the raw words alone.
    std::seed_seq words{42u, 0u, 0u};
    std::mt19937_64 engine(words);
    const double extent = 0.2;
    const double unit = static_cast<double>(engine() >> 11) / 9007199254740992.0;  // 2^53
    const double target = extent * (2.0 * unit - 1.0);

    const CommandBench bench(2.0);
    Configured<GeneratedHandMotion> source(
        bench,
        "seed: 42, reach_m: [0.2, 0.2, 0.2], fastest_s: 1, slowest_s: 1, pause_s: 0.5, "
        "top_speed_mps: .inf, tremor_m: 0, tremor_rad: 0");
    EXPECT_NEAR(sampleAt(source, 1.0).tool.position.x() - bench.tool.position.x(), target, 1e-12);
}

TEST(GeneratedHandMotion, HoldsTheLastTargetAfterTheRun) {
    const CommandBench bench(1.0);
    Configured<GeneratedHandMotion> source(bench, "tremor_m: 0, tremor_rad: 0");
    const MotionCommand late = sampleAt(source, 100.0);
    EXPECT_EQ(late.toolTwist, Vector6::Zero());
    expectSame(late, sampleAt(source, 1e9));
}

TEST(GeneratedHandMotion, RefusesTimesThatAreNone) {
    const CommandBench bench;
    Configured<GeneratedHandMotion> source(bench, "");
    MotionCommand command;
    for (double t : {-1.0, std::nan(""), HUGE_VAL}) EXPECT_EQ(source.sample(t, command), TickStatus::InvalidInput);
    EXPECT_EQ(command.tool.position, Eigen::Vector3d::Zero());  // not written
}

TEST(GeneratedHandMotion, DoesNotAllocate) {
    const CommandBench bench;
    Configured<GeneratedHandMotion> source(bench, "");
    expectNoAllocation(bench, source, 50000);
}

TEST(GeneratedHandMotion, GivesTheSameThroughTheLoader) {
    const CommandBench bench;
    expectSameAsLibrary<GeneratedHandMotion>(bench, "generated_hand_motion", 30.0,
                                             [&](CommandSource& source) { bench.configure(source, "seed: 9"); });
}

}  // namespace
}  // namespace viable
