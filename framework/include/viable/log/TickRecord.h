#pragma once

#include <array>
#include <cstdint>

#include "viable/plugin/CommandSource.h"
#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** The parts of a tick whose times are logged. */
enum class Stage : unsigned char { Command, Dynamics, Controller, Filter, Robust, Plant, Record };
inline constexpr int kStageCount = 7;

/** Everything of one tick: the state at `time_s`, what was decided there and what acts from this
row to the next. Plain data without heap, so that the control loop can fill and copy it. Joint
vectors have one entry per joint; of a vector that is shorter, the log holds NaN in the missing
places. What a run does not have (the real arm, the command of the other space) is not logged. */
struct TickRecord {
    /** State of the nominal plant. */
    struct Nominal {
        JointVector q;     ///< [rad]
        JointVector qd;    ///< [rad/s]
        JointVector qdd;   ///< [rad/s^2]
        JointVector jerk;  ///< held from this row to the next [rad/s^3]
    };

    double time_s = 0.0;  ///< since the start of the run, >= 0
    MotionCommand command;
    Nominal nominal;
    Pose tool;          ///< tool of the nominal arm, base frame
    JointState real;    ///< as measured
    JointState actual;  ///< the truth of a simulated plant

    JointVector desiredTorque;  ///< tau_d, the controller's [Nm]
    JointVector filterTorque;   ///< tau_c, the safety filter's [Nm]
    JointVector robustTorque;   ///< tau_a, the robust loop's [Nm]
    JointVector motorTorque;    ///< what the motors gave [Nm]

    FilterStatus status = FilterStatus::Passed;
    std::array<JointIntervention, kMaxJoints> joints{};  ///< which limit acts, margin [rad]
    bool braking = false;          ///< the arm follows the host's own stop, not the command
    std::int64_t substituted = 0;  ///< controller torques replaced by the last good one so far

    double compute_us = 0.0;                     ///< the whole tick [us]
    std::array<double, kStageCount> stage_us{};  ///< indexed by Stage [us]
};

/** "command", "dynamics", ...: the words used in logs. */
const char* getName(Stage stage);

}  // namespace viable
