
#include "CaseSupport.h"
#include "config/Draws.h"

namespace viable {
namespace {

constexpr double kTolerance_rad = 1e-9;
constexpr int kRuns = 8;

/** The loop of a run of the sweep, with one or the other dynamics of the plant. */
struct SweepLoop {
    SweepLoop(int run, const std::string& dynamics)
        : experiment(read(run, dynamics)),
          configured(configureCase(experiment.cases.front())),
          loop(configured->setup, std::move(configured->plugins),
               {configured->bound ? &*configured->bound : nullptr, experiment.cases.front().feedsExternalTorque}) {}

    static Experiment read(int run, const std::string& dynamics) {
        const std::string file = VIABLE_SOURCE_DIR "/experiments/indy7_sweep.yaml";
        const PluginLoader loader({VIABLE_PLUGIN_DIR});
        ConfigNode root = readExperimentTree(file, {"real_plant.dynamics=" + dynamics});
        resolveDraws(root, {1, run});
        return readExperiment(root, file, {}, loader, {VIABLE_SOURCE_DIR "/robots"});
    }

    Experiment experiment;
    std::unique_ptr<ConfiguredCase> configured;
    ControlLoop loop;
};

TEST(PlantDynamics, TheSweepsRunsAreThoseOfSimbodyWithTheRecursion) {
    double largest = 0.0, moved = 0.0;
    for (int run = 0; run < kRuns; ++run) {
        SweepLoop simbody(run, "simbody"), recursion(run, "recursion");
        TickRecord expected, found;
        const int ticks = static_cast<int>(simbody.configured->setup.duration_s / simbody.configured->setup.tick_s);
        ASSERT_EQ(ticks, 5000);
        for (int k = 0; k < ticks; ++k) {
            simbody.loop.tick(expected);
            recursion.loop.tick(found);
            ASSERT_FALSE(simbody.loop.isStopping() || recursion.loop.isStopping()) << simbody.loop.stopMessage();
            ASSERT_TRUE(found.actual.q.allFinite() && expected.actual.q.allFinite());
            largest = std::max(largest, (found.actual.q - expected.actual.q).cwiseAbs().maxCoeff());
            ASSERT_LE(largest, kTolerance_rad) << "run " << run << ", tick " << k;
        }
        moved = std::max(moved, (expected.actual.q - simbody.configured->setup.start.q).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(moved, 0.05);
    EXPECT_GT(largest, 0.0) << "both ran with the same dynamics";
    std::printf("  largest difference %.1e rad\n", largest);
}

}  // namespace
}  // namespace viable
