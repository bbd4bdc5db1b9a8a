#include "viable/environment/Surroundings.h"

#include <cmath>
#include <sstream>

#include "core/Memo.h"
#include "core/Sha256.h"
#include "environment/DistanceField.h"

namespace viable {

/** The solids by kind, as a query wants them: all numbers of one beside each other, those of a kind in a row. */
struct Surroundings::Shapes {
    struct Box {
        Eigen::Matrix3d toBox;  ///< rotation from the base frame
        Eigen::Vector3d centre, half;
        double radius;  ///< of the sphere around it
        int obstacle;
    };
    struct Cylinder {
        Eigen::Vector3d centre, axis;
        double radius, half;
        double around;  ///< radius of the sphere around it
        int obstacle;
    };
    struct Sphere {
        Eigen::Vector3d centre;
        double radius;
        int obstacle;
    };
    struct HalfSpace {
        Eigen::Vector3d normal;
        double offset;
        int obstacle;
    };
    /** The straight way from one waypoint to the next; after the last one a way of no length. */
    struct Segment {
        Eigen::Vector3d from, along;
        double perSquare;  ///< 1 / |along|^2; 0: no length
        double begin_s, perSecond;
    };
    struct Path {
        std::vector<Segment> segments;
        Eigen::Vector3d centre;  ///< of the sphere around all that it sweeps
        double around;
        double radius;
        bool repeats;
        int obstacle;
    };

    std::vector<Box> boxes;
    std::vector<Sphere> spheres;
    std::vector<Cylinder> cylinders;
    std::vector<HalfSpace> halfSpaces;
    std::vector<Path> paths;

    void add(const Solid& solid, int obstacle);
    void add(const MovingSphere& sphere, int obstacle);
};

struct Surroundings::MapField {
    MapField(const MapChoice& choice, const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, double cell_m,
             double reach_m)
        : map(choice), field(map, choice.unknown, choice.pose, lower, upper, cell_m, reach_m, choice.place) {}

    OccupancyMap map;
    DistanceField field;
};

/** Maps with their fields that are remembered at a time; at worst a gigabyte each, usually a few megabytes. */
constexpr std::size_t kMostKnownFields = 2;

void Surroundings::Shapes::add(const Solid& solid, int obstacle) {
    const Eigen::Vector3d centre = solid.pose.translation();
    const Eigen::Vector3d z = solid.pose.linear().col(2);
    switch (solid.kind) {
        case Solid::Kind::Box:
            boxes.push_back(
                {solid.pose.linear().transpose(), centre, 0.5 * solid.size, 0.5 * solid.size.norm(), obstacle});
            break;
        case Solid::Kind::Sphere:
            spheres.push_back({centre, solid.radius, obstacle});
            break;
        case Solid::Kind::Cylinder:
            cylinders.push_back(
                {centre, z, solid.radius, 0.5 * solid.length, std::hypot(solid.radius, 0.5 * solid.length), obstacle});
            break;
        case Solid::Kind::HalfSpace:
            halfSpaces.push_back({z, z.dot(centre), obstacle});
            break;
    }
}

void Surroundings::Shapes::add(const MovingSphere& sphere, int obstacle) {
    const auto& waypoints = sphere.waypoints;
    Path path;
    path.radius = sphere.radius;
    path.repeats = sphere.repeats;
    path.obstacle = obstacle;
    Eigen::AlignedBox3d box;
    for (std::size_t i = 0; i < waypoints.size(); ++i) {
        const auto& from = waypoints[i];
        const auto& to = waypoints[std::min(i + 1, waypoints.size() - 1)];
        const Eigen::Vector3d along = to.position - from.position;
        const double square = along.squaredNorm(), duration = to.time_s - from.time_s;
        path.segments.push_back({from.position, along, square > 0.0 ? 1.0 / square : 0.0, from.time_s,
                                 duration > 0.0 ? 1.0 / duration : 0.0});
        box.extend(from.position);
    }
    path.centre = box.center();
    path.around = 0.0;
    for (const auto& waypoint : waypoints)
        path.around = std::max(path.around, (waypoint.position - path.centre).norm());
    path.around += sphere.radius;
    paths.push_back(std::move(path));
}

Surroundings::Surroundings(const Environment& environment, const Eigen::Vector3d& lower, const Eigen::Vector3d& upper,
                           double reach_m)
    : environment_(environment), names_(environment.obstacleNames()) {
    checkEnvironment(environment);
    int obstacle = 0;
    auto shapes = std::make_unique<Shapes>();
    for (const Solid& solid : environment.solids) shapes->add(solid, obstacle++);
    for (const MovingSphere& sphere : environment.spheres) {
        VIABLE_CHECK(!sphere.waypoints.empty(), "a moving sphere is somewhere");
        shapes->add(sphere, obstacle++);
    }
    shapes_ = std::move(shapes);
    if (environment.map) {
        mapField_ = shareMapField(*environment.map, lower, upper, environment.fieldCell_m, reach_m);
        field_ = &mapField_->field;
    }
}

Surroundings::~Surroundings() = default;

const OccupancyMap* Surroundings::map() const {
    return mapField_ ? &mapField_->map : nullptr;
}

std::shared_ptr<const Surroundings::MapField> Surroundings::shareMapField(const MapChoice& choice,
                                                                          const Eigen::Vector3d& lower,
                                                                          const Eigen::Vector3d& upper, double cell_m,
                                                                          double reach_m) {
    std::string content;
    try {
        content = detail::calcSha256(choice.file);
    } catch (const Error&) {  // the reader complains
    }
    // One content is one map wherever it lies; the reader takes its format from the ending.
    std::ostringstream key;
    key << (content.empty() ? choice.file : choice.file.extension()) << '\n'
        << choice.sha256 << '\n'
        << content << '\n'
        << std::hexfloat << static_cast<int>(choice.unknown) << '\n'
        << choice.pose.matrix() << '\n'
        << lower << '\n'
        << upper << '\n'
        << cell_m << ' ' << reach_m;
    static detail::Memo<std::shared_ptr<const MapField>> known(kMostKnownFields);
    return known.get(key.str(),
                     [&] { return std::make_shared<const MapField>(choice, lower, upper, cell_m, reach_m); });
}

/** Nothing within this sphere can be nearer than `best`. */
static bool isFarther(const Eigen::Vector3d& fromCentre, double radius, double best) {
    const double least = best + radius;
    return least <= 0.0 || fromCentre.squaredNorm() >= least * least;
}

static Eigen::Vector3d toUnit(const Eigen::Vector3d& v, double length) {
    return length > 0.0 ? Eigen::Vector3d(v / length) : Eigen::Vector3d::UnitZ();
}

template <bool kWithGradient, typename IsLeftOut>
Surroundings::Nearest Surroundings::findIn(const Eigen::Vector3d& p, double t, const IsLeftOut& isLeftOut) const {
    Nearest nearest;
    if (!p.allFinite()) {
        nearest.distance = -std::numeric_limits<double>::infinity();
        return nearest;
    }
    double& best = nearest.distance;
    for (const Shapes::HalfSpace& solid : shapes_->halfSpaces) {
        if (isLeftOut(solid.obstacle)) continue;
        const double distance = solid.normal.dot(p) - solid.offset;
        if (distance >= best) continue;
        best = distance;
        nearest.obstacle = solid.obstacle;
        if constexpr (kWithGradient) nearest.gradient = solid.normal;
    }
    for (const Shapes::Sphere& solid : shapes_->spheres) {
        if (isLeftOut(solid.obstacle)) continue;
        const Eigen::Vector3d away = p - solid.centre;
        if (isFarther(away, solid.radius, best)) continue;
        const double length = away.norm();
        best = length - solid.radius;
        nearest.obstacle = solid.obstacle;
        if constexpr (kWithGradient) nearest.gradient = toUnit(away, length);
    }
    for (const Shapes::Box& solid : shapes_->boxes) {
        if (isLeftOut(solid.obstacle)) continue;
        const Eigen::Vector3d away = p - solid.centre;
        if (isFarther(away, solid.radius, best)) continue;
        const Eigen::Vector3d local = solid.toBox * away;
        const Eigen::Vector3d beyond = local.cwiseAbs() - solid.half;
        const Eigen::Vector3d outside = beyond.cwiseMax(0.0);
        int face = 0;
        const double deepest = beyond.maxCoeff(&face);
        const double length = deepest > 0.0 ? outside.norm() : 0.0;
        const double distance = deepest > 0.0 ? length : deepest;
        if (distance >= best) continue;
        best = distance;
        nearest.obstacle = solid.obstacle;
        if constexpr (kWithGradient) {
            Eigen::Vector3d direction = Eigen::Vector3d::Unit(face);
            if (length > 0.0) direction = outside / length;
            for (int k = 0; k < 3; ++k) direction[k] = std::copysign(direction[k], local[k]);
            nearest.gradient = solid.toBox.transpose() * direction;
        }
    }
    for (const Shapes::Cylinder& solid : shapes_->cylinders) {
        if (isLeftOut(solid.obstacle)) continue;
        const Eigen::Vector3d away = p - solid.centre;
        if (isFarther(away, solid.around, best)) continue;
        const double along = solid.axis.dot(away);
        const Eigen::Vector3d across = away - along * solid.axis;
        const double offAxis = across.norm();
        const double beyondSide = offAxis - solid.radius;
        const double beyondEnd = std::abs(along) - solid.half;
        const double distance = beyondSide > 0.0 && beyondEnd > 0.0
                                    ? std::sqrt(beyondSide * beyondSide + beyondEnd * beyondEnd)
                                    : std::max(beyondSide, beyondEnd);
        if (distance >= best) continue;
        best = distance;
        nearest.obstacle = solid.obstacle;
        if constexpr (kWithGradient) {
            const Eigen::Vector3d end = std::copysign(1.0, along) * solid.axis;
            const Eigen::Vector3d side =
                offAxis > 0.0 ? Eigen::Vector3d(across / offAxis) : solid.axis.unitOrthogonal();
            if (beyondSide > 0.0 && beyondEnd > 0.0 && distance > 0.0)
                nearest.gradient = (beyondSide * side + beyondEnd * end) / distance;
            else
                nearest.gradient = beyondSide > beyondEnd ? side : end;
        }
    }
    for (const Shapes::Path& path : shapes_->paths) {
        if (isLeftOut(path.obstacle)) continue;
        if (isFarther(p - path.centre, path.around, best)) continue;
        // The way that it is on at t, and from there only what is left of it.
        std::size_t first = 0;
        double gone = 0.0;
        if (!path.repeats && t > path.segments.front().begin_s) {
            while (first + 1 < path.segments.size() && path.segments[first + 1].begin_s <= t) ++first;
            gone = std::min((t - path.segments[first].begin_s) * path.segments[first].perSecond, 1.0);
        }
        double least = std::numeric_limits<double>::infinity();
        Eigen::Vector3d nearestAway = Eigen::Vector3d::Zero();
        for (std::size_t i = first; i < path.segments.size(); ++i, gone = 0.0) {
            const Shapes::Segment& segment = path.segments[i];
            const Eigen::Vector3d away = p - segment.from;
            const double s = std::clamp(away.dot(segment.along) * segment.perSquare, gone, 1.0);
            const Eigen::Vector3d off = away - s * segment.along;
            const double square = off.squaredNorm();
            if (square >= least) continue;
            least = square;
            if constexpr (kWithGradient) nearestAway = off;
        }
        const double length = std::sqrt(least);
        if (length - path.radius >= best) continue;
        best = length - path.radius;
        nearest.obstacle = path.obstacle;
        if constexpr (kWithGradient) nearest.gradient = toUnit(nearestAway, length);
    }
    if (field_ && !isLeftOut(size() - 1)) {
        Eigen::Vector3d gradient;
        const double distance = kWithGradient ? field_->calcDistance(p, gradient) : field_->calcDistance(p);
        if (distance < best) {
            best = distance;
            nearest.obstacle = size() - 1;
            if constexpr (kWithGradient) nearest.gradient = gradient;
        }
    }
    return nearest;
}

constexpr auto kNone = [](int /*obstacle*/) { return false; };

double Surroundings::calcDistance(const Eigen::Vector3d& p, double t) const {
    return findIn<false>(p, t, kNone).distance;
}

Surroundings::Nearest Surroundings::findNearest(const Eigen::Vector3d& p, double t) const {
    return findIn<true>(p, t, kNone);
}

Surroundings::Nearest Surroundings::findNearest(const Eigen::Vector3d& p, double t, const LeftOut& without) const {
    return findIn<true>(p, t, [&](int obstacle) { return without.has(obstacle); });
}

Surroundings::Nearest Surroundings::findNearest(const Eigen::Vector3d& p, double t, int obstacle) const {
    return findIn<true>(p, t, [obstacle](int other) { return other != obstacle; });
}

bool Surroundings::LeftOut::add(int obstacle) {
    if (count == static_cast<int>(obstacles.size())) return false;
    obstacles[count++] = obstacle;
    return true;
}

}  // namespace viable
