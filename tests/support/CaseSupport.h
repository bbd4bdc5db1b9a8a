#pragma once

#include "Complaint.h"
#include "Paths.h"
#include "TemporaryFolder.h"
#include "experiment/CaseRun.h"
#include "experiment/ExperimentFile.h"

namespace viable::test {

/** The real plugins and those that misbehave. */
inline PluginLoader makeTestLoader() {
    return PluginLoader({VIABLE_PLUGIN_DIR, VIABLE_BINARY_DIR "/tests/broken_plugins"});
}

inline Experiment readTestExperiment(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
    const TemporaryFolder folder;
    return readExperiment(folder.write("test.yaml", yaml), overrides, makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
}

/** One joint that is sent to and fro within its limits; keys can be overridden. */
inline const char* const kOneJoint = R"(schema: 1
title: one joint
robot: single_joint
duration_s: 2
tick_s: 0.001
command: {plugin: waypoints, points: [[0, 1], [1, -1]], repeat_s: 2}
controller: {plugin: joint_pd}
filter: {plugin: tosbp, gamma: 100}
cases: {A: {}}
)";

/** The main experiment's arm, short. */
inline const char* const kTeleoperation = R"(schema: 1
title: arm
robot: indy7
duration_s: 2
limits:
  position_rad: {center: [0, -pi/12, -pi/2, 0, -5*pi/12, 0], half_range: [pi/6, pi/12, pi/6, pi/12, pi/6, pi/3]}
  velocity_radps: 2*pi/3
  acceleration_radps2: 4*pi
  jerk_radps3: 12*pi
command: {plugin: generated_hand_motion, seed: 1}
controller:
  plugin: task_space_pd
  stiffness: [600, 600, 600, 160, 160, 160]
  damping: [60, 60, 60, 16, 16, 16]
filter: {plugin: tosbp}
robust_loop: {plugin: nric, k_r: 600, k_p: 20, k_i: 8}
real_plant: {plugin: simbody, payload_kg: 1.0}
cases: {A: {}}
)";

/** A hand that is led slowly enough for any arm; gains follow from the arm. */
inline const char* const kHandLed = R"(schema: 1
title: a hand leads an Indy7
robot: indy7
duration_s: 2
limits: {velocity_radps: 1.5, acceleration_radps2: 8, jerk_radps3: 200}
command: {plugin: generated_hand_motion, seed: 1, reach_m: [0.1, 0.1, 0.1], rotation_rad: 0.3, top_speed_mps: 0.3}
controller: {plugin: tool_servo}
filter: {plugin: certified_braking}
robust_loop: {plugin: nric}
real_plant: {plugin: simbody}
cases: {A: {}}
)";

inline CaseResult runFirstCase(const std::string& yaml, const std::vector<std::string>& overrides = {},
                               const RunOptions& options = {}) {
    return runCase(configureCase(readTestExperiment(yaml, overrides).cases.front()), options);
}

/** The nominal arm of kTeleoperation alone, through the first case and to its end. */
inline Summary runNominalArm(const std::vector<std::string>& overrides) {
    std::string file = kTeleoperation;
    const std::size_t real = file.find("robust_loop:");
    file.erase(real, file.find("cases:") - real);
    const CaseResult result = runFirstCase(file, overrides);
    EXPECT_EQ(result.stopReason, StopReason::None) << result.stopMessage;
    return result.summary;
}

inline double passedShare(const Summary& s) {
    return static_cast<double>(s.ticksWith(FilterStatus::Passed)) / static_cast<double>(s.ticks());
}

/** A configured loop for the first case of an experiment. */
struct TestLoop {
    explicit TestLoop(const std::string& yaml, const std::vector<std::string>& overrides = {})
        : experiment(readTestExperiment(yaml, overrides)),
          configured(configureCase(experiment.cases.front())),
          loop(configured->setup, std::move(configured->plugins),
               {nullptr, experiment.cases.front().feedsExternalTorque}) {}
    void tick(int count = 1) {
        for (int k = 0; k < count; ++k) loop.tick(record);
    }

    Experiment experiment;
    std::unique_ptr<ConfiguredCase> configured;
    ControlLoop loop;
    TickRecord record;  ///< of the last tick
};

inline bool allFinite(const TickRecord& r) {
    return r.nominal.q.allFinite() && r.nominal.qd.allFinite() && r.nominal.qdd.allFinite() &&
           r.nominal.jerk.allFinite() && r.desiredTorque.allFinite() && r.filterTorque.allFinite() &&
           r.robustTorque.allFinite() && r.motorTorque.allFinite();
}

/** Ticks until the loop has stopped, in at most `most` ticks, every record finite; `check` sees each record. */
template <class Check>
void runUntilStopped(ControlLoop& loop, TickRecord& record, int most, const Check& check) {
    for (int ticks = 1; !loop.hasStopped(); ++ticks) {
        loop.tick(record);
        ASSERT_TRUE(allFinite(record));
        check(record);
        ASSERT_LT(ticks, most);
    }
}

/** It stops for this reason, every record finite. */
inline void expectStop(ControlLoop& loop, StopReason reason) {
    TickRecord record;
    runUntilStopped(loop, record, 5000, [](const TickRecord&) {});
    EXPECT_EQ(loop.stopReason(), reason);
}

}  // namespace viable::test
