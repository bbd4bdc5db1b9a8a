#pragma once

#include <octomap/OcTree.h>

#include <random>
#include <sstream>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "environment/OccupancyMap.h"

namespace viable::test {

inline MapChoice chooseMap(const std::filesystem::path& file) {
    MapChoice choice;
    choice.name = "map";
    choice.file = file;
    choice.place = "experiment.yaml:7:3: environment.map";
    return choice;
}

/** What reading complains about; empty when it does not. */
inline std::string findMapFault(const MapChoice& choice) {
    return findComplaint([&] { OccupancyMap map(choice); });
}

/** A tree of `count` random occupied and as many free cells within `reach` of the origin, pruned. */
inline octomap::OcTree makeRandomTree(double resolution, int count, double reach, unsigned seed) {
    octomap::OcTree tree(resolution);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(-reach, reach);
    for (int i = 0; i < 2 * count; ++i) tree.updateNode(place(random), place(random), place(random), i % 2 == 0, true);
    tree.updateInnerOccupancy();
    tree.prune();
    return tree;
}

inline std::string writeBinary(octomap::OcTree& tree) {
    std::ostringstream stream;
    tree.writeBinary(stream);
    return stream.str();
}

inline std::string writeFull(const octomap::OcTree& tree) {
    std::ostringstream stream;
    tree.write(stream);
    return stream.str();
}

inline void store(const std::filesystem::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
}

inline double calcBoxDistance(const Eigen::Vector3d& fromCentre, const Eigen::Vector3d& half) {
    return (fromCentre.cwiseAbs() - half).cwiseMax(0.0).norm();
}

/** A rotation and shift with nothing special about it. */
inline Eigen::Isometry3d makeOddPose() {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() << 0.31, -0.27, 0.113;
    pose.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(0.3, -0.5, 0.81).normalized()).toRotationMatrix();
    return pose;
}

}  // namespace viable::test
