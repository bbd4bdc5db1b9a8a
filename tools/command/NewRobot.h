#pragma once

#include <string>
#include <vector>

namespace viable {

/** What `viable new robot` was asked for. */
struct NewRobotArguments {
    std::string name, urdf, mjcf, out, base, tip;
    std::vector<std::string> fixed, at;
    bool assumes = false, isMassless = false;

    const std::string& file() const { return mjcf.empty() ? urdf : mjcf; }
};

/** Writes the folder of a robot and prints what is to be done in it. Throws Error (BadInput). */
void writeRobot(const NewRobotArguments& arguments);

}  // namespace viable
