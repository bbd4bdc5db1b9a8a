#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>

#include <chrono>
#include <random>

#include "Effort.h"
#include "Program.h"
#include "WitnessPage.h"
#include "log/Recorder.h"

// Runs that are killed (kill -9) at random moments. How far the loop had come is told by a witness, a command
// plugin that writes each tick's number and time into mapped memory, and so by nothing that takes part in logging.
// VIABLE_SEED: of the moments of the kills.

namespace viable::test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kRecordTick_s = 0.001;
constexpr double kMostLost_s = 0.2;
constexpr int kAtOnce = 4;  // runs in real time leave the processor to others

const char* const kKilledExperiment = R"(schema: 1
title: to be killed
robot: single_joint
duration_s: 80000
tick_s: 0.001
controller: {plugin: joint_pd}
filter: {plugin: acceleration_viability}
cases:
  A: {command: {plugin: witness, file: A.witness}}
  B: {robot: indy7, command: {plugin: witness, file: B.witness}}
)";

std::mt19937_64 makeRandom() {
    const long seed = getSeed(static_cast<long>(std::random_device()()));
    std::printf("VIABLE_SEED=%ld\n", seed);
    std::fflush(stdout);  // or every child that is forked says it again
    return std::mt19937_64(static_cast<std::uint64_t>(seed));
}

/** A page of memory in a file, for the witness of one case. */
class Witness {
public:
    explicit Witness(const fs::path& file) {
        const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        EXPECT_EQ(::ftruncate(descriptor, sizeof(WitnessPage)), 0);
        void* memory = ::mmap(nullptr, sizeof(WitnessPage), PROT_READ, MAP_SHARED, descriptor, 0);
        ::close(descriptor);
        EXPECT_NE(memory, MAP_FAILED);
        page_ = static_cast<const WitnessPage*>(memory);
    }
    ~Witness() { ::munmap(const_cast<WitnessPage*>(page_), sizeof(WitnessPage)); }
    Witness(const Witness&) = delete;
    Witness& operator=(const Witness&) = delete;

    std::int64_t ticks() const { return page_->ticks.load(std::memory_order_acquire); }
    /** From the beginning of tick `from` to that of tick `to`. */
    double getSeconds(std::int64_t from, std::int64_t to) const {
        const auto at = [&](std::int64_t tick) {
            return page_->begun_ns[static_cast<std::size_t>(tick) % WitnessPage::kKept];
        };
        EXPECT_LE(ticks() - from, static_cast<std::int64_t>(WitnessPage::kKept));
        return 1e-9 * static_cast<double>(at(to) - at(from));
    }

private:
    const WitnessPage* page_;
};

/** The worst that became of any log so far. */
struct Tally {
    int kills = 0, logs = 0, withoutLog = 0, withoutRows = 0;
    double worstLog_s = 0.0, worstWall_s = 0.0;

    void print(const char* what) const {
        std::printf(
            "%s: %d kills, %d logs (%d without rows), %d cases killed before their log; lost at "
            "most %.4f s of the log, %.4f s of the clock\n",
            what, kills, logs, withoutRows, withoutLog, worstLog_s, worstWall_s);
        std::fflush(stdout);
    }
};

/** A run with its witnesses, from its start to what is left of it. */
class KilledRun {
public:
    KilledRun(bool paced, std::vector<std::string> cases) : cases_(std::move(cases)) {
        const std::string file = folder_.write("e.yaml", kKilledExperiment);
        std::vector<std::string> arguments{"run", file, "--out", folder_ / "run", "--jobs", "2"};
        for (const char* name : {"A", "B"})
            witnesses_.push_back(std::make_unique<Witness>(folder_ / (std::string(name) + ".witness")));
        for (const std::string& name : cases_) {
            arguments.insert(arguments.end(), {"--case", name});
            if (!paced) arguments.insert(arguments.end(), {"--set", "cases." + name + ".command.paced=false"});
        }
        program_ = std::make_unique<Program>(std::move(arguments));
    }

    fs::path getLog(const std::string& name) const { return folder_ / ("run/" + name + ".mcap"); }

    bool hasLog() const {
        return std::any_of(cases_.begin(), cases_.end(),
                           [&](const std::string& name) { return fs::exists(getLog(name)); });
    }
    bool isAlive() const { return isAlive_; }

    void kill() {
        ::kill(program_->pid(), SIGKILL);
        const Outcome o = program_->wait();
        isAlive_ = false;
        EXPECT_EQ(o.code, -SIGKILL) << o.out << o.err;
    }

    /** Looks at every log that there is, recovers it and looks again. */
    void check(Tally& tally) const {
        ++tally.kills;
        for (const std::string& name : cases_) {
            SCOPED_TRACE("case " + name);
            checkCase(name, *witnesses_[name == "A" ? 0 : 1], tally);
        }
    }

private:
    void checkCase(const std::string& name, const Witness& witness, Tally& tally) const {
        const fs::path log = getLog(name);
        if (!fs::exists(log)) {
            EXPECT_EQ(witness.ticks(), 0) << "ticks without a log";
            ++tally.withoutLog;
            return;
        }
        ++tally.logs;
        try {
            const std::string bytes = readFile(log);
            LogReader reader(log);
            EXPECT_FALSE(reader.isComplete());
            const Outcome o = run({"recover", log});
            ASSERT_EQ(o.code, 0) << o.err;
            EXPECT_EQ(o.err, "");
            EXPECT_TRUE(readFile(log) == bytes) << "the original was touched";
            const fs::path whole = folder_ / ("run/" + name + ".recovered.mcap");
            LogReader recovered(whole);
            EXPECT_TRUE(recovered.isComplete());
            EXPECT_EQ(recovered.columns().size(), reader.columns().size());
            EXPECT_EQ(recovered.metadata(), reader.metadata());

            std::int64_t rows = 0;
            TickRecord row, same;
            for (; reader.read(row); ++rows) {
                ASSERT_NEAR(row.time_s, static_cast<double>(rows) * kRecordTick_s, 1e-9);
                ASSERT_TRUE(recovered.read(same)) << "row " << rows << " was not recovered";
                ASSERT_EQ(same.time_s, row.time_s);
                ASSERT_EQ(same.nominal.q, row.nominal.q);
                ASSERT_EQ(same.filterTorque, row.filterTorque);
                ASSERT_EQ(same.compute_us, row.compute_us);
            }
            EXPECT_FALSE(recovered.read(same));
            EXPECT_EQ(o.out, "wrote " + whole.string() + ": " + std::to_string(rows) + " rows\n");
            measure(rows, witness, tally);
        } catch (const Error& e) {
            ADD_FAILURE() << "after " << witness.ticks() << " ticks: " << e.what();
        }
    }

    /** Lost are the ticks from the first that is not in the log to the last that had begun, that one
    too: it may have been finished. */
    static void measure(std::int64_t rows, const Witness& witness, Tally& tally) {
        const std::int64_t lost = witness.ticks() - rows;
        ASSERT_GE(lost, 0) << "rows that never were";
        if (rows == 0) ++tally.withoutRows;
        tally.worstLog_s = std::max(tally.worstLog_s, static_cast<double>(lost) * kRecordTick_s);
        if (lost > 0) tally.worstWall_s = std::max(tally.worstWall_s, witness.getSeconds(rows, witness.ticks() - 1));
    }

    TemporaryFolder folder_;
    std::vector<std::string> cases_;
    std::vector<std::unique_ptr<Witness>> witnesses_;
    std::unique_ptr<Program> program_;
    bool isAlive_ = true;
};

/** Kills `count` runs, up to `atOnce` at a time, each 5 to 800 ms after its first log began; every fifth so long
after its start, when it may not have come to a log. */
Tally killAtRandom(long count, int atOnce, bool paced) {
    std::mt19937_64 random = makeRandom();
    std::uniform_int_distribution<int> microseconds(5000, 800000);
    struct Doomed {
        std::unique_ptr<KilledRun> run;
        std::chrono::microseconds delay;
        Clock::time_point due;  // of those that wait for their log: the end of time
    };
    Tally tally;
    while (tally.kills < count) {
        std::vector<Doomed> runs;
        for (int i = 0; i < atOnce && tally.kills + i < count; ++i) {
            const std::chrono::microseconds delay(microseconds(random));
            const bool fromStart = (tally.kills + i) % 5 == 0;
            const auto due = fromStart ? Clock::now() + delay : Clock::time_point::max();
            runs.push_back({std::make_unique<KilledRun>(paced, std::vector<std::string>{"A", "B"}), delay, due});
        }
        for (std::size_t alive = runs.size(); alive > 0;) {
            for (Doomed& doomed : runs) {
                if (!doomed.run->isAlive()) continue;
                if (doomed.due == Clock::time_point::max() && doomed.run->hasLog())
                    doomed.due = Clock::now() + doomed.delay;
                if (Clock::now() < doomed.due) continue;
                doomed.run->kill();
                --alive;
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        for (const Doomed& doomed : runs) {
            doomed.run->check(tally);
            if (testing::Test::HasFatalFailure()) return tally;
        }
    }
    return tally;
}

// A run in real time, as with a robot, measured in the log's time (which is the clock's unless the machine is too
// busy for a tick per millisecond).
TEST(Fault73_Kill, ARunInRealTimeLosesAtMostTwoTenthsOfASecond) {
    const Tally tally = killAtRandom(countOf(50), kAtOnce, true);
    tally.print("real time");
    EXPECT_GE(tally.logs, tally.kills * 4 / 5);
    EXPECT_LE(tally.worstLog_s, kMostLost_s);
}

// A simulation is faster than the log's time: up to a ring of rows waits in the recorder besides the chunk. What is
// lost of the clock is printed; it is hundredths of a second where the writing thread gets its turn.
TEST(Fault73_Kill, AFastRunLosesAtMostTheRecordersRingAndAChunk) {
    const Tally tally = killAtRandom(countOf(10), 1, false);
    tally.print("as fast as it goes");
    EXPECT_GE(tally.logs, tally.kills * 4 / 5);
    constexpr double kMostTicks = kRecorderCapacity + kLongestChunk_s / kRecordTick_s + 2;
    EXPECT_LE(tally.worstLog_s, kMostTicks * kRecordTick_s);
}

// The moment at which the log's name appears, and the next half millisecond.
TEST(Fault73_Kill, ALogCanBeReadFromTheMomentItHasAName) {
    std::mt19937_64 random = makeRandom();
    Tally tally;
    const long count = countOf(25);
    while (tally.kills < count) {
        KilledRun run(true, {"A"});
        while (!run.hasLog()) {
        }
        const auto due = Clock::now() + std::chrono::microseconds(random() % 2 == 0 ? 0 : random() % 500);
        while (Clock::now() < due) {
        }
        run.kill();
        run.check(tally);
        ASSERT_FALSE(HasFatalFailure());
    }
    tally.print("at once");
    EXPECT_EQ(tally.logs, tally.kills);
}

}  // namespace
}  // namespace viable::test
