#include "RandomSteps.h"

#include "CommandBench.h"

namespace viable {
namespace {

/** The bench's robot with limits: [-1, 2], [-2, 3], [-3, 4]. */
RunSetup makeSetup(const CommandBench& bench) {
    RunSetup setup = bench.setup();
    setup.limits.position.lower << -1, -2, -3;
    setup.limits.position.upper << 2, 3, 4;
    return setup;
}

struct Source : RandomSteps {
    Source(const CommandBench& bench, const std::string& text) {
        configure(makeSetup(bench), bench.read(text));
        reset(bench.start);
    }
};

std::string findComplaint(const CommandBench& bench, const std::string& text) {
    return test::findComplaint([&] { Source source(bench, text); });
}

TEST(RandomSteps, HoldsPositionsForTimesInTheRangeAndGoesBeyondTheLimitsAsOftenAsAsked) {
    const CommandBench bench(3000.0);
    Source source(bench, "seed: 3, shortest_s: 0.5, longest_s: 3, beyond_share: 0.3, beyond_rad: 0.5");
    EXPECT_EQ(source.traits().space, MotionCommand::Space::Joint);
    const RunSetup setup = makeSetup(bench);
    int steps[3] = {}, below[3] = {}, above[3] = {}, together = 0;
    double since[3] = {}, shortest = 1e9, longest = 0.0;
    MotionCommand last = sampleAt(source, 0.0);
    for (int k = 1; k <= 300000; ++k) {
        const double t = k * 0.01;
        const MotionCommand now = sampleAt(source, t);
        ASSERT_EQ(now.qd, JointVector::Zero(3));
        int jumps = 0;
        for (int i = 0; i < 3; ++i) {
            if (now.q[i] == last.q[i]) continue;
            ++jumps;
            if (steps[i]++ > 0) {
                shortest = std::min(shortest, t - since[i]);
                longest = std::max(longest, t - since[i]);
            }
            since[i] = t;
            const double lower = setup.limits.position.lower[i], upper = setup.limits.position.upper[i];
            ASSERT_GE(now.q[i], lower - 0.5);
            ASSERT_LE(now.q[i], upper + 0.5);
            below[i] += now.q[i] < lower;
            above[i] += now.q[i] > upper;
        }
        together += jumps > 1;
        last = now;
    }
    EXPECT_GE(shortest, 0.5 - 0.011);
    EXPECT_LE(longest, 3.0 + 0.011);
    EXPECT_LT(shortest, 0.55);
    EXPECT_GT(longest, 2.95);
    for (int i = 0; i < 3; ++i) {
        EXPECT_GT(steps[i], 1500);
        EXPECT_NEAR(below[i], 0.15 * steps[i], 0.04 * steps[i]);
        EXPECT_NEAR(above[i], 0.15 * steps[i], 0.04 * steps[i]);
    }
    EXPECT_LT(together, steps[0] / 10);  // each joint has times of its own
}

TEST(RandomSteps, SameSeedSameStepsWhateverTheOrderOfTheQuestions) {
    const CommandBench bench;
    Source one(bench, "seed: 5"), two(bench, "seed: 5"), other(bench, "seed: 6");
    bool differs = false;
    for (int k = 0; k < 3000; ++k) expectSame(sampleAt(one, k * 0.01), sampleAt(two, k * 0.01));
    two.reset(bench.start);
    for (int k = 2999; k >= 0; --k) expectSame(sampleAt(one, k * 0.01), sampleAt(two, k * 0.01));
    for (int k = 0; k < 3000; ++k) differs |= sampleAt(one, k * 0.01).q != sampleAt(other, k * 0.01).q;
    EXPECT_TRUE(differs);
    // A longer run begins in the same way.
    const CommandBench longer(300.0);
    Source more(longer, "seed: 5");
    for (int k = 0; k < 3000; ++k) expectSame(sampleAt(one, k * 0.01), sampleAt(more, k * 0.01));
}

TEST(RandomSteps, HoldsTheLastSetPointsBeyondItsEnd) {
    const CommandBench bench(5.0);
    Source source(bench, "longest_s: 0.5");
    expectSame(sampleAt(source, 16.0), sampleAt(source, 1e9));
    MotionCommand command;
    for (const double t : {-1.0, std::nan(""), HUGE_VAL})
        EXPECT_EQ(source.sample(t, command), TickStatus::InvalidInput);
}

TEST(RandomSteps, AllInsideOrAllBeyond) {
    const CommandBench bench;
    Source inside(bench, "beyond_share: 0"), beyond(bench, "beyond_share: 1, beyond_rad: 2");
    const RunSetup setup = makeSetup(bench);
    for (int k = 0; k < 3000; ++k)
        for (int i = 0; i < 3; ++i) {
            const double lower = setup.limits.position.lower[i], upper = setup.limits.position.upper[i];
            const double q = sampleAt(inside, k * 0.01).q[i], x = sampleAt(beyond, k * 0.01).q[i];
            ASSERT_TRUE(q >= lower && q <= upper) << q;
            ASSERT_TRUE(x <= lower || x >= upper) << x;
        }
}

TEST(RandomSteps, ComplainsAboutTimesAndLimitsThatCannotBe) {
    const CommandBench bench;
    EXPECT_CONTAINS(findComplaint(bench, "shortest_s: 2, longest_s: 1"),
                    "command.longest_s: longest_s = 1 s is shorter than shortest_s = 2 s");
    EXPECT_CONTAINS(findComplaint(CommandBench(1e6), "shortest_s: 0.001"), "more than 1e+06 steps");
    EXPECT_CONTAINS(findComplaint(bench, "beyond_share: 1.1"), "beyond_share");
    RandomSteps source;
    expectError({"needs a position limit on both sides of"}, [&] { bench.configure(source, ""); });
}

TEST(RandomSteps, AllocatesNothingInATick) {
    const CommandBench bench;
    Source source(bench, "");
    expectNoAllocation(bench, source, 30000);
}

TEST(RandomSteps, LoadsAsALibrary) {
    const CommandBench bench;
    expectSameAsLibrary<RandomSteps>(bench, "random_steps", 30.0, [&](CommandSource& source) {
        source.configure(makeSetup(bench), bench.read("seed: 9"));
    });
}

}  // namespace
}  // namespace viable
