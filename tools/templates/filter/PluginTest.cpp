#include "@CLASS@.h"

#include <gtest/gtest.h>

#include "viable/testing/PluginBench.h"

namespace {

using viable::testing::PluginBench;

TEST(@CLASS@, AnAccelerationBeyondTheLimitIsClamped) {
    PluginBench bench;
    @CLASS@ filter;
    bench.configure(filter, "share: 0.5");
    const viable::JointVector wanted = 10.0 * bench.setup().limits.acceleration.upper;
    viable::FilterDecision decision;
    EXPECT_EQ(filter.filter({bench.state(), bench.calcTorque(wanted), bench.dynamics()}, decision),
              viable::FilterStatus::Modified);
    for (int i = 0; i < bench.size(); ++i)
        EXPECT_DOUBLE_EQ(decision.value[i], 0.5 * bench.setup().limits.acceleration.upper[i]);
}

TEST(@CLASS@, WhatIsAdmissibleIsNotTouched) {
    PluginBench bench;
    @CLASS@ filter;
    bench.configure(filter);
    const viable::JointVector torque = bench.calcTorque(0.1 * bench.setup().limits.acceleration.upper);
    viable::FilterDecision decision;
    EXPECT_EQ(filter.filter({bench.state(), torque, bench.dynamics()}, decision), viable::FilterStatus::Passed);
    viable::HeldMotion motion;
    calcHeldMotion({bench.state(), torque, bench.dynamics()}, viable::FilterStatus::Passed, decision,
                   bench.setup().tick_s, motion);
    EXPECT_EQ(motion.torque, torque);
}

}  // namespace
