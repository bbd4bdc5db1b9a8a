#include "PoseRecording.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>

#include "core/RotationVector.h"
#include "core/Text.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using detail::format;

constexpr std::size_t kLongestLine = 4096;
constexpr std::array<const char*, 8> kColumns = {"time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};

std::string_view trim(std::string_view s) {
    const auto first = s.find_first_not_of(" \t\r");
    if (first == std::string_view::npos) return {};
    return s.substr(first, s.find_last_not_of(" \t\r") - first + 1);
}

void split(std::string_view line, bool byComma, std::vector<std::string_view>& fields) {
    fields.clear();
    if (byComma) {
        for (std::size_t begin = 0;;) {
            const std::size_t end = line.find(',', begin);
            fields.push_back(trim(line.substr(begin, end - begin)));
            if (end == std::string_view::npos) return;
            begin = end + 1;
        }
    }
    for (std::size_t begin = 0; (begin = line.find_first_not_of(" \t", begin)) != line.npos;) {
        const std::size_t end = std::min(line.find_first_of(" \t", begin), line.size());
        fields.push_back(line.substr(begin, end - begin));
        begin = end;
    }
}

double toDouble(std::string_view text, const std::string& where, const std::string& column) {
    std::string_view digits = text;
    if (!digits.empty() && digits.front() == '+') digits.remove_prefix(1);
    double value = 0.0;
    // from_chars: the decimal point must not depend on the user's locale.
    const auto result = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    const std::string shown(text.substr(0, 40));
    if (result.ec != std::errc() || result.ptr != digits.data() + digits.size())
        throw badInput(where, "'" + shown + "' is not a number (column " + column + ")", "Correct or remove this line");
    if (!std::isfinite(value))
        throw badInput(where, "'" + shown + "' is not finite (column " + column + ")",
                       "Remove the lines in which tracking was lost");
    return value;
}

// For each of kColumns its place in the header line.
std::array<std::size_t, 8> findColumns(const std::vector<std::string_view>& header, const std::string& where) {
    std::vector<std::string> names(header.begin(), header.end());
    std::array<std::size_t, 8> places{};
    for (std::size_t c = 0; c < kColumns.size(); ++c) {
        const auto found = std::find(names.begin(), names.end(), kColumns[c]);
        if (found == names.end()) {
            const std::string closest = findClosestName(kColumns[c], names);
            throw badInput(where,
                           std::string("there is no column '") + kColumns[c] + "'" +
                               (closest.empty() ? "" : "; the closest is '" + closest + "'"),
                           "The first line must name the columns time_s,x_m,y_m,z_m,qx,qy,qz,qw, in any order");
        }
        if (std::find(found + 1, names.end(), kColumns[c]) != names.end())
            throw badInput(where, std::string("the column '") + kColumns[c] + "' stands there twice",
                           "Name each column once");
        places[c] = static_cast<std::size_t>(found - names.begin());
    }
    return places;
}

/** Two samples with too much time between them. */
struct Gap {
    int from, to;  // lines
    double length_s;
};

[[noreturn]] void refuseGaps(const std::vector<Gap>& gaps, const std::string& file, double maxGap_s) {
    constexpr std::size_t kShown = 10;
    const char* const remedy =
        "Set `gaps: hold` (the tool rests in a gap), use a part of the recording without gaps, raise max_gap_s, or "
        "convert the stamps if they are not in seconds";
    if (gaps.size() == 1)
        throw badInput(
            file + ":" + std::to_string(gaps[0].to),
            format("gap of %.6g s since line %d, but max_gap_s is %g s", gaps[0].length_s, gaps[0].from, maxGap_s),
            remedy);
    std::string list;
    for (std::size_t i = 0; i < std::min(gaps.size(), kShown); ++i)
        list += (i > 0 ? ", " : "") + format("%.6g s before line %d", gaps[i].length_s, gaps[i].to);
    if (gaps.size() > kShown) {
        const auto isShorter = [](const Gap& a, const Gap& b) { return a.length_s < b.length_s; };
        list += format(" and %zu more, the longest of all %.6g s", gaps.size() - kShown,
                       std::max_element(gaps.begin(), gaps.end(), isShorter)->length_s);
    }
    throw badInput(file, format("%zu gaps, but max_gap_s is %g s: ", gaps.size(), maxGap_s) + list, remedy);
}

void checkStep(const TimedPose& last, int lastLine, const TimedPose& now, const std::string& where) {
    const double speed = (now.position - last.position).norm() / (now.time_s - last.time_s);
    if (speed > kTopSpeed_mps)
        throw badInput(
            where, format("moves at %.4g m/s from line %d to here, faster than %g m/s", speed, lastLine, kTopSpeed_mps),
            "Positions are in metres and stamps in seconds; remove samples in which the tracker jumped");
    const double turn = calcRotationVector(now.orientation * last.orientation.conjugate()).norm();
    if (turn > kTopStep_rad)
        throw badInput(
            where, format("turns by %.4g rad from line %d to here, more than %.4g rad", turn, lastLine, kTopStep_rad),
            "Quaternions are written qx qy qz qw; remove samples in which the tracker jumped");
}

}  // namespace

std::vector<std::vector<TimedPose>> readPoseRecording(const std::filesystem::path& file,
                                                      const RecordingChecks& checks) {
    std::error_code failure;
    if (!std::filesystem::is_regular_file(file, failure))
        throw badInput(file.string(), "is not a file", "Give the file of a recording");
    std::ifstream stream(file);
    if (!stream) throw badInput(file.string(), "cannot be opened", "Check that it may be read");

    std::vector<std::vector<TimedPose>> parts(1);
    std::vector<Gap> gaps;
    std::size_t count = 0;
    std::string line;
    std::vector<std::string_view> fields;
    bool isCsv = false, hasFormat = false;
    std::size_t columnCount = kColumns.size();
    std::array<std::size_t, 8> columns = {0, 1, 2, 3, 4, 5, 6, 7};
    double origin = 0.0, lastStamp = 0.0;
    int number = 0, lastNumber = 0;
    while (std::getline(stream, line)) {
        ++number;
        const std::string where = file.string() + ":" + std::to_string(number);
        if (line.size() > kLongestLine)
            throw badInput(where, "the line has " + std::to_string(line.size()) + " characters",
                           "This is not a recording of poses in text form");
        std::string_view text = line;
        if (number == 1 && text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
        text = trim(text);
        if (text.empty() || text.front() == '#') continue;
        if (!hasFormat) {
            hasFormat = true;
            isCsv = text.find(',') != std::string_view::npos;
            if (isCsv) {
                split(text, true, fields);
                columns = findColumns(fields, where);
                columnCount = fields.size();
                continue;
            }
        }
        split(text, isCsv, fields);
        if (fields.size() != columnCount)
            throw badInput(where, format("%zu columns instead of %zu", fields.size(), columnCount),
                           isCsv ? "Every line needs as many values as the first line has names"
                                 : "A line is 'timestamp tx ty tz qx qy qz qw', separated by blanks");
        std::array<double, 8> v{};
        for (std::size_t c = 0; c < kColumns.size(); ++c) v[c] = toDouble(fields[columns[c]], where, kColumns[c]);

        if (count == 0) origin = v[0];
        TimedPose now{v[0] - origin, {v[1], v[2], v[3]}, {v[7], v[4], v[5], v[6]}};
        const double norm = now.orientation.norm();
        if (!(std::abs(norm - 1.0) <= kUnitTolerance))
            throw badInput(where, format("the quaternion has length %.6g instead of 1 (+-%g)", norm, kUnitTolerance),
                           "Quaternions are written qx qy qz qw; remove lines in which tracking was lost");
        now.orientation.normalize();
        if (count > 0) {
            const TimedPose& last = parts.back().back();
            if (!(now.time_s > last.time_s))
                throw badInput(
                    where, format("time stamp %.9f s is not later than %.9f s on line %d", v[0], lastStamp, lastNumber),
                    "Sort the recording and remove samples with the same stamp");
            const double rounding_s =  // of the stamps
                4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(v[0]), std::abs(origin));
            if (const double step = now.time_s - last.time_s; step <= checks.maxGap_s + rounding_s) {
                checkStep(last, lastNumber, now, where);
            } else {
                gaps.push_back({lastNumber, number, step});
                parts.emplace_back();
            }
        }
        if (count == kMostSamples)
            throw badInput(where, format("more than %zu samples", kMostSamples), "Cut the recording");
        parts.back().push_back(now);
        ++count;
        lastStamp = v[0];
        lastNumber = number;
    }
    if (stream.bad()) throw badInput(file.string(), "could not be read to its end", "Check the disk");
    if (!gaps.empty() && !checks.splitsAtGaps) refuseGaps(gaps, file.string(), checks.maxGap_s);
    if (count < kFewestSamples)
        throw badInput(file.string(), format("%zu samples, but at least %zu are needed", count, kFewestSamples),
                       "A line is 'timestamp tx ty tz qx qy qz qw', or CSV with a line of column names");
    return parts;
}

std::vector<TimedPose> smooth(const std::vector<TimedPose>& samples, double sigma_s) {
    if (!(sigma_s > 0.0)) return samples;
    const double reach = 3.0 * sigma_s;  // beyond, the weights are below 1.2 %
    std::vector<TimedPose> result = samples;
    std::size_t first = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const TimedPose& centre = samples[i];
        while (samples[first].time_s < centre.time_s - reach) ++first;
        double s0 = 0.0, s1 = 0.0, s2 = 0.0;
        Vector6 y0 = Vector6::Zero(), y1 = Vector6::Zero();
        for (std::size_t j = first; j < samples.size(); ++j) {
            const double d = samples[j].time_s - centre.time_s;
            if (d > reach) break;
            const double weight = std::exp(-0.5 * d * d / (sigma_s * sigma_s));
            Vector6 y;
            y.head<3>() = samples[j].position - centre.position;
            y.tail<3>() = calcRotationVector(samples[j].orientation * centre.orientation.conjugate());
            s0 += weight;
            s1 += weight * d;
            s2 += weight * d * d;
            y0 += weight * y;
            y1 += weight * d * y;
        }
        const double determinant = s0 * s2 - s1 * s1;
        if (determinant <= 1e-12 * s0 * s2) continue;  // no neighbour in reach
        const Vector6 y = (s2 * y0 - s1 * y1) / determinant;
        result[i].position += y.head<3>();
        result[i].orientation = (calcRotation(y.tail<3>()) * centre.orientation).normalized();
    }
    return result;
}

}  // namespace viable
