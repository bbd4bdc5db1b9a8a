#pragma once

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

using test::TemporaryFolder;

/** A robot folder `arm` whose files a test changes before loading. */
struct RobotFolder {
    std::string urdf;
    std::string limits;
    std::string actuation =
        "schema: 1\ngear_ratio: 1\nrotor_inertia_kgm2: 0\ntorque_limit_Nm: .inf\n"
        "friction: {coulomb_Nm: 0, viscous_Nm: 0, viscous_velocity_radps: 1}\n";
    std::string name = "arm";

    std::filesystem::path path() const { return temporary.path() / name; }

    std::filesystem::path write() const {
        std::filesystem::create_directories(path());
        put(name + ".urdf", urdf);
        put("limits.yaml", limits);
        put("actuation.yaml", actuation);
        return path();
    }
    void put(const std::string& file, const std::string& text) const {
        std::ofstream(path() / file, std::ios::binary) << text;
    }
    RobotDescription load() const { return loadRobot(write()); }

    /** The message with which the folder, as it now stands on disk, is refused. */
    std::string findFault() const {
        return test::catchError([&] { loadRobot(path()); });
    }
    /** The same, once the files are written. */
    std::string writeAndFindFault() const {
        write();
        return findFault();
    }

    /** Replaces the only occurrence of `from`. */
    static void replace(std::string& text, const std::string& from, const std::string& to) {
        const std::size_t at = text.find(from);
        ASSERT_NE(at, std::string::npos) << from;
        ASSERT_EQ(text.find(from, at + 1), std::string::npos) << from;
        text.replace(at, from.size(), to);
    }

    TemporaryFolder temporary;
};

inline std::string makeLink(const std::string& name, double mass, const std::string& com, const std::string& rpy,
                            const std::string& inertia) {
    return "<link name='" + name + "'><inertial><origin xyz='" + com + "' rpy='" + rpy + "'/><mass value='" +
           std::to_string(mass) + "'/><inertia " + inertia + "/></inertial></link>\n";
}

inline std::string makeJoint(const std::string& name, const std::string& type, const std::string& parent,
                             const std::string& child, const std::string& origin, const std::string& axis) {
    return "<joint name='" + name + "' type='" + type + "'><origin " + origin + "/><parent link='" + parent +
           "'/><child link='" + child + "'/><axis xyz='" + axis +
           "'/><limit lower='-2' upper='2' velocity='3' effort='10'/></joint>\n";
}

inline const char* const kSomeInertia = "ixx='0.02' iyy='0.03' izz='0.04' ixy='0.001' ixz='-0.002' iyz='0.003'";

inline const char* const kSomeLimits = "schema: 1\nhome_rad: 0\nacceleration_radps2: 10\njerk_radps3: 100\n";

/** Two revolute joints in a row. */
inline void makeSimpleArm(RobotFolder& folder) {
    folder.urdf = "<robot name='arm'>\n<link name='base'/>\n" +
                  makeJoint("shoulder", "revolute", "base", "upper", "xyz='0 0 0.3' rpy='0 0 0'", "0 0 1") +
                  makeLink("upper", 2.0, "0.1 0 0.05", "0 0 0", kSomeInertia) +
                  makeJoint("elbow", "revolute", "upper", "fore", "xyz='0.4 0 0' rpy='0 0 0'", "0 1 0") +
                  makeLink("fore", 1.0, "0.2 0.01 0", "0 0 0", kSomeInertia) + "</robot>\n";
    folder.limits = kSomeLimits;
}

/** Revolute and prismatic joints with slanted axes and turned frames, and masses on fixed links. */
inline void makeSlantedArm(RobotFolder& folder) {
    folder.urdf = "<robot name='arm'>\n<link name='base'/>\n" +
                  makeJoint("turn", "revolute", "base", "a", "xyz='0.1 -0.2 0.3' rpy='0.3 -0.4 0.5'", "1 2 -0.5") +
                  makeLink("a", 2.5, "0.1 0.05 -0.07", "0.4 0.5 -0.6", kSomeInertia) +
                  makeJoint("slide", "prismatic", "a", "b", "xyz='0.2 0.1 0' rpy='-0.7 0.2 1.1'", "-0.3 0.4 -2") +
                  makeLink("b", 1.5, "-0.02 0.03 0.1", "0 0 0", kSomeInertia) +
                  makeJoint("spin", "continuous", "b", "c", "xyz='0 0.15 0.1' rpy='1.2 0 -0.2'", "0 0 -1") +
                  makeLink("c", 1.1, "0.08 -0.1 0.02", "1 0 2", kSomeInertia) +
                  makeJoint("mount", "fixed", "c", "hand", "xyz='0.05 0.02 0.1' rpy='0.1 0.2 0.3'", "0 0 1") +
                  makeLink("hand", 0.6, "0 0.01 0.05", "0.5 0 0", kSomeInertia) +
                  makeJoint("reach", "prismatic", "hand", "d", "xyz='0 0 0.1' rpy='0 0 0'", "1 0 0") +
                  makeLink("d", 0.5, "0.03 0 0", "0 0 0", kSomeInertia) +
                  makeJoint("flange", "fixed", "d", "tcp", "xyz='0.07 0 0.02' rpy='0 1.5 0'", "0 0 1") +
                  "<link name='tcp'/>\n</robot>\n";
    folder.limits = kSomeLimits;
}

/** A trunk with two branches; the tool is on the left one. Children come before parents in the
file. */
inline void makeBranchedArm(RobotFolder& folder) {
    folder.urdf = "<robot name='arm'>\n<link name='base'/>\n" +
                  makeJoint("left2", "revolute", "l1", "l2", "xyz='0.3 0 0' rpy='0 0 0.4'", "0 1 0") +
                  makeJoint("right1", "revolute", "trunk", "r1", "xyz='0 -0.2 0.5' rpy='0 0 0'", "1 0 1") +
                  makeJoint("left1", "revolute", "trunk", "l1", "xyz='0 0.2 0.5' rpy='0.3 0 0'", "1 0 0") +
                  makeJoint("lift", "prismatic", "base", "trunk", "xyz='0 0 0.1' rpy='0 0.1 0'", "0 0 1") +
                  makeLink("l2", 0.7, "0.1 0 0", "0 0 0", kSomeInertia) +
                  makeLink("l1", 1.2, "0.1 0.02 0", "0.3 0 0", kSomeInertia) +
                  makeLink("r1", 0.9, "0 -0.1 0.05", "0 0 0.2", kSomeInertia) +
                  makeLink("trunk", 4.0, "0 0 0.2", "0 0 0", kSomeInertia) + "</robot>\n";
    folder.limits = std::string(kSomeLimits) + "tool_link: l2\n";
}

}  // namespace viable
