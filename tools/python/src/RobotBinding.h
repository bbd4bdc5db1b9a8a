#pragma once

#include "Arrays.h"
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

}  // namespace viable::python
