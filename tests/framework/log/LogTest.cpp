#include <sys/mman.h>
#include <sys/wait.h>

#include <chrono>
#include <csignal>

#include "LogTestSupport.h"
#include "records/McapFile.h"

namespace viable::test {
namespace {

using Space = MotionCommand::Space;

bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

std::uint64_t getU64(const std::string& bytes, std::size_t at) {
    std::uint64_t v = 0;
    for (int i = 7; i >= 0; --i) v = v << 8 | static_cast<unsigned char>(bytes.at(at + i));
    return v;
}
void setU64(std::string& bytes, std::size_t at, std::uint64_t v) {
    for (std::size_t i = 0; i < 8; ++i) bytes.at(at + i) = static_cast<char>(v >> (8 * i));
}

class LogTest : public LogTestBase {};

struct RoundTrip {
    int joints;
    Space space;
    bool hasRealPlant;
    bool hasExternalTorque = false;
    bool hasArmLimits = false;
};

class LogRoundTrip : public LogTestBase, public ::testing::WithParamInterface<RoundTrip> {};

TEST_P(LogRoundTrip, EveryBitComesBack) {
    LogLayout layout = makeLayout(GetParam().joints, GetParam().space, GetParam().hasRealPlant);
    layout.hasExternalTorque = GetParam().hasExternalTorque;
    if (GetParam().hasArmLimits) layout.limits = {LimitKind::Clearance, LimitKind::Speed, LimitKind::Separation};
    const std::vector<TickRecord> records = makeRecords(layout, 731, 0.001, 11);
    LogWriter writer(path("run.mcap"), makeOpening(layout));
    for (const TickRecord& record : records) writer.append(record);
    writer.finish();
    writer.finish();  // again: nothing happens
    ASSERT_TRUE(writer.status().ok()) << writer.status().error;
    EXPECT_EQ(writer.status().rows, records.size());
    EXPECT_EQ(writer.status().lost, 0u);
    EXPECT_EQ(writer.status().bytes, std::filesystem::file_size(path("run.mcap")));

    LogReader reader(path("run.mcap"));
    EXPECT_TRUE(reader.isComplete());
    EXPECT_EQ(reader.layout().jointNames, layout.jointNames);
    EXPECT_EQ(reader.layout().commandSpace, layout.commandSpace);
    EXPECT_EQ(reader.layout().hasRealPlant, layout.hasRealPlant);
    EXPECT_EQ(reader.layout().hasExternalTorque, layout.hasExternalTorque);
    EXPECT_EQ(reader.layout().limits, layout.limits);
    const auto countColumns = [&](const std::string& channel) {
        return std::count_if(reader.columns().begin(), reader.columns().end(),
                             [&](const LogColumn& c) { return c.name().rfind(channel + ".", 0) == 0; });
    };
    EXPECT_EQ(countColumns("external"), layout.hasExternalTorque ? GetParam().joints : 0);
    EXPECT_EQ(countColumns("clearance"), GetParam().hasArmLimits ? 12 : 0);
    EXPECT_EQ(countColumns("speed"), GetParam().hasArmLimits ? 4 : 0);
    EXPECT_EQ(countColumns("separation"), GetParam().hasArmLimits ? 11 : 0);
    EXPECT_EQ(reader.library().rfind("viable ", 0), 0u) << reader.library();
    EXPECT_EQ(reader.metadata(), makeOpening(layout).metadata);
    ASSERT_EQ(reader.attachments().size(), 1u);
    EXPECT_EQ(reader.attachments()[0].name, "experiment.yaml");
    EXPECT_EQ(reader.attachments()[0].mediaType, "application/yaml");
    EXPECT_EQ(reader.attachments()[0].data, "schema: 1\nrobot: indy7\n");

    expectSameRows(readAll(reader), records, layout);
    TickRecord none;
    EXPECT_FALSE(reader.read(none));
}

INSTANTIATE_TEST_SUITE_P(Layouts, LogRoundTrip,
                         ::testing::Values(RoundTrip{6, Space::Joint, true}, RoundTrip{6, Space::Tool, true},
                                           RoundTrip{7, Space::Joint, true, true},
                                           RoundTrip{6, Space::Tool, false, false, true},
                                           RoundTrip{7, Space::Joint, true, true, true},
                                           RoundTrip{1, Space::Joint, false}, RoundTrip{7, Space::Tool, false},
                                           RoundTrip{16, Space::Joint, true}, RoundTrip{1, Space::Tool, false}));

TEST_F(LogTest, SameRunGivesTheSameBytes) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    const std::vector<TickRecord> records = makeRecords(layout, 300, 0.001, 3);
    EXPECT_EQ(makeLog(makeOpening(layout), records).bytes, makeLog(makeOpening(layout), records).bytes);
}

TEST_F(LogTest, EmptyRunIsAWholeLog) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), {}).bytes);
    LogReader reader(path("run.mcap"));
    EXPECT_TRUE(reader.isComplete());
    EXPECT_TRUE(readAll(reader).empty());
}

TEST_F(LogTest, ChunksHoldAtMostATenthOfASecond) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    // Opening, ten chunks of 100 ticks, the end.
    EXPECT_EQ(makeLog(makeOpening(layout), makeRecords(layout, 1000, 0.001, 5)).writes.size(), 12u);
    // 20 ticks of 5 ms each.
    EXPECT_EQ(makeLog(makeOpening(layout), makeRecords(layout, 200, 0.005, 5)).writes.size(), 12u);
}

TEST_F(LogTest, ChunksStayNearOneMebibyteAtAnyTick) {
    const LogLayout layout = makeLayout(16, Space::Joint, true);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 3000, 1e-6, 5));
    ASSERT_GT(log.writes.size(), 4u);
    for (std::size_t i = 1; i + 1 < log.writes.size(); ++i)
        EXPECT_LT(getU64(log.bytes, log.writes[i] + 9 + 16), kLargestChunk + 8192);
}

// A second, deliberately plain way to write MCAP and CDR: no chunks, no checksums, no index.
class PlainMcap {
public:
    PlainMcap() : bytes_("\x89MCAP0\r\n", 8) { record(0x01, string("") + string("another")); }

    static std::string integer(std::uint64_t v, int size) {
        std::string s;
        for (int i = 0; i < size; ++i) s += static_cast<char>(v >> (8 * i));
        return s;
    }
    static std::string string(const std::string& s) { return integer(s.size(), 4) + s; }

    void record(int opcode, const std::string& content) {
        bytes_ += static_cast<char>(opcode) + integer(content.size(), 8) + content;
    }
    void channel(int id, const std::string& topic, const std::string& message, const std::string& schema,
                 const std::string& joints = R"(["a","b"])", const std::string& written = "") {
        record(0x03, integer(static_cast<std::uint64_t>(id), 2) + string("viable/msg/" + message) + string("ros2msg") +
                         string(schema));
        std::string entries = string("joint_names") + string(joints);
        if (!written.empty()) entries += string("written") + string(written);
        record(0x04, integer(static_cast<std::uint64_t>(id), 2) + integer(static_cast<std::uint64_t>(id), 2) +
                         string(topic) + string("cdr") + string(entries));
    }
    void message(int id, std::uint32_t sequence, const std::string& cdr) {
        record(0x05, integer(static_cast<std::uint64_t>(id), 2) + integer(sequence, 4) + integer(0, 8) + integer(0, 8) +
                         std::string("\0\1\0\0", 4) + cdr);
    }
    std::string finish() const {
        std::string all = bytes_;
        all += static_cast<char>(0x0F) + integer(4, 8) + integer(0, 4);
        all += static_cast<char>(0x02) + integer(20, 8) + std::string(20, '\0');
        return all + std::string("\x89MCAP0\r\n", 8);
    }

private:
    std::string bytes_;
};

/** CDR by its rules: every value at a multiple of its size. */
struct Cdr {
    std::string bytes;
    Cdr& put(std::uint64_t v, std::size_t size) {
        while (bytes.size() % size != 0) bytes += '\0';
        bytes += PlainMcap::integer(v, static_cast<int>(size));
        return *this;
    }
    Cdr& put(double v) {
        std::uint64_t bits;
        std::memcpy(&bits, &v, sizeof(bits));
        return put(bits, 8);
    }
    Cdr& put(const std::string& s) {
        put(s.size() + 1, 4);
        bytes += s + '\0';
        return *this;
    }
};

/** Records whose limits are those of records[0], but in the rows from `changes` on, where one limit of one joint gets
another value. */
std::vector<TickRecord> makeChangingLimits(const LogLayout& layout, int count, const std::vector<int>& changes) {
    std::vector<TickRecord> records = makeRecords(layout, count, 0.001, 61);
    JointLimits limits = records[0].limits;
    limits.position.lower[0] = std::numeric_limits<double>::quiet_NaN();
    for (int i = 0; i < count; ++i) {
        if (std::find(changes.begin(), changes.end(), i) != changes.end()) limits.velocity.upper[1] = 1.0 + i;
        records[static_cast<std::size_t>(i)].limits = limits;
    }
    return records;
}

TEST_F(LogTest, LimitsAreWrittenWhereTheyChangeAndAtEachChunksStart) {
    const LogLayout layout = makeLayout(3, Space::Joint, true);
    const std::vector<TickRecord> records = makeChangingLimits(layout, 450, {37, 38, 200, 399});
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), records).bytes);
    mcap::McapFile file(path("run.mcap"), "");
    int limits = -1;
    std::vector<std::uint32_t> rows;
    while (file.next()) {
        mcap::ByteReader in(file.content());
        const int id = in.readU16();
        if (file.opcode() == mcap::kChannel) {
            in.readU16();
            if (in.readString() == "/limits") limits = id;
        } else if (file.opcode() == mcap::kMessage && id == limits) {
            rows.push_back(in.readU32());
        }
    }
    EXPECT_EQ(rows, (std::vector<std::uint32_t>{0, 37, 38, 100, 200, 300, 399, 400}));
    LogReader reader(path("run.mcap"));
    expectSameRows(readAll(reader), records, layout);
}

TEST_F(LogTest, RowsAfterALostChunkHaveTheirOwnLimits) {
    const LogLayout layout = makeLayout(3, Space::Joint, true);
    const std::vector<TickRecord> records = makeChangingLimits(layout, 500, {150, 320});
    const WrittenLog log = makeLog(makeOpening(layout), records);
    ASSERT_EQ(log.writes.size(), 7u);  // opening, five chunks, end
    for (std::size_t lost = 1; lost <= 5; ++lost) {
        // Without its end, which says where the lost chunk was.
        const std::string bytes = log.bytes.substr(0, log.writes[lost]) +
                                  log.bytes.substr(log.writes[lost + 1], log.writes[6] - log.writes[lost + 1]);
        writeBytes(path("torn.mcap"), bytes);
        LogReader reader(path("torn.mcap"));
        const std::vector<TickRecord> back = readAll(reader);
        ASSERT_EQ(back.size(), 400u);
        for (std::size_t i = 0; i < back.size(); ++i) {
            const std::size_t row = i < 100 * (lost - 1) ? i : i + 100;
            ASSERT_EQ(getBits(back[i], layout), getBits(records[row], layout)) << "row " << row;
        }
    }
}

TEST_F(LogTest, ARowWithoutLimitsInItsChunkIsRefused) {
    const auto write = [&](bool hasLimits) {
        PlainMcap log;
        log.channel(1, "/limits", "Limits", "float64[] jerk_upper_radps3\n", R"(["a","b"])", "on_change");
        log.channel(2, "/desired", "Desired", "float64[] tau_nm\n");
        const auto pair = [](double a, double b) { return Cdr().put(2, 4).put(a).put(b).bytes; };
        if (hasLimits) log.message(1, 0, pair(8.0, 9.0));
        log.message(2, 0, pair(1.0, 2.0));
        log.message(2, 1, pair(3.0, 4.0));
        log.message(1, 2, pair(6.0, 7.0));
        log.message(2, 2, pair(5.0, 6.0));
        writeBytes(path("log.mcap"), log.finish());
    };
    write(true);
    LogReader reader(path("log.mcap"));
    const std::vector<TickRecord> rows = readAll(reader);
    ASSERT_EQ(rows.size(), 3u);
    EXPECT_EQ(rows[1].desiredTorque[1], 4.0);
    EXPECT_EQ(rows[1].limits.jerk.upper, (JointVector(2) << 8.0, 9.0).finished());
    EXPECT_EQ(rows[2].limits.jerk.upper, (JointVector(2) << 6.0, 7.0).finished());
    write(false);
    EXPECT_TRUE(contains(complainReading(path("log.mcap")),
                         "row 0 comes before the first message of channel `/limits` in its chunk"));
}

TEST_F(LogTest, OfAnOldLogEachRowHasItsLimits) {
    const auto write = [&](int lacking) {
        PlainMcap log;
        log.channel(1, "/limits", "Limits", "float64[] jerk_upper_radps3\n");
        log.channel(2, "/desired", "Desired", "float64[] tau_nm\n");
        for (int row = 0; row < 3; ++row) {
            const auto pair = [&](double a) { return Cdr().put(2, 4).put(a + row).put(a - row).bytes; };
            if (row != lacking) log.message(1, static_cast<std::uint32_t>(row), pair(10.0));
            log.message(2, static_cast<std::uint32_t>(row), pair(1.0));
        }
        writeBytes(path("log.mcap"), log.finish());
    };
    write(-1);
    LogReader reader(path("log.mcap"));
    const std::vector<TickRecord> rows = readAll(reader);
    ASSERT_EQ(rows.size(), 3u);
    for (int row = 0; row < 3; ++row)
        EXPECT_EQ(rows[static_cast<std::size_t>(row)].limits.jerk.upper,
                  (JointVector(2) << 10.0 + row, 10.0 - row).finished());
    write(1);
    EXPECT_TRUE(contains(complainReading(path("log.mcap")), "row 1 lacks a channel"));
}

TEST_F(LogTest, ShortVectorIsFilledWithNan) {
    const LogLayout layout = makeLayout(3, Space::Joint, true);
    TickRecord record = makeRecords(layout, 1, 0.001, 1)[0];
    record.robustTorque.resize(1);
    record.robustTorque[0] = 4.5;
    record.real.q.resize(0);
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), {record}).bytes);
    LogReader reader(path("run.mcap"));
    ASSERT_TRUE(reader.read(record));
    ASSERT_EQ(record.robustTorque.size(), 3);
    EXPECT_EQ(record.robustTorque[0], 4.5);
    EXPECT_TRUE(std::isnan(record.robustTorque[1]) && std::isnan(record.robustTorque[2]));
    ASSERT_EQ(record.real.q.size(), 3);
    EXPECT_TRUE(record.real.q.array().isNaN().all());
}

TEST_F(LogTest, Fault73_CutOffAnywhereGivesEveryWholeChunk) {
    const LogLayout layout = makeLayout(6, Space::Tool, true);
    const std::vector<TickRecord> records = makeRecords(layout, 1000, 0.001, 21);
    const WrittenLog log = makeLog(makeOpening(layout), records);
    // Rows that must be there when the file ends at a given byte: those of the chunk records (each
    // the first record of its write) that end before it.
    std::map<std::size_t, std::size_t> rowsAfter;
    for (std::size_t i = 1; i + 1 < log.writes.size(); ++i) {
        const std::size_t begin = log.writes[i];
        ASSERT_EQ(log.bytes[begin], 0x06);
        rowsAfter[begin + 9 + getU64(log.bytes, begin + 1)] = 100 * i;
    }
    ASSERT_EQ(rowsAfter.size(), 10u);

    std::mt19937_64 random(73);
    std::vector<std::size_t> places;
    for (int i = 0; i < 200; ++i) places.push_back(random() % log.bytes.size());
    for (const auto& [end, rows] : rowsAfter) {
        places.push_back(end - 1);
        places.push_back(end);
    }
    places.push_back(log.bytes.size() - 1);
    for (const std::size_t place : places) {
        SCOPED_TRACE("cut at byte " + std::to_string(place));
        writeBytes(path("cut.mcap"), log.bytes.substr(0, place));
        if (place < log.writes[1]) {
            // In the opening: at most a part of the channels is known. No rows, no crash.
            try {
                LogReader reader(path("cut.mcap"));
                EXPECT_FALSE(reader.isComplete());
                EXPECT_TRUE(readAll(reader).empty());
            } catch (const Error& e) {
                EXPECT_TRUE(contains(e.what(), "opening") || contains(e.what(), "empty") ||
                            contains(e.what(), "not an MCAP"))
                    << e.what();
            }
            continue;
        }
        std::size_t expected = 0;
        for (const auto& [end, rows] : rowsAfter)
            if (end <= place) expected = rows;
        LogReader reader(path("cut.mcap"));
        EXPECT_FALSE(reader.isComplete());
        EXPECT_EQ(reader.layout().jointNames, layout.jointNames);
        EXPECT_EQ(reader.attachments().size(), 1u);
        const std::vector<TickRecord> back = readAll(reader);
        ASSERT_EQ(back.size(), expected);
        for (std::size_t i = 0; i < back.size(); ++i)
            ASSERT_EQ(getBits(back[i], layout), getBits(records[i], layout)) << "row " << i;
    }
}

TEST_F(LogTest, Fault73_KilledProgramLosesAtMostOneChunk) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    const std::vector<TickRecord> records = makeRecords(layout, 500, 0.001, 2);
    void* const shared =
        ::mmap(nullptr, sizeof(std::atomic<std::int64_t>), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    ASSERT_NE(shared, MAP_FAILED);
    auto* const appended = new (shared) std::atomic<std::int64_t>(0);
    std::mt19937_64 random(9);
    for (int kill = 0; kill < 30; ++kill) {
        const std::filesystem::path file = path("killed" + std::to_string(kill) + ".mcap");
        appended->store(0);
        const pid_t child = ::fork();
        ASSERT_GE(child, 0);
        if (child == 0) {
            LogWriter writer(file, makeOpening(layout));
            for (std::int64_t i = 0;; ++i) {
                TickRecord record = records[static_cast<std::size_t>(i) % records.size()];
                record.time_s = static_cast<double>(i) * 0.001;
                writer.append(record);
                appended->store(i + 1);
            }
        }
        while (appended->load() == 0) std::this_thread::yield();
        std::this_thread::sleep_for(std::chrono::microseconds(random() % 20000));
        ::kill(child, SIGKILL);
        int status = 0;
        ASSERT_EQ(::waitpid(child, &status, 0), child);
        ASSERT_TRUE(WIFSIGNALED(status));

        LogReader reader(file);
        EXPECT_FALSE(reader.isComplete());
        const std::vector<TickRecord> back = readAll(reader);
        const auto rows = static_cast<std::int64_t>(back.size());
        EXPECT_LE(rows, appended->load() + 1);
        EXPECT_GE(rows, appended->load() - 101);
        if (rows > 0) EXPECT_EQ(back.back().time_s, static_cast<double>(rows - 1) * 0.001);
    }
    ::munmap(shared, sizeof(std::atomic<std::int64_t>));
}

TEST_F(LogTest, FlippedBitIsNoticed) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    const std::vector<TickRecord> records = makeRecords(layout, 450, 0.001, 8);
    const WrittenLog log = makeLog(makeOpening(layout), records);
    std::mt19937_64 random(88);
    int noticed = 0;
    for (int i = 0; i < 600; ++i) {
        // A third each in the opening, anywhere, and in the end.
        const std::size_t last = log.writes.back();
        const std::size_t place = i % 3 == 0   ? random() % log.writes[1]
                                  : i % 3 == 1 ? random() % log.bytes.size()
                                               : last + random() % (log.bytes.size() - last);
        std::string bytes = log.bytes;
        bytes[place] = static_cast<char>(bytes[place] ^ (1 << random() % 8));
        writeBytes(path("flipped.mcap"), bytes);
        SCOPED_TRACE("byte " + std::to_string(place));
        try {
            LogReader reader(path("flipped.mcap"));
            const std::vector<TickRecord> back = readAll(reader);
            // Only the closing magic has no checksum; without it the file counts as cut off.
            EXPECT_FALSE(reader.isComplete());
            EXPECT_GE(place, bytes.size() - 8);
            EXPECT_EQ(back.size(), records.size());
        } catch (const Error& e) {
            ++noticed;
            EXPECT_EQ(e.kind(), ErrorKind::BadInput);
            EXPECT_TRUE(contains(e.what(), "flipped.mcap")) << e.what();
            if (place >= 8) EXPECT_TRUE(contains(e.what(), ": byte ")) << e.what();
        }
    }
    EXPECT_GT(noticed, 500);
}

TEST_F(LogTest, DamagedChunkTellsWhere) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 450, 0.001, 8));
    const std::size_t chunk = log.writes[3];  // the third
    const auto read = [&](const std::string& bytes) {
        writeBytes(path("bad.mcap"), bytes);
        LogReader reader(path("bad.mcap"));
        TickRecord record;
        for (int i = 0; i < 200; ++i) EXPECT_TRUE(reader.read(record));
        return catchError(ErrorKind::BadInput, [&] { reader.read(record); });
    };
    std::string bytes = log.bytes;
    bytes[chunk + 9 + 24] = static_cast<char>(bytes[chunk + 9 + 24] ^ 1);
    EXPECT_TRUE(contains(read(bytes), "the chunk's checksum differs"));
    EXPECT_TRUE(contains(read(bytes), "bad.mcap: byte " + std::to_string(chunk + 9)));

    bytes = log.bytes;
    setU64(bytes, chunk + 9 + 16, std::uint64_t{1} << 60);
    EXPECT_TRUE(contains(read(bytes), "a chunk of 1152921504606846976 bytes; at most 67108864"));

    bytes = log.bytes;
    setU64(bytes, chunk + 9 + 16, getU64(bytes, chunk + 9 + 16) - 1);
    EXPECT_TRUE(contains(read(bytes), "cannot be decompressed"));
    bytes = log.bytes;
    setU64(bytes, chunk + 9 + 16, getU64(bytes, chunk + 9 + 16) + 1);
    EXPECT_TRUE(contains(read(bytes), "bytes instead of"));

    const std::size_t name = chunk + 9 + 32;
    ASSERT_EQ(bytes.substr(name, 4), "zstd");
    bytes = log.bytes;
    bytes.replace(name, 4, "fast");
    EXPECT_TRUE(contains(read(bytes), "compressed by `fast`; this version reads `zstd`, `lz4` and none"));

    bytes = log.bytes.substr(0, log.writes[4]);  // cut off behind a chunk that is compressed as it was before
    const std::string before = "x-viable-columns";
    bytes.replace(name, 4, before);
    bytes[name - 4] = static_cast<char>(before.size());
    setU64(bytes, chunk + 1, getU64(bytes, chunk + 1) + before.size() - 4);
    EXPECT_EQ(read(bytes),
              path("bad.mcap").string() +
                  ": the log was written with `--compact`, which viable reads up to plugin interface 11. "
                  "Write it with one of those by `viable export LOG --to mcap FILE`: FILE is a log for this one");

    bytes = log.bytes;
    setU64(bytes, name + 4, ~std::uint64_t{0});
    EXPECT_TRUE(contains(read(bytes), "needs 18446744073709551615 bytes where only"));

    bytes = log.bytes;
    setU64(bytes, chunk + 1, ~std::uint64_t{0});
    EXPECT_TRUE(contains(read(bytes), "a record runs past the end of the data"));
}

TEST_F(LogTest, WhatIsNoLogIsRefused) {
    const auto open = [&](const std::filesystem::path& file) {
        return catchError(ErrorKind::BadInput, [&] { LogReader reader(file); });
    };
    EXPECT_TRUE(contains(open(path("absent.mcap")), "cannot be opened: No such file"));
    EXPECT_TRUE(contains(open(folder_), "not a file"));
    writeBytes(path("empty.mcap"), "");
    EXPECT_TRUE(contains(open(path("empty.mcap")), "the file is empty"));
    writeBytes(path("text.mcap"), "time_s,nominal.joint0.q_rad\n");
    EXPECT_TRUE(contains(open(path("text.mcap")), "not an MCAP file"));
    writeBytes(path("magic.mcap"), std::string("\x89MCAP0\r\n", 8));
    EXPECT_TRUE(contains(open(path("magic.mcap")), "ends within its opening"));
    // A record of 300 MB that the (sparse) file even has.
    const WrittenLog log = makeLog(makeOpening(makeLayout(1, Space::Joint, false)), {});
    std::string bytes = log.bytes.substr(0, log.writes[1]);
    bytes += std::string("\x09", 1) + std::string(8, '\0');
    setU64(bytes, bytes.size() - 8, 300'000'000);
    writeBytes(path("sparse.mcap"), bytes);
    std::filesystem::resize_file(path("sparse.mcap"), bytes.size() + 300'000'000);
    EXPECT_TRUE(contains(open(path("sparse.mcap")), "a record of 300000000 bytes"));
}

TEST_F(LogTest, OlderAndNewerFieldsAreFoundByName) {
    PlainMcap log;
    // Fields in another order, some missing, some unknown; one whole channel unknown.
    log.channel(5, "/nominal", "Nominal",
                "# a comment\nuint8 KIND=3\nuint8 kind\nfloat64[] qd_radps # [rad/s]\n"
                "string[] notes\nuint16[3] codes\nfloat64[] q_rad\nfloat32[<=4] extra\nbool last\n");
    log.channel(7, "/weather", "Weather", "geometry_msgs/Pose pose\n");
    log.channel(6, "/tick", "Tick", "int64 braking\nstring status\nfloat64 time_s");
    for (std::uint32_t row = 0; row < 3; ++row) {
        const double t = 0.25 * row;
        log.message(7, row, "anything");
        log.message(6, row, Cdr().put(row == 1 ? 1 : 0, 8).put("stopped_by_plan").put(t).bytes);
        Cdr body;
        body.put(9, 1).put(2, 4).put(t + 1.5).put(-2.5);
        body.put(2, 4).put("x").put("longer");
        body.put(1, 2).put(2, 2).put(3, 2);
        body.put(2, 4).put(t).put(0.125);
        body.put(1, 4).put(0, 4).put(1, 1);
        log.message(5, row, body.bytes);
    }
    writeBytes(path("old.mcap"), log.finish());
    LogReader reader(path("old.mcap"));
    EXPECT_EQ(reader.library(), "another");
    EXPECT_TRUE(reader.isComplete());
    EXPECT_FALSE(reader.layout().hasRealPlant);
    EXPECT_EQ(reader.layout().jointNames, (std::vector<std::string>{"a", "b"}));
    std::vector<std::string> names;
    for (const LogColumn& column : reader.columns()) names.push_back(column.name());
    EXPECT_EQ(names, (std::vector<std::string>{"time_s", "nominal.a.q_rad", "nominal.a.qd_radps", "nominal.b.q_rad",
                                               "nominal.b.qd_radps", "tick.status", "tick.braking"}));
    const std::vector<TickRecord> back = readAll(reader);
    ASSERT_EQ(back.size(), 3u);
    for (std::size_t row = 0; row < 3; ++row) {
        const double t = 0.25 * static_cast<double>(row);
        EXPECT_EQ(back[row].time_s, t);
        EXPECT_EQ(back[row].nominal.q, (JointVector(2) << t, 0.125).finished());
        EXPECT_EQ(back[row].nominal.qd, (JointVector(2) << t + 1.5, -2.5).finished());
        EXPECT_EQ(back[row].nominal.qdd.size(), 0);
        EXPECT_EQ(back[row].status, FilterStatus::StoppedByPlan);
        EXPECT_EQ(back[row].braking, row == 1);
        EXPECT_EQ(back[row].substituted, 0);
    }
}

TEST_F(LogTest, ALogFromBeforeObstaclesOpens) {
    PlainMcap log;
    log.channel(1, "/filter", "Filter",
                "float64[] tau_nm\nstring[] active\nfloat64[] tau_removed_nm\nfloat64[] margin_rad\n"
                "float64[] stop_s\n");
    Cdr row;
    row.put(2, 4).put(1.0).put(2.0);
    row.put(2, 4).put("none").put("jerk_upper");
    for (const double first : {3.0, 5.0, 7.0}) row.put(2, 4).put(first).put(first + 1.0);
    log.message(1, 0, row.bytes);
    writeBytes(path("old.mcap"), log.finish());
    LogReader reader(path("old.mcap"));
    EXPECT_TRUE(reader.layout().limits.isEmpty());
    for (const LogColumn& column : reader.columns())
        EXPECT_FALSE(contains(column.name(), "rest_rad") || contains(column.name(), "clearance")) << column.name();
    TickRecord record;
    ASSERT_TRUE(reader.read(record));
    EXPECT_EQ(record.stops[1].margin, 6.0);
    EXPECT_EQ(record.stops[1].duration_s, 8.0);
    EXPECT_EQ(record.stops[1].rest, 0.0);
    EXPECT_FALSE(record.reports[LimitKind::Clearance].isKnown);
    EXPECT_FALSE(reader.read(record));
}

TEST_F(LogTest, WrongMessagesAreRefused) {
    const auto read = [&](const std::string& schema, const std::string& joints,
                          const std::vector<std::pair<std::uint32_t, std::string>>& messages) {
        PlainMcap log;
        log.channel(1, "/desired", "Desired", schema, joints);
        for (const auto& [sequence, body] : messages) log.message(1, sequence, body);
        writeBytes(path("wrong.mcap"), log.finish());
        return complainReading(path("wrong.mcap"));
    };
    const std::string good = "float64[] tau_nm\n";
    const std::string joints = R"(["a","b"])";
    EXPECT_TRUE(contains(read("float32[] tau_nm\n", joints, {}),
                         "gives `tau_nm` the type `float32[]`; this version reads `float64[]`"));
    EXPECT_TRUE(contains(read("Pose tau_nm\n", joints, {}), "has the type `Pose`, unknown here"));
    EXPECT_TRUE(contains(read("float64[] tau_nm\nfloat64[] tau_nm\n", joints, {}), "names `tau_nm` twice"));
    EXPECT_TRUE(contains(read("float64[]\n", joints, {}), "a line without a name"));
    for (const char* bad :
         {"", "[]", "[1]", "{}", "[\"a\"", "\"a\"", R"(["","","","","","","","","","","","","","","","",""])"}) {
        EXPECT_TRUE(contains(read(good, bad, {}), "`/desired` does not name 1 to 16 joints")) << bad;
    }
    EXPECT_TRUE(contains(read(good, joints, {{0, Cdr().put(3, 4).put(1.).put(2.).put(3.).bytes}}),
                         "`tau_Nm` has 3 entries for 2 joints"));
    EXPECT_TRUE(
        contains(read(good, joints, {{0, Cdr().put(2, 4).put(1.).bytes}}), "needs 8 bytes where only 0 are left"));
    EXPECT_TRUE(contains(read(good, joints, {{0, Cdr().put(0xffffffff, 4).bytes}}), "has 4294967295 entries"));

    PlainMcap log;
    log.channel(1, "/tick", "Tick", "string status\nint64 braking\n");
    log.message(1, 0, Cdr().put("asleep").put(0, 8).bytes);
    writeBytes(path("word.mcap"), log.finish());
    EXPECT_TRUE(contains(complainReading(path("word.mcap")), "`status` cannot be `asleep`"));

    PlainMcap lacking;
    lacking.channel(1, "/desired", "Desired", good);
    lacking.channel(2, "/motor", "Motor", good);
    const std::string body = Cdr().put(2, 4).put(1.).put(2.).bytes;
    lacking.message(1, 0, body);
    lacking.message(1, 1, body);
    lacking.message(2, 1, body);
    writeBytes(path("lacking.mcap"), lacking.finish());
    EXPECT_TRUE(contains(complainReading(path("lacking.mcap")), "row 0 lacks a channel"));
}

TEST_F(LogTest, NoBytesAtAllMakeTheReaderFallOver) {
    const LogLayout layout = makeLayout(3, Space::Joint, true);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 20, 0.01, 4));
    std::mt19937_64 random(5);
    int failures = 0;
    for (int i = 0; i < 600; ++i) {
        // Several bytes anywhere become anything: lengths, counts, checksums (0: not checked).
        std::string bytes = log.bytes;
        for (std::uint64_t k = 1 + random() % 6; k > 0; --k) {
            const std::size_t place = 8 + random() % (bytes.size() - 8);
            bytes[place] = static_cast<char>(random() % 3 == 0 ? 0xff : random());
        }
        writeBytes(path("noise.mcap"), bytes);
        try {
            LogReader reader(path("noise.mcap"));
            readAll(reader);
        } catch (const Error&) {
            ++failures;
        }
    }
    EXPECT_GT(failures, 400);
}

TEST_F(LogTest, Fault74_ASecondRunIntoOneFileIsRefused) {
    const LogOpening opening = makeOpening(makeLayout(1, Space::Joint, false));
    LogWriter first(path("run.mcap"), opening);
    const std::string before = readBytes(path("run.mcap"));
    const std::string text = catchError(ErrorKind::BadInput, [&] { LogWriter second(path("run.mcap"), opening); });
    EXPECT_EQ(text, path("run.mcap").string() +
                        ": the log exists already and is never overwritten. Choose another folder "
                        "or move the old log away");
    EXPECT_EQ(readBytes(path("run.mcap")), before);
    first.finish();
    EXPECT_TRUE(first.status().ok());

    std::filesystem::create_symlink(path("nowhere"), path("link.mcap"));
    catchError(ErrorKind::BadInput, [&] { LogWriter second(path("link.mcap"), opening); });
    EXPECT_FALSE(std::filesystem::exists(path("nowhere")));
    EXPECT_TRUE(contains(catchError(ErrorKind::LogNotWritten, [&] { LogWriter w(path("absent/run.mcap"), opening); }),
                         "cannot be created: No such file or directory"));
}

TEST_F(LogTest, Fault74_OfTwoRunsAtOnceOneGetsTheFile) {
    const LogOpening opening = makeOpening(makeLayout(1, Space::Joint, false));
    for (int round = 0; round < 50; ++round) {
        const std::filesystem::path file = path("race" + std::to_string(round) + ".mcap");
        expectOneOfTwo([&] { LogWriter(file, opening).finish(); });
        EXPECT_TRUE(LogReader(file).isComplete());
    }
}

// Logs of plugin interface 5 and before have another word for it.
TEST(LogFields, TheOldWordForRecoveringIsRead) {
    int found = 0;
    for (const LogChannel* channel : listLogChannels())
        for (const LogField& field : channel->fields) {
            if (field.name != "status" && field.name != "stop") continue;
            TickRecord record;
            ASSERT_TRUE(field.setText(record, 0, "returning")) << field.name;
            EXPECT_STREQ(field.text(record, 0), "recovering");
            EXPECT_FALSE(field.setText(record, 0, "returned"));
            ++found;
        }
    EXPECT_EQ(found, 2);
}

}  // namespace
}  // namespace viable::test
