#include "viable/simulation/ArmHardware.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/Text.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** The noise is cut here [standard deviations]: one reading in 16 000 is. */
constexpr double kNoiseCut = 4.0;
constexpr double kTurn = 2.0 * EIGEN_PI;
/** Times are whole ticks up to rounding. */
constexpr double kTickRounding = 1e-6;

std::int64_t toTick(double time_s, double tick_s) {
    const double tick = std::ceil(time_s / tick_s - kTickRounding);
    constexpr double kLast = 9e18;
    return tick < kLast ? static_cast<std::int64_t>(tick) : std::numeric_limits<std::int64_t>::max();
}

}  // namespace

TickWindow TickWindow::read(const Parameters& parameters, const char* from, const char* until, double tick_s) {
    const double from_s = parameters.number(from), until_s = parameters.number(until);
    if (!(until_s > from_s))
        throw badInput(parameters.place(until),
                       "the end, " + detail::formatNumber(until_s) + " s, is not after the beginning, " +
                           detail::formatNumber(from_s) + " s",
                       std::string("Give a time after ") + from + ", or .inf.");
    TickWindow window;
    window.first = toTick(from_s, tick_s);
    window.end = toTick(until_s, tick_s);
    return window;
}

void JointSensors::configure(const RobotDescription& robot, double tick_s, const Parameters& parameters) {
    n_ = robot.size();
    tick_s_ = tick_s;
    const bool exact = parameters.text("encoder") == "exact";
    encoder_ = exact ? Encoder::Exact : Encoder::Counts;
    noise_ = parameters.number("encoder_noise_rad");
    seed_ = static_cast<std::uint64_t>(parameters.integer("seed"));
    isVelocityExact_ = exact && noise_ == 0.0;
    resolution_.setZero(n_);
    for (int i = 0; i < n_; ++i)
        if (!exact) resolution_[i] = robot.encoderStep(i);

    const std::string& fault = parameters.text("sensor_fault");
    const char* const names[] = {"none", "stuck", "bias", "sign", "spike", "swap", "wrap", "nan"};
    fault_ = static_cast<Fault>(std::find(std::begin(names), std::end(names), fault) - names);
    faultJoint_ = static_cast<int>(parameters.integer("sensor_fault_joint"));
    faultSize_ = parameters.number("sensor_fault_rad");
    faultTicks_ = TickWindow::read(parameters, "sensor_fault_from_s", "sensor_fault_until_s", tick_s);
    const int channels = fault_ == Fault::Swap ? n_ - 1 : n_;  // the last joint has no next one
    if (fault_ != Fault::None && faultJoint_ >= channels)
        throw badInput(parameters.place("sensor_fault_joint"),
                       "joint " + std::to_string(faultJoint_) + " cannot have the fault `" + fault +
                           "`; the robot's joints are 0 to " + std::to_string(n_ - 1),
                       fault_ == Fault::Swap ? "A joint is swapped with the next one, so not the last one."
                                             : "Joints are counted from 0.");
}

void JointSensors::reset(const JointState& truth) {
    random_.seed(seed_);
    tick_ = 0;
    measured_ = truth;
    takeReadings(truth);
    measured_.qd = truth.qd;
}

void JointSensors::read(const JointState& truth) {
    ++tick_;
    takeReadings(truth);
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

void JointSensors::takeReadings(const JointState& truth) {
    JointState reading = truth;
    for (int i = 0; i < n_; ++i) {
        double& q = reading.q[i];
        if (noise_ > 0.0) q += noise_ * drawNormal();
        if (resolution_[i] > 0.0) q = resolution_[i] * std::round(q / resolution_[i]);
    }
    if (faultTicks_.contains(tick_)) disturb(reading);
    if (!isVelocityExact_) reading.qd = (reading.q - measured_.q) / tick_s_;
    measured_ = reading;
}

void JointSensors::disturb(JointState& reading) {
    double &q = reading.q[faultJoint_], &qd = reading.qd[faultJoint_];
    switch (fault_) {
        case Fault::None:
            break;
        case Fault::Stuck:
            q = measured_.q[faultJoint_];
            qd = 0.0;
            break;
        case Fault::Bias:
            q += faultSize_;
            break;
        case Fault::Sign:
            q = -q;
            qd = -qd;
            break;
        case Fault::Spike:
            if (tick_ == faultTicks_.first) q += faultSize_;
            break;
        case Fault::Swap:
            std::swap(q, reading.q[faultJoint_ + 1]);
            std::swap(qd, reading.qd[faultJoint_ + 1]);
            break;
        case Fault::Wrap:
            q += kTurn;
            break;
        case Fault::Nan:
            q = qd = std::numeric_limits<double>::quiet_NaN();
            break;
    }
}

}  // namespace viable
