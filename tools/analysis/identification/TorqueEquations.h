#pragma once

#include <cstddef>

#include "analysis/identification/Identification.h"

namespace viable::detail {

/** Torques of a payload at the tool, linear in (m, m c, m c c'): the last in the order xx, yy, zz, xy, yz, zx. */
inline constexpr std::size_t kPayloadColumns = 10;

/** One joint's torque balance, averaged over a window in which its velocity has one sign. */
struct TorqueEquation {
    int joint = 0;
    int block = 0;
    int run = 0;                ///< windows of one run follow each other by half a window
    double sign = 1.0;          ///< of the velocity
    double weight = 1.0;        ///< length over the longest window's
    double torque = 0.0;        ///< measured less `rigid` [Nm]
    double rigid = 0.0;         ///< M qdd + b of the nominal arm [Nm]
    double torqueRate = 0.0;    ///< of the measured torque [Nm/s]
    double acceleration = 0.0;  ///< of the joint [rad/s^2]
    /** Of the nominal arm for 1 m/s^2 of gravity more along the base's x and y [Nm]; a tilt of the base is that. */
    std::array<double, 2> tilt{};
    std::array<double, kPayloadColumns> payload{};  ///< [Nm/kg], [Nm/(kg m)], [Nm/(kg m^2)]
    std::vector<double> bodies;                     ///< of each body of the nominal arm [Nm]
    /** Of the samples in the window; shares add up to 1. */
    std::vector<double> speeds, shares;
    std::vector<double> accelerations;  ///< of the speeds: below zero where the joint slows down [rad/s^2]
    double shaking = 0.0;               ///< deviation of the velocity from the smoothed one [rad/s]
};

struct JointActivity {
    bool hasTorques = true;
    double moving_s = 0.0;
    double largest = 0.0;    ///< speed [rad/s]
    double torqueRms = 0.0;  ///< [Nm]
};

struct TorqueEquations {
    std::vector<TorqueEquation> rows;  ///< joint by joint, in order of time
    std::vector<JointActivity> joints;
    int blocks = 0;
    double duration_s = 0.0, window_s = 0.0, block_s = 0.0;
};

/** Smooths the records and averages; errors as those of identify(). */
TorqueEquations makeTorqueEquations(const RobotDescription& nominal, const std::vector<MotionRecord>& records,
                                    const IdentificationOptions& options);

}  // namespace viable::detail
