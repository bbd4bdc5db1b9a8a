#include "environment/CollisionChecker.h"

#include <cmath>

#include "environment/CellTree.h"

namespace viable {

namespace {

struct Segment {
    Eigen::Vector3d a, b;
};

/** Signed distance from a convex solid at a point of a segment, and its derivative along the segment. */
struct Sample {
    double value, slope;
};

/** The least value on [0, 1] of a convex function of s, to kAccuracy_m, or any value not below `cutoff` when the least
is not below it. Two tangents meet below the function: that bounds what is left to gain. */
template <class Function>
double findLeast(const Function& function, double cutoff) {
    double left = 0.0, right = 1.0;
    Sample atLeft = function(left), atRight = function(right);
    if (atLeft.slope >= 0.0) return atLeft.value;
    if (atRight.slope <= 0.0) return atRight.value;
    double least = std::min(atLeft.value, atRight.value);
    constexpr int kMostRounds = 200;  // two bisect once: 1e-30 of the segment
    for (int round = 0; round < kMostRounds; ++round) {
        double s =
            left + (atRight.value - atLeft.value - atRight.slope * (right - left)) / (atLeft.slope - atRight.slope);
        s = std::min(std::max(s, left), right);
        const double bound = atLeft.value + atLeft.slope * (s - left);
        if (bound >= cutoff || least - bound <= 0.5 * CollisionChecker::kAccuracy_m) break;
        if (round % 2 == 1) s = 0.5 * (left + right);  // tangents alone may creep
        const Sample now = function(s);
        least = std::min(least, now.value);
        if (now.slope == 0.0) break;
        if (now.slope < 0.0) {
            left = s;
            atLeft = now;
        } else {
            right = s;
            atRight = now;
        }
    }
    return least;
}

/** @param segment  in the frame of the box's centre and edges */
double calcBoxDistance(const Segment& segment, const Eigen::Vector3d& half, double cutoff) {
    const Eigen::Vector3d along = segment.b - segment.a;
    return findLeast(
        [&](double s) -> Sample {
            const Eigen::Vector3d p = segment.a + s * along;
            double square = 0.0, turn = 0.0;
            Sample inside{-std::numeric_limits<double>::infinity(), 0.0};
            for (int k = 0; k < 3; ++k) {
                const double side = p[k] < 0.0 ? -1.0 : 1.0;
                const double beyond = side * p[k] - half[k];
                if (beyond > inside.value) inside = {beyond, side * along[k]};
                if (beyond > 0.0) {
                    square += beyond * beyond;
                    turn += beyond * side * along[k];
                }
            }
            if (square == 0.0) return inside;
            const double distance = std::sqrt(square);
            return {distance, turn / distance};
        },
        cutoff);
}

/** @param segment  in the frame of the cylinder's centre, z along it */
double calcCylinderDistance(const Segment& segment, double radius, double half, double cutoff) {
    const Eigen::Vector3d along = segment.b - segment.a;
    return findLeast(
        [&](double s) -> Sample {
            const Eigen::Vector3d p = segment.a + s * along;
            const double offAxis = std::hypot(p.x(), p.y());
            const Sample side{offAxis - radius,
                              offAxis > 0.0 ? (p.x() * along.x() + p.y() * along.y()) / offAxis : 0.0};
            const Sample end{std::abs(p.z()) - half, p.z() < 0.0 ? -along.z() : along.z()};
            if (side.value > 0.0 && end.value > 0.0) {
                const double distance = std::hypot(side.value, end.value);
                return {distance, (side.value * side.slope + end.value * end.slope) / distance};
            }
            return side.value > end.value ? side : end;
        },
        cutoff);
}

double calcPointDistance(const Segment& segment, const Eigen::Vector3d& point) {
    const Eigen::Vector3d along = segment.b - segment.a;
    const double square = along.squaredNorm();
    double s = square > 0.0 ? along.dot(point - segment.a) / square : 0.0;
    s = std::min(std::max(s, 0.0), 1.0);
    return (segment.a + s * along - point).norm();
}

/** An end of one is nearest, or the place where the lines come nearest: projected once more, which keeps the accuracy
for lines that are nearly parallel. */
double calcSegmentDistance(const Segment& first, const Segment& second) {
    double least = std::min(std::min(calcPointDistance(first, second.a), calcPointDistance(first, second.b)),
                            std::min(calcPointDistance(second, first.a), calcPointDistance(second, first.b)));
    const Eigen::Vector3d u = first.b - first.a, v = second.b - second.a;
    const Eigen::Vector3d n = u.cross(v);
    const double s = (second.a - first.a).cross(v).dot(n) / n.squaredNorm();
    if (s > 0.0 && s < 1.0)  // parallel: no number
        least = std::min(least, calcPointDistance(second, first.a + s * u));
    return least;
}

}  // namespace

struct CollisionChecker::Scene {
    RobotDescription robot;
    ArmGeometry geometry;
    Environment environment;
    std::vector<Eigen::Isometry3d> toSolid;  ///< base frame to each solid's
    std::unique_ptr<OccupancyMap> map;
    Eigen::Isometry3d toMap = Eigen::Isometry3d::Identity();
    detail::CellTree cells;  ///< solid ones, map frame
    double covered = 0.0;    ///< cells holds all within this distance of the base's origin [m]

    double calcArmReach() const;
    void readMap();
    Eigen::Isometry3d calcMotion(int joint, double q) const;
    std::vector<Segment> placeCapsules(const JointVector& q) const;
    double calcSolidDistance(std::size_t solid, const Segment& segment, double cutoff) const;
    double calcMapDistance(const Segment& segment, double cutoff) const;
};

/** No point of a capsule gets farther from the base's origin while joints keep their limits [m]. */
double CollisionChecker::Scene::calcArmReach() const {
    std::vector<double> reach(robot.joints.size(), 0.0);
    for (std::size_t j = 0; j < reach.size(); ++j) {
        const JointDescription& joint = robot.joints[j];
        reach[j] = joint.placement.translation().norm();
        if (joint.parent >= 0) reach[j] += reach[joint.parent];
        if (joint.type != JointType::Prismatic) continue;
        const JointBounds& position = robot.limits.position;
        const auto index = static_cast<Eigen::Index>(j);
        constexpr double kLongestStroke_m = 10.0;  // farther out cells are looked up one by one
        reach[j] +=
            std::min(std::max(std::abs(position.lower[index]), std::abs(position.upper[index])), kLongestStroke_m);
    }
    double most = 0.0;
    for (const LinkCapsule& capsule : geometry.capsules)
        most = std::max(most, (capsule.carrier < 0 ? 0.0 : reach[capsule.carrier]) +
                                  std::max(capsule.a.norm(), capsule.b.norm()) + capsule.radius);
    return most;
}

void CollisionChecker::Scene::readMap() {
    const MapChoice& choice = *environment.map;
    map = std::make_unique<OccupancyMap>(choice);
    toMap = choice.pose.inverse();
    covered = calcArmReach() + kMostHorizon_m;
    const Eigen::Vector3d centre = toMap.translation();
    std::vector<OccupancyMap::Cell> found;
    map->forEachSolidCell(centre.array() - covered, centre.array() + covered, choice.unknown == UnknownSpace::Occupied,
                          [&](const OccupancyMap::Cell& cell) { found.push_back(cell); });
    cells = detail::CellTree(std::move(found));
}

Eigen::Isometry3d CollisionChecker::Scene::calcMotion(int index, double q) const {
    const JointDescription& joint = robot.joints[index];
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    if (joint.type == JointType::Prismatic)
        motion.translation() = q * joint.axis;
    else
        motion.linear() = Eigen::AngleAxisd(q, joint.axis).toRotationMatrix();
    return joint.placement * motion;
}

/** The capsules' segments in the base frame. */
std::vector<Segment> CollisionChecker::Scene::placeCapsules(const JointVector& q) const {
    std::vector<Eigen::Isometry3d> frames;
    for (int j = 0; j < robot.size(); ++j) {
        const int parent = robot.joints[j].parent;
        const Eigen::Isometry3d motion = calcMotion(j, q[j]);
        frames.push_back(parent < 0 ? motion : frames[parent] * motion);
    }
    std::vector<Segment> segments;
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) {
            segments.push_back({capsule.a, capsule.b});
            continue;
        }
        const Eigen::Isometry3d& frame = frames[capsule.carrier];
        segments.push_back({frame * capsule.a, frame * capsule.b});
    }
    return segments;
}

/** Of a segment; `cutoff` or more when it is not below that. */
double CollisionChecker::Scene::calcSolidDistance(std::size_t index, const Segment& segment, double cutoff) const {
    const Solid& solid = environment.solids[index];
    const double around =
        solid.kind == Solid::Kind::Box ? 0.5 * solid.size.norm() : std::hypot(solid.radius, 0.5 * solid.length);
    if (solid.kind != Solid::Kind::HalfSpace && calcPointDistance(segment, solid.pose.translation()) - around >= cutoff)
        return cutoff;
    const Segment local{toSolid[index] * segment.a, toSolid[index] * segment.b};
    switch (solid.kind) {
        case Solid::Kind::Sphere:
            return calcPointDistance(local, Eigen::Vector3d::Zero()) - solid.radius;
        case Solid::Kind::HalfSpace:
            return std::min(local.a.z(), local.b.z());
        case Solid::Kind::Box:
            return calcBoxDistance(local, 0.5 * solid.size, cutoff);
        case Solid::Kind::Cylinder:
            return calcCylinderDistance(local, solid.radius, 0.5 * solid.length, cutoff);
    }
    VIABLE_CHECK(false, "a solid has one of the kinds");
    return 0.0;
}

double CollisionChecker::Scene::calcMapDistance(const Segment& segment, double cutoff) const {
    const Segment local{toMap * segment.a, toMap * segment.b};
    const Eigen::AlignedBox3d box(local.a.cwiseMin(local.b), local.a.cwiseMax(local.b));
    double best = cutoff;
    const auto look = [&](const OccupancyMap::Cell& cell) {
        const Segment fromCell{local.a - cell.centre, local.b - cell.centre};
        constexpr double kHalfDiagonal = 0.8660254037844387;
        if (calcPointDistance(fromCell, Eigen::Vector3d::Zero()) - kHalfDiagonal * cell.edge >= best) return;
        best = std::min(best, calcBoxDistance(fromCell, Eigen::Vector3d::Constant(0.5 * cell.edge), best));
    };
    if (std::max(segment.a.norm(), segment.b.norm()) + std::max(cutoff, 0.0) <= covered)
        cells.visitNear(box, best, look);
    else  // a prismatic joint far out
        map->forEachSolidCell(box.min().array() - std::max(cutoff, 0.0), box.max().array() + std::max(cutoff, 0.0),
                              environment.map->unknown == UnknownSpace::Occupied, look);
    return best;
}

CollisionChecker::CollisionChecker(const RobotDescription& robot, const ArmGeometry& geometry,
                                   const Environment& environment)
    : scene_(std::make_unique<Scene>()) {
    scene_->robot = robot;
    scene_->geometry = geometry;
    scene_->environment = environment;
    for (const Solid& solid : environment.solids) scene_->toSolid.push_back(solid.pose.inverse());
    if (environment.map) scene_->readMap();
}

CollisionChecker::~CollisionChecker() = default;

CollisionChecker::Contact CollisionChecker::findContact(const JointVector& q, double t, double horizon) const {
    const Scene& scene = *scene_;
    Contact contact;
    if (!isFinite(q, scene.robot.size())) {
        contact.distance = -std::numeric_limits<double>::infinity();
        return contact;
    }
    contact.distance = std::min(horizon, kMostHorizon_m);
    const std::vector<Segment> segments = scene.placeCapsules(q);
    const std::vector<LinkCapsule>& capsules = scene.geometry.capsules;

    for (const auto& [i, j] : scene.geometry.pairs) {
        const double distance = calcSegmentDistance(segments[i], segments[j]) - capsules[i].radius - capsules[j].radius;
        if (!(distance >= contact.distance))  // what is NaN is no clearance
            contact = {distance, capsules[i].link, -1, capsules[j].link};
    }
    std::vector<Eigen::Vector3d> centres;
    for (const MovingSphere& sphere : scene.environment.spheres) centres.push_back(sphere.calcCentre(t));
    for (std::size_t i = 0; i < capsules.size(); ++i) {
        if (capsules[i].carrier < 0) continue;  // what the base carries stands where it stands
        const auto take = [&](double distance, std::size_t obstacle) {
            if (!(distance >= contact.distance)) contact = {distance, capsules[i].link, static_cast<int>(obstacle), -1};
        };
        const double radius = capsules[i].radius;
        const std::size_t solids = scene.environment.solids.size();
        // What is told to be no nearer than the cut-off is not: the difference of two sums is not zero by rounding.
        const auto keepBelow = [&](double distance, double cutoff, std::size_t obstacle) {
            if (!(distance >= cutoff)) take(distance - radius, obstacle);
        };
        for (std::size_t k = 0; k < solids; ++k) {
            const double cutoff = contact.distance + radius;
            keepBelow(scene.calcSolidDistance(k, segments[i], cutoff), cutoff, k);
        }
        for (std::size_t k = 0; k < centres.size(); ++k)
            take(calcPointDistance(segments[i], centres[k]) - scene.environment.spheres[k].radius - radius, solids + k);
        if (scene.map) {
            const double cutoff = contact.distance + radius;
            keepBelow(scene.calcMapDistance(segments[i], cutoff), cutoff, solids + centres.size());
        }
    }
    return contact;
}

}  // namespace viable
