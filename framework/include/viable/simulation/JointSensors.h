#pragma once

#include <cstdint>
#include <random>

#include "viable/core/JointTypes.h"
#include "viable/plugin/Parameters.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The ticks whose beginning lies in [from_s, until_s). */
class TickWindow {
public:
    /** Throws Error (BadInput) at the parameter `until` unless it is after `from`. */
    static TickWindow read(const Parameters& parameters, const char* from, const char* until, double tick_s);
    bool contains(std::int64_t tick) const { return tick >= first && tick < end; }

    std::int64_t first = 0;
    std::int64_t end = 0;
};

/** The position sensors of a simulated arm: whole counts, noise, and one faulty channel.

Method: reading = position + noise, rounded to whole counts; the velocity is the difference of two readings
over a tick, or with `encoder: exact` and without noise the true one. The noise is normal, cut at 4 standard
deviations, so that it has a bound. The fault then acts on the readings, and so on their difference:
    stuck  the channel stays at its last reading           sign  its reading is negated
    bias   sensor_fault_rad is added                       swap  it and the next joint's are exchanged
    spike  the same, in the first reading of the window    wrap  one turn is added
    nan    no number
(the true velocity, where that is reported, is 0 while stuck, negated, exchanged or no number.)
Real time: no allocation, lock or throw after configure(). */
class JointSensors {
public:
    /** Throws Error (BadInput) for a fault on a joint that the robot has not. */
    void configure(const RobotDescription& robot, double tick_s, const Parameters& parameters);

    /** The reading at t = 0, with the velocity as it is. */
    void reset(const JointState& truth);

    /** The reading at the end of a tick. */
    void read(const JointState& truth);

    const JointState& measured() const { return measured_; }
    /** As the parameter `encoder` says. */
    Encoder encoder() const { return encoder_; }

private:
    enum class Fault { None, Stuck, Bias, Sign, Spike, Swap, Wrap, Nan };

    double drawNormal();
    void takeReadings(const JointState& truth);
    void disturb(JointState& reading);

    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector resolution_;  // [rad]; 0: exact
    Encoder encoder_ = Encoder::Counts;
    bool isVelocityExact_ = true;
    double noise_ = 0.0;
    std::uint64_t seed_ = 0;
    std::mt19937_64 random_;
    Fault fault_ = Fault::None;
    int faultJoint_ = 0;
    double faultSize_ = 0.0;
    TickWindow faultTicks_;

    std::int64_t tick_ = 0;
    JointState measured_;
};

}  // namespace viable
