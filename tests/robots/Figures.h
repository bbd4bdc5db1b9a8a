#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

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
