#include "@CLASS@.h"

#include <gtest/gtest.h>

#include "viable/testing/PluginBench.h"

namespace {

using viable::testing::PluginBench;

TEST(@CLASS@, IsSilentWhereTheRealArmIsTheNominalOne) {
    PluginBench bench;
    @CLASS@ loop;
    bench.configure(loop);
    viable::JointVector torque;
    EXPECT_EQ(loop.compute({bench.state().q, bench.state().qd}, bench.state(), bench.dynamics().gravity, torque),
              viable::TickStatus::Ok);
    EXPECT_TRUE(torque.isZero(0.0));
}

TEST(@CLASS@, PullsTheRealJointToTheNominalOne) {
    PluginBench bench;
    @CLASS@ loop;
    bench.configure(loop, "stiffness: 200");
    viable::JointState real{bench.state().q, bench.state().qd};
    real.q[1] -= 0.01;
    viable::JointVector torque;
    loop.compute(real, bench.state(), bench.dynamics().gravity, torque);
    EXPECT_NEAR(torque[1], 2.0, 1e-9);
}

}  // namespace
