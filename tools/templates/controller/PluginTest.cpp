#include "@CLASS@.h"

#include <gtest/gtest.h>

#include "viable/testing/PluginBench.h"

namespace {

using viable::testing::PluginBench;

TEST(@CLASS@, CarriesGravityAtTheCommandedPlace) {
    PluginBench bench;
    @CLASS@ controller;
    bench.configure(controller);
    viable::ControllerOutput output;
    EXPECT_EQ(controller.compute({bench.command(bench.state().q), bench.state(), bench.dynamics()}, output),
              viable::TickStatus::Ok);
    EXPECT_EQ(output.torque, bench.dynamics().gravity);
}

TEST(@CLASS@, PullsTowardsTheCommand) {
    PluginBench bench;
    @CLASS@ controller;
    bench.configure(controller, "stiffness: 50");
    viable::ControllerOutput output;
    viable::JointVector q = bench.state().q;
    q[0] += 0.1;
    controller.compute({bench.command(q), bench.state(), bench.dynamics()}, output);
    EXPECT_NEAR(output.torque[0] - bench.dynamics().gravity[0], 5.0, 1e-12);
}

}  // namespace
