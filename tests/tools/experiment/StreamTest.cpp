#include "CaseSupport.h"

// stream: the command comes over a line.

namespace viable::test {
namespace {

CaseResult run(const std::vector<std::string>& streams) {
    std::vector<std::string> overrides = {"controller={plugin: tool_servo}", "filter={plugin: certified_braking}",
                                          "duration_s=6"};
    overrides.insert(overrides.end(), streams.begin(), streams.end());
    return runFirstCase(kTeleoperation, overrides);
}

std::string refuse(const std::string& stream) {
    return catchError([&] { readTestExperiment(kTeleoperation, {"stream=" + stream}); });
}

TEST(Stream, AFastCleanLineChangesNothing) {
    EXPECT_EQ(run({"stream={rate_hz: 1000, between: hold}"}).summary.toolErrorRms(), run({}).summary.toolErrorRms());
}

TEST(Stream, TheErrorIsTheDistanceToWhatWasSent) {
    // What is received stands still for 2 s at a time, and would be reached.
    const double slow = run({"stream={rate_hz: 0.5, between: hold}"}).summary.toolErrorRms();
    EXPECT_GT(slow, 3.0 * run({}).summary.toolErrorRms());
}

TEST(Stream, IsDrawnFromItsSeedWhichTheResultNames) {
    const auto calc = [](const char* seed) {
        return run({std::string("stream={rate_hz: 20, jitter: 0.5, loss: 0.2, gap_s: 0.2, gap_every_s: 1, seed: ") +
                    seed + "}"});
    };
    const CaseResult one = calc("3");
    EXPECT_EQ(one.seeds.at("stream"), "3");
    EXPECT_EQ(one.summary.toolErrorRms(), calc("3").summary.toolErrorRms());
    EXPECT_NE(one.summary.toolErrorRms(), calc("4").summary.toolErrorRms());
    EXPECT_FALSE(one.summary.anyLimitBroken());
}

TEST(Stream, TheResolvedFileHasItWithAllDefaults) {
    const Experiment experiment = readTestExperiment(kTeleoperation, {"stream={rate_hz: 30}"});
    const ConfigNode* stream = experiment.cases.front().resolved.find("stream");
    ASSERT_NE(stream, nullptr);
    EXPECT_EQ(stream->find("between")->text, "extrapolate");
    EXPECT_EQ(stream->find("seed")->text, "1");
    EXPECT_EQ(readTestExperiment(kTeleoperation).cases.front().resolved.find("stream"), nullptr);
}

TEST(Stream, WhatIsWrongInItIsToldWithItsPlace) {
    expectContains(refuse("{}"), {"rate_hz"});
    expectContains(refuse("{rate_hz: 2000}"), {"more than one sample a tick"});
    expectContains(refuse("{rate_hz: 10, jitter: 1}"), {"jitter"});
    expectContains(refuse("{rate_hz: 10, gap_s: 2, gap_every_s: 2}"), {"gap_every_s"});
    expectContains(refuse("{rate_hz: 10, between: predict}"), {"`hold`, `interpolate`, `extrapolate`"});
    expectContains(refuse("{rate: 10}"), {"rate_hz"});
    expectContains(refuse("{plugin: hold}"), {"stream is no plugin"});
}

}  // namespace
}  // namespace viable::test
