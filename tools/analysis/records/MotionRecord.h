#pragma once

#include <filesystem>
#include <optional>

#include "viable/core/JointLimits.h"

namespace viable {

/** Which of the two arms of a log of this program. */
enum class LoggedArm { Real, Nominal };

/** The sampled motion of some joints, as a file holds it. Plain data. */
struct MotionRecord {
    struct Joint {
        std::string name;
        bool isPrismatic = false;       ///< unit m instead of rad
        std::vector<double> positions;  ///< one per time [rad, m]; not a number: no reading
        std::vector<double> torques;    ///< one per time [Nm, N], or empty: the file has none
    };

    std::vector<double> times_s;  ///< since the first sample, strictly ascending, finite; at least kLeastSamples
    std::vector<Joint> joints;    ///< at least one
    /** The limits that the file itself names: those in force in a log of this program, which are the same in all of
    its rows. */
    std::optional<JointLimits> limits;
    bool saysUnits = true;  ///< false: files of this kind do not tell whether a joint turns or slides
    std::string robot;      ///< robot that the file names, for a log of this program its folder; empty: none
    LoggedArm arm = LoggedArm::Real;
    bool isCutOff = false;  ///< a log of this program without its end: what it has is here
    std::string source;     ///< the file, for messages
    std::string begin;  ///< stamp of the first sample as the file has it (an MCAP file's in s); times_s count from it
};

/** Fewer samples hold no jerk and no noise. */
inline constexpr std::size_t kLeastSamples = 20;

/** What to read of a file that leaves a choice. */
struct MotionRecordOptions {
    LoggedArm arm = LoggedArm::Real;  ///< of a log of this program, or of its export as CSV
    /** CSV: the columns to use and their units in place of what the header says, as NAME:UNIT,NAME:UNIT,... such as
    "timestamp:s,tx:m,ty:m". The one with a unit of time is the time; the others are left out. Empty: the header's. */
    std::string columns;
    std::string topic;  ///< of an MCAP file of others, where several have joint states; empty: the only one
};

/** Reads sampled joint motion. The kind of the file is told from its content:

A log of this program, also one that was cut off: the readings of the real arm with the torques of its motors, or the
positions of the nominal arm without torques. limits are those of the rows when all rows have the same; for the real arm
with the position and velocity limits that the run held on it.

An MCAP file with messages of sensor_msgs/JointState, of ROS 2 (CDR) or ROS 1; chunks plain, zstd or lz4. Times are
header.stamp, or the log times where every stamp is zero. A joint that a message does not name has no reading there;
torques are there for a joint whose every reading has an effort. Every joint is taken for a revolute one [rad].

CSV, separated by comma, semicolon, tab or blanks. The line before the numbers names the columns; it may begin with #,
as comments do. Each name ends in its unit, after _ or in brackets: time_s, "t [ms]", joint1_rad, "joint1 (deg)",
lift_mm, joint1_Nm. Units: s, ms, us, ns; rad, deg; m, cm, mm (a prismatic joint); Nm, N (torque of the joint of that
name). Columns with a unit of something else, such as _radps, are skipped. An empty field or nan is a missing reading.
What `viable export` writes is read by options.arm; it gives no limits and no robot.

Times keep a nanosecond, also as seconds since 1970.
Throws Error (BadInput) with file, line or sample and remedy: for what cannot be read, times that do not ascend,
infinite readings, and fewer than kLeastSamples samples or readings of a joint. */
MotionRecord readMotionRecord(const std::filesystem::path& file, const MotionRecordOptions& options = {});

/** What the columns of such a file are. */
struct ColumnTable {
    struct Row {
        std::string name;  ///< "nominal.<joint>.q_rad": of all joints
        std::string unit;  ///< "rad/s"; "1" for a number without one, empty for a word or a column that is not read
        std::string form;  ///< "number", "word", or "text" of a CSV
        std::string meaning;
        int count = 1;  ///< columns: of the joints with this unit
    };
    std::vector<Row> columns;
    std::size_t rows = 0;  ///< of the file
};

/** Of a log of this program all that it holds; of other files what readMotionRecord() makes of them. Errors as there. */
ColumnTable describeColumns(const std::filesystem::path& file, const MotionRecordOptions& options = {});

}  // namespace viable
