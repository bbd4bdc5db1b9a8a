#pragma once

#include "viable/config/Settings.h"
#include "viable/environment/Environment.h"

namespace viable::detail {

// An environment as it is written.

struct PlaceSettings {
    Eigen::Vector3d xyz = Eigen::Vector3d::Zero(), rpy = Eigen::Vector3d::Zero();

    template <class V>
    void describe(V& v) {
        v(xyz, "xyz", "m", "Origin in the robot's base frame.").atLeast(-1000).upTo(1000).required();
        v(rpy, "rpy", "rad", "Roll, pitch and yaw as in a URDF: about x, then y, then z of the base frame.")
            .atLeast(-100)
            .upTo(100);
    }
    Eigen::Isometry3d pose() const;
};

struct CylinderSettings {
    double radius = 0.0, length = 0.0;

    template <class V>
    void describe(V& v) {
        v(radius, "radius", "m", "Of the cylinder.").above(0).upTo(1000).required();
        v(length, "length", "m", "Along its z axis.").above(0).upTo(1000).required();
    }
};

struct HalfSpaceSettings {
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
    double offset = 0.0;

    template <class V>
    void describe(V& v) {
        v(normal, "normal", "", "Points to the free side.").atLeast(-1000).upTo(1000).required();
        v(offset, "offset", "", "A point x is on the surface where normal . x is this.")
            .atLeast(-1000)
            .upTo(1000)
            .required();
    }
    void check(const ConfigNode& block) const;
    /** Where z = 0 is the border and +z the free side. */
    Eigen::Isometry3d pose() const;
};

struct ObstacleSettings {
    std::string name;
    std::optional<Eigen::Vector3d> box;
    std::optional<double> sphere;
    std::optional<CylinderSettings> cylinder;
    std::optional<HalfSpaceSettings> halfSpace;
    std::optional<PlaceSettings> at;
    std::vector<Waypoint> path;
    bool repeats = false;

    template <class V>
    void describe(V& v) {
        v(box, "box", "m", "Its edges along x, y and z.").above(0).upTo(1000);
        v(sphere, "sphere", "m", "Its radius.").above(0).upTo(1000);
        v(cylinder, "cylinder", "Its sizes.");
        v(halfSpace, "half_space", "All that lies behind a plane is solid: a floor, a wall.");
        v(at, "at", "The centre of a box, sphere or cylinder, and its orientation.");
        v(path, "path", "Of a sphere that moves: straight and at constant speed from one waypoint to the next.");
        v(repeats, "repeats", "After its last waypoint, which is at the place of the first, the path starts again.");
    }
    void check(const ConfigNode& block) const;
};

struct MapSettings {
    std::string file, sha256;
    std::optional<PlaceSettings> at;
    UnknownSpace unknown = UnknownSpace::Occupied;

    template <class V>
    void describe(V& v) {
        v(file, "file", "An OctoMap file, .bt or .ot, relative to this file.").required();
        v(sha256, "sha256", "Of the file; another file is refused.");
        v(at, "at", "Where the map's frame lies in the robot's base frame.");
        v(unknown, "unknown", "occupied|free", "How cells without information count.");
    }
    void check(const ConfigNode& block);
};

struct EnvironmentSettings {
    double safetyDistance_m = Environment().safetyDistance_m, fieldCell_m = Environment().fieldCell_m;
    std::vector<ObstacleSettings> obstacles;
    std::vector<Person> people;
    std::optional<MapSettings> map;

    template <class V>
    void describe(V& v) {
        v(safetyDistance_m, "safety_distance_m", "m", "Smallest clearance that must be kept.").atLeast(0).upTo(1);
        v(fieldCell_m, "field_cell_m", "m", "Edge of the cells of the distance field around a map.")
            .atLeast(0.001)
            .upTo(1);
        v(obstacles, "obstacles", "By name: one of box, sphere, cylinder and half_space, and where it is.");
        v(people, "people",
          "By name: who may come near, as far as whole_arm_braking can know it, and for tests how they walk.")
            .count(0, kMaxPeople);
        v(map, "map", "A map of occupied, free and unknown space.");
    }
};

}  // namespace viable::detail
