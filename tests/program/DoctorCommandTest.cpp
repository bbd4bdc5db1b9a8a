// `viable doctor`: what it tells root and an ordinary user, and its codes.

#include <nlohmann/json.hpp>

#include "Program.h"

namespace viable::test {
namespace {

using nlohmann::json;

constexpr rlim_t kEightMegabytes = 8 * 1024 * 1024;

/** An ordinary user with 8 MB of lockable memory and no priority, whoever runs the tests. */
void becomeOrdinary() {
    const rlimit memory{kEightMegabytes, kEightMegabytes}, none{0, 0};
    setrlimit(RLIMIT_MEMLOCK, &memory);
    setrlimit(RLIMIT_RTPRIO, &none);
    if (geteuid() == 0 && (setgid(65534) != 0 || setuid(65534) != 0)) _exit(98);
    if (access(VIABLE_PROGRAM, X_OK) != 0) _exit(77);
}

#define SKIP_WHERE_HIDDEN(outcome) \
    if ((outcome).code == 77) GTEST_SKIP() << "an ordinary user cannot reach " VIABLE_PROGRAM

TEST(DoctorCommand, TellsEachThingAndARemedyForWhatIsNotGood) {
    const Outcome o = run({"doctor", "--measure", "0"});
    ASSERT_EQ(o.code, 0) << o.err;
    expectContains(
        o.out, {"Real time on this machine, for the user ", " kernel ", " priority limit ", " SCHED_FIFO ",
                " memory lock ", " /dev/cpu_dma_latency ", " real-time throttling ", " processors ", " CPU governor ",
                " isolated CPUs ", " SMT ", " heat ", " CPU quota ", " virtual machine ", " clock source ",
                " huge pages ", " /dev/shm ", " UDP on this machine ", "\nA loop of this user "});
    EXPECT_EQ(o.out.find("wake-up"), std::string::npos);
    EXPECT_EQ(o.err, "");
}

TEST(DoctorCommand, MeasuresBothHalvesInOneTable) {
    const Outcome o = run({"doctor", "--measure", "0.2"});
    ASSERT_EQ(o.code, 0) << o.err;
    expectContains(o.out, {"Measured for 0.2 s at a tick of 1 ms, in turns, beside a load of ", "without priority",
                           "p50       p99     p99.9     worst", "\nwake-up, late by ", "\nthe same work, takes ",
                           "\nUDP, another process and back ", "\nshared memory, there and back ", "\nticks missed ",
                           "\nanswers lost "});
}

TEST(DoctorCommand, JsonHasTheSameAndTheHistograms) {
    const Outcome o = run({"doctor", "--measure", "0.2", "--tick", "0.002", "--json"});
    ASSERT_EQ(o.code, 0) << o.err;
    const json told = json::parse(o.out);
    EXPECT_EQ(told["lines"].size(), 17u);
    for (const json& line : told["lines"]) {
        const std::string level = line["level"];
        EXPECT_TRUE(level == "good" || level == "worse" || level == "missing" || level == "unknown") << level;
        EXPECT_EQ(line["remedy"].get<std::string>().empty(), level == "good" || level == "unknown") << line;
    }
    EXPECT_EQ(told["real_time"], told["not_real_time_because"] == "");
    const json& measured = told["measured"];
    EXPECT_EQ(measured["tick_s"], 0.002);
    const auto expectHalf = [](const json& half) {
        const std::int64_t seen = half["ticks"].get<std::int64_t>() - half["ticks_missed"].get<std::int64_t>();
        EXPECT_GT(seen, 0);
        EXPECT_EQ(half["work"]["count"], seen);
        std::int64_t inBuckets = 0;
        for (const json& bucket : half["work"]["buckets_us"]) inBuckets += bucket[2].get<std::int64_t>();
        EXPECT_EQ(inBuckets, seen);
        EXPECT_GE(half["work"]["worst_us"], half["work"]["p999_us"]);
        EXPECT_TRUE(half.contains("udp_round_trip") && half.contains("shared_memory_round_trip"));
    };
    expectHalf(measured["without_priority"]);
    const bool isGranted = told["lines"][2]["level"] == "good";
    EXPECT_EQ(told["lines"][2]["name"], "SCHED_FIFO");
    ASSERT_EQ(measured["with_priority"].is_object(), isGranted);
    if (isGranted) {
        expectHalf(measured["with_priority"]);
        EXPECT_EQ(measured["with_priority"]["priority"], 80);
    }
}

TEST(Fault27, AnOrdinaryUserWith8MegabytesIsToldWhatIsMissingAndNothingHangs) {
    const Outcome o = run({"doctor", "--measure", "0.2"}, becomeOrdinary);
    SKIP_WHERE_HIDDEN(o);
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    expectContains(o.out,
                   {"missing  priority limit         soft 0, hard 0 (user)\n",
                    "missing  SCHED_FIFO             priority 80 is refused: Operation not permitted\n",
                    "missing  memory lock            soft 8 MB, hard 8 MB (user); this process alone has ",
                    "\nA loop of this user runs as not real time: SCHED_FIFO is refused, memory cannot be locked.\n",
                    "with priority: refused", "\nRefused with priority:\n  memory is not locked",
                    "the loop has no real-time priority: none is allowed to this user (ulimit -r is 0)"});
    const Outcome j = run({"doctor", "--measure", "0.1", "--json"}, becomeOrdinary);
    ASSERT_EQ(j.code, 0) << j.err;
    const json told = json::parse(j.out);
    EXPECT_EQ(told["real_time"], false);
    EXPECT_TRUE(told["measured"]["with_priority"].is_null());
    EXPECT_GE(told["measured"]["refused"].size(), 2u);
}

TEST(DoctorCommand, WhatCannotBeMeasuredIsRefused) {
    const auto expectRefused = [](const std::vector<std::string>& arguments, const std::vector<std::string>& words) {
        const Outcome o = run(arguments);
        EXPECT_EQ(o.code, 2) << o.out << o.err;
        EXPECT_EQ(o.out, "");
        expectContains(o.err, words);
    };
    expectRefused({"doctor", "--measure", "-1"},
                  {"--measure", "-1 is not possible", "0.1 to 86400 s, or 0: no measurement."});
    expectRefused({"doctor", "--measure", "nan"}, {"--measure"});
    expectRefused({"doctor", "--tick", "0"}, {"--tick", "5e-05 to 0.1 s."});
    expectRefused({"doctor", "--priority", "100"}, {"--priority", "1 to 99."});
    expectRefused({"doctor", "--cpu", "100000"}, {"--cpu", "Choose 0 to "});
}

TEST(DoctorCommand, ASystemThatHasNoSocketsLeftIsTold) {
    if (kSanitized) GTEST_SKIP() << "a sanitizer needs files of its own to look at an exception";
    const Outcome o = run({"doctor", "--measure", "0.1"}, [] {
        for (int file = 3; file < 1024; ++file) close(file);  // what whoever runs the tests has left open
        const rlimit few{4, 4};                               // one file at a time
        setrlimit(RLIMIT_NOFILE, &few);
    });
    EXPECT_EQ(o.code, 7) << o.out << o.err;
    expectContains(o.err, {"the measurement could not be made: no UDP socket: Too many open files", "`ulimit -n`"});
    expectContains(o.out, {" UDP on this machine "});
}

}  // namespace
}  // namespace viable::test
