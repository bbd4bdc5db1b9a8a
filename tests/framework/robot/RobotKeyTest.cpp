#include "robot/RobotKey.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>

#include "Paths.h"

namespace viable {
namespace {

using Change = std::function<void(RobotDescription&)>;

void nudge(double& figure) {
    figure = std::nextafter(figure, 1e9);
}

TEST(RobotKey, DiffersWhereAnyFigureOrNameDiffers) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const std::vector<Change> changes = {
        [](auto& r) { r.name += "x"; },
        [](auto& r) { r.joints.pop_back(); },
        [](auto& r) { r.joints[1].name += "x"; },
        [](auto& r) { r.joints[1].childLink += "x"; },
        [](auto& r) { r.joints[1].type = JointType::Prismatic; },
        [](auto& r) { r.joints[1].parent = -1; },
        [](auto& r) { nudge(r.joints[1].placement.translation()[2]); },
        [](auto& r) { nudge(r.joints[1].placement.linear()(0, 1)); },
        [](auto& r) { nudge(r.joints[1].axis[0]); },
        [](auto& r) { nudge(r.joints[5].body.mass); },
        [](auto& r) { nudge(r.joints[5].body.com[1]); },
        [](auto& r) { nudge(r.joints[5].body.inertia(2, 2)); },
        [](auto& r) { r.toolParent = 4; },
        [](auto& r) { r.toolLink += "x"; },
        [](auto& r) { nudge(r.toolPlacement.translation()[0]); },
        [](auto& r) { nudge(r.gravity[0]); },
        [](auto& r) { nudge(r.limits.position.lower[0]); },
        [](auto& r) { nudge(r.limits.velocity.upper[0]); },
        [](auto& r) { nudge(r.limits.acceleration.upper[5]); },
        [](auto& r) { r.limits.jerk.upper[5] = 1e8; },
        [](auto& r) { r.allowLargeAngles = !r.allowLargeAngles; },
        [](auto& r) { nudge(r.home[3]); },
        [](auto& r) { nudge(r.actuation.gearRatio[0]); },
        [](auto& r) { nudge(r.actuation.rotorInertia[0]); },
        [](auto& r) { nudge(r.actuation.torqueLimit[0]); },
        [](auto& r) { nudge(r.actuation.encoderCounts[0]); },
        [](auto& r) { nudge(r.actuation.friction.coulomb[0]); },
        [](auto& r) { nudge(r.actuation.friction.viscous[0]); },
        [](auto& r) { nudge(r.actuation.friction.viscousVelocity[0]); },
        [](auto& r) { r.assumed.push_back("home_rad"); },
        [](auto& r) {  // the same letters, cut otherwise
            r.joints[0].name += r.joints[0].childLink[0];
            r.joints[0].childLink.erase(0, 1);
        },
    };
    std::set<std::string> keys{detail::calcRobotKey(robot)};
    for (std::size_t i = 0; i < changes.size(); ++i) {
        RobotDescription other = robot;
        changes[i](other);
        EXPECT_TRUE(keys.insert(detail::calcRobotKey(other)).second) << "change " << i;
    }
    RobotDescription moved = robot;
    moved.folder = "/elsewhere";
    EXPECT_EQ(detail::calcRobotKey(moved), detail::calcRobotKey(robot));
}

}  // namespace
}  // namespace viable
