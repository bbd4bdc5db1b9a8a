#include <sys/fsuid.h>
#include <sys/stat.h>

#include "Effort.h"
#include "FullDisk.h"
#include "LogTestSupport.h"
#include "records/LogExport.h"

namespace viable::test {
namespace {

using Space = MotionCommand::Space;

struct LogRecoveryTest : LogTestBase {
    /** Recovers `bytes`, which must stay as they are, and returns the new log's bytes. */
    std::string recover(const std::string& bytes, std::uint64_t expectedRows) {
        writeBytes(path("cut.mcap"), bytes);
        std::filesystem::remove(path("whole.mcap"));
        EXPECT_EQ(recoverLog(path("cut.mcap"), path("whole.mcap")), expectedRows);
        EXPECT_EQ(readBytes(path("cut.mcap")), bytes) << "the original was touched";
        EXPECT_EQ(listFolder(), (std::vector<std::string>{"cut.mcap", "whole.mcap"}));
        return readBytes(path("whole.mcap"));
    }

    /** A log of `rows` rows without its end. */
    WrittenLog makeCutLog(const LogLayout& layout, int rows, unsigned seed) {
        WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, rows, 0.001, seed));
        log.bytes.resize(log.writes.back());
        return log;
    }
};

unsigned getSeed(unsigned otherwise) {
    const auto seed = static_cast<unsigned>(test::getSeed(otherwise));
    std::printf("VIABLE_SEED=%u\n", seed);
    return seed;
}

TEST_F(LogRecoveryTest, Fault73_CutOffAnywhereBecomesAWholeLogOfItsRows) {
    std::mt19937_64 random(getSeed(731));
    for (const bool hasRealPlant : {true, false}) {
        const LogLayout layout =
            makeLayout(hasRealPlant ? 6 : 2, hasRealPlant ? Space::Joint : Space::Tool, hasRealPlant);
        const std::vector<TickRecord> records = makeRecords(layout, 730, 0.001, 51);
        const WrittenLog log = makeLog(makeOpening(layout), records);
        writeBytes(path("original"), log.bytes);
        LogReader original(path("original"));
        const std::vector<TickRecord> rows = readAll(original);
        std::filesystem::remove(path("original"));
        ASSERT_EQ(rows.size(), records.size());

        std::vector<std::size_t> places{0, 1, 8, log.bytes.size() - 1, log.bytes.size()};
        for (const std::size_t write : log.writes)
            for (const std::size_t place : {write - 1, write, write + 1})
                if (place < log.bytes.size()) places.push_back(place);
        for (int i = 0; i < 20; ++i) places.push_back(random() % log.writes[1]);
        for (int i = 0; i < 80; ++i) places.push_back(random() % log.bytes.size());
        int recovered = 0;
        for (const std::size_t place : places) {
            SCOPED_TRACE("cut at byte " + std::to_string(place) + " of " + std::to_string(log.bytes.size()));
            const std::string bytes = log.bytes.substr(0, place);
            if (place < log.writes[1]) {  // in the opening
                writeBytes(path("cut.mcap"), bytes);
                std::filesystem::remove(path("whole.mcap"));
                const std::string text =
                    catchError(ErrorKind::BadInput, [&] { recoverLog(path("cut.mcap"), path("whole.mcap")); });
                EXPECT_EQ(text.rfind(path("cut.mcap").string() + ": ", 0), 0u) << text;
                EXPECT_TRUE(text.find("within its opening and holds no rows") != text.npos ||
                            text.find("the file is empty") != text.npos || text.find("not an MCAP file") != text.npos)
                    << text;
                EXPECT_EQ(listFolder(), std::vector<std::string>{"cut.mcap"});
                continue;
            }
            writeBytes(path("cut.mcap"), bytes);
            LogReader cut(path("cut.mcap"));
            EXPECT_EQ(cut.isComplete(), place == log.bytes.size());
            const std::size_t left = readAll(cut).size();

            const std::string whole = recover(bytes, left);
            LogReader reader(path("whole.mcap"));
            EXPECT_TRUE(reader.isComplete());
            EXPECT_EQ(reader.layout().jointNames, layout.jointNames);
            const std::vector<TickRecord> back = readAll(reader);
            ASSERT_EQ(back.size(), left);
            for (std::size_t i = 0; i < back.size(); ++i)
                ASSERT_EQ(getBits(back[i], layout), getBits(rows[i], layout)) << "row " << i;
            // Index, statistics, attachments, checksums: all as if the run had ended there.
            const std::vector<TickRecord> first(records.begin(), records.begin() + static_cast<long>(left));
            ASSERT_EQ(whole, makeLog(makeOpening(layout), first).bytes);
            ++recovered;
        }
        EXPECT_GT(recovered, 60);
    }
}

TEST_F(LogRecoveryTest, AWholeLogGivesTheSameBytes) {
    // Chunks that end by their size, too; times that go back.
    const LogLayout layout = makeLayout(16, Space::Tool, true);
    std::vector<TickRecord> records = makeRecords(layout, 1200, 0.00005, 52);
    for (std::size_t i = 700; i < 800; ++i) records[i].time_s -= 0.01;
    const WrittenLog log = makeLog(makeOpening(layout), records);
    EXPECT_GT(log.writes.size(), 4u);
    EXPECT_EQ(recover(log.bytes, records.size()), log.bytes);
}

TEST_F(LogRecoveryTest, TheOpeningIsKept) {
    LogOpening opening = makeOpening(makeLayout(3, Space::Tool, false));
    opening.layout.jointNames = {"the \"elbow\", left", "left/lift.1", "\xC3\xBC"};
    opening.metadata[""] = "no key";
    opening.metadata["zero"] = std::string("a\0b", 3);
    opening.attachments.push_back({"empty", "", ""});
    opening.attachments.push_back({"empty", "text/plain", std::string(300'000, '\0') + "end"});
    const WrittenLog log = makeLog(opening, makeRecords(opening.layout, 250, 0.001, 53));
    recover(log.bytes.substr(0, log.writes.back()), 250);
    LogReader reader(path("whole.mcap"));
    EXPECT_EQ(reader.layout().jointNames, opening.layout.jointNames);
    EXPECT_EQ(reader.layout().commandSpace, Space::Tool);
    EXPECT_FALSE(reader.layout().hasRealPlant);
    EXPECT_EQ(reader.metadata(), opening.metadata);
    ASSERT_EQ(reader.attachments().size(), opening.attachments.size());
    for (std::size_t i = 0; i < opening.attachments.size(); ++i) {
        EXPECT_EQ(reader.attachments()[i].name, opening.attachments[i].name);
        EXPECT_EQ(reader.attachments()[i].mediaType, opening.attachments[i].mediaType);
        EXPECT_EQ(reader.attachments()[i].data, opening.attachments[i].data);
    }
}

TEST_F(LogRecoveryTest, NothingIsOverwritten) {
    const LogLayout layout = makeLayout(1, Space::Joint, false);
    const std::string bytes = makeCutLog(layout, 450, 54).bytes;
    writeBytes(path("cut.mcap"), bytes);
    writeBytes(path("mine.mcap"), "mine");
    std::filesystem::create_directory(path("folder"));
    std::filesystem::create_symlink(path("nowhere"), path("dangling"));
    std::filesystem::create_symlink(path("cut.mcap"), path("link"));
    const std::vector<std::string> before = listFolder();
    for (const char* target : {"mine.mcap", "cut.mcap", "folder", "dangling", "link"}) {
        EXPECT_EQ(catchError(ErrorKind::BadInput, [&] { recoverLog(path("cut.mcap"), path(target)); }),
                  path(target).string() +
                      ": the file exists already and is never overwritten. Choose another name or move "
                      "the old file away");
    }
    EXPECT_EQ(readBytes(path("mine.mcap")), "mine");
    EXPECT_EQ(readBytes(path("cut.mcap")), bytes);
    EXPECT_EQ(listFolder(), before);
}

TEST_F(LogRecoveryTest, OfTwoAtOnceOneGetsTheName) {
    const LogLayout layout = makeLayout(1, Space::Joint, false);
    writeBytes(path("cut.mcap"), makeCutLog(layout, 250, 55).bytes);
    for (int round = 0; round < 50; ++round) {
        const std::filesystem::path target = path("whole" + std::to_string(round) + ".mcap");
        expectOneOfTwo([&] { recoverLog(path("cut.mcap"), target); });
        EXPECT_TRUE(LogReader(target).isComplete());
    }
    EXPECT_EQ(listFolder().size(), 51u) << "a temporary file was left";
}

TEST_F(LogRecoveryTest, Fault72_AFullDiskLeavesNothing) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 850, 0.001, 56));
    writeBytes(path("cut.mcap"), log.bytes.substr(0, log.writes.back()));
    // Full in the opening, at a chunk's border, in a chunk, in the summary, before the last byte.
    for (const std::size_t room :
         {std::size_t{1}, log.writes[1], log.writes[4] + 1000, log.writes.back(), log.bytes.size() - 1}) {
        SCOPED_TRACE("room for " + std::to_string(room) + " bytes");
        std::string text;
        {
            const FullDisk disk(room);
            text = catchError(ErrorKind::LogNotWritten, [&] { recoverLog(path("cut.mcap"), path("full.mcap")); });
        }
        EXPECT_EQ(text, path("full.mcap").string() +
                            ": the file cannot be written: File too large. Choose a folder that "
                            "exists, may be written to and has room");
        EXPECT_EQ(listFolder(), std::vector<std::string>{"cut.mcap"});
    }
    EXPECT_EQ(recoverLog(path("cut.mcap"), path("whole.mcap")), 850u);
}

TEST_F(LogRecoveryTest, WhereNothingCanBeWrittenTheReasonIsSaid) {
    const LogLayout layout = makeLayout(1, Space::Joint, false);
    writeBytes(path("cut.mcap"), makeCutLog(layout, 250, 57).bytes);
    writeBytes(path("file"), "");
    const auto getText = [&](const std::filesystem::path& target) {
        return catchError(ErrorKind::LogNotWritten, [&] { recoverLog(path("cut.mcap"), target); });
    };
    const auto expected = [](const std::filesystem::path& target, const std::string& reason) {
        return target.string() + ": the file cannot be written: " + reason +
               ". Choose a folder that exists, may be written to and has room";
    };
    const std::filesystem::path absent = path("absent") / "whole.mcap";
    EXPECT_EQ(getText(absent), expected(absent, "No such file or directory"));
    const std::filesystem::path inFile = path("file") / "whole.mcap";
    EXPECT_EQ(getText(inFile), expected(inFile, "Not a directory"));
    const std::filesystem::path tooLong = path(std::string(256, 'x'));
    EXPECT_EQ(getText(tooLong), expected(tooLong, "File name too long"));
    EXPECT_EQ(getText("").rfind("the file cannot be written: No such file", 0), 0u);

    // Folders that may not be written to, or not be entered. Root asks as somebody else.
    const bool isRoot = ::geteuid() == 0;
    ASSERT_EQ(::chmod(folder_.c_str(), 0755), 0);
    const std::filesystem::path locked = path("locked"), hidden = path("hidden");
    std::filesystem::create_directory(locked);
    std::filesystem::create_directory(hidden);
    ASSERT_EQ(::chmod(locked.c_str(), 0555), 0);
    ASSERT_EQ(::chmod(hidden.c_str(), isRoot ? 0700 : 0000), 0);
    if (isRoot) ::setfsuid(65534);
    for (const std::filesystem::path& folder : {locked, hidden})
        EXPECT_EQ(getText(folder / "whole.mcap"), expected(folder / "whole.mcap", "Permission denied"));
    if (isRoot) ::setfsuid(0);
    ASSERT_EQ(::chmod(hidden.c_str(), 0755), 0);
    EXPECT_EQ(listFolder(), (std::vector<std::string>{"cut.mcap", "file", "hidden", "locked"}));
    EXPECT_TRUE(std::filesystem::is_empty(locked));
    EXPECT_TRUE(std::filesystem::is_empty(hidden));
}

TEST_F(LogRecoveryTest, ANameAsLongAsNamesMayBeIsFine) {
    const LogLayout layout = makeLayout(1, Space::Joint, false);
    writeBytes(path("cut.mcap"), makeCutLog(layout, 250, 58).bytes);
    EXPECT_EQ(recoverLog(path("cut.mcap"), path(std::string(255, 'x'))), 250u);
    EXPECT_EQ(listFolder().size(), 2u);
}

TEST_F(LogRecoveryTest, WhatIsNoLogIsRefused) {
    writeBytes(path("empty"), "");
    writeBytes(path("text"), "time_s,nominal.joint0.q_rad\n0,0\n");
    const auto getText = [&](const char* log) {
        return catchError(ErrorKind::BadInput, [&] { recoverLog(path(log), path("whole.mcap")); });
    };
    EXPECT_EQ(getText("empty"), path("empty").string() + ": the file is empty. Give a log written by `viable run`");
    EXPECT_EQ(getText("text"),
              path("text").string() + ": not an MCAP file of version 0. Give a log written by `viable run`");
    EXPECT_EQ(getText("absent"),
              path("absent").string() + ": the log cannot be opened: No such file or directory. Check the path");
    EXPECT_EQ(catchError(ErrorKind::BadInput, [&] { recoverLog(folder_, path("whole.mcap")); }),
              folder_.string() + ": not a file. Give a log");
    EXPECT_EQ(listFolder(), (std::vector<std::string>{"empty", "text"}));
}

TEST_F(LogRecoveryTest, DamageIsNotHidden) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 650, 0.001, 59));
    std::string bytes = log.bytes.substr(0, log.writes.back() - 5);
    bytes[log.writes[3] + 300] = static_cast<char>(bytes[log.writes[3] + 300] ^ 1);
    writeBytes(path("damaged.mcap"), bytes);
    const std::string text =
        catchError(ErrorKind::BadInput, [&] { recoverLog(path("damaged.mcap"), path("whole.mcap")); });
    EXPECT_EQ(text.rfind(path("damaged.mcap").string() + ": byte ", 0), 0u) << text;
    EXPECT_EQ(listFolder(), std::vector<std::string>{"damaged.mcap"});
}

}  // namespace
}  // namespace viable::test
