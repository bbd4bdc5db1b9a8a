#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace viable {

/** Position, velocity, acceleration and jerk. */
inline constexpr int kMotionOrders = 4;

/** What is known of a joint at one time: index 0 position [rad, m], 1 velocity, 2 acceleration, 3 jerk (per s each). */
struct MotionEstimate {
    std::array<double, kMotionOrders> mean{};
    std::array<double, kMotionOrders> deviation{};  ///< posterior standard deviation
};

/** Readings next to each other that were left out. */
struct OutlierRun {
    double begin_s = 0.0, end_s = 0.0;
    int count = 0;
    double distance = 0.0;  ///< of the farthest from the estimate [rad, m]
};

/** What is known of a derivative's mean over some time. Where it is beyond a limit, so is the derivative somewhere in
that time; and it is known far better than the derivative at any one time. */
struct MeanEstimate {
    double begin_s = 0.0, duration_s = 0.0;
    double mean = 0.0, deviation = 0.0;
};

/** A change of a motion: one of its derivatives is larger by `height` for `duration_s`; it rises and falls smoothly
over `rise_s` beside that. */
struct MotionPulse {
    int order = 3;  ///< which derivative; 0: the position itself
    double middle_s = 0.0;
    double duration_s = 0.0;
    double rise_s = 0.0;  ///< at order 3 it may be 0: jerk may jump
    double height = 0.0;

    double reach_s() const { return 0.5 * duration_s + rise_s; }  ///< it begins and ends so far from the middle
    /** What it adds to the position; behind it lower derivatives stay changed. */
    double calcPosition(double time_s) const;
};

/** The motion of one joint estimated from noisy readings of its position; made by smoothMotion(). */
class SmoothedMotion {
public:
    ~SmoothedMotion();
    SmoothedMotion(SmoothedMotion&&) noexcept;
    SmoothedMotion& operator=(SmoothedMotion&&) noexcept;

    double begin_s() const { return segments().front().first; }
    double end_s() const { return segments().back().second; }
    double noise() const;     ///< standard deviation of a reading, rounding included [rad, m]
    double quantum() const;   ///< step that the readings are rounded to, 0: none was found [rad, m]
    double window_s() const;  ///< motion that is quicker than this is smoothed away
    const std::vector<std::size_t>& outliers() const;  ///< readings that were left out, ascending

    const std::vector<OutlierRun>& outlierRuns() const;  ///< the same, those that follow each other together
    double interval_s() const;                           ///< median distance of two readings
    /** From how many independent numbers noise and smoothness are known: degrees of freedom of a band. */
    double freedom() const;
    /** Begin and end of each part of the record without a long gap; between them nothing is known. */
    std::vector<std::pair<double, double>> segments() const;

    /** The estimate at a time within a segment (elsewhere: at the end of the one before, or the first one's begin). */
    MotionEstimate evaluate(double time_s) const;

    /** How much there is to look at: the length of the path that the error of one derivative, over its deviation, takes
    on the unit sphere (Sun and Loader 1994). A band for the whole record follows from it. */
    double calcArc(int order) const;

    /** Means of the order-th derivative (1 to 3) over all times of one length from knot to knot, the longest (of 64 knots at
    most) that fits between any two times `duration_s` apart. None where the knots are too far apart for that, or at all of those
    that lie on both sides of a long gap. */
    std::vector<MeanEstimate> calcMeans(int order, double duration_s) const;

    /** What would have been estimated, had the motion had a pulse besides, with the same errors of the readings. */
    struct Tried {
        std::vector<double> times_s;            ///< equally spaced, from the beginning to the end of the plateau
        std::vector<MotionEstimate> estimates;  ///< at these; none where too few readings are near
        std::vector<MeanEstimate> means;        ///< as calcMeans(), those inside the plateau
    };
    Tried tryPulse(const MotionPulse& pulse) const;

private:
    struct Impl;
    explicit SmoothedMotion(std::unique_ptr<Impl> impl);
    friend SmoothedMotion smoothMotion(const std::vector<double>&, const std::vector<double>&, const std::string&);
    std::unique_ptr<Impl> impl_;
};

/** @param times_s  strictly ascending, need not be regular
@param readings  as many; not a number: missing
@param where  of the readings, for messages
Throws Error (BadInput) where the readings hold nothing to estimate from. */
SmoothedMotion smoothMotion(const std::vector<double>& times_s, const std::vector<double>& readings,
                            const std::string& where);

/** A motion takes some 900 bytes a reading: so many are smoothed at once, whatever the number of cores. */
inline std::size_t countSmoothedAtOnce(std::size_t readings) {
    constexpr std::size_t kMostReadings = 2'000'000;
    return std::max<std::size_t>(1, kMostReadings / std::max<std::size_t>(1, readings));
}

}  // namespace viable
