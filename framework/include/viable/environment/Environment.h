#pragma once

#include "viable/environment/People.h"

namespace viable {

/** A solid that does not move; poses are in the robot's base frame. */
struct Solid {
    enum class Kind : unsigned char { Box, Sphere, Cylinder, HalfSpace };
    std::string name;
    Kind kind = Kind::Box;
    /** Box, Sphere, Cylinder: frame at the centre (a cylinder lies along z). HalfSpace: the part below z = 0 of
    the frame is solid. */
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< Box: edges, > 0 [m]
    double radius = 0.0;                             ///< Sphere, Cylinder: > 0 [m]
    double length = 0.0;                             ///< Cylinder: > 0 [m]
};

/** A sphere on a known path: straight and at constant speed from one waypoint to the next. Before the time of
the first waypoint it rests there; after the last it rests, or repeats the path. */
struct MovingSphere {
    using Waypoint = viable::Waypoint;
    std::string name;
    double radius = 0.0;              ///< [m]
    std::vector<Waypoint> waypoints;  ///< at least one; with `repeats` the last position is the first
    bool repeats = false;

    /** The centre at time t [s] of the run. */
    Eigen::Vector3d calcCentre(double t) const;
};

/** How cells count that a map has no information about. */
enum class UnknownSpace : unsigned char { Occupied, Free };

/** An OctoMap file and where its frame lies in the robot's base frame. */
struct MapChoice {
    std::string name;
    std::filesystem::path file;  ///< .bt or .ot
    std::string sha256;          ///< hash of the file, hexadecimal; empty: not compared
    std::string place;           ///< the place that names the file, for messages
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    UnknownSpace unknown = UnknownSpace::Occupied;
};

/** The surroundings of an arm, as in an experiment file (`environment:`). Plain data. */
struct Environment {
    std::vector<Solid> solids;
    std::vector<MovingSphere> spheres;
    std::optional<MapChoice> map;
    /** People who may come near. They are not part of Surroundings: observations come over a PeopleFeed. */
    std::vector<Person> people;
    double safetyDistance_m = 0.02;  ///< smallest clearance that must be kept
    double fieldCell_m = 0.02;       ///< spacing of the nodes of the distance field around a map

    /** The names in the order of their indices elsewhere: solids, then spheres, then the map. */
    std::vector<std::string> obstacleNames() const;
};

/** Checks an environment that was filled in code. Throws Error (BadInput) that names every obstacle with an invalid
pose, or with a size that is not above 0 or not finite. It names also invalid waypoints, and waypoints that do not
rise in time, and an impossible safety distance or cell. */
void checkEnvironment(const Environment& environment);

/** Reads an `environment` block. Throws Error (BadInput) with the place: unknown shapes or keys, sizes that are not
positive, waypoints out of order, names given twice. The map file must exist; it is not read. */
Environment readEnvironment(const ConfigNode& block);

}  // namespace viable
