#pragma once

#include "tracking/TrackingBound.h"

namespace viable {

/** What disturbs in a run. */
enum class Kind {
    Friction,  ///< its factor jumps
    Constant,  ///< friction of a factor that stays
    Known,     ///< such friction, known to 20 % and fed forward
    Pushes,
    Payload,
    Readings,
    All
};

const char* getName(Kind kind);

/** A robot with its limits, gains and everything that it may have. */
struct Subject {
    std::string name;
    std::size_t number = 0;  ///< in the table
    RobotDescription robot;
    JointLimits limits;
    double tick_s = 0.001;
    NricOptions gains;
    DisturbanceSet all;
};

/** Of all joints, to either side. */
void setLimits(JointLimits& limits, double velocity, double acceleration, double jerk);

/** A robot by name, its motors never at their limit, as the bound assumes; what no robot folder gives is assumed.
@param anywhere  in its whole range of positions */
Subject loadSubject(const std::string& name, bool anywhere);

/** Of a set what is of one kind; the delay stays. */
DisturbanceSet select(const DisturbanceSet& all, Kind kind);
/** A subject's gains, with what is fed forward in a kind. */
NricOptions selectGains(const Subject& subject, const JointLimits& limits, Kind kind);

/** The factor on a robot's friction figures: what it may be, and whether it may jump. */
struct FrictionRange {
    JointVector least, largest;
    bool isConstant = false;
};

FrictionRange findFrictionRange(const DisturbanceSet& set, int n);

}  // namespace viable
