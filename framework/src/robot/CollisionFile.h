#pragma once

#include "robot/urdf/UrdfReader.h"

namespace viable::detail {

/** The file in a robot's folder that says what of it can hit something. */
inline constexpr const char* kCollisionFile = "collision.yaml";

/** Most capsules of a robot: their pairs grow with the square. */
inline constexpr int kMaxCapsules = 256;

/** collision.yaml as written. */
struct CollisionFile {
    std::vector<LinkShapes> links;                              ///< capsules, in the links' own frames; in file order
    std::vector<std::pair<std::string, std::string>> mayTouch;  ///< links
};

/** What to do where `viable new robot` left a blank. */
enum class Blanks : unsigned char { Refuse, LeaveOut };

/** Throws Error (BadInput) with the place of what is wrong. */
CollisionFile readCollisionFile(const std::filesystem::path& file, const UrdfRobot& urdf, Blanks blanks);

}  // namespace viable::detail
