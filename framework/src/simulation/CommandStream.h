#pragma once

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

    template <class V>
    void describe(V& v) {
        v(rate_hz, "rate_hz", "Hz", "Samples sent; at most one a tick.").atLeast(0.1).upTo(1e5).required();
        v(jitter, "jitter", "", "A sample is late by up to this share of a period, drawn evenly.").atLeast(0).below(1);
        v(loss, "loss", "", "Share of the samples that never come.").atLeast(0).below(1);
        v(gap_s, "gap_s", "s", "Nothing comes for so long, once in every gap_every_s.").atLeast(0);
        v(gapEvery_s, "gap_every_s", "s", "Longer than gap_s; where in it a gap begins is drawn.")
            .atLeast(0.001)
            .upTo(1e5);
        v(between, "between", "hold|interpolate|extrapolate",
          "What the command is between two samples: the newest one at rest; straight to the newest one, which is "
          "reached when the next is due; on from the newest as the last two went.");
        v(seed, "seed", "Of what is drawn.").atLeast(0);
    }
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
