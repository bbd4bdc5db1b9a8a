#pragma once

namespace viable {

// The words of TorqueGuard and ReferenceGuard.

/** Result of a tick. */
enum class GuardStatus : unsigned char {
    NotStarted,  ///< start() has not been called, or has thrown; there is no output (a torque is zero)
    Passed,      ///< the motion that is wanted is admissible, and done
    Limited,     ///< changed as little as needed to keep the limits
    Recovering,  ///< still beyond a limit: approached as fast as jerk allows (`recovery`)
    Waiting,     ///< TorqueGuard: an unusable reading; the nominal arm brakes, and goes on with the next good one
    Stopping,    ///< the nominal arm is being braked for good; law or target do not count any more
    Stopped,     ///< the nominal arm is at rest: go on stepping until the brakes are engaged
    Failed,      ///< numbers beyond all arithmetic; a torque goes to zero within 25 ms: engage the brakes
};

/** "not_started", "passed", ... */
const char* getName(GuardStatus status);

/** Why the arm was stopped for good. After NoReadings no reading is used any more: the real arm is braked blindly and
not held in place. */
enum class GuardStop : unsigned char {
    None,
    Requested,         ///< requestStop()
    LawFailed,         ///< TorqueGuard: the torque law threw, or gave no usable torque for more than 10 ticks in a row
    NoReadings,        ///< TorqueGuard: more than 10 unusable ones in a row; engage the brakes at once (see above)
    TooFar,            ///< TorqueGuard: a joint was beyond `largestDeviation`, or did not answer its motor
    TicksMissed,       ///< more than 1000 in a row
    FilterFailed,      ///< the limits could not be kept: absurd limits, or an error of this library
    RobustLoopFailed,  ///< TorqueGuard: its torque would be beyond 1e9 Nm: absurd gains or readings
    GuaranteeBroken,   ///< a decision had no stop within the limits, and was not applied: an error of this library
    LibraryFailed,     ///< an error of this library: please report it
};

}  // namespace viable
