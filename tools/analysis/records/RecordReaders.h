#pragma once

#include "analysis/records/MotionRecord.h"

namespace viable::detail {

/** Most joints that a file may have: a slip must not take all memory. */
inline constexpr std::size_t kMostJoints = 256;

// One for each kind of file. They leave the numbers of samples and readings to readMotionRecord().
MotionRecord readTickLog(const std::filesystem::path& file, LoggedArm arm);
MotionRecord readJointStateLog(const std::filesystem::path& file, const std::string& topic);
MotionRecord readCsvRecord(const std::filesystem::path& file, const MotionRecordOptions& options);
/** The names that the header gives to the columns, and the number of lines after it. */
std::vector<std::string> readCsvHeader(const std::filesystem::path& file, std::size_t& rows);
/** Is it what `viable export` writes? */
bool isExportedCsv(const std::vector<std::string>& header);

/** Stamps as the file writes them. */
inline Error notAscending(const std::string& where, const std::string& before, const std::string& stamp) {
    return badInput(where, "time " + stamp + (before == stamp ? " comes twice" : " follows " + before),
                    "Times must ascend from sample to sample: sort the samples or correct their times");
}

inline Error infiniteReading(const std::string& where, const std::string& joint) {
    return badInput(where, "the reading of joint `" + joint + "` is infinite",
                    "Leave a reading out where there is none: an empty field or nan");
}

/** What to do about a log of this program that holds no real arm. */
inline constexpr char kNoRealArmRemedy[] = "Take the nominal arm: --signal nominal";

}  // namespace viable::detail
