#include <octomap/OcTree.h>
#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <map>
#include <random>
#include <set>

#include "Properties.h"
#include "PushedArm.h"
#include "environment/ArmClearances.h"
#include "environment/CollisionChecker.h"
#include "robot/ArmReach.h"
#include "robot/PoseSampling.h"
#include "tracking/JointFollower.h"

namespace viable {

namespace {

constexpr double kTick_s = 1e-3, kRun_s = 20.0;
constexpr int kTicks = 20000;
/** An arm rests below this [rad/s], and is frozen where it rests that long though it could do what is asked. */
constexpr double kRest_radps = 1e-3, kFrozen_s = 2.0;
/** A joint that is asked to go at least so far [rad] and could go so far alone has a free direction. */
constexpr double kFreeWay_rad = 0.1;
constexpr int kFreePoses = 20;
/** Nearer than this to anything counts as near [m]: what a look demands, balls for capsules, spacing of a map's field. */
constexpr double kMargin_m = 0.02;
/** A way brings nothing nearer than it is where no distance on it is less by more [m]. */
constexpr double kNearer_m = 1e-6;
constexpr double kHorizon_m = 0.1, kAllowed_m = 1e-8;
constexpr int kTicksPerJudged = 20;
/** Links nearer than kMargin_m in more than this share of so many random poses may touch. */
constexpr double kNearlyAlways = 0.95;
constexpr int kPoses = 200;
/** One run in so many may be frozen once, and so much of all time not. */
constexpr std::int64_t kRunsPerFrozen = 500;
constexpr double kLeastMoving = 0.985;
/** A target stands so long, and is reached before the end of that, or is not. One of the tool stands longer, as spare joints
go to their rest. Within the end an arm that does not swing moves no joint by more than a count of its encoder, or by this
where it has no figure [rad]. */
constexpr double kStands_s = 12.0, kToolStands_s = 30.0, kRested_s = 1.0, kCount_rad = 2.0 * kPi / (1 << 19);
constexpr double kArrived_rad = 1e-3;
/** Where an arm cannot start in so many tries another arm and scene are drawn: some never can. */
constexpr int kTriesToStart = 20;
/** One run in so many may move on; and so many targets at least are reached (an obstacle bars the others). */
constexpr std::int64_t kRunsPerRestless = 200;
constexpr double kLeastReached = 0.5;

/** A robot and how far it gets. */
struct ReachingRobot : Robot {
    template <class... Parts>
    explicit ReachingRobot(const Parts&... parts)
        : Robot(parts...), reach(calcReach(description, geometry, description.limits)) {}
    Eigen::AlignedBox3d reach;
};

/** As `viable new robot` does: links that are near each other in nearly all poses may touch. */
void letTouch(const RobotDescription& robot, ArmGeometry& geometry) {
    const auto getLinks = [&](int first, int second) {
        const auto& capsules = geometry.capsules;
        return std::pair(capsules[static_cast<std::size_t>(first)].link,
                         capsules[static_cast<std::size_t>(second)].link);
    };
    ArmClearances clearances(robot, geometry);
    std::map<std::pair<int, int>, int> nearPoses;
    std::mt19937_64 random(1);
    for (int k = 0; k < kPoses; ++k) {
        std::set<std::pair<int, int>> near;
        const JointVector q = detail::drawPose(robot.limits.position, random);
        for (const ArmClearances::Item& item : clearances.find(q, nullptr, 0.0, kMargin_m))
            near.insert(getLinks(item.capsule, item.otherCapsule));
        for (const auto& links : near) ++nearPoses[links];
    }
    auto& pairs = geometry.pairs;
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                               [&](const auto& pair) {
                                   return nearPoses[getLinks(pair.first, pair.second)] > kNearlyAlways * kPoses;
                               }),
                pairs.end());
}

/** A Panda of other sizes and limits, often with one more joint at its base. */
ReachingRobot drawRobot(const Robot& panda, Random& random) {
    RobotDescription d = panda.description;
    ArmGeometry geometry = panda.geometry;
    d.name = "random";
    std::vector<double> scale(d.joints.size() + 1);
    for (double& x : scale) x = random.uniform(0.7, 1.4);
    for (std::size_t i = 0; i < d.joints.size(); ++i) d.joints[i].placement.translation() *= scale[i];
    for (LinkCapsule& capsule : geometry.capsules) {
        const double x = scale[static_cast<std::size_t>(capsule.carrier + 1)];
        capsule.a *= x;
        capsule.b *= x;
        capsule.radius *= x;
    }
    JointLimits& l = d.limits;
    if (random.chance(0.7)) {
        JointDescription first = d.joints.front();
        first.name = "first";
        first.axis = random.direction();
        for (JointDescription& joint : d.joints) ++joint.parent;
        d.joints.insert(d.joints.begin(), first);
        ++d.toolParent;
        for (LinkCapsule& capsule : geometry.capsules) capsule.carrier += capsule.carrier >= 0;
        Actuation& motors = d.actuation;
        JointFriction& friction = motors.friction;
        for (JointVector* v : {&l.position.lower, &l.position.upper, &l.velocity.lower, &l.velocity.upper,
                               &l.acceleration.lower, &l.acceleration.upper, &l.jerk.lower, &l.jerk.upper, &d.home,
                               &motors.gearRatio, &motors.rotorInertia, &motors.torqueLimit, &motors.encoderCounts,
                               &friction.coulomb, &friction.viscous, &friction.viscousVelocity})
            if (v->size() > 0) *v = (JointVector(v->size() + 1) << (*v)[0], *v).finished();
    }
    for (int i = 0; i < d.size(); ++i) {
        const double x = random.logUniform(0.3, 1.0);
        for (JointBounds* bounds : {&l.velocity, &l.acceleration, &l.jerk})
            bounds->lower[i] *= x, bounds->upper[i] *= x;
    }
    letTouch(d, geometry);
    return ReachingRobot(d, geometry);
}

/** A map of three walls and clutter of 4 cm cells, in a file as long as this lives. */
class MapFile {
public:
    MapFile() : path(std::filesystem::temp_directory_path() / ("viable-freezing-" + std::to_string(getpid()) + ".bt")) {
        octomap::OcTree tree(0.04);
        const auto fill = [&](double x0, double x1, double y0, double y1, double z0, double z1) {
            for (double x = x0; x < x1; x += 0.04)
                for (double y = y0; y < y1; y += 0.04)
                    for (double z = z0; z < z1; z += 0.04) tree.updateNode(x, y, z, true, true);
        };
        fill(0.6, 0.64, -0.8, 0.8, 0.0, 1.2);
        fill(-0.6, 0.5, 0.6, 0.64, 0.0, 0.8);
        fill(-0.4, 0.4, -0.7, -0.66, 0.2, 0.4);
        Random random(1, 1);
        for (int k = 0; k < 100; ++k)
            tree.updateNode(random.uniform(-0.8, 0.5), random.uniform(-0.7, -0.4), random.uniform(0.0, 1.0), true,
                            true);
        tree.updateInnerOccupancy();
        tree.prune();
        tree.writeBinary(path.string());
    }
    ~MapFile() { std::filesystem::remove(path); }
    MapFile(const MapFile&) = delete;
    MapFile& operator=(const MapFile&) = delete;

    const std::filesystem::path path;
};

enum class Scene { Clutter, Plates, Slot, Cage, Balls, Map, Crowd, Gap, Door };
constexpr std::array kSceneNames = {"clutter", "plates", "slot", "cage", "balls", "map", "crowd", "gap", "door"};

Scene drawKind(Random& random) {
    return static_cast<Scene>(random.integer(0, static_cast<int>(kSceneNames.size()) - 1));
}

Eigen::Matrix3d drawTurn(Random& random) {
    return Eigen::AngleAxisd(random.uniform(0.0, kPi), random.direction()).toRotationMatrix();
}

void addBox(Environment& environment, const Eigen::Vector3d& size, const Eigen::Vector3d& place,
            const Eigen::Matrix3d& turn) {
    Solid box;
    box.name = "box" + std::to_string(environment.solids.size());
    box.kind = Solid::Kind::Box;
    box.size = size;
    box.pose.translation() = place;
    box.pose.linear() = turn;
    environment.solids.push_back(box);
}

void addSphere(Environment& environment, double radius, std::vector<MovingSphere::Waypoint> waypoints) {
    MovingSphere sphere;
    sphere.name = "ball" + std::to_string(environment.spheres.size());
    sphere.radius = radius;
    sphere.waypoints = std::move(waypoints);
    environment.spheres.push_back(sphere);
}

/** Anywhere within the limits, up to `share` of the way from home. */
JointVector drawPose(Random& random, const RobotDescription& robot, double share) {
    JointVector q = robot.home;
    for (int i = 0; i < q.size(); ++i) {
        const JointBounds& position = robot.limits.position;
        const double to =
            random.uniform(std::max(0.95 * position.lower[i], -kPi), std::min(0.95 * position.upper[i], kPi));
        q[i] += share * (to - q[i]);
    }
    return q;
}

Environment drawScene(Random& random, Scene scene, ReachingRobot& robot, const std::filesystem::path& map) {
    const double reach = 0.5 * robot.reach.sizes().head<2>().minCoeff();
    const Eigen::Matrix3d upright = Eigen::Matrix3d::Identity();
    const auto drawPlace = [&] {
        return Eigen::Vector3d(random.uniform(0.3, 1.0) * reach * random.direction() +
                               0.3 * reach * Eigen::Vector3d::UnitZ());
    };
    Environment environment;
    environment.safetyDistance_m = random.logUniform(0.005, 0.03);
    switch (scene) {
        case Scene::Clutter:
            for (int k = random.integer(5, 20); k > 0; --k)
                addBox(environment, 0.1 * Eigen::Vector3d::Ones() + 0.05 * random.direction(), drawPlace(),
                       drawTurn(random));
            break;
        case Scene::Plates:  // of 5 mm
            for (int k = random.integer(2, 6); k > 0; --k)
                addBox(environment, {random.uniform(0.2, 0.8), random.uniform(0.2, 0.8), 0.005}, drawPlace(),
                       drawTurn(random));
            break;
        case Scene::Slot: {  // two plates that face each other
            const Eigen::Matrix3d turn = drawTurn(random);
            const Eigen::Vector3d middle = drawPlace(), half = random.uniform(0.1, 0.2) * turn.col(2);
            for (const double side : {-1.0, 1.0}) addBox(environment, {0.6, 0.6, 0.01}, middle + side * half, turn);
            break;
        }
        case Scene::Cage:  // four walls around the arm and a lid
            for (int k = 0; k < 4; ++k) {
                const Eigen::Matrix3d turn = Eigen::AngleAxisd(k * kPi / 2, Eigen::Vector3d::UnitZ()).matrix();
                addBox(environment, {0.02, 2.0 * reach, 2.0 * reach}, random.uniform(0.5, 0.9) * reach * turn.col(0),
                       turn);
            }
            addBox(environment, {2.0 * reach, 2.0 * reach, 0.02}, random.uniform(0.9, 1.2) * reach * upright.col(2),
                   upright);
            break;
        case Scene::Balls:
            for (int k = random.integer(1, 3); k > 0; --k) {
                std::vector<MovingSphere::Waypoint> way;
                double t = random.uniform(0.0, 2.0);
                for (int j = random.integer(2, 5); j > 0; --j, t += random.uniform(1.0, 4.0))
                    way.push_back({t, drawPlace()});
                addSphere(environment, random.uniform(0.03, 0.12), way);
            }
            break;
        case Scene::Map:
            environment.map.emplace();
            environment.map->name = "map";
            environment.map->file = map;
            environment.map->unknown = UnknownSpace::Free;
            environment.fieldCell_m = 0.04;
            break;
        case Scene::Crowd:
            for (int k = 0; k < 120; ++k)
                addSphere(environment, random.uniform(0.02, 0.04), {{0.0, 1.2 * drawPlace()}});
            break;
        case Scene::Gap:     // between two boxes, where the tool gets
        case Scene::Door: {  // in a wall there
            const JointVector q = drawPose(random, robot.description, 1.0);
            Dynamics dynamics;
            robot.model.calcDynamics(q, JointVector::Zero(q.size()), dynamics);
            const Eigen::Matrix3d turn = drawTurn(random);
            const double half = random.uniform(0.08, 0.2), wall = 0.3;
            for (const int axis : scene == Scene::Gap ? std::vector{0} : std::vector{0, 1})
                for (const double side : {-1.0, 1.0}) {
                    Eigen::Vector3d size = scene == Scene::Gap ? Eigen::Vector3d(wall, wall, wall)
                                                               : Eigen::Vector3d(2.0 * half, 2.0 * half, 0.02);
                    if (scene == Scene::Door && axis == 1) size[0] += 2.0 * wall;
                    size[axis] = wall;
                    addBox(environment, size, dynamics.tool.position + side * (half + wall / 2.0) * turn.col(axis),
                           turn);
                }
            break;
        }
    }
    return environment;
}

/** How an arm is led: by a spring, from pose to pose; to one target of its joints; to one of its tool, as a hand of up to so far
[m, rad], which an obstacle may bar. */
enum class Law { Spring, Joints, Tool };
constexpr double kHand_m = 0.4, kHand_rad = 1.0;

/** An arm that is asked to go elsewhere in a scene, and how long it rests. */
class FreezingCase {
public:
    FreezingCase(ReachingRobot& robot, Random& random, Scene scene, const std::filesystem::path& map,
                 Law law = Law::Spring)
        : law_(law), robot_(robot), random_(random), environment_(drawScene(random, scene, robot, map)) {
        options_.torqueShare = random.chance(0.5) ? 1.0 : kInfinity;
        start_ = {robot.description.home, JointVector::Zero(n()), JointVector::Zero(n())};
        if (random.chance(0.7)) start_.q = drawPose(random, robot.description, random.uniform(0.1, 1.0));
        stiffness_ = random.logUniform(10.0, 300.0);
        alone_ = random.chance(0.2) ? random.integer(0, n() - 1) : -1;
        still_.setZero(n());
    }

    /** False: there is no such start. */
    bool begin() {
        const auto surroundings =
            std::make_shared<Surroundings>(environment_, robot_.reach.min(), robot_.reach.max(), 1.0);
        feed_ = std::make_unique<SurroundingsFeed>(surroundings);
        robot_.model.calcDynamics(start_.q, start_.qd, dynamics_);
        const RobotDescription& d = robot_.description;
        setup_.emplace(RunSetup{d, d.limits, kTick_s, kRun_s, start_, dynamics_.tool, &robot_.geometry, feed_.get()});
        try {
            filter_.configure(*setup_, options_);
        } catch (const Error&) {
            return false;
        }
        checker_ = std::make_unique<CollisionChecker>(d, robot_.geometry, environment_);
        state_ = start_;
        goal_ = start_.q;
        if (law_ == Law::Joints) servo_.emplace().configure(d, d.limits, kTick_s, start_, 1.0, &robot_.geometry);
        if (law_ != Law::Tool) return true;
        ToolFollowerOptions options;
        options.reference.rotationLength_m = ToolFreedom(d, d.limits).calcRotationLength(dynamics_.J);
        tool_.emplace().configure(d, d.limits, kTick_s, start_, options, &robot_.geometry);
        hand_ = dynamics_.tool;
        hand_.position += random_.uniform(0.0, kHand_m) * random_.direction();
        hand_.orientation = Eigen::AngleAxisd(random_.uniform(0.0, kHand_rad), random_.direction()) * hand_.orientation;
        return true;
    }

    /** One tick; the distance that is missing [m]. */
    double step(int tick) {
        const double t = tick * kTick_s;
        if (!tool_ && ticksLeft_-- <= 0) {
            goal_ = drawPose(random_, robot_.description, 1.0);
            for (int i = 0; alone_ >= 0 && i < n(); ++i)
                if (i != alone_) goal_[i] = start_.q[i];
            ticksLeft_ = servo_ ? kTicks : static_cast<int>(random_.uniform(4.0, 20.0) / kTick_s);
        }
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        if (servo_ || tool_) {
            const Surroundings* const surroundings = feed_->view().surroundings;
            if (servo_)
                servo_->calc(state_, {goal_, still_, still_}, surroundings, t, jerk_);
            else
                tool_->calc(state_, hand_, surroundings, t, jerk_);
            torque_ = dynamics_.M * state_.qdd + dynamics_.b;
        } else {
            torque_ =
                dynamics_.M * (stiffness_ * (goal_ - state_.q) - 2.0 * std::sqrt(stiffness_) * state_.qd) + dynamics_.b;
        }
        filter_.filter({state_, torque_, dynamics_, law_ == Law::Spring ? nullptr : &jerk_}, decision_);
        const JointVector before = state_.q;
        advanceNominal(decision_, kTick_s, state_);
        if (!tool_) countRest(t);
        const bool isThere = tool_ ? (dynamics_.tool.position - hand_.position).norm() <= kArrived_rad
                                   : (goal_ - state_.q).cwiseAbs().maxCoeff() <= kArrived_rad;
        if (!isThere) arrival_s = t + kTick_s;
        if (t < stands_s() - kRested_s) {
            least_ = most_ = rested_ = state_.q;
            path_.setZero(n());
        } else {
            least_ = least_.cwiseMin(state_.q);
            most_ = most_.cwiseMax(state_.q);
            path_ += (state_.q - before).cwiseAbs();
        }
        if (tick % kTicksPerJudged != 0) return 0.0;
        const double missing =
            environment_.safetyDistance_m - checker_->findContact(state_.q, t + kTick_s, kHorizon_m).distance;
        return missing > kAllowed_m ? missing : 0.0;
    }
    void end() { countEpisode(); }
    double stands_s() const { return tool_ ? kToolStands_s : kStands_s; }

    std::int64_t restTicks = 0, frozenTicks = 0, longestFrozen = 0;
    double arrival_s = 0.0;  ///< the last time at which it was away from the target

    /** How far a joint moves in the rest of a target's time, in counts of its encoder; of an arm led by its tool, whose spare
    joints go on to their rest, to and fro. */
    double countMoved() const {
        double moved = 0.0;
        for (int i = 0; i < n(); ++i) {
            const double count = robot_.description.encoderStep(i);
            const double way = tool_ ? path_[i] - std::abs(state_.q[i] - rested_[i]) : most_[i] - least_[i];
            moved = std::max(moved, way / (count > 0.0 ? count : kCount_rad));
        }
        return moved;
    }

    /** Prints the frozen pose, and the joint that could have moved. */
    void printFrozen(const char* run) const {
        std::cout << run << ": frozen for " << static_cast<double>(frozenTicks) * kTick_s << " s: joint "
                  << freeJoint_ + 1 << " could go to its goal from pose " << frozenPose_.transpose() << ", goal "
                  << frozenGoal_.transpose() << "\n";
    }

private:
    int n() const { return robot_.description.size(); }

    /** Of every capsule from what is around, and of every pair of capsules; the rest of a ball's path counts, as the arm must be
    able to rest. */
    std::vector<double> findDistances(const JointVector& q, double t) {
        if (parts_.empty()) makeParts();
        std::vector<double> distances;
        for (const std::unique_ptr<CollisionChecker>& part : parts_) {
            distances.push_back(part->findContact(q, t, kHorizon_m).distance);
            for (const MovingSphere& sphere : environment_.spheres)
                for (double later = t; sphere.waypoints.size() > 1 && later < sphere.waypoints.back().time_s;
                     later += 0.1)
                    distances.back() = std::min(distances.back(), part->findContact(q, later, kHorizon_m).distance);
        }
        return distances;
    }

    void makeParts() {
        const RobotDescription& d = robot_.description;
        ArmGeometry geometry = robot_.geometry;
        geometry.pairs.clear();
        for (const LinkCapsule& capsule : robot_.geometry.capsules) {
            geometry.capsules = {capsule};
            parts_.push_back(std::make_unique<CollisionChecker>(d, geometry, environment_));
        }
        for (const auto& [a, b] : robot_.geometry.pairs) {
            geometry.capsules = {robot_.geometry.capsules[static_cast<std::size_t>(a)],
                                 robot_.geometry.capsules[static_cast<std::size_t>(b)]};
            geometry.pairs = {{0, 1}};
            parts_.push_back(std::make_unique<CollisionChecker>(d, geometry, Environment()));
        }
    }

    /** A joint that is asked to move and could, all others resting: nothing comes near, or nearer than it is; -1: none. */
    int findFreeJoint(double t) {
        std::vector<double> least = findDistances(state_.q, t);
        for (double& distance : least)
            distance = std::min(environment_.safetyDistance_m + kMargin_m, distance - kNearer_m);
        for (int i = 0; i < n(); ++i) {
            const double way = goal_[i] - state_.q[i];
            if (std::abs(way) < kFreeWay_rad) continue;
            bool isFree = true;
            JointVector q = state_.q;
            for (int k = 1; k <= kFreePoses && isFree; ++k) {
                q[i] = state_.q[i] + std::copysign(kFreeWay_rad * k / kFreePoses, way);
                const std::vector<double> distances = findDistances(q, t);
                isFree = std::equal(distances.begin(), distances.end(), least.begin(), std::greater_equal<>());
            }
            if (isFree) return i;
        }
        return -1;
    }

    void countRest(double t) {
        const bool isAsked = (goal_ - state_.q).cwiseAbs().maxCoeff() >= kFreeWay_rad;
        if (!isAsked || state_.qd.cwiseAbs().maxCoeff() > kRest_radps) {
            countEpisode();
            return;
        }
        ++episode_;
        if (episode_ * kTick_s < kFrozen_s || episode_ % 500 != 0) return;
        const int joint = findFreeJoint(t);
        isFrozen_ |= joint >= 0;
        if (joint < 0 || freeJoint_ >= 0) return;
        freeJoint_ = joint;
        frozenPose_ = state_.q;
        frozenGoal_ = goal_;
    }

    void countEpisode() {
        if (episode_ * kTick_s > kFrozen_s) {
            restTicks += episode_;
            if (isFrozen_) {
                frozenTicks += episode_;
                longestFrozen = std::max(longestFrozen, episode_);
            }
        }
        episode_ = 0;
        isFrozen_ = false;
    }

    const Law law_;
    ReachingRobot& robot_;
    Random& random_;
    Environment environment_;
    WholeArmBrakingOptions options_;
    std::unique_ptr<SurroundingsFeed> feed_;
    std::unique_ptr<CollisionChecker> checker_;
    std::vector<std::unique_ptr<CollisionChecker>> parts_;  ///< made when an arm rests
    std::optional<RunSetup> setup_;
    WholeArmBrakingFilter filter_;
    std::optional<JointFollower> servo_;
    std::optional<ToolFollower> tool_;
    Pose hand_;
    JointVector still_, jerk_, least_, most_, rested_, path_;
    MotionState start_, state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector torque_, goal_, frozenPose_, frozenGoal_;
    double stiffness_ = 1.0;
    int alone_ = -1, ticksLeft_ = 0, freeJoint_ = -1;
    std::int64_t episode_ = 0;
    bool isFrozen_ = false;
};

/** "  run 3, panda, slot" */
std::string nameRun(const Run& run, const Robot& robot, Scene scene) {
    return "  run " + std::to_string(run.arm()) + ", " + robot.description.name + ", " +
           kSceneNames[static_cast<std::size_t>(scene)];
}

}  // namespace

bool checkFreezing(const Options& options) {
    ReachingRobot robots[] = {ReachingRobot("indy7"), ReachingRobot("panda"), ReachingRobot("ur5e")};
    const MapFile map;
    Run run("freezing", options);
    long long ticks = 0, rest = 0, frozen = 0, runs = 0, frozenRuns = 0, longest = 0;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        ReachingRobot& robot = robots[random.integer(0, 2)];
        const Scene scene = drawKind(random);
        std::unique_ptr<FreezingCase> arm;
        do arm = std::make_unique<FreezingCase>(robot, random, scene, map.path);
        while (!arm->begin());
        for (int tick = 0; tick < kTicks; ++tick) {
            const double missing = arm->step(tick);
            run.addSteps(robot.description.size());
            ++ticks;
            if (missing == 0.0) continue;
            run.fail((robot.description.name + " at tick " + std::to_string(tick) + ": nearer than the safety distance")
                         .c_str(),
                     missing);
            break;
        }
        arm->end();
        ++runs;
        rest += arm->restTicks;
        frozen += arm->frozenTicks;
        longest = std::max<long long>(longest, arm->longestFrozen);
        if (arm->frozenTicks == 0) continue;
        ++frozenRuns;
        arm->printFrozen(nameRun(run, robot, scene).c_str());
    }
    run.print();
    const auto share = [&](long long of) { return static_cast<double>(of) / static_cast<double>(ticks); };
    std::printf(
        "  runs: %lld, frozen though a joint could go where it is asked: %lld, longest %.1f s\n"
        "  time frozen: %.3g %%, at rest for more than %.0f s away from the goal: %.3g %%\n",
        runs, frozenRuns, static_cast<double>(longest) * kTick_s, 100.0 * share(frozen), kFrozen_s,
        100.0 * share(rest));
    const long long most = runs / kRunsPerFrozen;
    if (frozenRuns > most)
        std::printf("TOO MANY: frozen in %lld runs, at most %lld of so many may be\n", frozenRuns, most);
    if (share(frozen) > 1.0 - kLeastMoving)
        std::printf("TOO LONG: frozen, at most %.3g %% of the time may be\n", 100.0 * (1.0 - kLeastMoving));
    return run.isGood() && frozenRuns <= most && share(frozen) <= 1.0 - kLeastMoving;
}

namespace {

bool checkRests(const Options& options, const char* property, Law law) {
    ReachingRobot robots[] = {ReachingRobot("indy7"), ReachingRobot("panda"), ReachingRobot("ur5e")};
    const MapFile map;
    Run run(property, options);
    long long runs = 0, swings = 0, frozen = 0, arrived = 0;
    Figures arrivals;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        std::optional<ReachingRobot> drawn;
        ReachingRobot* robot = nullptr;
        Scene scene{};
        std::unique_ptr<FreezingCase> arm;
        for (int tries = 0; !arm || !arm->begin(); ++tries) {
            if (tries % kTriesToStart == 0) {
                const int which = random.integer(0, law == Law::Tool ? 3 : 2);
                robot = which < 3 ? &robots[which] : &drawn.emplace(drawRobot(robots[1], random));
                do scene = drawKind(random);
                while (scene == Scene::Balls);  // those move
            }
            arm = std::make_unique<FreezingCase>(*robot, random, scene, map.path, law);
        }
        for (int tick = 0; tick * kTick_s < arm->stands_s(); ++tick) {
            const double missing = arm->step(tick);
            run.addSteps(robot->description.size());
            if (missing > 0.0) run.fail("nearer than the safety distance", missing);
        }
        arm->end();
        ++runs;
        const std::string name = nameRun(run, *robot, scene);
        const double moved = arm->countMoved();
        const bool hasArrived = arm->arrival_s < kStands_s - kRested_s;
        arrived += hasArrived;
        if (hasArrived) arrivals.add(arm->arrival_s);
        if (moved > 1.0) {
            ++swings;
            std::printf("%s: at the end moves by %.3g counts\n", name.c_str(), moved);
        }
        if (arm->frozenTicks > 0) {
            ++frozen;
            arm->printFrozen(name.c_str());
        }
    }
    run.print();
    std::printf("  targets: %lld, reached: %lld, moves on: %lld, frozen: %lld\n", runs, arrived, swings, frozen);
    arrivals.print("arrival [s]");
    const long long most = runs / kRunsPerRestless, mostFrozen = runs / kRunsPerFrozen;
    if (swings > most || frozen > mostFrozen)
        std::printf("TOO MANY: at most %lld of so many may move on, and %lld be frozen\n", most, mostFrozen);
    run.expectShare("reached", arrived, runs, kLeastReached);
    return run.isGood() && swings <= most && frozen <= mostFrozen;
}

}  // namespace

bool checkSwinging(const Options& options) {
    return checkRests(options, "swinging", Law::Joints);
}

bool checkTrembling(const Options& options) {
    return checkRests(options, "trembling", Law::Tool);
}

}  // namespace viable
