#pragma once

#include "Arrays.h"
#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/robot/RobotModel.h"

namespace viable::python {

/** viable.Robot: a description and its dynamics. */
struct PythonRobot {
    explicit PythonRobot(RobotDescription given) : description(std::move(given)), model(description) {}
    const RobotDescription description;
    RobotModel model;
    Dynamics dynamics;  // of the last call
    int size() const { return description.size(); }
};

/** One call into a guard or a batch at a time: a law must not step the guard that calls it, nor another thread meanwhile. */
class Turn {
public:
    Turn(bool& isTaken, const char* owner) : isTaken_(isTaken) {
        if (isTaken)
            throw badInput(owner, "it was called while it was at work, by its own law or by another thread",
                           "Call it from one thread, and not from inside its law.");
        isTaken = true;
    }
    ~Turn() { isTaken_ = false; }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

private:
    bool& isTaken_;
};

}  // namespace viable::python
