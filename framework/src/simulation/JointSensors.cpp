#include "viable/simulation/ArmHardware.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"

namespace viable {

/** The noise is cut here [standard deviations]: one reading in 16 000 is. */
constexpr double kNoiseCut = 4.0;
constexpr double kTurn = 2.0 * EIGEN_PI;
/** Times are whole ticks up to rounding. */
constexpr double kTickRounding = 1e-6;

static std::int64_t toTick(double time_s, double tick_s) {
    const double tick = std::ceil(time_s / tick_s - kTickRounding);
    constexpr double kLast = 9e18;
    return tick < kLast ? static_cast<std::int64_t>(tick) : std::numeric_limits<std::int64_t>::max();
}

TickWindow TickWindow::make(double from_s, double until_s, double tick_s, const Parameters& parameters,
                            const std::string& what) {
    if (!(until_s > from_s))
        throw badInput(parameters.place((what + "_until_s").c_str()),
                       "the end, " + detail::formatNumber(until_s) + " s, is not after the beginning, " +
                           detail::formatNumber(from_s) + " s",
                       "Give a time after " + what + "_from_s, or .inf.");
    TickWindow window;
    window.first = toTick(from_s, tick_s);
    window.end = toTick(until_s, tick_s);
    return window;
}

void JointSensors::configure(const RobotDescription& robot, double tick_s, const JointSensorOptions& options,
                             const Parameters& parameters) {
    n_ = robot.size();
    tick_s_ = tick_s;
    options_ = options;
    const bool exact = options.encoder == Encoder::Exact;
    isVelocityExact_ = exact && options.noise_rad == 0.0;
    resolution_.setZero(n_);
    for (int i = 0; i < n_; ++i)
        if (!exact) resolution_[i] = robot.encoderStep(i);

    faultTicks_ = TickWindow::make(options.faultFrom_s, options.faultUntil_s, tick_s, parameters, "sensor_fault");
    const int channels = options_.fault == SensorFault::Swap ? n_ - 1 : n_;  // the last joint has no next one
    if (options_.fault != SensorFault::None && options_.faultJoint >= channels)
        throw badInput(parameters.place("sensor_fault_joint"),
                       "joint " + std::to_string(options_.faultJoint) + " cannot have the fault `" +
                           parameters.resolved().find("sensor_fault")->text + "`; the robot's joints are 0 to " +
                           std::to_string(n_ - 1),
                       options_.fault == SensorFault::Swap
                           ? "A joint is swapped with the next one, so not the last one."
                           : "Joints are counted from 0.");
}

void JointSensors::reset(const JointState& truth) {
    random_.seed(options_.seed);
    tick_ = 0;
    measured_ = truth;
    updateReadings(truth);
    measured_.qd = truth.qd;
}

void JointSensors::read(const JointState& truth) {
    ++tick_;
    updateReadings(truth);
}

double JointSensors::drawNormal() {
    // Box and Muller, with an own mapping to (0, 1]: the standard distributions differ between
    // libraries.
    const double unit = 0x1p-53;
    const double u1 = (static_cast<double>(random_() >> 11) + 1.0) * unit;
    const double u2 = static_cast<double>(random_() >> 11) * unit;
    const double normal = std::sqrt(-2.0 * std::log(u1)) * std::cos(2.0 * EIGEN_PI * u2);
    return std::min(std::max(normal, -kNoiseCut), kNoiseCut);
}

void JointSensors::updateReadings(const JointState& truth) {
    JointState reading = truth;
    for (int i = 0; i < n_; ++i) {
        double& q = reading.q[i];
        if (options_.noise_rad > 0.0) q += options_.noise_rad * drawNormal();
        if (resolution_[i] > 0.0) q = resolution_[i] * std::round(q / resolution_[i]);
    }
    if (faultTicks_.contains(tick_)) disturb(reading);
    if (!isVelocityExact_) reading.qd = (reading.q - measured_.q) / tick_s_;
    measured_ = reading;
}

void JointSensors::disturb(JointState& reading) {
    double &q = reading.q[options_.faultJoint], &qd = reading.qd[options_.faultJoint];
    switch (options_.fault) {
        case SensorFault::None:
            break;
        case SensorFault::Stuck:
            q = measured_.q[options_.faultJoint];
            qd = 0.0;
            break;
        case SensorFault::Bias:
            q += options_.fault_rad;
            break;
        case SensorFault::Sign:
            q = -q;
            qd = -qd;
            break;
        case SensorFault::Spike:
            if (tick_ == faultTicks_.first) q += options_.fault_rad;
            break;
        case SensorFault::Swap:
            std::swap(q, reading.q[options_.faultJoint + 1]);
            std::swap(qd, reading.qd[options_.faultJoint + 1]);
            break;
        case SensorFault::Wrap:
            q += kTurn;
            break;
        case SensorFault::Nan:
            q = qd = std::numeric_limits<double>::quiet_NaN();
            break;
    }
}

}  // namespace viable
