#include "draft/BodyAssumptions.h"

#include <algorithm>

#include "core/Text.h"
#include "robot/RigidBody.h"

namespace viable::detail {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/** Mass of a link by the volume of what is drawn of it [kg/m^3]: motors and gears in a hollow body. Near the middle, 1240,
of 416 drawn links of public URDFs; half of them have 640 to 1890. Of 29 arms with makers' figures it meets 83 % of the masses
within a factor of 3, and 75 % of the inertias. */
constexpr double kDensity = 1280.0;
/** Radius of a link that nobody drew, as a share of the arm's length. With it the masses of public arms, once taken away,
are met in the middle. */
constexpr double kTubeShare = 0.035;
/** Length of an arm whose joints all lie in one point [m]. */
constexpr double kSmallArm = 0.1;
/** A mesh encloses what it draws where its faces, as vectors, add up to no more than this share of their area, and where it
is as thick as this in the mean [m]. A capsule that stands for another mesh is filled so far. */
constexpr double kClosed = 1e-3, kThinnestPlate = 5e-4, kFill = 0.6;
/** A drawn link is in another unit where it is longer than this [m], and than so many times the arm. */
constexpr double kLargestLink = 10.0, kLargestShare = 10.0;

BodyInertia calcCapsule(const DraftCapsule& c) {
    const double r = c.radius, length = (c.to - c.from).norm();
    const double tube = EIGEN_PI * r * r * length, caps = 4.0 / 3.0 * EIGEN_PI * r * r * r;
    const double along = 0.5 * tube * r * r + 0.4 * caps * r * r;
    const double across = tube * (r * r / 4.0 + length * length / 12.0) +
                          caps * (0.4 * r * r + length * length / 4.0 + 3.0 / 8.0 * length * r);
    const Vector3d axis = length > 0.0 ? Vector3d((c.to - c.from) / length) : Vector3d::UnitZ();
    return {tube + caps, 0.5 * (c.from + c.to),
            across * Matrix3d::Identity() + (along - across) * axis * axis.transpose()};
}

/** Moments of the volume that triangles enclose: sums over the tetrahedra to a point among them. None where they leave
holes, or are drawn from both sides. */
BodyInertia calcEnclosed(const Mesh& mesh) {
    const auto get = [&](std::size_t i) {
        const float* p = mesh.positions.data() + 3 * static_cast<std::size_t>(mesh.indices[i]);
        return Vector3d(p[0], p[1], p[2]);
    };
    Vector3d middle = Vector3d::Zero();
    for (std::size_t i = 0; i < mesh.indices.size(); ++i) middle += get(i) / static_cast<double>(mesh.indices.size());
    BodyInertia body;
    Vector3d first = Vector3d::Zero();
    Matrix3d second = Matrix3d::Zero();
    Vector3d faces = Vector3d::Zero();
    double area = 0.0;
    for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
        const Vector3d a = get(i) - middle, b = get(i + 1) - middle, c = get(i + 2) - middle, sum = a + b + c;
        const double volume = a.dot(b.cross(c)) / 6.0;
        const Vector3d face = (b - a).cross(c - a);
        faces += face;
        area += face.norm();
        body.mass += volume;
        first += volume / 4.0 * sum;
        second += volume / 20.0 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
    }
    // A plate has its faces twice; `area` counts them twice as well.
    if (faces.norm() > kClosed * area || std::abs(body.mass) < kThinnestPlate * area / 4.0) return {};
    if (body.mass < 0.0) {  // faces turned inwards
        body.mass = -body.mass;
        first = -first;
        second = -second;
    }
    const Vector3d com = first / body.mass;
    second -= body.mass * com * com.transpose();
    body.com = middle + com;
    body.inertia = second.trace() * Matrix3d::Identity() - second;
    return body;
}

BodyInertia scale(BodyInertia body, double factor) {
    body.mass *= factor;
    body.inertia *= factor;
    return body;
}

/** What the chain to the farthest tip is long [m]. */
double calcArmLength(const UrdfRobot& robot) {
    std::vector<double> length;
    double longest = 0.0;
    const auto measure = [&](int carrier, const Eigen::Isometry3d& placement) {
        const double here = carrier < 0 ? 0.0 : length[carrier] + placement.translation().norm();
        longest = std::max(longest, here);
        return here;
    };
    for (const JointDescription& joint : robot.joints) length.push_back(measure(joint.parent, joint.placement));
    for (const std::string& leaf : robot.leafLinks)
        measure(robot.links.at(leaf).carrier, robot.links.at(leaf).placement);
    return longest > 0.0 ? longest : kSmallArm;
}

/** From a joint's origin to the farthest of what hangs on it. */
DraftCapsule findTube(const UrdfRobot& robot, int joint, double armLength) {
    DraftCapsule tube;
    tube.radius = kTubeShare * armLength;
    const auto consider = [&](const Vector3d& end) {
        if (end.norm() > tube.to.norm()) tube.to = end;
    };
    for (const JointDescription& next : robot.joints)
        if (next.parent == joint) consider(next.placement.translation());
    for (const auto& [name, place] : robot.links)
        if (place.carrier == joint) consider(place.placement.translation());
    return tube;
}

}  // namespace

BodyInertia calcSolid(const LinkShape& shape, const Mesh& mesh, const DraftCapsule& capsule) {
    BodyInertia body;
    switch (shape.kind) {
        case LinkShape::Kind::Sphere:
            body = calcCapsule({Vector3d::Zero(), Vector3d::Zero(), shape.radius});
            break;
        case LinkShape::Kind::Box: {
            body.mass = shape.size.prod();
            const Vector3d squares = body.mass / 12.0 * shape.size.cwiseAbs2();
            body.inertia = (Vector3d::Constant(squares.sum()) - squares).asDiagonal();
            break;
        }
        case LinkShape::Kind::Cylinder: {
            const double r2 = shape.radius * shape.radius;
            body.mass = EIGEN_PI * r2 * shape.length;
            const double across = body.mass * (r2 / 4.0 + shape.length * shape.length / 12.0);
            body.inertia = Vector3d(across, across, 0.5 * body.mass * r2).asDiagonal();
            break;
        }
        case LinkShape::Kind::Mesh: {
            const BodyInertia around = calcCapsule(capsule), inside = calcEnclosed(mesh);
            const bool isWhole = inside.mass > 0.0 && inside.mass <= around.mass && inside.inertia.allFinite() &&
                                 findInertiaFault(inside.inertia, true).empty();
            return isWhole ? transformBody(shape.pose, inside) : scale(around, kFill);
        }
        case LinkShape::Kind::Capsule:
            break;  // a URDF has none
    }
    return transformBody(shape.pose, body);
}

void assumeBodies(UrdfDocument& document, const UrdfRobot& robot, const std::map<std::string, MissingBody>& bodies,
                  RobotDraft& draft) {
    const double armLength = calcArmLength(robot);
    std::string drawn, bare, tensors;
    for (XmlElement* element : document.list("link")) {
        const std::string name = getAttribute(element, "name");
        const auto found = bodies.find(name);
        if (found == bodies.end()) continue;
        const MissingBody missing = found->second;
        const int carrier = robot.links.at(name).carrier;
        BodyInertia solid;
        for (const DraftLink& link : draft.links) {
            const UrdfRobot::LinkPlace& place = robot.links.at(link.name);
            const bool belongs = missing == MissingBody::All ? place.carrier == carrier : link.name == name;
            const bool isOdd = std::any_of(link.capsules.begin(), link.capsules.end(), [&](const DraftCapsule& c) {
                return (c.to - c.from).norm() + 2.0 * c.radius > std::max(kLargestLink, kLargestShare * armLength);
            });
            if (!belongs || isOdd || !(link.solid.mass > 0.0)) continue;
            solid = mergeBodies(solid,
                                missing == MissingBody::All ? transformBody(place.placement, link.solid) : link.solid);
        }
        const bool isDrawn = solid.mass > 0.0;
        if (!isDrawn) solid = calcCapsule(findTube(robot, carrier, armLength));
        if (missing == MissingBody::All) {
            solid = scale(solid, kDensity);
            addItem(isDrawn ? drawn : bare, name + format(" %.3g kg", solid.mass));
        } else {
            const auto given = std::find_if(robot.bodies.begin(), robot.bodies.end(),
                                            [&](const UrdfRobot::Link& body) { return body.name == name; });
            solid = scale(solid, given->body.mass / solid.mass);
            solid.com = given->body.com;
            addItem(tensors, name);
        }
        writeBody(*element, solid);
    }
    const auto note = [&](const std::string& figure, const std::string& which, const std::string& rule) {
        if (!which.empty()) draft.assumptions.push_back({figure, which + ": " + rule});
    };
    const std::string density = format("%g kg/m^3, as of the median link of public arms", kDensity);
    note("mass", drawn, "the volume of the shapes at " + density);
    note(
        "mass", bare,
        format(
            "no shape is drawn or found; a tube to the next joint, its radius %g %% of the arm's length of %.3g m, at ",
            100.0 * kTubeShare, armLength) +
            density);
    note("inertia", tensors, "that of the shape, or of a tube to the next joint, with the mass given");
}

}  // namespace viable::detail
