#pragma once

#include <time.h>

#include <cmath>
#include <cstdint>

#include "viable/robot/RobotModel.h"

/** YOURS GOES HERE: the driver of your robot, with the same functions. This one simulates an arm
with the description's friction and a payload that the guard knows nothing of, and sleeps like a
real loop. */
class SimulatedRobot {
public:
    /** @param isSimulatedTime  no sleeping; every thousandth tick comes five ticks late */
    SimulatedRobot(const viable::RobotDescription& robot, double tick_s, bool isSimulatedTime)
        : friction_(robot.actuation.friction),
          model_(viable::withPayload(robot, calcPayload(robot), Eigen::Vector3d::Zero())),
          tick_s_(tick_s),
          isSimulatedTime_(isSimulatedTime),
          state_{robot.home, viable::JointVector::Zero(robot.size())} {
        model_.calcDynamics(state_.q, state_.qd, dynamics_);
        torque_ = dynamics_.gravity;
        clock_gettime(CLOCK_MONOTONIC, &next_);
    }

    /** Sleeps until the next tick is due. Returns how many ticks have passed on top: 0 when in time. */
    std::int64_t waitForTick() {
        const std::int64_t late = isSimulatedTime_ ? (++ticks_ % 1000 == 0 ? 5 : 0) : sleep();
        for (std::int64_t i = 0; i <= late; ++i) move();  // what a real arm does by itself
        return late;
    }

    /** What the joint sensors say: positions [rad] and velocities [rad/s]. */
    const viable::JointState& read() const { return state_; }

    /** Sets the motor torques [Nm], which hold until the next call. */
    void drive(const viable::JointVector& torque) { torque_ = torque; }

    /** Takes the reference of a robot that is led by positions. This one is led by torques. */
    void stream(const viable::MotionState&) {}

    /** Tells the brakes to close, which takes them a tenth of a second: the motors go on until then. */
    void engageBrakes() { isBraking_ = true; }

    /** The brakes are closed, and the motors may be switched off. */
    bool brakesHold() const { return braked_s_ >= 0.1; }

private:
    /** [kg] A twentieth of the arm: 1 kg or so for arms of a man's size. */
    static double calcPayload(const viable::RobotDescription& robot) {
        double mass = 0.0;
        for (const auto& joint : robot.joints) mass += joint.body.mass;
        return 0.05 * mass;
    }

    std::int64_t sleep() {
        const auto toNanoseconds = [](const timespec& t) {
            return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
        };
        const auto period = static_cast<std::int64_t>(std::llround(tick_s_ * 1e9));
        const auto advance = [&](std::int64_t periods) {
            const std::int64_t at = toNanoseconds(next_) + periods * period;
            next_.tv_sec = static_cast<time_t>(at / 1'000'000'000);
            next_.tv_nsec = static_cast<long>(at % 1'000'000'000);
        };
        advance(1);
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next_, nullptr) != 0) {
        }
        timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        const std::int64_t late = (toNanoseconds(now) - toNanoseconds(next_)) / period;
        advance(late);
        return late;
    }

    void move() {
        if (isBraking_) braked_s_ += tick_s_;
        if (brakesHold()) {
            state_.qd.setZero();
            return;
        }
        constexpr int kSteps = 4;
        const double dt = tick_s_ / kSteps;
        for (int step = 0; step < kSteps; ++step) {
            model_.calcDynamics(state_.q, state_.qd, dynamics_);
            viable::JointVector driving = torque_, acceleration;
            for (int i = 0; i < driving.size(); ++i) {
                const double v = state_.qd[i];
                driving[i] -= friction_.coulomb[i] * std::tanh(v / 0.02) +
                              std::copysign(friction_.calcViscous(i, std::abs(v)), v);
            }
            viable::calcForwardDynamics(dynamics_, driving, acceleration);
            state_.qd += dt * acceleration;
            state_.q += dt * state_.qd;
        }
    }

    viable::JointFriction friction_;
    viable::RobotModel model_;
    double tick_s_;
    bool isSimulatedTime_;
    viable::JointState state_;
    viable::JointVector torque_;
    viable::Dynamics dynamics_;
    timespec next_{};
    std::int64_t ticks_ = 0;
    bool isBraking_ = false;
    double braked_s_ = 0.0;  // since engageBrakes()
};
