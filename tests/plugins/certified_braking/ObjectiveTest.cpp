#include "CaseSupport.h"

// What a change is measured in: `objective`. That all of them keep the limits: viable_properties limits --objective.

namespace viable {
namespace {

/** A hand moves the tool of an arm with a spare joint, one of whose joints can hardly move. */
constexpr char kPanda[] = R"(schema: 1
title: spare joint
robot: panda
duration_s: 10
limits:
  position_rad: {lower: [-2.8, -1.7, -2.8, -3, -2.8, 0, -2.8], upper: [2.8, 1.7, 2.8, -0.1, 2.8, 3.7, 2.8]}
  velocity_radps: 2
  acceleration_radps2: 15
  jerk_radps3: 500
command:
  {plugin: generated_hand_motion, seed: 2, reach_m: [0.1, 0.1, 0.1], rotation_rad: 0.2, top_speed_mps: 0.2, tremor_m: 0}
controller:
  plugin: task_space_pd
  stiffness: [600, 600, 600, 160, 160, 160]
  damping: [60, 60, 60, 16, 16, 16]
filter: {plugin: certified_braking, gamma: 200}
cases: {A: {}}
)";

Summary run(const std::string& filter, const std::string& objective, int heldJoint, const std::string& range) {
    const std::string joint = "[" + std::to_string(heldJoint) + "]=";
    return test::runFirstCase(
               kPanda, {"filter.plugin=" + filter, "filter.objective=" + objective,
                        "limits.position_rad.lower" + joint + "-" + range, "limits.position_rad.upper" + joint + range})
        .summary;
}

TEST(Objective, ToolLetsSpareJointsTakeOverFromOneAtItsLimit) {
    for (const char* filter : {"certified_braking", "whole_arm_braking"})
        for (const int joint : {0, 2}) {
            const double free = run(filter, "torque", joint, "2.8").toolErrorRms();
            const Summary tool = run(filter, "tool", joint, "0.02");
            const double torque = run(filter, "torque", joint, "0.02").toolErrorRms();
            EXPECT_LE(tool.toolErrorRms(), torque / 5.0) << filter << ", joint " << joint;
            EXPECT_LE(tool.toolErrorRms(), 2.0 * free) << filter << ", joint " << joint;
            EXPECT_FALSE(tool.anyLimitBroken());
        }
}

TEST(Objective, PathHoldsAllJointsBackAlikeAndKeepsTheLimits) {
    for (const char* objective : {"joint", "path"}) {
        const Summary s = run("certified_braking", objective, 0, "0.02");
        EXPECT_FALSE(s.anyLimitBroken()) << objective;
        EXPECT_EQ(s.ticksWith(FilterStatus::Infeasible), 0) << objective;
        EXPECT_LT(s.toolErrorRms(), run("certified_braking", "torque", 0, "0.02").toolErrorRms()) << objective;
    }
}

}  // namespace
}  // namespace viable
