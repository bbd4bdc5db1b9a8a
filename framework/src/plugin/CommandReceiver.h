#pragma once

#include <array>

#include "viable/plugin/CommandSource.h"

namespace viable {

/** Makes a command for every tick out of samples that come when they come: 10 to 200 times a second, late, or not at
all.

Time is that of receipt; stamps of the sender are not needed. The sender's period is learnt from the last 16 intervals,
and its phase from the earliest receipts. So the speed is right for a sample that is late by less than three quarters of
a period. It is also right after lost samples (up to a third of all). Bursts of more than six samples count as a faster
sender. The extrapolation continues the change of the last two differences, unless it is far larger than usual: a jump. So
a joint, the tool's position or its orientation is not overshot when it stops, turns round or jumps. The velocity fades as
fast as earlier predictions failed. After two periods or 0.2 s without a sample, the command goes back to the last one,
slowly, in 7.5 times as long. Samples that come more seldom than four times a second are held. Turns must stay below half
a turn from sample to sample. Nothing is differentiated twice; no velocity that a sample brings along is used.
Real time: no allocation, lock or throw. */
class CommandReceiver {
public:
    explicit CommandReceiver(BetweenSamples between = BetweenSamples::Hold) : between_(between) {}

    /** @param first  stands until the first sample */
    void reset(const MotionCommand& first);

    /** A sample has come, of the same space and size as the first. @param t  the time, rising from call to call [s] */
    void take(double t, const MotionCommand& received);

    /** The command at time t, not before that of the last sample, with its velocity. */
    void calc(double t, MotionCommand& command) const;

private:
    static constexpr int kIntervals = 16;

    /** What moves by itself: a joint, the tool's position or its orientation. It is seen from the newest sample. */
    struct Way {
        using Vector = Eigen::Vector3d;      // joints: the first is theirs
        Vector slope = Vector::Zero();       // between the last two samples
        Vector next = Vector::Zero();        // what should follow
        Vector velocity = Vector::Zero();    // with which the command goes on
        Vector offset = Vector::Zero();      // of the command from there, when the sample came
        double slope2 = 0.0, change2 = 0.0;  // mean squares of slopes in motion, and of their changes
        bool isOff = false;                  // the slope is far from all others
        double came = 0.0, expected = 0.0;   // means: `next` times what came, its square
        double fading = 0.0;                 // [1/s]
        double most_s = 0.0;                 // ahead, of turns
    };

    double followClock(double t);
    bool isOtherSender(double interval_s);
    void learnPeriod(double interval_s);
    void predict(Way& way, const Eigen::Vector3d& slope, double lasted_s, double trend) const;
    double calcAhead(const Way& way, double t, double& rate) const;
    int countWays() const;

    BetweenSamples between_;
    MotionCommand newest_;     // sample, at rest
    double received_s_ = 0.0;  // when
    double sent_s_ = 0.0;      // when, as far as receipts tell
    std::int64_t samples_ = 0;
    std::array<double, kIntervals> intervals_{};  // the last ones, in any order
    std::int64_t intervalCount_ = 0;              // since the sender is the same
    int streak_ = 0;                              // intervals in a row that are longer (shorter: negative)
    double streak_s_ = 0.0;                       // the last of them
    double period_s_ = 0.0;                       // learnt
    double lasted_s_ = 0.0;                       // the sample before the newest
    std::array<Way, kMaxJoints> ways_;
    double begin_s_ = 0.0, blend_s_ = 0.0, stands_s_ = 0.0;  // offsets: from when on, how long; velocities: until when
};

}  // namespace viable
