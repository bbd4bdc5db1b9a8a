#include "viable/simulation/ArmContact.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "environment/OccupancyMap.h"
#include "robot/PoseSampling.h"
#include "viable/robot/RobotModel.h"

namespace viable {

namespace {

/** Balls along a capsule are this share of its radius apart. */
constexpr double kBallSpacing = 0.5;
/** Longest sub-step times the fastest frequency of the arm on its contacts; see `kGearStep` of the simbody plant. */
constexpr double kContactStep = 0.5;
/** The spring of friction is damped with this time constant [s]. */
constexpr double kSlipDamping_s = 5e-4;
/** Hertz's springs are as stiff as at this share of the ball's radius, for the length of a sub-step. */
constexpr double kHertzDepth = 0.1;
/** A moving sphere's velocity is its way in this time [s]. */
constexpr double kMoment_s = 1e-6;
constexpr int kPoses = 100;

struct Ball {
    int carrier;
    Eigen::Vector3d centre;  // in the carrier's frame
    double radius;
    int row;  // balls of the same capsule
};

/** A place that touches, or may. */
struct Place {
    double depth;
    Eigen::Vector3d normal, point, velocity;  // out of the obstacle; base frame, relative to the obstacle
};

/** What friction remembers of a ball at an obstacle. */
struct Slip {
    bool touches = false;
    Eigen::Vector3d stretch = Eigen::Vector3d::Zero();  // of the spring along the surface [m]
};

using Shortest = ArmContact::Shortest;

Shortest findFromBox(const Eigen::Vector3d& p, const Eigen::Vector3d& half) {
    const Eigen::Vector3d side = p.unaryExpr([](double x) { return x < 0.0 ? -1.0 : 1.0; });
    const Eigen::Vector3d beyond = side.cwiseProduct(p) - half;
    const Eigen::Vector3d outside = beyond.cwiseMax(0.0);
    const double distance = outside.norm();
    if (distance > 0.0) return {distance, side.cwiseProduct(outside) / distance};
    Eigen::Index axis = 0;
    const double inside = beyond.maxCoeff(&axis);
    return {inside, side[axis] * Eigen::Vector3d::Unit(axis)};
}

Shortest findFromBall(const Eigen::Vector3d& p, double radius) {
    const double distance = p.norm();
    return {distance - radius, distance > 0.0 ? Eigen::Vector3d(p / distance) : Eigen::Vector3d::UnitZ()};
}

Shortest findFromCylinder(const Eigen::Vector3d& p, double radius, double half) {
    const double offAxis = std::hypot(p.x(), p.y()), side = offAxis - radius, end = std::abs(p.z()) - half;
    const Eigen::Vector3d out =
        offAxis > 0.0 ? Eigen::Vector3d(p.x() / offAxis, p.y() / offAxis, 0.0) : Eigen::Vector3d::UnitX();
    const Eigen::Vector3d up(0.0, 0.0, p.z() < 0.0 ? -1.0 : 1.0);
    if (side > 0.0 && end > 0.0) {
        const double distance = std::hypot(side, end);
        return {distance, (side * out + end * up) / distance};
    }
    return side > end ? Shortest{side, out} : Shortest{end, up};
}

}  // namespace

struct ArmContact::Scene {
    RobotDescription robot;
    ContactOptions options;
    double substep_s = 0.0;
    std::vector<Ball> balls;
    std::vector<Solid> solids;
    std::vector<Eigen::Isometry3d> toSolid;
    std::vector<MovingSphere> spheres;
    std::optional<OccupancyMap> map;
    Eigen::Isometry3d toMap = Eigen::Isometry3d::Identity();
    bool withUnknown = false;
    std::vector<Slip> slips;  // of each ball at each obstacle

    std::size_t obstacles() const { return solids.size() + spheres.size() + (map ? 1 : 0); }
    void addBalls(const ArmGeometry& geometry);
    double calcStiffness(double radius, double depth) const;
    double calcForce(double radius, double depth) const;
    double findFastest() const;

    /** The arm in one state. */
    struct Frames {
        Frames(const RobotDescription& robot, const JointState& arm);
        std::array<Eigen::Isometry3d, kMaxJoints> pose;
        std::array<Eigen::Vector3d, kMaxJoints> axis, turning, moving;  // of each joint; of its frame [rad/s, m/s]
        Eigen::Vector3d calcVelocity(int carrier, const Eigen::Vector3d& point) const;
    };
    void addTorque(const Frames& frames, int carrier, const Eigen::Vector3d& point, const Eigen::Vector3d& force,
                   JointVector& torque) const;
    bool findPlace(const Frames& frames, const Ball& ball, std::size_t obstacle, double time_s, Place& out) const;
    bool findCell(const Eigen::Vector3d& centre, double radius, Shortest& out) const;
    /** Along the surface, on the arm [N]. */
    Eigen::Vector3d calcFriction(const Place& place, const Slip& slip, double stiffness, double normal) const;
    template <class Visit>
    void forEachContact(const Frames& frames, double time_s, const Visit& visit) const;
};

ArmContact::Scene::Frames::Frames(const RobotDescription& robot, const JointState& arm) {
    for (int i = 0; i < robot.size(); ++i) {
        const JointDescription& joint = robot.joints[i];
        const bool isFirst = joint.parent < 0, slides = joint.type == JointType::Prismatic;
        const int parent = std::max(joint.parent, 0);
        pose[i] = isFirst ? joint.placement : Eigen::Isometry3d(pose[parent] * joint.placement);
        axis[i] = pose[i].linear() * joint.axis;
        if (slides)
            pose[i].translate(Eigen::Vector3d(arm.q[i] * joint.axis));
        else
            pose[i].rotate(Eigen::AngleAxisd(arm.q[i], joint.axis));
        turning[i] = isFirst ? Eigen::Vector3d::Zero() : turning[parent];
        moving[i] =
            isFirst ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : calcVelocity(joint.parent, pose[i].translation());
        (slides ? moving : turning)[i] += arm.qd[i] * axis[i];
    }
}

Eigen::Vector3d ArmContact::Scene::Frames::calcVelocity(int carrier, const Eigen::Vector3d& point) const {
    return moving[carrier] + turning[carrier].cross(point - pose[carrier].translation());
}

void ArmContact::Scene::addTorque(const Frames& frames, int carrier, const Eigen::Vector3d& point,
                                  const Eigen::Vector3d& force, JointVector& torque) const {
    for (int i = carrier; i >= 0;) {
        const JointDescription& joint = robot.joints[i];
        const Eigen::Vector3d& axis = frames.axis[i];
        torque[i] += joint.type == JointType::Prismatic ? axis.dot(force)
                                                        : axis.dot((point - frames.pose[i].translation()).cross(force));
        i = joint.parent;
    }
}

void ArmContact::Scene::addBalls(const ArmGeometry& geometry) {
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) continue;
        const double length = (capsule.b - capsule.a).norm();
        const int gaps = static_cast<int>(std::ceil(length / (kBallSpacing * capsule.radius)));
        for (int k = 0; k <= gaps; ++k)
            balls.push_back({capsule.carrier, capsule.a + (gaps > 0 ? 1.0 * k / gaps : 0.0) * (capsule.b - capsule.a),
                             capsule.radius, gaps + 1});
    }
}

double ArmContact::Scene::calcForce(double radius, double depth) const {
    if (options.law == ContactLaw::Spring) return options.stiffness * depth;
    return 4.0 / 3.0 * options.modulus * std::sqrt(radius * depth) * depth;
}

/** d force / d depth [N/m]. */
double ArmContact::Scene::calcStiffness(double radius, double depth) const {
    return options.law == ContactLaw::Spring ? options.stiffness : 2.0 * options.modulus * std::sqrt(radius * depth);
}

/** The square of the fastest frequency of the arm on its contacts [1/s^2]: as if all balls of a capsule touched. */
double ArmContact::Scene::findFastest() const {
    std::vector<Point> centres;
    for (const Ball& ball : balls) centres.push_back({ball.carrier, ball.centre});
    const std::vector<double> mobility = findMobility(robot, centres);
    double fastest = 0.0;
    for (std::size_t k = 0; k < balls.size(); ++k) {
        const Ball& ball = balls[k];
        fastest = std::max(fastest, ball.row * calcStiffness(ball.radius, kHertzDepth * ball.radius) * mobility[k]);
    }
    return fastest;
}

/** The nearest cell; false: none is near enough. */
bool ArmContact::Scene::findCell(const Eigen::Vector3d& centre, double radius, Shortest& out) const {
    out.distance = radius;
    bool isFound = false;
    const Eigen::Vector3d p = toMap * centre;
    map->forEachSolidCell(p.array() - radius, p.array() + radius, withUnknown, [&](const OccupancyMap::Cell& cell) {
        const Shortest found = findFromBox(p - cell.centre, Eigen::Vector3d::Constant(0.5 * cell.edge));
        if (!(found.distance < out.distance)) return;
        out = found;
        isFound = true;
    });
    out.normal = toMap.linear().transpose() * out.normal;
    return isFound;
}

bool ArmContact::Scene::findPlace(const Frames& frames, const Ball& ball, std::size_t obstacle, double time_s,
                                  Place& out) const {
    const Eigen::Vector3d centre = frames.pose[ball.carrier] * ball.centre;
    Shortest found{kInfinity, Eigen::Vector3d::Zero()};
    Eigen::Vector3d ofObstacle = Eigen::Vector3d::Zero();
    if (obstacle < solids.size()) {
        const Eigen::Isometry3d& to = toSolid[obstacle];
        found = findShortest(solids[obstacle], to * centre);
        found.normal = to.linear().transpose() * found.normal;
    } else if (obstacle < solids.size() + spheres.size()) {
        const MovingSphere& sphere = spheres[obstacle - solids.size()];
        const Eigen::Vector3d now = sphere.calcCentre(time_s);
        found = findFromBall(centre - now, sphere.radius);
        if (found.distance < ball.radius) ofObstacle = ArmContact::calcVelocity(sphere, time_s);
    } else if (!findCell(centre, ball.radius, found)) {
        return false;
    }
    out.depth = ball.radius - found.distance;
    if (!(out.depth > 0.0)) return false;
    out.normal = found.normal;
    out.point = centre - (ball.radius - 0.5 * out.depth) * out.normal;
    out.velocity = frames.calcVelocity(ball.carrier, out.point) - ofObstacle;
    return true;
}

Eigen::Vector3d ArmContact::Scene::calcFriction(const Place& place, const Slip& slip, double stiffness,
                                                double normal) const {
    const auto along = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d {
        return v - place.normal.dot(v) * place.normal;
    };
    const Eigen::Vector3d wanted = -stiffness * (along(slip.stretch) + kSlipDamping_s * along(place.velocity));
    const double most = options.friction * normal, size = wanted.norm();
    return size > most ? Eigen::Vector3d(most / size * wanted) : wanted;
}

/** Calls visit(ball, obstacle, slip's index, place, stiffness, normal force, force on the arm). */
template <class Visit>
void ArmContact::Scene::forEachContact(const Frames& frames, double time_s, const Visit& visit) const {
    const std::size_t count = obstacles();
    for (std::size_t b = 0; b < balls.size(); ++b)
        for (std::size_t k = 0; k < count; ++k) {
            const Ball& ball = balls[b];
            Place place;
            if (!findPlace(frames, ball, k, time_s, place)) continue;
            const double rate = -place.normal.dot(place.velocity);
            const double normal =
                std::max(0.0, calcForce(ball.radius, place.depth) * (1.0 + 1.5 * options.dissipation * rate));
            const double stiffness = calcStiffness(ball.radius, place.depth);
            const Eigen::Vector3d force =
                normal * place.normal + calcFriction(place, slips[b * count + k], stiffness, normal);
            visit(ball, k, b * count + k, place, stiffness, normal, force);
        }
}

ArmContact::Shortest ArmContact::findShortest(const Solid& solid, const Eigen::Vector3d& p) {
    switch (solid.kind) {
        case Solid::Kind::Box:
            return findFromBox(p, 0.5 * solid.size);
        case Solid::Kind::Sphere:
            return findFromBall(p, solid.radius);
        case Solid::Kind::Cylinder:
            return findFromCylinder(p, solid.radius, 0.5 * solid.length);
        case Solid::Kind::HalfSpace:
            return {p.z(), Eigen::Vector3d::UnitZ()};
    }
    VIABLE_CHECK(false, "a solid has one of the kinds");
    return {};
}

Eigen::Vector3d ArmContact::calcVelocity(const MovingSphere& sphere, double time_s) {
    return (sphere.calcCentre(time_s + kMoment_s) - sphere.calcCentre(time_s)) / kMoment_s;
}

std::vector<double> ArmContact::findMobility(const RobotDescription& robot, const std::vector<Point>& points) {
    const int n = robot.size();
    const JointBounds range{robot.limits.position.lower.cwiseMax(-kPi), robot.limits.position.upper.cwiseMin(kPi)};
    std::mt19937 random(1);
    Scene scene;
    scene.robot = robot;
    RobotModel model(robot);
    Dynamics dynamics;
    std::vector<double> largest(points.size(), 0.0);
    for (int pose = 0; pose < kPoses; ++pose) {
        const JointState arm{detail::drawPose(range, random), JointVector::Zero(n)};
        model.calcDynamics(arm.q, arm.qd, dynamics);
        const Eigen::LLT<JointMatrix> factor(dynamics.M);
        const Scene::Frames frames(robot, arm);
        for (std::size_t k = 0; k < points.size(); ++k) {
            const int carrier = points[k].carrier;
            const Eigen::Vector3d p = frames.pose[carrier] * points[k].place;
            Eigen::Matrix3d mobility;
            std::array<JointVector, 3> pull;
            for (int axis = 0; axis < 3; ++axis) {
                JointVector& torque = pull[axis];
                torque.setZero(n);
                scene.addTorque(frames, carrier, p, Eigen::Vector3d::Unit(axis), torque);
                const JointVector moved = factor.solve(torque);
                for (int other = 0; other <= axis; ++other)
                    mobility(axis, other) = mobility(other, axis) = pull[other].dot(moved);
            }
            largest[k] =
                std::max(largest[k], Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(mobility).eigenvalues()[2]);
        }
    }
    return largest;
}

bool ArmContact::isWanted(const RunSetup& setup, const ContactOptions& options, const Parameters& parameters) {
    if (options.parts == ContactParts::None) return false;
    if (!setup.environment || setup.environment->obstacleNames().empty())
        throw badInput(parameters.place("contact"), "there is nothing to touch",
                       "Give obstacles in `environment`, or `contact: none`.");
    return true;
}

void ArmContact::checkSteps(double frequencySquared, double tick_s, int substeps, const Parameters& parameters) {
    const double needed = std::ceil(tick_s * std::sqrt(frequencySquared) / kContactStep);
    if (substeps < needed)
        throw badInput(
            parameters.place("substeps"),
            std::to_string(substeps) + " is too few for so stiff a contact of so light a part of the arm",
            "Write substeps: " + std::to_string(std::lround(needed)) + " or more, or let what it touches be softer.");
}

ArmContact::ArmContact() = default;
ArmContact::~ArmContact() = default;
ArmContact::ArmContact(ArmContact&&) noexcept = default;
ArmContact& ArmContact::operator=(ArmContact&&) noexcept = default;

void ArmContact::configure(const RunSetup& setup, const RobotDescription& robot, int substeps,
                           const ContactOptions& options, const Parameters& parameters) {
    scene_.reset();
    torque_.setZero(setup.size());
    if (!isWanted(setup, options, parameters)) return;
    auto scene = std::make_unique<Scene>();
    scene->robot = robot;
    scene->options = options;
    scene->substep_s = setup.tick_s / substeps;
    scene->balls.push_back({robot.toolParent, robot.toolPlacement.translation(), options.toolRadius, 1});
    if (options.parts == ContactParts::Arm && setup.geometry) scene->addBalls(*setup.geometry);
    scene->solids = setup.environment->solids;
    for (const Solid& solid : scene->solids) scene->toSolid.push_back(solid.pose.inverse());
    scene->spheres = setup.environment->spheres;
    if (const std::optional<MapChoice>& map = setup.environment->map) {
        scene->map.emplace(*map);
        scene->toMap = map->pose.inverse();
        scene->withUnknown = map->unknown == UnknownSpace::Occupied;
    }
    scene->slips.resize(scene->balls.size() * scene->obstacles());
    checkSteps(scene->findFastest(), setup.tick_s, substeps, parameters);
    scene_ = std::move(scene);
}

void ArmContact::reset() {
    report_ = {};
    torque_.setZero();
    if (scene_) std::fill(scene_->slips.begin(), scene_->slips.end(), Slip());
}

void ArmContact::addTorque(double time_s, const JointState& arm, JointVector& torque) const {
    const Scene& scene = *scene_;
    const Scene::Frames frames(scene.robot, arm);
    scene.forEachContact(
        frames, time_s,
        [&](const Ball& ball, std::size_t, std::size_t, const Place& place, double, double,
            const Eigen::Vector3d& force) { scene.addTorque(frames, ball.carrier, place.point, force, torque); });
}

bool ArmContact::endStep(double time_s, const JointState& arm) {
    Scene& scene = *scene_;
    const Scene::Frames frames(scene.robot, arm);
    report_ = {};
    torque_.setZero();
    std::vector<Slip>& slips = scene.slips;
    for (Slip& slip : slips) slip.touches = false;
    bool isKnown = true;
    const std::size_t map = scene.solids.size() + scene.spheres.size();
    scene.forEachContact(frames, time_s,
                         [&](const Ball& ball, std::size_t obstacle, std::size_t index, const Place& place,
                             double stiffness, double normal, const Eigen::Vector3d& force) {
                             isKnown &= obstacle < map || place.depth < ball.radius;
                             scene.addTorque(frames, ball.carrier, place.point, force, torque_);
                             ++report_.contacts;
                             report_.force += force;
                             report_.pressing += normal;
                             if (place.depth > report_.depth) {
                                 report_.depth = place.depth;
                                 report_.point = place.point;
                                 report_.carrier = ball.carrier;
                                 report_.obstacle = static_cast<int>(obstacle);
                             }
                             Slip& slip = slips[index];
                             slip.touches = true;
                             slip.stretch += scene.substep_s * place.velocity;
                             slip.stretch -= place.normal.dot(slip.stretch) * place.normal;
                             const double most = scene.options.friction * normal / stiffness,
                                          size = slip.stretch.norm();
                             if (size > most) slip.stretch *= most / size;
                         });
    for (Slip& slip : slips)
        if (!slip.touches) slip.stretch.setZero();
    return isKnown;
}

}  // namespace viable
