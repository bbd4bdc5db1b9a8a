#pragma once

#include <cstdint>

#include "viable/plugin/CommandSource.h"

namespace viable {

/** What a command is between two samples of it. */
enum class BetweenSamples : unsigned char {
    Hold,         ///< the newest one, at rest
    Interpolate,  ///< straight to the newest one, there a period later: one sample behind
    Extrapolate,  ///< on from the newest one as the last two went, until the next is overdue
};

/** "hold", "interpolate", "extrapolate". */
const char* getName(BetweenSamples between);

/** Makes a command for every tick out of samples that come when they come: 10 to 200 times a second, late, or not at
all.

Time is that of receipt; stamps of the sender are not needed. Period and phase of the sender are learnt from the
receipts: the earliest ones tell its clock, so that one that is late or lost tells no other speed.
What is extrapolated goes no faster than any of the last two differences did and in the direction of both (a slope
limiter): a command that jumps is not overshot. Nothing is differentiated twice; no velocity that a sample brings along
is used.
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
    double followClock(double t);
    bool findNextVelocity(const MotionCommand& sample, double lasted_s);
    void leadTo(const MotionCommand& now, double meets_s);
    static void move(MotionCommand& command, double seconds);

    BetweenSamples between_;
    MotionCommand newest_;      // sample
    double received_s_ = 0.0;   // when
    double sent_s_ = 0.0;       // when, as far as receipts tell
    double period_s_ = 0.0;     // learnt
    double lasted_s_ = 0.0;     // the sample before the newest
    std::int64_t samples_ = 0;  // since the period is learnt
    int slower_ = 0;            // in a row, samples that seem to follow a lost one
    MotionCommand base_;        // at begin_s_, with the velocity that leads to ...
    MotionCommand goal_;        // ... at meets_s_, with its velocity until stands_s_
    double begin_s_ = 0.0, meets_s_ = 0.0, stands_s_ = 0.0;
    JointVector slope_;                // between the last two samples: joints
    Vector6 twist_ = Vector6::Zero();  // the tool's
};

}  // namespace viable
