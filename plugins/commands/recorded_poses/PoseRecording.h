#pragma once

#include <filesystem>
#include <vector>

#include "viable/core/JointTypes.h"

namespace viable {

/** One recorded pose. */
struct TimedPose {
    double time_s;
    Eigen::Vector3d position;        ///< [m]
    Eigen::Quaterniond orientation;  ///< unit
};

/** What a recording must be like. */
struct RecordingChecks {
    double maxGap_s;            ///< longest time between two samples
    bool splitsAtGaps = false;  ///< longer ones end a part; else they are refused
};

/** Fewer samples than this make no motion. */
inline constexpr std::size_t kFewestSamples = 4;
inline constexpr std::size_t kMostSamples = 1000000;
/** Quaternions may be this far from unit length: files have few decimals. They are normalised. */
inline constexpr double kUnitTolerance = 1e-2;
/** Faster than any hand: positions that are not metres, or a tracker that lost its target. [m/s] */
inline constexpr double kTopSpeed_mps = 20.0;
/** More rotation than this from sample to sample cannot be told from its opposite. [rad] */
inline constexpr double kTopStep_rad = 1.5707963267948966;

/** Reads a recording: TUM trajectory text (`timestamp tx ty tz qx qy qz qw`, separated by blanks)
or CSV whose first line names the columns time_s, x_m, y_m, z_m, qx, qy, qz, qw in any order (other
columns are passed over). Lines that begin with `#` and empty lines are passed over. Stamps are in
seconds from any origin; the first part begins at 0. More than one part only where it is split.

Throws Error (BadInput) with file and line for a wrong number of columns, numbers that are none or
not finite, quaternions that are not unit, stamps that do not increase, and steps that no hand makes;
with the file for gaps, all of them, and for fewer than kFewestSamples samples. */
std::vector<std::vector<TimedPose>> readPoseRecording(const std::filesystem::path& file, const RecordingChecks& checks);

/** The samples with noise taken out: at each one, the value there of the straight line (for
orientations: in the tangent space) that fits its neighbours best, weighted by a Gaussian with
standard deviation `sigma_s`. Zero phase; straight motion stays as it is. */
std::vector<TimedPose> smooth(const std::vector<TimedPose>& samples, double sigma_s);

}  // namespace viable
