#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace viable::detail {

/** The readings of one joint as the smoothing takes them. */
struct Readings {
    std::vector<double> times_s;                                ///< ascending
    std::vector<double> values;                                 ///< less the median
    std::vector<double> relative;                               ///< variance of a reading's error over sigma^2
    std::vector<char> isUsed;                                   ///< not an outlier
    std::vector<std::size_t> source;                            ///< place of each in the record
    std::vector<std::pair<std::size_t, std::size_t>> segments;  ///< [first, end) between long gaps
    double offset = 0.0;                                        ///< what was subtracted
    double interval_s = 0.0;                                    ///< median distance of two readings
    double quantum = 0.0;        ///< step that the values are rounded to; 0: none was found
    double leastVariance = 0.0;  ///< of a reading: what rounding alone gives

    double knownVariance = 0.0;  ///< sigma^2, 0: to be estimated

    /** Without readings, but with what holds for all of them. */
    Readings makeEmpty() const;
    /** Readings [first, end) of another as one more segment. */
    void addSegment(const Readings& other, std::size_t first, std::size_t end);
};

/** Throws Error (BadInput) where too few readings are left, or all are the same. Single readings far from a smooth curve
through their neighbours are not used. */
Readings makeReadings(const std::vector<double>& times_s, const std::vector<double>& values, const std::string& where);

/** Takes out segments of which hardly a reading is used; @returns the places of their readings in the record. */
std::vector<std::size_t> dropBarrenSegments(Readings& readings);

}  // namespace viable::detail
