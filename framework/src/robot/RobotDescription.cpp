#include "viable/robot/RobotDescription.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "robot/DynamicsCheck.h"
#include "robot/PoseSampling.h"
#include "robot/RigidBody.h"
#include "robot/urdf/UrdfReader.h"
#include "viable/config/Settings.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using detail::ErrorList;
using detail::formatNumber;
using detail::UrdfRobot;

/** Largest condition number of M accepted: beyond it, solving for accelerations loses more than
ten of the sixteen digits. */
constexpr double kMaxInertiaCondition = 1e7;
/** Poses at which the condition is looked at; always the same ones. */
constexpr int kConditionPoses = 200;
constexpr std::uint64_t kConditionSeed = 1;

const char* const kFolderContents = "A robot folder NAME holds NAME.urdf, limits.yaml and actuation.yaml.";

// ---------------------------------------------------------------------------------------- files

/** The folder's path without a trailing separator, so that its last part is the robot's name. */
fs::path normalizeFolder(const fs::path& folder) {
    fs::path path = fs::absolute(folder).lexically_normal();
    if (!path.has_filename()) path = path.parent_path();
    return path;
}

/** The path of a file of the robot, once it is certain that it is a plain file inside the folder.
 */
fs::path requireFile(const fs::path& folder, const std::string& name, const std::string& remedy) {
    const fs::path file = folder / name;
    std::error_code failed;
    const fs::file_status itself = fs::symlink_status(file, failed);
    if (itself.type() == fs::file_type::not_found)
        throw badInput(folder.string(), "the file " + name + " is missing", remedy);
    const fs::file_status target = fs::status(file, failed);
    if (target.type() == fs::file_type::not_found)
        throw badInput(file.string(),
                       "this is a link to " + fs::read_symlink(file, failed).string() + ", which does not exist",
                       "Replace the link by the file itself.");
    if (target.type() == fs::file_type::directory)
        throw badInput(file.string(), "this is a folder, not a file", kFolderContents);
    if (target.type() != fs::file_type::regular)
        throw badInput(file.string(), "this is not a plain file that can be read", kFolderContents);
    const fs::path real = fs::canonical(file, failed);
    const fs::path home = fs::canonical(folder, failed);
    if (failed || std::mismatch(home.begin(), home.end(), real.begin(), real.end()).first != home.end())
        throw badInput(file.string(), "this is a link to " + real.string() + ", outside the robot's folder",
                       "Copy the file into the folder, so that the folder is the whole robot.");
    return file;
}

/** What to do about a missing URDF, seen from the files that are there. */
std::string suggestUrdf(const fs::path& folder, const std::string& name) {
    std::error_code failed;
    std::set<std::string> candidates;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, failed)) {
        const std::string extension = entry.path().extension().string();
        if (extension == ".urdf" || extension == ".xacro") candidates.insert(entry.path().filename().string());
    }
    if (candidates.empty()) return kFolderContents;
    const std::string& found = *candidates.begin();
    if (fs::path(found).extension() == ".xacro")
        return "There is " + found + ": run `xacro " + found + " > " + name + ".urdf`.";
    return "There is " + found + ": the file must bear the folder's name.";
}

std::string joinNames(const std::vector<std::string>& names) {
    return "`" + detail::join(names, "`, `") + "`";
}

// --------------------------------------------------------------------------------------- limits

/** Limits that leave no range, with the place where they were written. */
void checkRanges(const RobotDescription& robot, const UrdfRobot& urdf, const ConfigNode& file) {
    const auto check = [&](const JointBounds& bounds, const char* key, const char* quantity, const char* unit,
                           bool mustHoldZero) {
        const ConfigNode* own = file.find(key);
        for (int i = 0; i < robot.size(); ++i) {
            const double lower = bounds.lower[i], upper = bounds.upper[i];
            if (lower < upper && (!mustHoldZero || (lower < 0.0 && upper > 0.0))) continue;
            throw badInput(own ? own->place() : urdf.jointPlaces[i],
                           std::string("the ") + quantity + " limits of joint `" + robot.joints[i].name + "` are " +
                               formatNumber(lower) + " to " + formatNumber(upper) + " " + unit +
                               ", which leaves no range",
                           own ? "The lower limit must be below the upper one."
                               : std::string("Correct <limit> in the URDF, or give ") + key + " in limits.yaml.");
        }
    };
    check(robot.limits.position, "position_rad", "position", "rad", false);
    check(robot.limits.velocity, "velocity_radps", "velocity", "rad/s", true);
}

void readTool(const ConfigNode* node, const UrdfRobot& urdf, const std::string& where, RobotDescription& robot) {
    if (node) {
        refuseBlank(*node);
        robot.toolLink = toText(*node);
    } else if (urdf.leafLinks.size() == 1) {
        robot.toolLink = urdf.leafLinks.front();
    } else {
        throw badInput(
            where, "the key `tool_link` is missing, and the robot ends in several links: " + joinNames(urdf.leafLinks),
            "Name the link that is the tool frame, such as `tool_link: " + urdf.leafLinks.front() + "`.");
    }
    const std::string place = node ? node->place() : where;
    const auto link = urdf.links.find(robot.toolLink);
    if (link == urdf.links.end()) {
        std::vector<std::string> names;
        for (const auto& entry : urdf.links) names.push_back(entry.first);
        const std::string closest = findClosestName(robot.toolLink, names);
        throw badInput(
            place, "the robot has no link `" + robot.toolLink + "`",
            (closest.empty() ? "" : "Did you mean `" + closest + "`? ") + "Its links are " + joinNames(names) + ".");
    }
    if (link->second.carrier < 0)
        throw badInput(place, "the tool link `" + robot.toolLink + "` is fixed to the base",
                       "Name a link that a joint moves.");
    robot.toolParent = link->second.carrier;
    robot.toolPlacement = link->second.placement;
}

/** `assumed`: keys of the same file. */
void readAssumed(const ConfigNode& node, const ConfigNode& file, std::vector<std::string>& assumed) {
    ErrorList errors;
    for (const ConfigNode& key : node.items)
        errors.collect([&] {
            assumed.push_back(toText(key));
            if (key.text != "assumed" && key.text != "schema" && file.find(key.text)) return;
            std::vector<std::string> keys;
            for (const auto& entry : file.entries)
                if (entry.first != "assumed" && entry.first != "schema") keys.push_back(entry.first);
            const std::string closest = findClosestName(key.text, keys);
            throw badInput(key.place(), "there is no figure `" + key.text + "` in this file",
                           (closest.empty() ? "" : "Did you mean `" + closest + "`? ") +
                               std::string("Name a key of this file, or take it out of the list."));
        });
    errors.throwIfAny(node.place());
}

/** What the files of a robot have in common. */
struct RobotFile {
    int schema = 1;
    std::vector<std::string> assumed;

    template <class V>
    void describe(V& v) {
        v(schema, "schema", "Version of the file format.").atLeast(1).upTo(1).required();
        v(assumed, "assumed", "Keys of this file that are no figures of the robot's maker.").optional();
    }
};

/** Reads `file` from `root`, as far as it goes, and notes what is assumed. @return  all its keys are known and good */
template <class File>
bool readRobotFile(const ConfigNode& root, File& file, RobotDescription& robot, ErrorList& errors) {
    const ConfigNode* const assumed = root.find("assumed");
    const bool isGood = errors.collect([&] { readSettings(root, file, robot.size()); });
    if (isGood && assumed)  // a misspelt figure may be one of them
        errors.collect([&] { readAssumed(*assumed, root, robot.assumed); });
    return isGood;
}

struct LimitsFile {
    JointLimits limits;
    RobotFile file = {};
    bool allowLargeAngles = false;
    PerJoint home = 0.0;
    std::string toolLink = {};
    SpeedLimits speedLimits = {};

    template <class V>
    void describe(V& v) {
        file.describe(v);
        limits.describe(v);
        v(allowLargeAngles, "allow_large_angles", "Position limits beyond 4 pi are intended, not degrees.");
        v(home, "home_rad", "rad", "Where the arm starts unless a file says otherwise.").required();
        v(toolLink, "tool_link", "The link that is the tool frame; that in which the arm ends.");
        v(speedLimits, "speed_limits", "Largest speeds of the arm's points.");
    }
    /** URDF knows neither, and leaving one out by oversight would mean no limit at all. */
    void check(const ConfigNode& root) const {
        ErrorList errors;
        for (const char* key : {"acceleration_radps2", "jerk_radps3"})
            errors.collect([&] { ConfigMap(root).require(key); });
        errors.throwIfAny(root.file);
    }
};

void readLimitsFile(const fs::path& path, const UrdfRobot& urdf, RobotDescription& robot) {
    const int n = robot.size();
    const ConfigNode root = readConfigFile(path);
    ErrorList errors;
    LimitsFile file{JointLimits::unlimited(n)};
    file.limits.position = urdf.position;
    file.limits.velocity = urdf.velocity;
    const bool isGood = readRobotFile(root, file, robot, errors);
    const ConfigNode* tool = root.find("tool_link");
    if (tool || isGood) errors.collect([&] { readTool(tool, urdf, path.string(), robot); });
    errors.throwIfAny(path.string());
    robot.limits = file.limits;
    robot.allowLargeAngles = file.allowLargeAngles;
    robot.home = file.home.expand(n);
    robot.speedLimits = file.speedLimits;

    checkRanges(robot, urdf, root);
    for (int i = 0; i < n; ++i) {
        const AxisLimits limits = robot.limits.axis(i);
        if (robot.home[i] >= limits.positionLower && robot.home[i] <= limits.positionUpper) continue;
        throw badInput(root.find("home_rad")->place(),
                       "the home position of joint `" + robot.joints[i].name + "` is " + formatNumber(robot.home[i]) +
                           " rad; its limits are [" + formatNumber(limits.positionLower) + ", " +
                           formatNumber(limits.positionUpper) + "] rad",
                       "Choose a home pose inside the position limits.");
    }
}

// ------------------------------------------------------------------------------------ actuation

struct FrictionBlock {
    PerJoint coulomb = 0.0, viscous = 0.0, viscousVelocity = 1.0;
    std::string source;

    template <class V>
    void describe(V& v) {
        v(coulomb, "coulomb_Nm", "Nm", "Coulomb friction of each joint.").atLeast(0).required();
        v(viscous, "viscous_Nm", "Nm", "Its viscous friction at high velocity.").atLeast(0).required();
        v(viscousVelocity, "viscous_velocity_radps", "rad/s", "The velocity at which that saturates.")
            .above(0)
            .required();
        v(source, "source", "Where the figures are from.");
    }
};

struct ActuationFile {
    RobotFile file;
    PerJoint gearRatio = 1.0, rotorInertia = 0.0, torqueLimit = 0.0, encoderCounts = 0.0;
    std::string source;
    FrictionBlock friction;

    template <class V>
    void describe(V& v) {
        file.describe(v);
        v(gearRatio, "gear_ratio", "", "Turns of the motor for one of the joint.").above(0).required();
        v(rotorInertia, "rotor_inertia_kgm2", "kg m^2", "Of the motor, before the gear.").atLeast(0).required();
        v(source, "rotor_inertia_source", "Where that figure is from.");
        v(torqueLimit, "torque_limit_Nm", "Nm", "What the motor gives at the joint.").above(0).orInfinite().required();
        v(encoderCounts, "encoder_counts_per_motor_turn", "", "0: the reading is exact.").atLeast(0);
        v(friction, "friction", "Friction figures.").required();
    }
};

enum class DynamicsGiven { None };

/** actuation.yaml of a robot that takes positions. */
struct KinematicFile {
    RobotFile file;
    DynamicsGiven dynamics = DynamicsGiven::None;

    template <class V>
    void describe(V& v) {
        file.describe(v);
        v(dynamics, "dynamics", "none", "The robot takes positions, and nobody knows its masses and motors.")
            .required();
    }
};

/** Whether actuation.yaml has the key `dynamics`; what is wrong with the file is told when it is read. */
bool leavesDynamicsOut(const fs::path& actuationFile) try {
    return readConfigFile(actuationFile).find("dynamics") != nullptr;
} catch (const Error&) {
    return false;
}

void readActuationFile(const fs::path& path, RobotDescription& robot) {
    const int n = robot.size();
    const ConfigNode root = readConfigFile(path);
    ErrorList errors;
    if (root.find("dynamics")) {
        KinematicFile kinematic;
        readRobotFile(root, kinematic, robot, errors);
        errors.throwIfAny(path.string());
        robot = withoutDynamics(std::move(robot));
        return;
    }
    ActuationFile file;
    readRobotFile(root, file, robot, errors);
    errors.throwIfAny(path.string());
    Actuation& actuation = robot.actuation;
    actuation.gearRatio = file.gearRatio.expand(n);
    actuation.torqueLimit = file.torqueLimit.expand(n);
    actuation.rotorInertia = file.rotorInertia.expand(n).cwiseProduct(actuation.gearRatio.cwiseAbs2());
    actuation.encoderCounts = file.encoderCounts.expand(n).cwiseProduct(actuation.gearRatio);
    actuation.friction = {file.friction.coulomb.expand(n), file.friction.viscous.expand(n),
                          file.friction.viscousVelocity.expand(n)};
}

// -------------------------------------------------------------------------------------- inertia

/** Refuses an arm whose accelerations cannot be found from its torques. */
void checkCondition(const RobotDescription& robot, const std::string& where) {
    const int n = robot.size();
    const ArmRecursion recursion(robot);
    std::mt19937_64 random(kConditionSeed);
    JointMatrix M;
    JointVector reach(n);
    for (int i = 0; i < n; ++i) reach[i] = detail::getFreeReach(robot.joints[i].type);
    const JointBounds range = detail::makeFinite(robot.limits.position, reach);
    for (int sample = 0; sample < kConditionPoses; ++sample) {
        recursion.calcInertia(detail::drawPose(range, random), M);
        const Eigen::SelfAdjointEigenSolver<JointMatrix> solver(M);
        const double smallest = solver.eigenvalues()[0];
        const double largest = solver.eigenvalues()[n - 1];
        if (largest < kMaxInertiaCondition * smallest) continue;
        int light, heavy;
        solver.eigenvectors().col(0).cwiseAbs().maxCoeff(&light);
        solver.eigenvectors().col(n - 1).cwiseAbs().maxCoeff(&heavy);
        const std::string& lightName = robot.joints[light].name;
        throw badInput(
            where,
            "the inertia matrix is too near to singular: at a pose inside the limits its eigenvalues reach from " +
                formatNumber(smallest) + " (mainly joint `" + lightName + "`) to " + formatNumber(largest) +
                " kg m^2 (mainly joint `" + robot.joints[heavy].name + "`); allowed is a ratio of " +
                formatNumber(kMaxInertiaCondition),
            "Give the links that joint `" + lightName +
                "` moves their true mass and inertia, or the joint its rotor inertia in actuation.yaml.");
    }
}

bool isRobotFolder(const fs::path& folder) {
    std::error_code failed;
    return fs::exists(folder / (folder.filename().string() + ".urdf"), failed);
}

}  // namespace

double RobotDescription::movingMass() const {
    double mass = 0.0;
    for (const JointDescription& joint : joints) mass += joint.body.mass;
    return mass;
}

std::vector<std::string> RobotDescription::jointNames() const {
    std::vector<std::string> names;
    for (const JointDescription& joint : joints) names.push_back(joint.name);
    return names;
}

double JointFriction::calcViscous(int joint, double speed) const {
    return -viscous[joint] * std::expm1(-speed / viscousVelocity[joint]);
}

double RobotDescription::encoderStep(int joint) const {
    const double counts = actuation.encoderCounts[joint];
    if (!(counts > 0.0)) return 0.0;
    return static_cast<double>((slides(joint) ? 1.0 : 2.0 * EIGEN_PI) / counts);  // of a long double: rounded once
}

JointFriction readFriction(const fs::path& actuationFile, const std::vector<std::string>& joints) {
    RobotDescription robot;
    robot.joints.resize(joints.size());
    readActuationFile(actuationFile, robot);
    return robot.actuation.friction;
}

RobotDescription loadRobot(const fs::path& folder) {
    std::error_code failed;
    const fs::file_status status = fs::status(folder, failed);
    if (status.type() == fs::file_type::not_found)
        throw badInput(folder.string(), "there is no such robot folder", kFolderContents);
    if (status.type() != fs::file_type::directory)
        throw badInput(folder.string(), "this is not a folder",
                       std::string("Give the robot's folder. ") + kFolderContents);
    RobotDescription robot;
    robot.folder = folder;
    robot.name = normalizeFolder(folder).filename().string();
    const std::string urdfName = robot.name + ".urdf";
    const fs::path urdfFile = requireFile(folder, urdfName, suggestUrdf(folder, robot.name));
    const fs::path limitsFile = requireFile(folder, "limits.yaml", kFolderContents);
    const fs::path actuationFile = requireFile(folder, "actuation.yaml", kFolderContents);

    UrdfRobot urdf = detail::readUrdf(urdfFile, !leavesDynamicsOut(actuationFile));
    robot.joints = urdf.joints;
    robot.assumed = urdf.assumed;
    ErrorList errors;
    errors.collect([&] { readLimitsFile(limitsFile, urdf, robot); });
    errors.collect([&] { readActuationFile(actuationFile, robot); });
    errors.throwIfAny(folder.string());
    if (!robot.hasDynamics()) return robot;
    checkCondition(robot, urdfFile.string());
    detail::checkRecursion(robot, ArmRecursion(robot), urdfFile.string());
    return robot;
}

fs::path findRobot(const std::string& name, const std::vector<fs::path>& searchPath, const std::string& where) {
    std::error_code failed;
    const bool isPath = name.find('/') != std::string::npos;
    std::string what;
    if (isPath) {
        if (fs::is_directory(name, failed)) return name;
        what = fs::exists(name, failed) ? "`" + name + "` is a file, not a robot folder"
                                        : "there is no robot folder `" + name + "`";
        if (fs::path(name).is_relative())
            what += " in " + fs::current_path(failed).string() + ", the folder that viable was called in";
    } else {
        if (!name.empty() && name != "." && name != "..")
            for (const fs::path& folder : searchPath)
                if (fs::is_directory(folder / name, failed)) return folder / name;
        what = "there is no robot called `" + name + "`";
    }

    std::vector<std::string> known;
    for (const fs::path& folder : listRobots(searchPath)) known.push_back(folder.filename().string());
    std::string remedy;
    if (!isPath && fs::is_directory(name, failed))
        remedy += "There is a folder of that name here: write `./" + name + "`. ";
    const std::string closest = findClosestName(fs::path(name).filename().string(), known);
    if (!closest.empty()) remedy += "Did you mean `" + closest + "`? ";
    remedy += known.empty() ? "No robot was found" : "There are " + joinNames(known);
    remedy += searchPath.empty() ? "; no folder was searched" : "; searched were";
    for (const fs::path& folder : searchPath) {
        remedy += (&folder == &searchPath.front() ? " " : ", ") + folder.string();
        if (!fs::is_directory(folder, failed)) remedy += " (no such folder)";
    }
    throw badInput(where, what, remedy + ".");
}

std::vector<fs::path> listRobots(const std::vector<fs::path>& searchPath) {
    std::vector<fs::path> robots;
    std::set<std::string> names;
    for (const fs::path& folder : searchPath) {
        std::error_code failed;
        std::vector<fs::path> here;
        for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end; entry.increment(failed))
            if (isRobotFolder(entry->path())) here.push_back(entry->path());
        std::sort(here.begin(), here.end());
        for (const fs::path& robot : here)
            if (names.insert(robot.filename().string()).second) robots.push_back(robot);
    }
    return robots;
}

RobotDescription withoutDynamics(RobotDescription robot) {
    const int n = robot.size();
    if (n > kMaxJoints) return robot;  // refused later
    for (JointDescription& joint : robot.joints) joint.body = {};
    robot.gravity.setZero();
    const JointVector ones = JointVector::Ones(n), none = JointVector::Zero(n);
    Actuation& a = robot.actuation;
    a.gearRatio = a.rotorInertia = ones;
    a.encoderCounts = none;
    a.torqueLimit = JointVector::Constant(n, kInfinity);
    a.friction.coulomb = a.friction.viscous = none;
    a.friction.viscousVelocity = ones;
    return robot;
}

void requireDynamics(const RobotDescription& robot, const std::string& place, const std::string& what) {
    if (robot.hasDynamics()) return;
    throw badInput(
        place,
        "the robot `" + robot.name + "` has no masses (`dynamics: none` in its actuation.yaml), and " + what +
            " needs them",
        "Lead it by positions: ReferenceGuard, or a case without robust_loop and real_plant. For torques begin "
        "the robot again without --without-masses.");
}

RobotDescription withPayload(RobotDescription robot, double mass_kg, const Eigen::Vector3d& offset) {
    if (!(mass_kg >= 0.0) || std::isinf(mass_kg) || !offset.allFinite())
        throw badInput("", "a payload of " + formatNumber(mass_kg) + " kg is not possible",
                       "A payload has a mass of zero or more and a finite place.");
    if (mass_kg > 0.0) requireDynamics(robot, "payload", "a payload");
    BodyInertia load;
    load.mass = mass_kg;
    load.com = robot.toolPlacement * offset;
    BodyInertia& body = robot.joints[robot.toolParent].body;
    body = detail::mergeBodies(body, load);
    return robot;
}

RobotDescription withScaledMasses(RobotDescription robot, const JointVector& factor) {
    VIABLE_CHECK(factor.size() == robot.size(), "one mass factor per joint");
    for (int i = 0; i < robot.size(); ++i) {
        if (!(factor[i] > 0.0) || std::isinf(factor[i]))
            throw badInput("", "the mass factor of joint `" + robot.joints[i].name + "` is " + formatNumber(factor[i]),
                           "A mass factor is positive and finite.");
        robot.joints[i].body.mass *= factor[i];
        robot.joints[i].body.inertia *= factor[i];
    }
    return robot;
}

}  // namespace viable
