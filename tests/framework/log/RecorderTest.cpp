#include "log/Recorder.h"

#include <fcntl.h>
#include <sys/resource.h>

#include <cerrno>
#include <chrono>
#include <csignal>

#include "LogTestSupport.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

using viable::testing::AllocationCounter;

using Space = MotionCommand::Space;

struct RecorderTest : LogTestBase {
    const LogLayout layout_ = makeLayout(6, Space::Joint, true);
};

/** Appends like a simulation does: tries again until the row is taken. */
int appendAll(Recorder& recorder, const std::vector<TickRecord>& records) {
    int retries = 0;
    for (const TickRecord& record : records)
        while (!recorder.append(record)) {
            ++retries;
            std::this_thread::yield();
        }
    return retries;
}

struct SlowSink : MemorySink {
    using MemorySink::MemorySink;
    bool write(const void* data, std::size_t size, std::string& error) override {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        return MemorySink::write(data, size, error);
    }
};

TEST_F(RecorderTest, ASlowWriterLosesNothing) {
    const std::vector<TickRecord> records = makeRecords(layout_, 5000, 0.001, 31);
    WrittenLog log;
    Recorder recorder(std::make_unique<LogWriter>(std::make_unique<SlowSink>(log), makeOpening(layout_)), 16);
    EXPECT_GT(appendAll(recorder, records), 0);
    const LogStatus status = recorder.finish();
    EXPECT_TRUE(status.ok()) << status.error;
    EXPECT_EQ(status.rows, records.size());
    EXPECT_EQ(status.lost, 0u);
    writeBytes(path("run.mcap"), log.bytes);
    LogReader reader(path("run.mcap"));
    expectSameRows(readAll(reader), records, layout_);
    EXPECT_EQ(recorder.finish().rows, records.size());  // again: the same
}

TEST_F(RecorderTest, RowsArriveWithoutFinishBeingCalled) {
    const std::vector<TickRecord> records = makeRecords(layout_, 250, 0.001, 32);
    {
        Recorder recorder(std::make_unique<LogWriter>(path("run.mcap"), makeOpening(layout_)));
        EXPECT_EQ(appendAll(recorder, records), 0);
    }
    LogReader reader(path("run.mcap"));
    EXPECT_TRUE(reader.isComplete());
    EXPECT_EQ(readAll(reader).size(), records.size());
}

struct Gate {
    std::atomic<bool> isOpen{false};
    std::atomic<bool> isReached{false};
    std::atomic<bool> isInterruptible{true};
};

/** Lets the opening through, then waits at the gate. */
class GatedSink : public MemorySink {
public:
    GatedSink(WrittenLog& log, Gate& gate) : MemorySink(log), gate_(gate) {}
    bool write(const void* data, std::size_t size, std::string& error) override {
        if (opening_) {
            opening_ = false;
        } else {
            sigset_t blocked;
            pthread_sigmask(SIG_SETMASK, nullptr, &blocked);
            gate_.isInterruptible = sigismember(&blocked, SIGINT) == 0;
            gate_.isReached = true;
            while (!gate_.isOpen) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        return MemorySink::write(data, size, error);
    }

private:
    Gate& gate_;
    bool opening_ = true;
};

TEST_F(RecorderTest, AFullRingSaysSoAndLosesNothing) {
    // Each row begins a chunk of its own, so that the second row's append() stands at the gate.
    const std::vector<TickRecord> records = makeRecords(layout_, 6, 0.2, 33);
    WrittenLog log;
    Gate gate;
    Recorder recorder(std::make_unique<LogWriter>(std::make_unique<GatedSink>(log, gate), makeOpening(layout_)), 4);
    ASSERT_TRUE(recorder.append(records[0]));
    ASSERT_TRUE(recorder.append(records[1]));
    while (!gate.isReached) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    // The row at the gate still has its slot: three more fit.
    EXPECT_TRUE(recorder.append(records[2]));
    EXPECT_TRUE(recorder.append(records[3]));
    EXPECT_TRUE(recorder.append(records[4]));
    EXPECT_FALSE(recorder.append(records[5]));
    EXPECT_FALSE(recorder.append(records[5]));
    gate.isOpen = true;
    while (!recorder.append(records[5])) std::this_thread::yield();
    EXPECT_EQ(recorder.finish().rows, 6u);
    EXPECT_FALSE(gate.isInterruptible) << "Ctrl-C must reach the main thread, not the writer";
    writeBytes(path("run.mcap"), log.bytes);
    LogReader reader(path("run.mcap"));
    const std::vector<TickRecord> back = readAll(reader);
    ASSERT_EQ(back.size(), 6u);
    for (std::size_t i = 0; i < back.size(); ++i) EXPECT_EQ(back[i].time_s, records[i].time_s);
}

TEST_F(RecorderTest, CounterSeesEveryWayToAllocate) {
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    struct alignas(128) Wide {
        char bytes[128];
    };
    void* volatile memory = nullptr;  // volatile: the allocation must not be optimised away
    const auto countOne = [&](const auto& allocate) {
        const AllocationCounter counter;
        allocate();
        return counter.count();
    };
    EXPECT_EQ(countOne([] {}), 0);
    EXPECT_EQ(countOne([&] { memory = std::malloc(10); }), 1);
    EXPECT_EQ(countOne([&] { memory = std::realloc(memory, 100000); }), 1);
    std::free(memory);
    EXPECT_EQ(countOne([&] { memory = std::calloc(3, 5); }), 1);
    std::free(memory);
    EXPECT_EQ(countOne([&] { memory = std::aligned_alloc(64, 128); }), 1);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % 64, 0u);
    std::free(memory);
    void* aligned = nullptr;
    EXPECT_EQ(countOne([&] { ASSERT_EQ(::posix_memalign(&aligned, 256, 10), 0); }), 1);
    std::free(aligned);
    EXPECT_EQ(countOne([&] { memory = new int(3); }), 1);
    delete static_cast<int*>(memory);
    EXPECT_EQ(countOne([&] { memory = new Wide; }), 1);
    delete static_cast<Wide*>(memory);
    // Other threads do not count.
    std::atomic<bool> go{false}, done{false};
    std::thread other([&] {
        while (!go) std::this_thread::yield();
        std::free(std::malloc(1000));
        done = true;
    });
    EXPECT_EQ(countOne([&] {
                  go = true;
                  while (!done) std::this_thread::yield();
              }),
              0);
    other.join();
}

TEST_F(RecorderTest, AppendAllocatesNothing) {
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    const std::vector<TickRecord> records = makeRecords(layout_, 3000, 0.001, 34);
    Recorder recorder(std::make_unique<LogWriter>(path("run.mcap"), makeOpening(layout_)), 64);
    const AllocationCounter counter;
    const int retries = appendAll(recorder, records);
    EXPECT_EQ(counter.count(), 0) << "with " << retries << " retries";
    EXPECT_EQ(recorder.finish().rows, records.size());
}

/** Takes so many bytes, then the disk is full, as /dev/full says it. */
class FullDiskSink : public MemorySink {
public:
    FullDiskSink(WrittenLog& log, std::size_t room) : MemorySink(log), room_(room) {
        full_ = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
    }
    ~FullDiskSink() override { ::close(full_); }
    bool write(const void* data, std::size_t size, std::string& error) override {
        const std::size_t taken = std::min(size, room_);
        room_ -= taken;
        MemorySink::write(data, taken, error);
        if (taken == size) return true;
        ++failedWrites;
        if (::write(full_, data, size - taken) < 0) error = std::strerror(errno);
        return false;
    }

    int failedWrites = 0;

private:
    std::size_t room_;
    int full_;
};

TEST_F(RecorderTest, Fault72_DiskFullDoesNotStopTheRun) {
    const std::vector<TickRecord> records = makeRecords(layout_, 2000, 0.001, 35);
    const WrittenLog whole = makeLog(makeOpening(layout_), records);
    // Full in the opening, in each part of a run, within the end.
    for (const std::size_t room :
         {std::size_t{0}, std::size_t{100}, whole.writes[1], whole.writes[1] + 1, whole.writes[7] + 5000,
          whole.writes.back() - 1, whole.writes.back(), whole.bytes.size() - 1}) {
        SCOPED_TRACE("room for " + std::to_string(room) + " bytes");
        WrittenLog log;
        auto sink = std::make_unique<FullDiskSink>(log, room);
        FullDiskSink& disk = *sink;
        Recorder recorder(std::make_unique<LogWriter>(std::move(sink), makeOpening(layout_)), 128);
        appendAll(recorder, records);  // ends: the ring is emptied though nothing is written
        const LogStatus status = recorder.finish();
        EXPECT_FALSE(status.ok());
        EXPECT_EQ(status.error, "No space left on device");
        EXPECT_EQ(status.rows + status.lost, records.size());
        EXPECT_EQ(disk.failedWrites, 1) << "nothing may follow the first gap";
        EXPECT_EQ(log.bytes, whole.bytes.substr(0, room));
        if (room < whole.writes[1]) {
            EXPECT_EQ(status.rows, 0u);
            continue;
        }
        writeBytes(path("full.mcap"), log.bytes);
        LogReader reader(path("full.mcap"));
        EXPECT_FALSE(reader.isComplete());
        std::size_t wholeChunks = 0;  // chunks that fitted in with their index
        while (wholeChunks + 2 < whole.writes.size() && whole.writes[wholeChunks + 2] <= room) ++wholeChunks;
        EXPECT_EQ(status.rows, 100 * wholeChunks);
        // A chunk whose index alone was cut off can still be read.
        const std::size_t rows = readAll(reader).size();
        EXPECT_TRUE(rows == status.rows || rows == status.rows + 100) << rows;
    }
}

TEST_F(RecorderTest, Fault72_AFileSizeLimitBecomesAnErrorOfTheLog) {
    const std::vector<TickRecord> records = makeRecords(layout_, 2000, 0.001, 36);
    rlimit before;
    ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
    Recorder recorder(std::make_unique<LogWriter>(path("run.mcap"), makeOpening(layout_)));
    rlimit small = before;
    small.rlim_cur = 500'000;
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    appendAll(recorder, records);
    const LogStatus status = recorder.finish();  // SIGXFSZ has its default action: the end
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_EQ(status.error, "File too large");
    EXPECT_GT(status.rows, 0u);
    EXPECT_EQ(status.rows + status.lost, records.size());
    EXPECT_EQ(std::filesystem::file_size(path("run.mcap")), 500'000u);
    LogReader reader(path("run.mcap"));
    EXPECT_FALSE(reader.isComplete());
    EXPECT_EQ(readAll(reader).size(), status.rows);
}

struct UnclosableSink : MemorySink {
    using MemorySink::MemorySink;
    bool close(std::string& error) override {
        error = "Input/output error";
        return false;
    }
};

TEST_F(RecorderTest, Fault72_AnErrorOnClosingIsNotLost) {
    WrittenLog log;
    Recorder recorder(std::make_unique<LogWriter>(std::make_unique<UnclosableSink>(log), makeOpening(layout_)));
    appendAll(recorder, makeRecords(layout_, 10, 0.001, 1));
    EXPECT_EQ(recorder.finish().error, "Input/output error");
}

}  // namespace
}  // namespace viable::test
