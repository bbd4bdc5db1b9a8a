#include "robot/CollisionDraft.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "robot/ArmRecursion.h"
#include "robot/MeshFile.h"
#include "robot/PoseSampling.h"
#include "robot/Segments.h"

namespace viable::detail {

namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

/** Ends are rounded to a tenth of a millimetre and radii rounded up to it, for a file that can be read. [1/m] */
constexpr double kGrains = 1e4;
/** Thinner things get this radius. [m] */
constexpr double kThinnest = 1e-3;
/** Corners that stand for a circle; they lie outside of it. */
constexpr int kCorners = 32;
/** Links that are nearer than this [m] (the usual safety distance) in more than this share of poses drawn within the
limits may touch: no pose would be left for the arm. */
constexpr double kNear = 0.02;
constexpr double kNearlyAlways = 0.95;
constexpr int kPoses = 1000;
constexpr std::uint64_t kPoseSeed = 1;

// ------------------------------------------------------------------------------------- capsules

double roundTo(double value) {
    return std::round(value * kGrains) / kGrains + 0.0;  // no minus zero
}

double roundUp(double value) {
    constexpr double kRounding = 1e-9;  // [m], far more than that of a double
    return std::ceil((value + kRounding) * kGrains) / kGrains;
}

/** Centre of a small circle around points of a plane: towards the farthest by 1/2, 1/3, ... (Badoiu and Clarkson,
SODA 2003), from the middle of their extent; the best on the way. */
Eigen::Vector2d findCircle(const std::vector<Eigen::Vector2d>& points) {
    constexpr int kRounds = 100;
    Eigen::Vector2d lower = points.front(), upper = points.front();
    for (const Eigen::Vector2d& p : points) {
        lower = lower.cwiseMin(p);
        upper = upper.cwiseMax(p);
    }
    Eigen::Vector2d centre = 0.5 * (lower + upper), best = centre;
    double smallest = std::numeric_limits<double>::infinity();
    for (int round = 1; round <= kRounds; ++round) {
        const Eigen::Vector2d* farthest = &points.front();
        for (const Eigen::Vector2d& p : points)
            if ((p - centre).squaredNorm() > (*farthest - centre).squaredNorm()) farthest = &p;
        const double radius2 = (*farthest - centre).squaredNorm();
        if (radius2 < smallest) {
            smallest = radius2;
            best = centre;
        }
        centre += (*farthest - centre) / (round + 1);
    }
    return best;
}

double calcVolume(const DraftCapsule& c) {
    return EIGEN_PI * c.radius * c.radius * ((c.to - c.from).norm() + 4.0 / 3.0 * c.radius);
}

/** The smallest capsule found along `direction` that contains all points. */
DraftCapsule fitAlong(const Vector3d& direction, const std::vector<Vector3d>& points) {
    constexpr int kRadii = 40;
    const Vector3d x = direction.unitOrthogonal(), y = direction.cross(x);
    std::vector<Eigen::Vector2d> flat;
    flat.reserve(points.size());
    for (const Vector3d& p : points) flat.emplace_back(p.dot(x), p.dot(y));
    const Eigen::Vector2d centre = findCircle(flat);
    double narrowest2 = kThinnest * kThinnest;
    for (const Eigen::Vector2d& p : flat) narrowest2 = std::max(narrowest2, (p - centre).squaredNorm());

    // Wider ones may be shorter, because their caps are too.
    DraftCapsule best;
    double smallest = std::numeric_limits<double>::infinity();
    for (int k = 0; k < kRadii; ++k) {
        const double radius = std::sqrt(narrowest2) * (1.0 + static_cast<double>(k) / kRadii);
        double first = std::numeric_limits<double>::infinity(), last = -first;
        for (std::size_t i = 0; i < points.size(); ++i) {
            const double cap = std::sqrt(std::max(0.0, radius * radius - (flat[i] - centre).squaredNorm()));
            const double t = points[i].dot(direction);
            first = std::min(first, t + cap);
            last = std::max(last, t - cap);
        }
        if (first > last) first = last = 0.5 * (first + last);  // a sphere holds them all
        const Vector3d foot = centre.x() * x + centre.y() * y;
        const DraftCapsule capsule{foot + first * direction, foot + last * direction, radius};
        const double volume = calcVolume(capsule);
        if (volume >= smallest) continue;
        smallest = volume;
        best = capsule;
    }
    return best;
}

/** A small capsule that contains all points: along one of their principal axes or one of `axes`, or a ball. */
DraftCapsule fitCapsule(const std::vector<Vector3d>& points, const Eigen::Matrix3d& axes) {
    Vector3d mean = Vector3d::Zero();
    for (const Vector3d& p : points) mean += p / static_cast<double>(points.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Vector3d& p : points) spread += (p - mean) * (p - mean).transpose();
    const Eigen::Matrix3d principal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors();
    DraftCapsule best;
    double smallest = std::numeric_limits<double>::infinity();
    const auto consider = [&](const DraftCapsule& capsule) {
        const double volume = calcVolume(capsule);
        if (volume >= smallest) return;
        smallest = volume;
        best = capsule;
    };
    for (int k = 0; k < 3; ++k) {
        consider(fitAlong(axes.col(k), points));
        consider(fitAlong(principal.col(k).normalized(), points));
    }
    const Vector3d middle = 0.5 * (best.from + best.to);
    double reach = kThinnest;
    for (const Vector3d& p : points) reach = std::max(reach, (p - middle).norm());
    consider({middle, middle, reach});

    best.from = best.from.unaryExpr(&roundTo);
    best.to = best.to.unaryExpr(&roundTo);
    double radius = kThinnest;
    for (const Vector3d& p : points) radius = std::max(radius, calcPointDistance(p, best.from, best.to));
    best.radius = roundUp(radius);
    return best;
}

/** The mesh, looked for beside and below the URDF, from there by a relative path, and in the package of that name. */
fs::path findMeshOfDraft(const std::string& name, const fs::path& folder) {
    std::error_code failed;
    if (fs::path found = findMesh(name, folder); !found.empty()) return found;
    if (name.find("://") == std::string::npos)
        return fs::is_regular_file(folder / name, failed) ? folder / name : fs::path();
    const std::string scheme = "package://";
    if (name.rfind(scheme, 0) != 0) return {};
    const fs::path path = name.substr(scheme.size());
    if (path.empty()) return {};
    const fs::path package = *path.begin();
    for (fs::path at = fs::weakly_canonical(folder, failed); at.has_relative_path(); at = at.parent_path())
        if (at.filename() == package && fs::is_regular_file(at.parent_path() / path, failed))
            return at.parent_path() / path;
    return {};
}

/** Points around all of a shape, in the link's frame; a sphere's is its centre. Empty for a mesh that cannot be read. */
std::vector<Vector3d> listCorners(const LinkShape& shape, const fs::path& folder) {
    std::vector<Vector3d> corners;
    switch (shape.kind) {
        case LinkShape::Kind::Sphere:
            corners.emplace_back(Vector3d::Zero());
            break;
        case LinkShape::Kind::Box:
            for (int k = 0; k < 8; ++k)
                corners.push_back(0.5 *
                                  shape.size.cwiseProduct(Vector3d(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1)));
            break;
        case LinkShape::Kind::Cylinder: {
            const double outside = shape.radius / std::cos(EIGEN_PI / kCorners);
            for (int k = 0; k < kCorners; ++k) {
                const double angle = 2.0 * EIGEN_PI * k / kCorners;
                for (const double z : {-0.5, 0.5})
                    corners.emplace_back(outside * std::cos(angle), outside * std::sin(angle), z * shape.length);
            }
            break;
        }
        case LinkShape::Kind::Mesh: {
            const fs::path file = findMeshOfDraft(shape.mesh, folder);
            if (file.empty()) break;
            const Mesh mesh = readMesh(file.string(), shape.size);
            for (std::size_t i = 0; i + 2 < mesh.positions.size(); i += 3)
                corners.emplace_back(mesh.positions[i], mesh.positions[i + 1], mesh.positions[i + 2]);
            break;
        }
        case LinkShape::Kind::Capsule:
            break;  // a URDF has none
    }
    for (Vector3d& corner : corners) corner = shape.pose * corner;
    return corners;
}

DraftLink draftLink(const UrdfRobot& robot, const std::string& name, const fs::path& folder) {
    DraftLink link;
    link.name = name;
    const auto found = robot.solids.find(name);
    if (found == robot.solids.end()) return link;
    for (const LinkShape& shape : found->second.shapes) {
        const std::vector<Vector3d> corners = listCorners(shape, folder);
        const bool isFinite =
            std::all_of(corners.begin(), corners.end(), [](const Vector3d& p) { return p.allFinite(); });
        if (corners.empty() || !isFinite) {
            link.lostMeshes.push_back(shape.mesh);
            continue;
        }
        DraftCapsule capsule = fitCapsule(corners, shape.pose.linear());
        if (shape.kind == LinkShape::Kind::Sphere)
            capsule.radius = roundUp(shape.radius + (corners[0] - capsule.from).norm());
        link.capsules.push_back(capsule);
    }
    return link;
}

// ------------------------------------------------------------------------------------- contacts

bool areJoined(const UrdfRobot& robot, const std::string& a, const std::string& b) {
    for (std::size_t i = 0; i < robot.joints.size(); ++i) {
        const std::string& parent = robot.parentLinks[i];
        const std::string& child = robot.joints[i].childLink;
        if ((parent == a && child == b) || (parent == b && child == a)) return true;
    }
    return false;
}

/** The position limits; of a joint that lacks one, half a turn or a metre to either side. */
JointBounds makeRange(const std::vector<DraftJoint>& joints) {
    const auto n = static_cast<int>(joints.size());
    JointBounds range{JointVector(n), JointVector(n)};
    for (int i = 0; i < n; ++i) {
        const DraftJoint& joint = joints[static_cast<std::size_t>(i)];
        const double reach = getFreeReach(joint.type);
        const bool isKnown = std::isfinite(joint.positionLower) && std::isfinite(joint.positionUpper);
        range.lower[i] = isKnown ? joint.positionLower : -reach;
        range.upper[i] = isKnown ? joint.positionUpper : reach;
    }
    return range;
}

/** A capsule where a pose puts it. */
struct Placed {
    Vector3d a, b;
    double radius;
};

/** Capsules of each link in the base frame. */
std::vector<std::vector<Placed>> placeCapsules(const UrdfRobot& robot, const std::vector<DraftLink>& links,
                                               const ArmRecursion::Frames& frames) {
    std::vector<std::vector<Placed>> placed(links.size());
    for (std::size_t k = 0; k < links.size(); ++k) {
        const UrdfRobot::LinkPlace& place = robot.links.at(links[k].name);
        Eigen::Isometry3d pose = place.placement;
        if (place.carrier >= 0) {
            Eigen::Isometry3d carrier = Eigen::Isometry3d::Identity();
            carrier.linear() = frames.rotation[static_cast<std::size_t>(place.carrier)];
            carrier.translation() = frames.origin[static_cast<std::size_t>(place.carrier)];
            pose = carrier * pose;
        }
        for (const DraftCapsule& c : links[k].capsules) placed[k].push_back({pose * c.from, pose * c.to, c.radius});
    }
    return placed;
}

bool areNear(const std::vector<Placed>& one, const std::vector<Placed>& other) {
    for (const Placed& c : one)
        for (const Placed& d : other)
            if (calcSegmentDistance(c.a, c.b, d.a, d.b) < c.radius + d.radius + kNear) return true;
    return false;
}

}  // namespace

void draftCollision(const UrdfRobot& robot, const fs::path& folder, RobotDraft& draft) {
    for (const UrdfRobot::Link& link : robot.bodies) draft.links.push_back(draftLink(robot, link.name, folder));

    struct Pair {
        std::size_t first, second;
        int nearPoses = 0;
    };
    std::vector<Pair> pairs;
    for (std::size_t i = 0; i < draft.links.size(); ++i) {
        for (std::size_t j = i + 1; j < draft.links.size(); ++j) {
            const DraftLink &a = draft.links[i], &b = draft.links[j];
            if (a.capsules.empty() || b.capsules.empty()) continue;
            if (robot.links.at(a.name).carrier == robot.links.at(b.name).carrier) continue;
            if (areJoined(robot, a.name, b.name))
                draft.contacts.push_back({a.name, b.name, "next to each other"});
            else
                pairs.push_back({i, j});
        }
    }
    if (pairs.empty()) return;
    RobotDescription arm;
    arm.joints = robot.joints;
    arm.actuation.rotorInertia.setZero(arm.size());
    const ArmRecursion recursion(arm);
    ArmRecursion::Frames frames;
    const JointBounds range = makeRange(draft.joints);
    std::mt19937_64 random(kPoseSeed);
    for (int pose = 0; pose < kPoses; ++pose) {
        recursion.calcFrames(drawPose(range, random), frames);
        const std::vector<std::vector<Placed>> placed = placeCapsules(robot, draft.links, frames);
        for (Pair& pair : pairs)
            if (areNear(placed[pair.first], placed[pair.second])) ++pair.nearPoses;
    }
    for (const Pair& pair : pairs) {
        const double share = static_cast<double>(pair.nearPoses) / kPoses;
        if (share <= kNearlyAlways) continue;
        char reason[100];
        std::snprintf(reason, sizeof reason, "nearer than %g cm in %.1f %% of %d random poses", 100.0 * kNear,
                      100.0 * share, kPoses);
        draft.contacts.push_back({draft.links[pair.first].name, draft.links[pair.second].name, reason});
    }
}

}  // namespace viable::detail
