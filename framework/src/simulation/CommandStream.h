#pragma once

#include <cstdint>
#include <random>

#include "plugin/CommandReceiver.h"

namespace viable {

/** How a command comes over a line. */
struct StreamOptions {
    double rate_hz = 100.0;   ///< samples sent
    double jitter = 0.0;      ///< a sample is late by up to this share of a period, drawn evenly; [0, 1)
    double loss = 0.0;        ///< share of the samples that never come; [0, 1)
    double gap_s = 0.0;       ///< nothing is sent for so long; 0: never
    double gapEvery_s = 5.0;  ///< once in so long, at a time drawn evenly; > gap_s
    BetweenSamples between = BetweenSamples::Extrapolate;
    std::uint64_t seed = 1;
};

/** A line between a command source and the arm: samples, delays and loses a command, and makes of what comes a command
for every tick again. The first sample comes at once.
Real time: no allocation, lock or throw. */
class CommandStream {
public:
    explicit CommandStream(const StreamOptions& options);

    /** Back to t = 0. @param first  stands until the first tick */
    void reset(const MotionCommand& first);

    /** One tick. @param sent  the command at t [s]. @param received  what has come of it by then */
    void pass(double t, const MotionCommand& sent, MotionCommand& received);

private:
    static double draw(std::mt19937_64& engine);
    bool isGap(double t);

    StreamOptions options_;
    std::mt19937_64 engine_, gapEngine_;  // each for itself: another gap draws no other delays
    CommandReceiver receiver_;
    std::int64_t next_ = 0;  // sample to be sent
    MotionCommand onItsWay_;
    bool hasOneOnItsWay_ = false;
    double arrival_s_ = 0.0;
    std::int64_t gaps_ = 0;  // whose begin has been drawn
    double gapBegin_s_ = 0.0;
};

}  // namespace viable
