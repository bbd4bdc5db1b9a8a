#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

/** What a command is between two samples of it. */
enum class BetweenSamples : unsigned char {
    Hold,         ///< the newest one, at rest
    Interpolate,  ///< straight to the newest one, there when the next is due: one sample behind
    Extrapolate,  ///< on from the newest one as the last two went, until the next is overdue
};

/** "hold", "interpolate", "extrapolate". */
const char* getName(BetweenSamples between);

/** Makes a command for every tick out of samples that come when they come: 10 to 200 times a second, late, or not at
all.

Time is that of receipt; stamps of the sender are not needed. How long a sample lasts is learnt from the receipts, so
that one that is early, late or lost tells no other speed. What is extrapolated goes no faster than any of the last
two differences did and in the direction of both (a slope limiter): a command that jumps is not overshot.
Nothing is differentiated twice; no velocity that a sample brings along is used.
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
    BetweenSamples between_;
    MotionCommand newest_;          // sample
    double received_s_ = 0.0;       // when
    int samples_ = 0;               // 2: and more
    double period_s_ = 0.0;         // learnt
    MotionCommand base_;            // at received_s_; its velocity is that from there on
    double moves_s_ = 0.0;          // so long
    JointVector slope_;             // between the last two samples: joints
    Vector6 twist_ = Vector6::Zero();  // the tool's
};

}  // namespace viable
