#include "viable/environment/Environment.h"

#include <cmath>

#include "config/ConfigText.h"
#include "config/MapReader.h"
#include "core/Text.h"
#include "environment/WaypointPath.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** Rotations that were multiplied often are not quite orthogonal. */
constexpr double kUnitTolerance = 1e-6;
/** Farthest place and largest size of anything around an arm [m]. */
constexpr double kFarthest_m = 1000.0;

constexpr NumberRange kPlace{-kFarthest_m, kFarthest_m};
constexpr NumberRange kSize{0.0, kFarthest_m, true};

Eigen::Vector3d toVector(const ConfigNode& node, const NumberRange& range) {
    const std::vector<double> x = toNumbers(node, 3, 3, range);
    return {x[0], x[1], x[2]};
}

/** {xyz, rpy}: rotations about the fixed axes x, y, z in that order, as in a URDF. */
Eigen::Isometry3d readPose(const ConfigNode& node) {
    ConfigMap map(node);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = toVector(map.require("xyz"), kPlace);
    if (const ConfigNode* rpy = map.find("rpy")) {
        const Eigen::Vector3d angles = toVector(*rpy, {-100.0, 100.0});
        pose.linear() = (Eigen::AngleAxisd(angles.z(), Eigen::Vector3d::UnitZ()) *
                         Eigen::AngleAxisd(angles.y(), Eigen::Vector3d::UnitY()) *
                         Eigen::AngleAxisd(angles.x(), Eigen::Vector3d::UnitX()))
                            .toRotationMatrix();
    }
    map.finish();
    return pose;
}

/** Where z = 0 is the border and +z the free side. */
Eigen::Isometry3d readHalfSpace(const ConfigNode& node) {
    ConfigMap map(node);
    const ConfigNode& normalNode = map.require("normal");
    const Eigen::Vector3d normal = toVector(normalNode, {-1e3, 1e3});
    const double length = normal.norm();
    if (!(std::abs(length - 1.0) < 1e-3))
        throw badInput(
            normalNode.place(),
            "the normal of a half-space has length " + detail::formatNumber(length) + ", allowed is 1",
            "Name the unit vector that points to the free side, such as [0, 0, 1]: then `offset` is in metres.");
    const double offset = toNumber(map.require("offset"), kPlace);
    map.finish();
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal).toRotationMatrix();
    pose.translation() = (offset / length) * (normal / length);
    return pose;
}

MovingSphere readMovingSphere(const std::string& name, double radius, const ConfigNode& path,
                              const ConfigNode* repeats) {
    MovingSphere sphere;
    sphere.name = name;
    sphere.radius = radius;
    sphere.repeats = repeats && toFlag(*repeats);
    sphere.waypoints = detail::readWaypoints(path, sphere.repeats, "sphere", "path");
    if (sphere.repeats && sphere.waypoints.size() < 2)
        throw badInput(repeats->place(), "a path of one place cannot repeat",
                       "Leave `repeats` out or name more places.");
    return sphere;
}

void readObstacle(const std::string& name, const ConfigNode& node, Environment& environment) {
    ConfigMap map(node);
    const ConfigNode* box = map.find("box");
    const ConfigNode* ball = map.find("sphere");
    const ConfigNode* cylinder = map.find("cylinder");
    const ConfigNode* halfSpace = map.find("half_space");
    const int shapes = (box != nullptr) + (ball != nullptr) + (cylinder != nullptr) + (halfSpace != nullptr);
    if (shapes > 1)
        throw badInput(
            node.place(), "an obstacle with " + std::to_string(shapes) + " shapes",
            "Make it as many obstacles. A case adds to the block at the top: give what differs there another "
            "name, or leave it out at the top.");
    Solid solid;
    solid.name = name;
    if (box) {
        solid.kind = Solid::Kind::Box;
        solid.size = toVector(*box, kSize);
    } else if (ball) {
        solid.kind = Solid::Kind::Sphere;
        solid.radius = toNumber(*ball, kSize);
        if (const ConfigNode* path = map.find("path")) {
            if (map.find("at"))
                throw badInput(node.place(), "a sphere with a place (`at`) and a path",
                               "Give one of them: a path's places are where it is.");
            const ConfigNode* repeats = map.find("repeats");
            environment.spheres.push_back(readMovingSphere(name, solid.radius, *path, repeats));
            map.finish();
            return;
        }
    } else if (cylinder) {
        solid.kind = Solid::Kind::Cylinder;
        ConfigMap sizes(*cylinder);
        solid.radius = toNumber(sizes.require("radius"), kSize);
        solid.length = toNumber(sizes.require("length"), kSize);
        sizes.finish();
    } else if (halfSpace) {
        solid.kind = Solid::Kind::HalfSpace;
        solid.pose = readHalfSpace(*halfSpace);
    }
    if (shapes == 1 && !ball && map.find("path"))
        throw badInput(node.place(), "an obstacle with a path that is not a sphere", "Only spheres move.");
    if (!halfSpace) {
        const ConfigNode* at = map.find("at");
        map.finish();  // an unknown shape is named, not missed
        if (shapes == 0)
            throw badInput(node.place(), "an obstacle without a shape",
                           "Name one of box, sphere, cylinder and half_space.");
        solid.pose = readPose(at ? *at : map.require("at"));
    }
    map.finish();
    environment.solids.push_back(solid);
}

fs::path findMapFile(const ConfigNode& node) {
    const std::string text = toText(node);
    const fs::path folder = node.file == detail::kOverrideFile ? fs::path() : fs::path(node.file).parent_path();
    const fs::path file = folder / text;
    if (file.extension() != ".bt" && file.extension() != ".ot")
        throw badInput(node.place(), detail::quoteText(text) + " is not a map that can be read",
                       "Name an OctoMap file, .bt or .ot.");
    std::error_code failed;
    if (fs::exists(file, failed) && !fs::is_regular_file(file, failed))
        throw badInput(node.place(), file.string() + " is a folder or a device", "Name a file.");
    if (!fs::is_regular_file(file, failed))
        throw badInput(
            node.place(), "there is no file " + file.string(),
            "Relative paths start in the folder of the file that names them; those of --set in the current one.");
    return file;
}

MapChoice readMap(const ConfigNode& node) {
    ConfigMap map(node);
    MapChoice choice;
    choice.name = "map";
    choice.place = node.place();
    choice.file = findMapFile(map.require("file"));
    if (const ConfigNode* at = map.find("at")) choice.pose = readPose(*at);
    if (const ConfigNode* unknown = map.find("unknown"))
        choice.unknown =
            toChoice(*unknown, {"occupied", "free"}) == "free" ? UnknownSpace::Free : UnknownSpace::Occupied;
    if (const ConfigNode* sha256 = map.find("sha256")) {
        choice.sha256 = toText(*sha256);
        for (char& digit : choice.sha256)
            if (digit >= 'A' && digit <= 'F') digit = static_cast<char>(digit - 'A' + 'a');
        if (choice.sha256.size() != 64 || choice.sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
            throw badInput(sha256->place(), "no SHA-256",
                           "It has 64 digits, 0-9 and a-f, in quotes; `sha256sum FILE` prints it.");
    }
    map.finish();
    return choice;
}

}  // namespace

Eigen::Vector3d MovingSphere::calcCentre(double t) const {
    return calcPlaceOnPath(waypoints, repeats, t);
}

std::vector<std::string> Environment::obstacleNames() const {
    std::vector<std::string> names;
    for (const Solid& solid : solids) names.push_back(solid.name);
    for (const MovingSphere& sphere : spheres) names.push_back(sphere.name);
    if (map) names.push_back(map->name);
    return names;
}

void checkEnvironment(const Environment& environment) {
    std::vector<std::string> wrong;
    const auto isSize = [](double x) { return std::isfinite(x) && x > 0.0; };
    const auto isPose = [](const Eigen::Isometry3d& pose) {
        const Eigen::Matrix3d rotation = pose.linear();
        return pose.matrix().allFinite() && rotation.isUnitary(kUnitTolerance) && rotation.determinant() > 0.0;
    };
    const auto complain = [&](const std::string& name, const char* what) {
        wrong.push_back("the obstacle `" + name + "` " + what);
    };
    for (const Solid& solid : environment.solids) {
        const bool isBox = solid.kind == Solid::Kind::Box, isCylinder = solid.kind == Solid::Kind::Cylinder;
        if (isBox && !(isSize(solid.size.x()) && isSize(solid.size.y()) && isSize(solid.size.z())))
            complain(solid.name, "has an edge that is not above 0 m");
        if ((isCylinder || solid.kind == Solid::Kind::Sphere) && !isSize(solid.radius))
            complain(solid.name, "has a radius that is not above 0 m");
        if (isCylinder && !isSize(solid.length)) complain(solid.name, "has a length that is not above 0 m");
        if (!isPose(solid.pose)) complain(solid.name, "has a pose that is no place and rotation");
    }
    for (const MovingSphere& sphere : environment.spheres) {
        if (!isSize(sphere.radius)) complain(sphere.name, "has a radius that is not above 0 m");
        if (sphere.waypoints.empty()) complain(sphere.name, "moves without a waypoint");
        if (!detail::isUsable(sphere.waypoints))
            complain(sphere.name, "has a waypoint that is not finite, or not later than the one before");
    }
    if (environment.map && !isPose(environment.map->pose))
        complain(environment.map->name, "has a pose that is no place and rotation");
    if (!(environment.safetyDistance_m >= 0.0) || !std::isfinite(environment.safetyDistance_m))
        wrong.push_back("safetyDistance_m is " + detail::formatNumber(environment.safetyDistance_m) +
                        ", allowed is 0 and above");
    if (!isSize(environment.fieldCell_m))
        wrong.push_back("fieldCell_m is " + detail::formatNumber(environment.fieldCell_m) + ", allowed is above 0");
    if (!wrong.empty())
        throw badInput("Environment", detail::join(wrong, "; "), "Give every obstacle its sizes and its place.");
    checkPeople(environment.people, "Environment");
}

Environment readEnvironment(const ConfigNode& block) {
    Environment environment;
    detail::Complaints complaints;
    detail::MapReader map(block, {"safety_distance_m", "field_cell_m", "obstacles", "people", "map"}, complaints);
    map.offer("safety_distance_m", [&](const ConfigNode& node) {
        environment.safetyDistance_m = toNumber(node, {0.0, 1.0});
    });
    map.offer("field_cell_m", [&](const ConfigNode& node) { environment.fieldCell_m = toNumber(node, {0.001, 1.0}); });
    map.offer("obstacles", [&](const ConfigNode& obstacles) {
        if (obstacles.kind != ConfigNode::Kind::Map)
            throw badInput(obstacles.place(), "obstacles are entries with a name each",
                           "Write `obstacles: {table: {box: ...}, ...}`.");
        for (const auto& entry : obstacles.entries)
            complaints.gather([&, &name = entry.first, &node = entry.second] {
                if (name == "map")
                    throw badInput(node.place(), "'map' is the name of the map", "Give the obstacle another name.");
                readObstacle(name, node, environment);
            });
    });
    map.offer("people", [&](const ConfigNode& node) { environment.people = readPeople(node); });
    map.offer("map", [&](const ConfigNode& node) { environment.map = readMap(node); });
    complaints.throwIfAny(block.place());
    return environment;
}

}  // namespace viable
