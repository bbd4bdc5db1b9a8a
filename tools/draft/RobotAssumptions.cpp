#include "draft/RobotAssumptions.h"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/Text.h"
#include "robot/PoseSampling.h"

namespace viable::detail {

namespace {

/** Times in which an arm may reach its velocity and its acceleration limit. [s] */
constexpr double kSpeedUp = 0.2, kRampUp = 0.05;
/** Share of the effort that is friction; that moves the rotor at the acceleration limit; and that motors give at most to
hold the arm and to accelerate it. */
constexpr double kFrictionShare = 0.01, kRotorShare = 0.1, kMotorShare = 0.8;
/** Velocity of a joint without a limit [rad/s, m/s]. */
constexpr double kTurning = 1.0, kSliding = 0.25;
/** Motors without a limit hold and accelerate the arm this many times. */
constexpr double kSpareTorque = 2.0;
/** No joint is taken to be lighter than this share of the heaviest: their motions could not be computed together. */
constexpr double kLeastInertiaShare = 1e-5;
/** A torque limit is a placeholder beyond so many times what holds and accelerates the arm. */
constexpr double kMostSpareTorque = 10.0;

constexpr int kReachPoses = 2000;
constexpr std::uint64_t kReachSeed = 1;
/** A home pose keeps this share of the range from both ends, turns no joint further than half a turn, leaves links so far
apart ([m], or less on a small arm), and has this share of the best mobility. */
constexpr double kInnerMargin = 0.15, kApart = 0.05, kApartShare = 0.05;
constexpr int kDirectionPoses = 50, kGapPoses = 200;
constexpr double kNoDirection = 0.01, kGoodShare = 0.5, kNearlyBest = 0.9;
/** The same, of a pose that the file calls home. */
constexpr double kGivenShare = 0.1;
/** A tool below the base is worth this share of one above: most arms stand on a table. */
constexpr double kBelowShare = 0.3;
/** An error of 1 rad counts as one of this share of the reach. */
constexpr double kLeverShare = 1.0 / 3.0;

/** Of the reach: radius of the ball that is in the way, and its distance from the arm at home. */
constexpr double kBallShare = 0.06, kGapShare = 0.02;
/** How far the hand that meets the ball goes to its sides, as a share of what the hand does. */
constexpr double kAside = 0.5;

/** A long way of a hand's reach, in shares of how far it goes along each axis, and a long turn [rad]; share of the joints'
limits that it may need at the home pose. */
constexpr double kLongWay = 1.5, kLongTurn = 0.45, kHandTurn = 0.3, kHandLimitShare = 0.5;
/** No run keeps less clearance [m]. */
constexpr double kLeastSafety = 0.002;
/** No hand is slower than this in its fastest reach [s]: the limits cannot be meant. */
constexpr double kSlowestHand = 60.0;

/** To three digits. */
double roundOff(double value) {
    return std::strtod(format("%.3g", value).c_str(), nullptr);
}

/** Words in the names of links that stand for a tool. */
constexpr std::initializer_list<const char*> kToolWords = {"tool", "tcp", "effector", "flange", "ee_link"};

/** The pseudoinverse, without directions in which the tool hardly moves. */
Eigen::MatrixXd invert(const Eigen::MatrixXd& J) {
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver;
    solver.setThreshold(kNoDirection);
    return solver.compute(J).pseudoInverse();
}

class Assumptions {
public:
    Assumptions(const UrdfRobot& robot, const LinkDistances& distances, RobotDraft& draft)
        : robot_(robot),
          distances_(distances),
          draft_(draft),
          n_(static_cast<int>(draft.joints.size())),
          arm_(makeDraftArm(robot)),
          recursion_(arm_) {}

    void run() {
        chooseTool();
        fill(&DraftJoint::velocity, "velocity limits", "1 rad/s or 0.25 m/s where the URDF has none",
             [](const DraftJoint& joint) { return joint.type == JointType::Prismatic ? kSliding : kTurning; });
        fill(&DraftJoint::positionLower, "position limits",
             "half a turn or 1 m to either side where the URDF has no range", [](DraftJoint& joint) {
                 joint.positionUpper = getFreeReach(joint.type);
                 joint.home = 0.0;
                 return -joint.positionUpper;
             });
        sampleArm();
        assumeMotors();
        chooseHome();
    }

private:
    DraftJoint& joint(int i) { return draft_.joints[i]; }
    void note(const std::string& figure, const std::string& rule) { draft_.assumptions.push_back({figure, rule}); }

    template <class Make>
    void fill(double DraftJoint::*member, const std::string& figure, const std::string& rule, const Make& make) {
        bool isFilled = false;
        for (DraftJoint& joint : draft_.joints) {
            if (!std::isnan(joint.*member)) continue;
            joint.*member = make(joint);
            isFilled = true;
        }
        if (isFilled) note(figure, rule);
    }

    void chooseTool() {
        if (draft_.tool.empty()) {
            int most = -1;
            for (const std::string& link : draft_.toolLinks) {
                int count = holdsWord(link, kToolWords) ? 1 : 0;  // of ends that as many joints move
                for (int i = robot_.links.at(link).carrier; i >= 0; i = robot_.joints[i].parent) count += 2;
                if (count <= most) continue;
                most = count;
                draft_.tool = link;
            }
            note("tool_link", "`" + draft_.tool + "`, an end that most joints move, of " + join(draft_.toolLinks) +
                                  " (another: --tip LINK)");
        }
        const UrdfRobot::LinkPlace& place = robot_.links.at(draft_.tool);
        toolParent_ = place.carrier;
        toolOffset_ = place.placement.translation();
        for (int i = n_ - 1; i >= 0; --i) {
            if (!recursion_.moves(i, toolParent_)) continue;
            ++draft_.task.toolJoints;
            toolRoot_ = i;
        }
    }

    // ------------------------------------------------------------------------------------ motors

    Eigen::Vector3d placeTool(const JointVector& q) const {
        ArmRecursion::Frames frames;
        recursion_.calcFrames(q, frames);
        return placeTool(frames);
    }
    Eigen::Vector3d placeTool(const ArmRecursion::Frames& frames) const {
        const auto i = static_cast<std::size_t>(toolParent_);
        return frames.origin[i] + frames.rotation[i] * toolOffset_;
    }

    /** Largest gravity torque and inertia of each joint, and the reach, over the limits. */
    void sampleArm() {
        gravity_.setZero(n_);
        inertia_.setZero(n_);
        const JointBounds range = makeDraftRange(draft_.joints);
        const JointVector rest = JointVector::Zero(n_);
        JointVector torque(n_);
        JointMatrix M(n_, n_);
        ArmRecursion::Frames frames;
        std::mt19937_64 random(kReachSeed);
        for (int pose = 0; pose < kReachPoses; ++pose) {
            const JointVector q = drawPose(range, random);
            recursion_.calcTorque(q, rest, rest, torque);
            recursion_.calcInertia(q, M);
            if (draft_.isModel)
                for (int i = 0; i < n_; ++i) M(i, i) += joint(i).rotorInertia;
            gravity_ = gravity_.cwiseMax(torque.cwiseAbs());
            inertia_ = inertia_.cwiseMax(M.diagonal());
            recursion_.calcFrames(q, frames);
            draft_.task.reach = std::max(draft_.task.reach, (placeTool(frames) - frames.origin[toolRoot_]).norm());
        }
        draft_.task.reach = roundOff(draft_.task.reach);
        inertia_ = inertia_.cwiseMax(kLeastInertiaShare * inertia_.maxCoeff());
    }

    void assumeMotors() {
        int i = 0;
        if (!draft_.hasBodies)
            for (DraftJoint& joint : draft_.joints) joint.effort = kInfinity;
        fill(&DraftJoint::effort, "torque limits",
             "where the URDF has none, twice what holds the arm and takes the joint to its velocity in 0.2 s",
             [&](const DraftJoint& joint) {
                 i = static_cast<int>(&joint - draft_.joints.data());
                 const double passive = draft_.isModel ? joint.coulomb + joint.damping * joint.velocity : 0.0;
                 return roundOff(kSpareTorque * (gravity_[i] + inertia_[i] * joint.velocity / kSpeedUp + passive));
             });
        bool isWeak = false, isPlaceholder = false;
        for (i = 0; i < n_; ++i) {
            DraftJoint& joint = this->joint(i);
            const double quick = joint.velocity / kSpeedUp;
            if (!draft_.hasBodies) {
                joint.acceleration = roundOff(quick);
                joint.jerk = roundOff(joint.acceleration / kRampUp);
                continue;
            }
            const double needed = gravity_[i] + inertia_[i] * quick;
            const double effort = std::min(joint.effort, kMostSpareTorque * needed);
            isPlaceholder = isPlaceholder || effort < joint.effort;
            if (!draft_.isModel) {
                joint.rotorInertia = roundOff(kRotorShare * effort / quick);
                joint.coulomb = roundOff(kFrictionShare * effort);
            }
            const double damping = draft_.isModel ? joint.damping * joint.velocity : 0.0;
            const double spare = kMotorShare * joint.effort - gravity_[i] - joint.coulomb - damping;
            const double possible = spare / (inertia_[i] + (draft_.isModel ? 0.0 : joint.rotorInertia));
            if (!(possible > 0.0))
                draft_.warnings.push_back(
                    "joint `" + joint.name + "`: its torque limit of " + formatNumber(joint.effort) +
                    " does not hold the arm with a fifth to spare: gravity asks for up to " +
                    format("%.3g", gravity_[i]) + ". Correct its effort in <limit>, or the masses that it carries.");
            const bool isLess = possible > 0.0 && possible < quick;
            isWeak = isWeak || isLess;
            joint.acceleration = roundOff(isLess ? possible : quick);
            joint.jerk = roundOff(joint.acceleration / kRampUp);
        }
        const std::string capped =
            isPlaceholder ? "; of a torque limit far beyond what the arm needs, ten times the need counts" : "";
        note("acceleration limits", std::string("the velocity limit in 0.2 s") +
                                        (isWeak ? ", less where 80 % of the motor's torque cannot do that" : ""));
        note("jerk limits", "the acceleration limit in 0.05 s");
        if (draft_.isModel || !draft_.hasBodies) return;
        note("rotor_inertia_kgm2",
             "seen at the joint, what a tenth of the torque takes to the velocity in 0.2 s" + capped);
        note("friction", "1 % of the torque limit, whatever the velocity" + capped);
    }

    // -------------------------------------------------------------------------------------- home

    /** How well the tool can be moved in every direction [m]; negative: not a pose to begin at. */
    double rate(const JointVector& q) const {
        JointVector torque(n_);
        const JointVector rest = JointVector::Zero(n_);
        recursion_.calcTorque(q, rest, rest, torque);
        for (int i = 0; i < n_; ++i)
            if (std::abs(torque[i]) > kMotorShare * draft_.joints[i].effort) return -1.0;
        const std::vector<double> distance = distances_.calc(q);
        for (std::size_t k = 0; k < distance.size(); ++k)
            if (distance[k] < gap_[k]) return -1.0;

        const double mobility = calcMobility(q)[draft_.task.directions - 1];
        return placeTool(q).z() < 0.0 ? kBelowShare * mobility : mobility;
    }

    /** How the tool moves per radian of each joint [m]; three more rows where there are joints enough to turn it at will:
    its rotation times a lever. */
    Eigen::MatrixXd calcJacobian(const JointVector& q) const {
        ArmRecursion::Frames frames;
        recursion_.calcFrames(q, frames);
        const Eigen::Vector3d tool = placeTool(frames);
        const int rows = draft_.task.toolJoints >= 6 ? 6 : 3;
        Eigen::MatrixXd J = Eigen::MatrixXd::Zero(rows, n_);
        for (int i = 0; i < n_; ++i) {
            if (!recursion_.moves(i, toolParent_)) continue;
            const Eigen::Vector3d& axis = frames.axis[i];
            if (recursion_.isPrismatic(i)) {
                J.col(i).head<3>() = axis;
                continue;
            }
            J.col(i).head<3>() = axis.cross(tool - frames.origin[i]);
            if (rows == 6) J.col(i).tail<3>() = kLeverShare * draft_.task.reach * axis;
        }
        return J;
    }

    /** Singular values of it, largest first: how far the tool moves in its best direction, and so on [m]. */
    Eigen::VectorXd calcMobility(const JointVector& q) const {
        return Eigen::JacobiSVD<Eigen::MatrixXd>(calcJacobian(q)).singularValues();
    }

    /** How near links come that are watched, at a pose [m]. */
    double calcNearest(const JointVector& q) const {
        const std::vector<double> distance = distances_.calc(q);
        double nearest = kInfinity;
        for (std::size_t k = 0; k < distance.size(); ++k)
            if (gap_[k] > 0.0) nearest = std::min(nearest, distance[k]);
        return nearest;
    }

    /** The same while the tool is led as a hand of hand.yaml leads it, about and along each axis; to first order. Negative
    where a joint would pass its limits. */
    double calcRoom(const JointVector& q) const {
        const Eigen::MatrixXd J = calcJacobian(q);
        const Eigen::MatrixXd inverse = invert(J);
        const double way = DraftTask::kHandShare * draft_.task.reach,
                     turn = kHandTurn * kLeverShare * draft_.task.reach;
        double nearest = calcNearest(q);
        for (int row = 0; row < J.rows(); ++row)
            for (const double size : {-1.0, 1.0}) {
                const JointVector there = q + size * (row < 3 ? way : turn) * inverse.col(row);
                for (int i = 0; i < n_; ++i) {
                    const DraftJoint& joint = draft_.joints[i];
                    if (there[i] < joint.positionLower || there[i] > joint.positionUpper) return -1.0;
                }
                nearest = std::min(nearest, calcNearest(there));
            }
        return nearest;
    }

    /** Whether the hand neither passes limits nor brings links near each other. */
    bool hasRoom(const JointVector& q) const { return calcRoom(q) >= std::min(kNear, kApartShare * draft_.task.reach); }

    /** The usual safety distance, or less where the arm's own links leave no room for it. */
    void setSafety(const JointVector& home) {
        const double room = calcRoom(home);
        const double nearest = room >= 0.0 ? room : calcNearest(home);
        if (nearest < 2.0 * kNear)
            draft_.task.safety = std::max(kLeastSafety, std::min(kNear, std::floor(0.5e3 * nearest) / 1e3));
    }

    /** Links that may touch need no gap; links that the joints hardly part, such as a wrist and a finger, need a small one. */
    void setGaps(const JointBounds& range) {
        const double apart = std::min(kApart, kApartShare * draft_.task.reach), least = std::min(apart, kNear);
        const std::vector<int> nearPoses = distances_.countNear(range, kGapPoses, apart);
        for (std::size_t k = 0; k < nearPoses.size(); ++k) {
            const auto& [first, second] = distances_.pairs()[k];
            const bool mayTouch = hasContact(draft_, draft_.links[first].name, draft_.links[second].name);
            gap_.push_back(mayTouch ? -kInfinity : nearPoses[k] > kGapPoses / 2 ? least : apart);
        }
    }

    void chooseHome() {
        JointBounds range = makeDraftRange(draft_.joints);
        for (int i = 0; i < n_; ++i) {
            const double margin = kInnerMargin * (range.upper[i] - range.lower[i]);
            const double middle = 0.5 * (range.lower[i] + range.upper[i]);
            const double reach =
                std::min(getFreeReach(joint(i).type), 0.5 * (range.upper[i] - range.lower[i]) - margin);
            // Half a turn about zero, as far as the range lets it.
            const double centre = std::clamp(0.0, std::min(middle, range.lower[i] + margin + reach),
                                             std::max(middle, range.upper[i] - margin - reach));
            range.lower[i] = centre - reach;
            range.upper[i] = centre + reach;
        }
        JointVector drafted(n_);
        for (int i = 0; i < n_; ++i) drafted[i] = joint(i).home;
        JointVector best = drafted;
        // A planar arm has fewer directions than its joints.
        std::mt19937_64 random(kReachSeed);
        for (int pose = 0; pose < kDirectionPoses; ++pose) {
            const Eigen::VectorXd mobility = calcMobility(drawPose(range, random));
            const auto possible = static_cast<int>((mobility.array() > kNoDirection * draft_.task.reach).count());
            draft_.task.directions = std::max(draft_.task.directions, possible);
        }
        setGaps(range);
        double before = -1.0, highest = -1.0;
        bool isRoomy = true;
        for (const bool mustHaveRoom : {true, false}) {
            if (highest > 0.0) break;
            isRoomy = mustHaveRoom;
            before = highest = mustHaveRoom && !hasRoom(drafted) ? -1.0 : rate(drafted);
            for (int pose = 0; pose < kReachPoses; ++pose) {
                const JointVector q = drawPose(range, random);
                const double mobility = rate(q);
                if (mobility <= highest || (mustHaveRoom && !hasRoom(q))) continue;
                highest = mobility;
                best = q;
            }
        }
        if (!isRoomy && highest > 0.0)
            draft_.warnings.push_back(
                "there is no home pose around which the tool can be led everywhere without bringing links near each "
                "other: hand.yaml may do so");
        if (highest < 0.0)
            draft_.warnings.push_back(
                format("none of %d poses is one to begin at: in each, motors do not hold the arm or links "
                       "touch; home_rad is the middle of the limits",
                       kReachPoses) +
                ".");
        if (highest >= 0.0 && (before < 0.0 || before < (draft_.hasHome ? kGivenShare : kGoodShare) * highest)) {
            for (int i = 0; i < n_; ++i)
                for (const double simple :
                     {0.0, std::round(10.0 * best[i]) / 10.0, std::round(100.0 * best[i]) / 100.0}) {
                    JointVector q = best;
                    q[i] = simple + 0.0;
                    if (simple < range.lower[i] || simple > range.upper[i] || rate(q) < kNearlyBest * highest ||
                        (isRoomy && !hasRoom(q)))
                        continue;
                    best = q;
                    break;
                }
            for (int i = 0; i < n_; ++i) joint(i).home = best[i];
            note("home_rad", format("of %d poses that the motors hold, where no links touch and the hand has room, the "
                                    "one from which the tool can best move in every direction",
                                    kReachPoses));
            drafted = best;
        }
        placeBall(drafted);
        timeHand(drafted);
        setSafety(drafted);
    }

    /** Of one reach of a hand: so that no joint needs more than a share of its limits, at the home pose and for a way that is
    long as reaches go. Peaks of minimum-jerk motion: Flash and Hogan, J. Neuroscience 5, 1985. */
    void timeHand(const JointVector& home) {
        const Eigen::MatrixXd J = calcJacobian(home);
        const Eigen::MatrixXd inverse = invert(J);
        Eigen::VectorXd way = Eigen::VectorXd::Constant(J.rows(), kLongWay * DraftTask::kHandShare * draft_.task.reach);
        if (J.rows() == 6) way.tail<3>().setConstant(kLongTurn * kLeverShare * draft_.task.reach);
        for (int i = 0; i < n_; ++i) {
            const DraftJoint& joint = draft_.joints[i];
            const double size = inverse.row(i).transpose().cwiseProduct(way).norm();
            draft_.task.fastest = std::max({draft_.task.fastest, 1.875 * size / (kHandLimitShare * joint.velocity),
                                            std::sqrt(5.774 * size / (kHandLimitShare * joint.acceleration)),
                                            std::cbrt(60.0 * size / (kHandLimitShare * joint.jerk))});
        }
        draft_.task.fastest = roundOff(std::min(draft_.task.fastest, kSlowestHand));
    }

    /** Along the base axis that leads on from the base to the tool, or along another one where a ball clear of the arm is
    nearer to the tool. */
    void placeBall(const JointVector& home) {
        DraftTask& task = draft_.task;
        ArmRecursion::Frames frames;
        recursion_.calcFrames(home, frames);
        const Eigen::Vector3d tool = placeTool(frames);
        if (!(task.reach > 0.0) || !std::isfinite(distances_.calcFrom(tool, home))) return;
        const Eigen::Vector3d ahead = tool - frames.origin[toolRoot_];
        Eigen::Index first = 0;
        ahead.head<2>().cwiseAbs().maxCoeff(&first);
        const double radius = kBallShare * task.reach, free = radius + kGapShare * task.reach + kNear;
        const double handReach = kLongWay * DraftTask::kHandShare * task.reach;
        const double farthest = radius + handReach;  // the hand goes through its near side
        double nearest = farthest;
        for (const Eigen::Index axis : {first, 1 - first, Eigen::Index{2}})
            for (const double side : {1.0, -1.0}) {
                const Eigen::Vector3d way = (ahead[axis] < 0.0 ? -side : side) * Eigen::Vector3d::Unit(axis);
                double distance = free;
                while (distance < nearest && distances_.calcFrom(tool + distance * way, home) < free)
                    distance += 0.01 * task.reach;
                if (!(distance < nearest)) continue;
                nearest = distance;
                task.ball = (tool + distance * way).unaryExpr([](double x) { return std::round(1e3 * x) / 1e3 + 0.0; });
                task.pastBall.setConstant(roundOff(kAside * DraftTask::kHandShare * task.reach));
                task.pastBall[axis] = roundOff(handReach);
            }
        if (nearest < farthest) task.radius = roundOff(radius);
    }

    const UrdfRobot& robot_;
    const LinkDistances& distances_;
    RobotDraft& draft_;
    const int n_;
    const RobotDescription arm_;
    const ArmRecursion recursion_;
    int toolParent_ = -1, toolRoot_ = 0;  ///< last and first joint that moves the tool
    Eigen::Vector3d toolOffset_ = Eigen::Vector3d::Zero();
    JointVector gravity_, inertia_;  ///< largest, per joint [Nm], [kg m^2]
    std::vector<double> gap_;        ///< between the links of each pair of `distances_` at least [m]
};

}  // namespace

void assumeFigures(const UrdfRobot& robot, const LinkDistances& distances, RobotDraft& draft) {
    Assumptions(robot, distances, draft).run();
}

}  // namespace viable::detail
