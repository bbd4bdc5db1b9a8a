#pragma once

#include "viable/plugin/CommandSource.h"
#include "viable/plugin/RealPlant.h"
#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** The parts of a tick whose times are logged. */
enum class Stage : unsigned char { Command, Dynamics, Controller, Filter, Robust, Plant, Record };
inline constexpr int kStageCount = 7;

/** The finding of the host's monitor on a decision and the stop after it. */
enum class StopVerdict : unsigned char {
    Safe,        ///< tick and stop stay within the limits and end at rest
    Recovering,  ///< beyond a limit, but not further than the stop before
    NoStop,      ///< no stop within the limits was found
};

/** Everything of one tick: the state at `time_s`, what was decided there and what acts from this row to the next.
Plain data without heap, so that the control loop can fill and copy it. Joint vectors have one entry per joint; of a
vector that is shorter, the log holds NaN in the missing places. Parts that a run does not have (the real arm, the
command of the other space) are not logged. */
struct TickRecord {
    /** State of the nominal plant. */
    struct Nominal {
        JointVector q;     ///< [rad]
        JointVector qd;    ///< [rad/s]
        JointVector qdd;   ///< [rad/s^2]
        JointVector jerk;  ///< held from this row to the next [rad/s^3]
    };

    /** One joint's stop from the state at the end of this tick, by the host's monitor. */
    struct Stop {
        /** Least distance of the path through this tick and the stop to a position limit [rad]; negative:
        beyond; infinity: no limit. */
        double margin = 0.0;
        double duration_s = 0.0;  ///< until the joint would be at rest [s]
        double rest = 0.0;        ///< place where it would rest [rad]; NaN: nowhere
    };

    /** A surface that holds the tool, as the torque sensors tell; where a contact force is asked for (MATH 13). */
    struct Touch {
        bool isOn = false;   ///< the nominal arm waits for the real tool, which is held
        double felt = 0.0;   ///< force along the normal [N]
        double asked = 0.0;  ///< less than the one of the file where the joints may not press so much [N]
        Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< out of the surface, base frame
    };

    double time_s = 0.0;  ///< since the start of the run, >= 0
    MotionCommand command;
    Nominal nominal;
    Pose tool;          ///< tool of the nominal arm, base frame
    JointState real;    ///< as measured
    JointState actual;  ///< the truth of a simulated plant
    /** Both are of this tick. False: no reading came in time, and the last one stands there again. Not logged. */
    bool hasReading = true;

    JointVector desiredTorque;  ///< tau_d, the controller's [Nm]
    JointVector filterTorque;   ///< tau_c, the safety filter's [Nm]
    JointVector robustTorque;   ///< tau_a, the robust loop's [Nm]
    JointVector motorTorque;    ///< torque that the motors gave [Nm]
    /** tau_ext, the surroundings', as measured, where it moves the nominal arm [Nm]; else empty. Not a number:
    the reading was unusable, and the last good one acted (after 10 such ticks none). */
    JointVector externalTorque;
    Touch touch;
    ContactReport contact;  ///< the true arm's, where its plant knows
    /** tau_d + tau_ext - tau_c [Nm]; zero in ticks without a controller's torque (a stop of the host's). */
    JointVector removedTorque;

    FilterStatus status = FilterStatus::Passed;
    std::array<JointIntervention, kMaxJoints> joints{};  ///< which limit acts
    std::array<Stop, kMaxJoints> stops{};
    StopVerdict verdict = StopVerdict::Safe;
    LimitReports reports;          ///< on limits of the whole arm, as the filter sees them along the tick and the stop
    PeopleFaults peopleFaults;     ///< as the filter found them
    JointLimits limits;            ///< limits of the nominal plant, in force in this tick
    bool braking = false;          ///< the arm follows the host's own stop, not the command
    bool missed = false;           ///< command, controller and filter did not run in this tick
    bool paused = false;           ///< nor did they because the host was told to pause
    std::int64_t take = 0;         ///< operator's take of a live run that it belongs to, from 1; 0: none
    std::int64_t substituted = 0;  ///< controller torques replaced by the last good one so far

    /** In real time, from the beginning of the last tick to that of this one [us]; 0: one of them was missed. */
    double interval_us = 0.0;
    double compute_us = 0.0;                     ///< the whole tick [us]
    std::array<double, kStageCount> stage_us{};  ///< indexed by Stage [us]
};

/** "command", "dynamics", ...: the words used in logs. */
const char* getName(Stage stage);

/** "safe", "recovering", "no_stop": the words used in logs. */
const char* getName(StopVerdict verdict);

}  // namespace viable
