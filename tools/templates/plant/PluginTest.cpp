#include "@CLASS@.h"

#include <gtest/gtest.h>

#include "viable/testing/PluginBench.h"

namespace {

using viable::testing::PluginBench;

TEST(@CLASS@, StaysWhereGravityIsCarried) {
    PluginBench bench;
    @CLASS@ plant;
    bench.configure(plant);
    viable::JointVector applied;
    for (int tick = 0; tick < 1000; ++tick)
        ASSERT_EQ(plant.advance(bench.dynamics().gravity, applied), viable::TickStatus::Ok);
    for (int i = 0; i < bench.size(); ++i) EXPECT_NEAR(plant.actual().q[i], bench.state().q[i], 1e-9);
}

TEST(@CLASS@, TheMotorsGiveNoMoreThanTheyHave) {
    PluginBench bench;
    @CLASS@ plant;
    bench.configure(plant);
    viable::JointVector applied;
    plant.advance(viable::JointVector::Constant(bench.size(), 1e6), applied);
    EXPECT_EQ(applied, bench.setup().robot.actuation.torqueLimit);
}

}  // namespace
