#include "draft/CollisionDraft.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "core/Text.h"
#include "draft/BodyAssumptions.h"
#include "meshes/MeshFile.h"
#include "robot/PoseSampling.h"
#include "robot/RigidBody.h"
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
/** Links that are near in more than this share of poses drawn within the limits may touch: no pose would be left for
the arm. */
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

/** The smallest of some capsules. */
struct Smallest {
    DraftCapsule capsule;
    double volume = kInfinity;

    void offer(const DraftCapsule& other) {
        const double otherVolume = calcVolume(other);
        if (otherVolume >= volume) return;
        volume = otherVolume;
        capsule = other;
    }
};

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
    Smallest smallest;
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
        smallest.offer({foot + first * direction, foot + last * direction, radius});
    }
    return smallest.capsule;
}

/** A small capsule that contains all points: along one of their principal axes or one of `axes`, or a ball. */
DraftCapsule fitCapsule(const std::vector<Vector3d>& points, const Eigen::Matrix3d& axes) {
    Vector3d mean = Vector3d::Zero();
    for (const Vector3d& p : points) mean += p / static_cast<double>(points.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Vector3d& p : points) spread += (p - mean) * (p - mean).transpose();
    const Eigen::Matrix3d principal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors();
    Smallest smallest;
    for (int k = 0; k < 3; ++k) {
        smallest.offer(fitAlong(axes.col(k), points));
        smallest.offer(fitAlong(principal.col(k).normalized(), points));
    }
    const Vector3d middle = 0.5 * (smallest.capsule.from + smallest.capsule.to);
    double reach = kThinnest;
    for (const Vector3d& p : points) reach = std::max(reach, (p - middle).norm());
    smallest.offer({middle, middle, reach});
    DraftCapsule& best = smallest.capsule;
    best.from = best.from.unaryExpr(&roundTo);
    best.to = best.to.unaryExpr(&roundTo);
    double radius = kThinnest;
    for (const Vector3d& p : points) radius = std::max(radius, calcPointDistance(p, best.from, best.to));
    best.radius = roundUp(radius);
    return best;
}

/** Points around all of a shape, in the link's frame; a sphere's is its centre. Empty for a mesh that cannot be read.
@param mesh  gets that of a mesh */
std::vector<Vector3d> listCorners(const LinkShape& shape, const fs::path& folder, Mesh& mesh) {
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
            const fs::path file = findMesh(shape.mesh, folder, MeshReach::Anywhere);
            if (file.empty()) break;
            mesh = readMesh(file.string(), shape.size);
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
        Mesh mesh;
        const std::vector<Vector3d> corners = listCorners(shape, folder, mesh);
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
        link.solid = mergeBodies(link.solid, calcSolid(shape, mesh, capsule));
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

}  // namespace

LinkDistances::LinkDistances(const UrdfRobot& robot, const std::vector<DraftLink>& links)
    : robot_(robot), links_(links), recursion_(makeDraftArm(robot)) {
    for (std::size_t i = 0; i < links.size(); ++i)
        for (std::size_t j = i + 1; j < links.size(); ++j) {
            const DraftLink &a = links[i], &b = links[j];
            if (a.capsules.empty() || b.capsules.empty() || areJoined(robot, a.name, b.name)) continue;
            if (robot.links.at(a.name).carrier != robot.links.at(b.name).carrier) pairs_.emplace_back(i, j);
        }
}

std::vector<std::vector<LinkDistances::Placed>> LinkDistances::place(const JointVector& q) const {
    ArmRecursion::Frames frames;
    recursion_.calcFrames(q, frames);
    std::vector<std::vector<Placed>> placed(links_.size());
    for (std::size_t k = 0; k < links_.size(); ++k) {
        const UrdfRobot::LinkPlace& place = robot_.links.at(links_[k].name);
        Eigen::Isometry3d pose = place.placement;
        if (place.carrier >= 0) {
            Eigen::Isometry3d carrier = Eigen::Isometry3d::Identity();
            carrier.linear() = frames.rotation[place.carrier];
            carrier.translation() = frames.origin[place.carrier];
            pose = carrier * pose;
        }
        for (const DraftCapsule& c : links_[k].capsules) placed[k].push_back({pose * c.from, pose * c.to, c.radius});
    }
    return placed;
}

double LinkDistances::calcDistance(const std::vector<Placed>& one, const std::vector<Placed>& other) {
    double nearest = kInfinity;
    for (const Placed& c : one)
        for (const Placed& d : other)
            nearest = std::min(nearest, calcSegmentDistance(c.a, c.b, d.a, d.b) - c.radius - d.radius);
    return nearest;
}

std::vector<double> LinkDistances::calc(const JointVector& q) const {
    const std::vector<std::vector<Placed>> placed = place(q);
    std::vector<double> distances;
    for (const auto& [first, second] : pairs_) distances.push_back(calcDistance(placed[first], placed[second]));
    return distances;
}

std::vector<int> LinkDistances::countNear(const JointBounds& range, int poses, double distance) const {
    std::vector<int> near(pairs_.size());
    std::mt19937_64 random(kPoseSeed);
    for (int pose = 0; pose < poses; ++pose) {
        const std::vector<double> distances = calc(drawPose(range, random));
        for (std::size_t k = 0; k < near.size(); ++k) near[k] += distances[k] < distance ? 1 : 0;
    }
    return near;
}

double LinkDistances::calcFrom(const Vector3d& point, const JointVector& q) const {
    const std::vector<std::vector<Placed>> placed = place(q);
    double nearest = kInfinity;
    for (std::size_t k = 0; k < links_.size(); ++k)
        if (robot_.links.at(links_[k].name).carrier >= 0)
            nearest = std::min(nearest, calcDistance(placed[k], {{point, point, 0.0}}));
    return nearest;
}

RobotDescription makeDraftArm(const UrdfRobot& robot) {
    RobotDescription arm;
    arm.joints = robot.joints;
    arm.actuation.rotorInertia.setZero(arm.size());
    return arm;
}

JointBounds makeDraftRange(const std::vector<DraftJoint>& joints) {
    const auto n = static_cast<int>(joints.size());
    JointBounds range{JointVector(n), JointVector(n)};
    for (int i = 0; i < n; ++i) {
        const DraftJoint& joint = joints[i];
        const double reach = getFreeReach(joint.type);
        const bool isKnown = std::isfinite(joint.positionLower) && std::isfinite(joint.positionUpper);
        range.lower[i] = isKnown ? joint.positionLower : -reach;
        range.upper[i] = isKnown ? joint.positionUpper : reach;
    }
    return range;
}

std::vector<DraftLink> draftLinks(const UrdfRobot& robot, const fs::path& folder) {
    std::vector<DraftLink> links;
    for (const UrdfRobot::Link& link : robot.bodies) links.push_back(draftLink(robot, link.name, folder));
    return links;
}

bool hasContact(const RobotDraft& draft, const std::string& first, const std::string& second) {
    return std::any_of(draft.contacts.begin(), draft.contacts.end(),
                       [&](const DraftContact& contact) { return contact.first == first && contact.second == second; });
}

std::vector<DraftContact> draftContacts(const UrdfRobot& robot, const RobotDraft& draft,
                                        const LinkDistances& distances) {
    std::vector<DraftContact> contacts;
    for (std::size_t i = 0; i < draft.links.size(); ++i)
        for (std::size_t j = i + 1; j < draft.links.size(); ++j)
            if (!draft.links[i].capsules.empty() && !draft.links[j].capsules.empty() &&
                areJoined(robot, draft.links[i].name, draft.links[j].name))
                contacts.push_back({draft.links[i].name, draft.links[j].name, "next to each other"});
    if (distances.pairs().empty()) return contacts;
    const std::vector<int> nearPoses = distances.countNear(makeDraftRange(draft.joints), kPoses, kNear);
    for (std::size_t k = 0; k < nearPoses.size(); ++k) {
        const double share = static_cast<double>(nearPoses[k]) / kPoses;
        const auto& [first, second] = distances.pairs()[k];
        if (share > kNearlyAlways)
            contacts.push_back(
                {draft.links[first].name, draft.links[second].name,
                 format("nearer than %g cm in %.1f %% of %d random poses", 100.0 * kNear, 100.0 * share, kPoses)});
    }
    return contacts;
}

std::vector<DraftContact> draftHomeContacts(const RobotDraft& draft, const LinkDistances& distances) {
    JointVector home(draft.joints.size());
    for (int i = 0; i < home.size(); ++i) home[i] = draft.joints[i].home;
    const std::vector<double> distance = distances.calc(home);
    std::vector<DraftContact> contacts;
    for (std::size_t k = 0; k < distance.size(); ++k) {
        const std::string& first = draft.links[distances.pairs()[k].first].name;
        const std::string& second = draft.links[distances.pairs()[k].second].name;
        if (!(distance[k] < kNear) || hasContact(draft, first, second)) continue;
        const std::string size = format("%.0f mm", 1e3 * std::abs(distance[k]));
        contacts.push_back(
            {first, second,
             distance[k] < 0.0 ? "overlap by " + size + " at the home pose" : "are " + size + " apart at the home pose",
             true});
    }
    return contacts;
}

}  // namespace viable::detail
