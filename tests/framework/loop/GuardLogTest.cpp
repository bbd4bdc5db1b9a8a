#include "viable/loop/GuardLog.h"

#include "CaseSupport.h"
#include "log/LogMetadata.h"
#include "records/LogReader.h"
#include "viable/loop/ReferenceGuard.h"
#include "viable/loop/TorqueGuard.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

RobotDescription loadIndy7() {
    return loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
}

/** Hands over, waiting for the disk: time is simulated. */
void append(GuardLog& log, const TickRecord& record) {
    while (!log.append(record)) std::this_thread::yield();
}

TEST(GuardLog, WhatATorqueGuardDidIsReadBackAsItWas) {
    const TemporaryFolder folder;
    const std::filesystem::path file = folder / "sway.mcap";
    const RobotDescription robot = loadIndy7();
    TorqueGuard guard(robot, 0.001);
    guard.start({robot.home, JointVector::Zero(6)});
    const auto law = [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
        torque = dynamics.M * (100.0 * (robot.home + JointVector::Constant(6, 0.2) - nominal.q) - 20.0 * nominal.qd) +
                 dynamics.b;
    };
    std::vector<TickRecord> records;
    {
        GuardLog log(file, robot, true);
        for (int k = 0; k < 1500; ++k) {
            guard.step({guard.nominal().q, guard.nominal().qd}, law);
            records.push_back(guard.record());
            append(log, guard.record());
        }
        EXPECT_EQ(log.finish(), "");
    }
    LogReader reader(file);
    EXPECT_TRUE(reader.isComplete());
    const LogMetadata metadata = readLogMetadata(reader.metadata(), reader.layout().jointNames);
    EXPECT_EQ(metadata.caseName, "sway");
    EXPECT_EQ(metadata.robot, robot.folder.lexically_normal().string());
    TickRecord row;
    for (const TickRecord& record : records) {
        ASSERT_TRUE(reader.read(row));
        ASSERT_EQ(row.nominal.q, record.nominal.q);
        ASSERT_EQ(row.nominal.jerk, record.nominal.jerk);
        ASSERT_EQ(row.motorTorque, record.motorTorque);
        ASSERT_EQ(row.limits.jerk.upper, record.limits.jerk.upper);
    }
    EXPECT_FALSE(reader.read(row));
    EXPECT_GT((records.back().nominal.q - robot.home).norm(), 0.1);
    expectError({"sway.mcap"}, [&] { GuardLog(file, robot, true); });  // never overwritten
}

TEST(GuardLog, WhatAReferenceGuardDidIsReadBackAsItWas) {
    const TemporaryFolder folder;
    const RobotDescription robot = loadIndy7();
    ReferenceGuard guard(robot, 0.001);
    const JointVector zero = JointVector::Zero(6), target = robot.home + JointVector::Constant(6, 0.2);
    guard.start({robot.home, zero, zero});
    GuardLog log(folder / "reference.mcap", robot, false);
    for (int k = 0; k < 500; ++k) {
        guard.step(target);
        append(log, guard.record());
    }
    EXPECT_EQ(log.finish(), "");
    LogReader reader(folder / "reference.mcap");
    TickRecord row;
    int rows = 0;
    for (; reader.read(row); ++rows) ASSERT_EQ(row.command.q, target);
    EXPECT_EQ(rows, 500);
    EXPECT_EQ(row.nominal.q, guard.record().nominal.q);
}

TEST(GuardLog, AppendAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const TemporaryFolder folder;
    const RobotDescription robot = loadIndy7();
    ReferenceGuard guard(robot, 0.001);
    const JointVector zero = JointVector::Zero(6);
    guard.start({robot.home, zero, zero});
    GuardLog log(folder / "reference.mcap", robot, false);
    guard.step(robot.home);
    const testing::AllocationCounter counter;
    for (int k = 0; k < 100; ++k) log.append(guard.record());
    EXPECT_EQ(counter.count(), 0);
    EXPECT_EQ(log.finish(), "");
}

}  // namespace
}  // namespace viable::test
