#include "viable/environment/Environment.h"

#include <cmath>

#include "config/ConfigText.h"
#include "core/ErrorList.h"
#include "core/Text.h"
#include "environment/EnvironmentSettings.h"
#include "environment/WaypointPath.h"

namespace viable {

namespace fs = std::filesystem;

/** Rotations that were multiplied often are not quite orthogonal. */
constexpr double kUnitTolerance = 1e-6;

static fs::path findMapFile(const ConfigNode& node) {
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

/** Nothing that moves may touch them, so they have no speed. */
static void refuseHeads(const ConfigNode& block) {
    const ConfigNode* const people = block.find("people");
    if (!people || people->kind != ConfigNode::Kind::Map) return;
    detail::ErrorList errors;
    for (const auto& [name, person] : people->entries) {
        const ConfigNode* const part = person.kind == ConfigNode::Kind::Map ? person.find("body_part") : nullptr;
        const std::string what = part ? part->text : "";
        if (what == "head" || what == "face" || what == "neck" || what == "skull")
            errors.add(part->place(), "`" + what + "` may not be touched by what moves",
                       "Leave `body_part` out: then what it can touch rests before.");
    }
    errors.throwIfAny(people->place());
}

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

namespace detail {

Eigen::Isometry3d PlaceSettings::pose() const {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = xyz;
    pose.linear() =
        (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
            .toRotationMatrix();
    return pose;
}

void HalfSpaceSettings::check(const ConfigNode& block) const {
    const double length = normal.norm();
    if (!(std::abs(length - 1.0) < 1e-3))
        throw badInput(
            block.find("normal")->place(),
            "the normal of a half-space has length " + formatNumber(length) + ", allowed is 1",
            "Name the unit vector that points to the free side, such as [0, 0, 1]: then `offset` is in metres.");
}

Eigen::Isometry3d HalfSpaceSettings::pose() const {
    const double length = normal.norm();
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal).toRotationMatrix();
    pose.translation() = (offset / length) * (normal / length);
    return pose;
}

void ObstacleSettings::check(const ConfigNode& block) const {
    const std::string place = block.place();
    const ConfigNode* const way = block.find("path");
    if (name == "map") throw badInput(place, "'map' is the name of the map", "Give the obstacle another name.");
    const int shapes = box.has_value() + sphere.has_value() + cylinder.has_value() + halfSpace.has_value();
    if (shapes > 1)
        throw badInput(place, "an obstacle with " + std::to_string(shapes) + " shapes",
                       "Make it as many obstacles. A case adds to the block at the top: give what differs there "
                       "another name, or leave it out at the top.");
    if (shapes == 0)
        throw badInput(place, "an obstacle without a shape", "Name one of box, sphere, cylinder and half_space.");
    if (way && !sphere) throw badInput(place, "an obstacle with a path that is not a sphere", "Only spheres move.");
    if (way && at)
        throw badInput(place, "a sphere with a place (`at`) and a path",
                       "Give one of them: a path's places are where it is.");
    if (halfSpace && at)
        throw badInput(place, "a half-space with a place (`at`)", "Its normal and its offset are its place.");
    if (!way && !halfSpace && !at) throw badInput(place, "the key `at` is missing", "Add `at: {xyz: [x, y, z]}` here");
    const ConfigNode* const again = block.find("repeats");
    if (again && !way)
        throw badInput(again->place(), "`repeats` without a `path`", "Leave `repeats` out, or name the path.");
    if (!way) return;
    checkWaypoints(path, *way, repeats, "sphere", "path");
    if (repeats && path.size() < 2)
        throw badInput(again->place(), "a path of one place cannot repeat", "Leave `repeats` out or name more places.");
}

void MapSettings::check(const ConfigNode& block) {
    const ConfigNode* const hash = block.find("sha256");
    if (!hash) return;
    for (char& digit : sha256)
        if (digit >= 'A' && digit <= 'F') digit = static_cast<char>(digit - 'A' + 'a');
    if (sha256.size() != 64 || sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
        throw badInput(hash->place(), "no SHA-256",
                       "It has 64 digits, 0-9 and a-f, in quotes; `sha256sum FILE` prints it.");
}

}  // namespace detail

Environment readEnvironment(const ConfigNode& block) {
    if (block.kind == ConfigNode::Kind::Map) refuseHeads(block);
    detail::EnvironmentSettings settings;
    readSettings(block, settings);
    Environment environment;
    environment.safetyDistance_m = settings.safetyDistance_m;
    environment.fieldCell_m = settings.fieldCell_m;
    environment.people = settings.people;
    for (const detail::ObstacleSettings& obstacle : settings.obstacles) {
        if (!obstacle.path.empty()) {
            environment.spheres.push_back({obstacle.name, *obstacle.sphere, obstacle.path, obstacle.repeats});
            continue;
        }
        Solid& solid = environment.solids.emplace_back();
        solid.name = obstacle.name;
        solid.kind = obstacle.box        ? Solid::Kind::Box
                     : obstacle.sphere   ? Solid::Kind::Sphere
                     : obstacle.cylinder ? Solid::Kind::Cylinder
                                         : Solid::Kind::HalfSpace;
        solid.pose = obstacle.halfSpace ? obstacle.halfSpace->pose() : obstacle.at->pose();
        if (obstacle.box) solid.size = *obstacle.box;
        if (obstacle.sphere) solid.radius = *obstacle.sphere;
        if (obstacle.cylinder) {
            solid.radius = obstacle.cylinder->radius;
            solid.length = obstacle.cylinder->length;
        }
    }
    if (settings.map) {
        const ConfigNode& node = *block.find("map");
        const detail::MapSettings& map = *settings.map;
        environment.map = MapChoice{"map",
                                    findMapFile(*node.find("file")),
                                    map.sha256,
                                    node.place(),
                                    map.at ? map.at->pose() : Eigen::Isometry3d::Identity(),
                                    map.unknown};
    }
    return environment;
}

}  // namespace viable
