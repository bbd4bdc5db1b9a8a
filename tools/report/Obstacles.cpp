#include "report/Obstacles.h"

#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "environment/OccupancyMap.h"
#include "experiment/ResolvedNodes.h"
#include "report/PoseJson.h"
#include "robot/ArmReach.h"

namespace viable::detail {

namespace {

using nlohmann::json;

/** Which cubes of a grid are occupied, within a ball. The cubes are the smallest cells of an octree or such cubes of
8, 64, ... of them that are nodes of it. */
class OccupiedCubes {
public:
    /** @param edge_m  of the cubes: the map's resolution times a power of two */
    OccupiedCubes(const Eigen::Vector3d& centre, double radius_m, double edge_m)
        : centre_(centre),
          radius_(radius_m),
          edge_(edge_m),
          first_(((centre.array() - radius_m) / edge_m).floor()),
          count_(static_cast<int>(std::ceil(2.0 * radius_m / edge_m)) + 1),
          occupied_(static_cast<std::size_t>(count_) * count_ * count_, false) {}

    /** Every cube that the cell covers or touches from within. */
    void add(const OccupancyMap::Cell& cell) {
        constexpr double kRounding = 1e-6;  // of a cube: cells and cubes share their faces
        std::array<int, 3> from, to;
        for (std::size_t k = 0; k < 3; ++k) {
            const double middle = cell.centre[static_cast<int>(k)], half = 0.5 * cell.edge;
            const auto clip = [&](double index) {
                return static_cast<int>(std::clamp(index - first_[static_cast<int>(k)], 0.0, double(count_)));
            };
            from[k] = clip(std::floor((middle - half) / edge_ + kRounding));
            to[k] = clip(std::ceil((middle + half) / edge_ - kRounding));
        }
        for (int x = from[0]; x < to[0]; ++x)
            for (int y = from[1]; y < to[1]; ++y)
                for (int z = from[2]; z < to[2]; ++z)
                    if ((calcCentre(x, y, z) - centre_).norm() <= radius_) occupied_[index(x, y, z)] = true;
    }

    /** The centres of those with a neighbour that is not occupied [m]. */
    std::vector<Eigen::Vector3d> findSurface() const {
        std::vector<Eigen::Vector3d> surface;
        for (int x = 0; x < count_; ++x)
            for (int y = 0; y < count_; ++y)
                for (int z = 0; z < count_; ++z)
                    if (isOccupied(x, y, z) && !isBuried(x, y, z)) surface.push_back(calcCentre(x, y, z));
        return surface;
    }

private:
    std::size_t index(int x, int y, int z) const { return (static_cast<std::size_t>(x) * count_ + y) * count_ + z; }
    bool isOccupied(int x, int y, int z) const {
        const auto isWithin = [this](int i) { return i >= 0 && i < count_; };
        return isWithin(x) && isWithin(y) && isWithin(z) && occupied_[index(x, y, z)];
    }
    bool isBuried(int x, int y, int z) const {
        return isOccupied(x - 1, y, z) && isOccupied(x + 1, y, z) && isOccupied(x, y - 1, z) &&
               isOccupied(x, y + 1, z) && isOccupied(x, y, z - 1) && isOccupied(x, y, z + 1);
    }
    Eigen::Vector3d calcCentre(int x, int y, int z) const {
        return edge_ * (first_ + Eigen::Array3d(x, y, z) + 0.5).matrix();
    }

    Eigen::Vector3d centre_;
    double radius_, edge_;
    Eigen::Array3d first_;  // index of the first cube along each axis, counted from the map's origin
    int count_;             // along each axis
    std::vector<bool> occupied_;
};

/** A ball that holds what an arm can reach, base frame. */
struct Ball {
    Eigen::Vector3d centre;
    double radius_m;
};

std::optional<Ball> findReach(const std::filesystem::path& robotFolder) try {
    const RobotDescription robot = loadRobot(robotFolder);
    const Eigen::AlignedBox3d reach = calcReach(robot, loadArmGeometry(robot), robot.limits);
    if (!reach.sizes().allFinite()) return std::nullopt;  // it slides without end
    return Ball{reach.center(), 0.5 * reach.sizes().maxCoeff()};
} catch (const Error&) {
    return std::nullopt;
}

/** The occupied cells, in cubes as large as it takes to draw them; `note` gets what the picture does not show. */
json describeCells(const OccupancyMap& map, const MapChoice& choice, const Ball& reach, BinaryBlock& binary,
                   std::string& note) {
    const Eigen::Isometry3d& pose = choice.pose;
    constexpr double kMostAlongAnAxis = 256.0;  // 2 MB of bits
    const Eigen::Vector3d centre = pose.inverse() * reach.centre;
    const Eigen::Vector3d half = Eigen::Vector3d::Constant(reach.radius_m);
    double edge = map.resolution();
    while (2.0 * reach.radius_m > kMostAlongAnAxis * edge) edge *= 2.0;
    std::vector<Eigen::Vector3d> surface;
    for (;; edge *= 2.0) {
        OccupiedCubes cubes(centre, reach.radius_m, edge);
        map.forEachSolidCell(centre - half, centre + half, false,
                             [&](const OccupancyMap::Cell& cell) { cubes.add(cell); });
        surface = cubes.findSurface();
        if (surface.size() <= kMaxDrawnCells) break;
    }
    std::vector<float> centres;
    centres.reserve(3 * surface.size());
    for (const Eigen::Vector3d& cube : surface)
        for (int k = 0; k < 3; ++k) centres.push_back(static_cast<float>(cube[k]));
    if (choice.unknown == UnknownSpace::Occupied)
        note = "Space that the map does not know counts as solid and is not drawn.";
    if (edge > map.resolution())
        note += (note.empty() ? "" : " ") + ("The map's cells of " + formatNumber(map.resolution()) +
                                             " m are drawn as cubes of " + formatNumber(edge) + " m.");
    return {{"edge_m", edge}, {"centres", binary.add(centres)}};
}

json describeSolid(const Solid& solid) {
    using Kind = Solid::Kind;
    json one = {{"name", solid.name},
                {"type", enumName<Kind::HalfSpace>(solid.kind, {"box", "sphere", "cylinder", "half_space"})},
                {"pose", toJson(solid.pose)}};
    if (solid.kind == Kind::Box) one["size"] = toJson(solid.size);
    if (solid.kind == Kind::Sphere || solid.kind == Kind::Cylinder) one["radius"] = solid.radius;
    if (solid.kind == Kind::Cylinder) one["length"] = solid.length;
    return one;
}

json describeSphere(const MovingSphere& sphere) {
    json waypoints = json::array();
    for (const MovingSphere::Waypoint& at : sphere.waypoints)
        waypoints.push_back({at.time_s, at.position.x(), at.position.y(), at.position.z()});
    return {{"name", sphere.name},
            {"type", "moving_sphere"},
            {"radius", sphere.radius},
            {"waypoints", waypoints},
            {"repeats", sphere.repeats}};
}

json describePerson(const Person& person) {
    json capsules = json::array(), waypoints = json::array(), unseen = json::array();
    for (const PersonCapsule& capsule : person.capsules)
        capsules.push_back({{"from", toJson(capsule.a)}, {"to", toJson(capsule.b)}, {"radius", capsule.radius}});
    for (const Person::Waypoint& at : person.walk)
        waypoints.push_back({at.time_s, at.position.x(), at.position.y(), at.position.z()});
    for (const Person::Absence& absence : person.unseen) unseen.push_back({absence.from_s, absence.to_s});
    return {{"name", person.name},          {"type", "person"},
            {"capsules", capsules},         {"waypoints", waypoints},
            {"repeats", person.repeats},    {"unseen", unseen},
            {"speed_mps", person.maxSpeed}, {"latency_s", person.latency_s},
            {"error_m", person.error_m}};
}

}  // namespace

json describeEnvironment(const ConfigNode& block, const std::string& mapSha256,
                         const std::filesystem::path& robotFolder, BinaryBlock& binary) try {
    std::string note;
    Environment environment;
    json cells;
    try {
        environment = readEnvironment(block);
        if (environment.map) {
            if (environment.map->sha256.empty()) environment.map->sha256 = mapSha256;
            const OccupancyMap map(*environment.map);
            if (const std::optional<Ball> reach = findReach(robotFolder))
                cells = describeCells(map, *environment.map, *reach, binary, note);
        }
    } catch (const Error& error) {  // a report of an old log must not need the map
        environment = readEnvironment(dropEntry(block, "map"));
        note = std::string("The map is not drawn: ") + error.what();
    }
    json obstacles = json::array();
    for (const Solid& solid : environment.solids) obstacles.push_back(describeSolid(solid));
    for (const MovingSphere& sphere : environment.spheres) obstacles.push_back(describeSphere(sphere));
    if (environment.map) {
        json one = {{"name", environment.map->name}, {"type", "map"}, {"pose", toJson(environment.map->pose)}};
        if (!cells.is_null()) one.update(cells);
        obstacles.push_back(one);
    }
    for (const Person& person : environment.people) obstacles.push_back(describePerson(person));
    return {{"safety_distance_m", environment.safetyDistance_m}, {"obstacles", obstacles}, {"note", note}};
} catch (const Error&) {
    return nullptr;
}

}  // namespace viable::detail
