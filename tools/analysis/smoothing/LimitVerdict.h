#pragma once

#include "analysis/records/MotionRecord.h"
#include "analysis/smoothing/Smoothing.h"

namespace viable {

/** Did a joint keep a limit? */
enum class Finding {
    NoLimit,     ///< there is none to keep
    Held,        ///< nothing beyond it was seen, and an excess of the size asked for would have been
    Broken,      ///< beyond it for certain, at the confidence asked for
    CannotTell,  ///< nothing beyond it was seen, but an excess of that size might have been missed
};

/** "no_limit", "held", "broken", "cannot_tell": the words used in JSON. */
const char* getName(Finding finding);

/** What shares of an excess are of: half the range between the limits of a position (order 0), else calcLimitScale(). */
double calcExcessScale(std::size_t order, double lower, double upper);

/** What was found about one quantity of one joint. Units are the quantity's. */
struct LimitVerdict {
    Finding finding = Finding::NoLimit;
    double lower = 0.0, upper = 0.0;  ///< the limits; infinite: none
    double critical = 0.0;            ///< half width of the band for the whole record [deviations]
    double criticalMean = 0.0;        ///< the same for means over segments
    double deviation = 0.0;           ///< median of the posterior standard deviation
    double judged = 0.0;              ///< share of the record's time in which the band is not wide open (ends, gaps)
    /** Smallest excess that would have been seen with 95 % probability where it lasts as long as asked. Infinite: none
    would. */
    double visibleExcess = 0.0;
    double lowest = 0.0, highest = 0.0;  ///< of the estimate
    /** Readings that follow each other were left out here, in which the joint may have been beyond the limit; not a number:
    nowhere. */
    double hiding_s = std::numeric_limits<double>::quiet_NaN();

    // Of a broken limit:
    LimitSide side = LimitSide::Neither;
    double first_s = 0.0;        ///< from here on the band lies beyond the limit
    double worst_s = 0.0;        ///< where it lies farthest beyond
    double excess = 0.0;         ///< by so much, as estimated there
    double certainExcess = 0.0;  ///< and at least by so much
    double duration_s = 0.0;     ///< the whole band lies beyond for so long in all
};

/** Least and largest value in each of equal segments of a record; infinite where there is none. */
struct Extremes {
    std::vector<double> least, largest;
    Extremes() = default;
    explicit Extremes(std::size_t n) : least(n, kInfinity), largest(n, -kInfinity) {}
    void add(std::size_t i, double x);
};

/** Of one quantity of one joint, for plots: its estimate and the band around it in the segments of RecordVerdict. */
struct MotionCurve {
    Extremes mean, band;
};

/** What the readings of one joint are like; see SmoothedMotion, which is too large to be kept. */
struct MotionFigures {
    double noise = 0.0, quantum = 0.0, window_s = 0.0;
    std::size_t outliers = 0;                       ///< readings that were left out
    std::array<MotionCurve, kMotionOrders> curves;  ///< empty where JudgeOptions do not ask for them
};

/** One joint: what its readings are like, and a verdict for position, velocity, acceleration and jerk. */
struct JointVerdict {
    std::string name;
    bool isPrismatic = false;
    std::string trouble;                  ///< why nothing can be said of this joint; empty: nothing is in the way
    std::optional<MotionFigures> motion;  ///< none where there is trouble
    std::array<LimitVerdict, kMotionOrders> limits;
};

struct JudgeOptions {
    /** Probability that no limit that was kept is called broken, in the whole record: all joints, quantities and times
    together. */
    double confidence = 0.99;
    /** A limit is only said to be held where an excess of this share of it, lasting so long, would have been seen. The
    share is of half the range between a position's limits. */
    double excess = 0.1;
    double excessDuration_s = 0.05;
    bool hasCurves = true;  ///< for writeJson()
};

/** Segments that a curve is cut into at most. */
inline constexpr std::size_t kCurvePoints = 1500;

/** What a record says of some limits. */
struct RecordVerdict {
    JudgeOptions options;
    std::vector<JointVerdict> joints;
    std::string source;  ///< of the record
    double begin_s = 0.0, end_s = 0.0;
    std::size_t samples = 0;

    /** The worst of all: broken, else cannot_tell, else held; no_limit where there is no limit at all. */
    Finding overall() const;

    /** Of the curves, and how long each is. */
    std::size_t segments() const { return std::min(kCurvePoints, std::max<std::size_t>(samples, 2)); }
    double segment_s() const { return (end_s - begin_s) / static_cast<double>(segments()); }
    /** That a time lies in. */
    std::size_t findSegment(double time_s) const {
        return std::min(segments() - 1, static_cast<std::size_t>(std::max(0.0, time_s - begin_s) / segment_s()));
    }
};

/** Judges every joint of a record by its readings alone.

Method: each joint's motion is smoothed (smoothMotion). A limit is broken where the band mean -+ c deviation lies beyond
it, or that of a mean over segments of excessDuration_s (what exceeds a limit on average exceeds it somewhere); c makes
a band hold everywhere at once (Sun and Loader 1994, with Student's t: 2 P(t > c) + arc / pi (1 + c^2 / n)^(-n / 2) is the
error allowed, shared by all joints, quantities and both bands). What would have been seen is found by trying: pulses are added to the
record at many places and the estimate is made again.
Assumes: the readings' errors are independent but for rounding; an encoder's periodic error, for one, is taken for
motion.
@param limits  one per joint of the record; infinite: no limit
Throws Error (BadInput) where no joint can be judged, or an option is out of range. */
RecordVerdict checkRecord(const MotionRecord& record, const std::vector<AxisLimits>& limits,
                          const JudgeOptions& options = {});

/** For a console: a line per joint and quantity, then what it comes to. */
std::string writeText(const RecordVerdict& verdict);

/** JSON: the verdicts with all digits and, for plots, readings, estimates and bands in at most kCurvePoints segments.
What is infinite or not known is null. @param verdict  with curves @param record  that was judged */
std::string writeJson(const RecordVerdict& verdict, const MotionRecord& record);

}  // namespace viable
