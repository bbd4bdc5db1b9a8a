#include "log/LogSeries.h"

#include "LogTestSupport.h"
#include "log/Recorder.h"

namespace viable::test {
namespace {

namespace fs = std::filesystem;

LogLayout makeSmallLayout() {
    LogLayout layout;
    layout.jointNames = {"a", "b"};
    layout.isLive = true;
    return layout;
}

std::vector<TickRecord> makeSmallRows(int count) {
    RecordMaker maker(makeSmallLayout(), 5);
    std::vector<TickRecord> rows;
    for (int k = 0; k < count; ++k) rows.push_back(maker.make(0.001 * k));
    return rows;
}

TEST(LogSeries, WithoutALimitIsOneFile) {
    const TemporaryFolder folder;
    LogSeries series(folder / "A.mcap", makeOpening(makeSmallLayout()), 0);
    for (const TickRecord& row : makeSmallRows(3000)) series.append(row);
    series.finish();
    EXPECT_EQ(series.status().rows, 3000u);
    EXPECT_FALSE(fs::exists(folder / "A.part2.mcap"));
    LogReader reader(folder / "A.mcap");
    EXPECT_EQ(readAll(reader).size(), 3000u);
}

TEST(LogSeries, EachFileIsALogTheNewestStayAndTheLimitHolds) {
    const TemporaryFolder folder;
    constexpr std::uint64_t kLimit = 8 << 20;
    LogSeries series(folder / "A.mcap", makeOpening(makeSmallLayout()), kLimit);
    const std::vector<TickRecord> rows = makeSmallRows(500);
    int appended = 0;
    std::uint64_t most = 0;
    const auto measure = [&] {
        std::uint64_t size = 0;
        for (const fs::directory_entry& entry : fs::directory_iterator(folder.path())) size += entry.file_size();
        return size;
    };
    for (int k = 0; k < 60; ++k) {
        for (TickRecord row : rows) {
            row.time_s = 0.001 * appended++;
            series.append(row);
        }
        most = std::max(most, measure());
    }
    series.finish();
    EXPECT_TRUE(series.status().ok()) << series.status().error;
    EXPECT_EQ(series.status().rows, static_cast<std::uint64_t>(appended));
    EXPECT_EQ(series.status().lost, 0u);
    ASSERT_GT(series.status().bytes, kLimit);  // or nothing was deleted
    EXPECT_LE(most, kLimit + (1 << 20));       // a chunk is written at once
    EXPECT_TRUE(fs::exists(folder / "A.mcap"));
    EXPECT_FALSE(fs::exists(folder / "A.part2.mcap"));
    double next = -1.0;
    int files = 0;
    for (int number = 2; number < 200; ++number) {
        const fs::path file = LogSeries::nameFile(folder / "A.mcap", number);
        if (!fs::exists(file)) continue;
        ++files;
        LogReader reader(file);
        EXPECT_TRUE(reader.isComplete());
        for (const TickRecord& row : readAll(reader)) {
            if (next >= 0.0) ASSERT_NEAR(row.time_s, next, 1e-9) << file;
            next = row.time_s + 0.001;
        }
    }
    EXPECT_NEAR(next, 0.001 * appended, 1e-9);
    EXPECT_GE(files, 4);
    EXPECT_LT(files, LogSeries::kFiles);
}

TEST(LogSeries, GoesOnWhereTheDiskTakesFilesAgain) {
    const TemporaryFolder folder;
    fs::create_directory(folder / "disk");
    constexpr std::uint64_t kLimit = 8 << 20;
    LogSeries series(folder / "disk" / "A.mcap", makeOpening(makeSmallLayout()), kLimit);
    const std::vector<TickRecord> rows = makeSmallRows(500);
    int appended = 0;
    const auto append = [&](int count) {
        for (; count > 0; --count) {
            TickRecord row = rows[static_cast<std::size_t>(appended) % rows.size()];
            row.time_s = 0.001 * appended++;
            series.append(row);
        }
    };
    append(500);
    fs::rename(folder / "disk", folder / "away");
    append(8000);  // enough for the first file to end
    EXPECT_FALSE(series.status().ok());
    EXPECT_GT(series.status().lost, 0u);
    fs::create_directory(folder / "disk");
    append(static_cast<int>(LogSeries::kRetryRows) + 2000);
    series.finish();
    EXPECT_EQ(series.status().rows + series.status().lost, static_cast<std::uint64_t>(appended));
    bool isFound = false;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder / "disk")) {
        LogReader reader(entry.path());
        isFound |= !readAll(reader).empty();
    }
    EXPECT_TRUE(isFound);
}

}  // namespace
}  // namespace viable::test
