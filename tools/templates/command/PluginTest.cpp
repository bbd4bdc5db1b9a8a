#include "@CLASS@.h"

#include <gtest/gtest.h>

#include "viable/testing/PluginBench.h"

namespace {

using viable::testing::PluginBench;

TEST(@CLASS@, BeginsAtTheStartAndSwingsAsFarAsItWasTold) {
    PluginBench bench;
    @CLASS@ command;
    bench.configure(command, "amplitude_rad: 0.4, frequency_hz: 1");
    viable::MotionCommand out;
    EXPECT_EQ(command.sample(0.0, out), viable::TickStatus::Ok);
    EXPECT_EQ(out.q, bench.state().q);
    EXPECT_TRUE(out.qd.isZero(0.0));
    command.sample(0.5, out);
    EXPECT_NEAR(out.q[0] - bench.state().q[0], 0.4, 1e-12);
}

TEST(@CLASS@, ItsVelocityIsTheDerivativeOfItsPosition) {
    PluginBench bench;
    @CLASS@ command;
    bench.configure(command);
    viable::MotionCommand before, now, after;
    for (double t = 0.1; t < 2.0; t += 0.1) {
        command.sample(t - 1e-5, before);
        command.sample(t, now);
        command.sample(t + 1e-5, after);
        for (int i = 0; i < bench.size(); ++i) EXPECT_NEAR(now.qd[i], (after.q[i] - before.q[i]) / 2e-5, 1e-6);
    }
}

}  // namespace
