#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "RandomStates.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** Reads a file of collected figures; skips the test where it is absent. For SetUp(). */
inline void readFigures(const char* file, nlohmann::json& figures) {
    if (!std::filesystem::exists(file)) GTEST_SKIP() << "the figures to compare with are not here: " << file;
    std::ifstream(file) >> figures;
}

/** A row of a Denavit-Hartenberg table [m, rad]. */
struct DhRow {
    double a, d, alpha;
};

inline JointVector toVector(const nlohmann::json& list, double unit = 1.0) {
    JointVector v(static_cast<int>(list.size()));
    for (int i = 0; i < v.size(); ++i) v[i] = list[i].get<double>() * unit;
    return v;
}

inline Eigen::Matrix3d toTensor(const nlohmann::json& inertia) {
    const auto get = [&](const char* key) { return inertia[key].get<double>(); };
    Eigen::Matrix3d I;
    I << get("ixx"), get("ixy"), get("ixz"), get("ixy"), get("iyy"), get("iyz"), get("ixz"), get("iyz"), get("izz");
    return I;
}

/** Roll, pitch and yaw about the fixed axes x, y and z. */
inline Eigen::Quaterniond toOrientation(const JointVector& rpy) {
    return Eigen::AngleAxisd(rpy[2], Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(rpy[1], Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(rpy[0], Eigen::Vector3d::UnitX());
}

inline Pose calcTool(RobotModel& model, const JointVector& q) {
    Dynamics dynamics;
    model.calcDynamics(q, JointVector::Zero(q.size()), dynamics);
    return dynamics.tool;
}

/** At random poses the tool is where the Denavit-Hartenberg table has it.
@param isModified  after Craig; else the standard form */
template <int rows>
void expectToolOfTable(const RobotDescription& robot, RobotModel& model, const DhRow (&table)[rows], bool isModified) {
    RandomStates states(robot, 7);
    for (int sample = 0; sample < 200; ++sample) {
        const JointVector q = states.draw().q;
        Eigen::Isometry3d chain = Eigen::Isometry3d::Identity();
        for (int i = 0; i < rows; ++i) {
            const auto turn = [&] {
                if (i < robot.size()) chain.rotate(Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ()));
                chain.translate(Eigen::Vector3d(0.0, 0.0, table[i].d));
            };
            const Eigen::AngleAxisd twist(table[i].alpha, Eigen::Vector3d::UnitX());
            if (isModified) chain.rotate(twist);
            if (!isModified) turn();
            chain.translate(Eigen::Vector3d(table[i].a, 0.0, 0.0));
            if (isModified) turn();
            if (!isModified) chain.rotate(twist);
        }
        const Pose tool = calcTool(model, q);
        ASSERT_LT((tool.position - chain.translation()).norm(), 1e-14);
        ASSERT_LT((tool.orientation.toRotationMatrix() - chain.linear()).norm(), 1e-14);
    }
}

/** The URDF's joint `i` and its link are the published ones, `joints` and `links` of a variant. @return the link */
inline const nlohmann::json& expectPublishedJoint(const RobotDescription& robot, const nlohmann::json& variant, int i) {
    const nlohmann::json &joint = variant["joints"][i], &link = variant["links"][i + 1];
    EXPECT_EQ(robot.joints[i].name, joint["name"]);
    EXPECT_EQ(robot.joints[i].childLink, link["name"]);
    EXPECT_EQ(robot.limits.position.lower[i], joint["lower"].get<double>());
    EXPECT_EQ(robot.limits.position.upper[i], joint["upper"].get<double>());
    EXPECT_EQ(robot.limits.velocity.upper[i], joint["velocity"].get<double>());
    EXPECT_EQ(robot.actuation.torqueLimit[i], joint["effort"].get<double>());
    const BodyInertia& body = robot.joints[i].body;
    EXPECT_EQ(body.mass, link["mass"].get<double>());
    EXPECT_EQ(JointVector(body.com), toVector(link["com"]));
    EXPECT_EQ(body.inertia, toTensor(link["inertia_com"])) << link["name"];
    return link;
}

/** The tool poses that were collected for the arm, printed to 1e-8: `fk_checks` of its figures. */
inline void expectCollectedToolPoses(const nlohmann::json& figures, RobotModel& model) {
    ASSERT_EQ(figures["fk_checks"].size(), 3u);
    for (const nlohmann::json& check : figures["fk_checks"]) {
        const Pose tool = calcTool(model, toVector(check["q"]));
        EXPECT_LT((tool.position - Eigen::Vector3d(toVector(check["xyz"]))).norm(), 2e-8);
        EXPECT_LT(tool.orientation.angularDistance(toOrientation(toVector(check["rpy_zyx_deg"], EIGEN_PI / 180))),
                  3e-8);
    }
}

}  // namespace viable
