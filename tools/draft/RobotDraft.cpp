#include "draft/RobotDraft.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "draft/BodyAssumptions.h"
#include "draft/Converter.h"
#include "draft/RobotAssumptions.h"
#include "robot/urdf/UrdfChecks.h"

namespace viable {

namespace {

using detail::UrdfRobot;

// What is taken for a slip: far outside of what is built, and within the errors of a wrong unit.
/** No slide of an arm: millimetres. [m] */
constexpr double kLongestSlide = 100.0;
/** No moving part of an arm: grams. [kg] */
constexpr double kHeaviestLink = 1000.0;
/** A centre of mass this many times as far from the link's origin as anything else of it: millimetres. */
constexpr double kFarCenter = 3.0;
/** How large a link is taken to be where the file shows nothing larger: for judging its centre of mass, and its
inertia. [m] */
constexpr double kAssumedReach = 0.5, kAssumedSize = 0.1;
/** A body's radius of gyration is at most its size: kg mm^2, or a placeholder of ones. */
constexpr double kLargeGyration = 3.0;
/** A rod's, 0.58 of its half length, is thirty times this share of its reach: t m^2, or a thousandth forgotten. */
constexpr double kSmallGyration = 0.02;
/** Principal moments below this share of the largest are zero. */
constexpr double kZeroMoment = 1e-9;
/** A home pose keeps this share of the range from both ends. */
constexpr double kHomeMargin = 0.1;

std::string show(double value) {
    return detail::format("%.3g", value);
}

std::string place(const std::string& where, const std::string& kind, const std::string& name) {
    return where + ": " + kind + " `" + name + "`: ";
}

// --------------------------------------------------------------------------------------- joints

DraftJoint draftJoint(const UrdfRobot& robot, int i, const DraftOptions& options, std::vector<std::string>& warnings) {
    const JointDescription& from = robot.joints[i];
    DraftJoint joint;
    joint.name = from.name;
    joint.type = from.type;
    joint.positionLower = robot.position.lower[i];
    joint.positionUpper = robot.position.upper[i];
    joint.velocity = robot.velocity.upper[i];
    joint.effort = robot.effort[i];
    const std::string who = place(robot.jointPlaces[i], "joint", joint.name);
    const auto blank = [&](const std::string& what, const std::string& key) {
        // A model has no word for the one, and the other may be unlimited; without masses nobody asks for torques.
        if (!options.mjcfConverter.empty() && key != "position_rad") return;
        if (!options.hasBodies && key == "torque_limit_Nm") return;
        warnings.push_back(who + what + "; " + key + (options.assumes ? " is assumed." : " is left to be filled in."));
    };

    const std::string range = show(joint.positionLower) + " to " + show(joint.positionUpper);
    const bool isAngle = joint.type != JointType::Prismatic;
    const double widest = std::max(std::abs(joint.positionLower), std::abs(joint.positionUpper));
    if (options.assumes && joint.positionLower > joint.positionUpper &&
        widest <= (isAngle ? kLargestAngle_rad : kLongestSlide)) {
        warnings.push_back(who + "its lower position limit is above the upper one, " + range +
                           "; taken the other way round.");
        std::swap(joint.positionLower, joint.positionUpper);
    }
    const double farthest = std::max(-joint.positionLower, joint.positionUpper);
    const double width = joint.positionUpper - joint.positionLower;
    const char* fault = nullptr;
    if (!(joint.positionLower < joint.positionUpper))
        fault = ", which leaves no range";
    else if (isAngle && joint.type != JointType::Continuous && farthest > kLargestAngle_rad)
        fault = ", more than two turns; URDF takes radians, and these are perhaps degrees";
    else if (!isAngle && farthest > kLongestSlide)
        fault = " m, longer than any slide; URDF takes metres, and these are perhaps millimetres";
    if (fault) {
        blank("its position limits are " + range + fault, "position_rad");
        joint.positionLower = joint.positionUpper = kNan;
    } else if (std::isfinite(width) && (!(joint.positionLower < 0.0 && joint.positionUpper > 0.0) ||
                                        std::min(-joint.positionLower, joint.positionUpper) < kHomeMargin * width)) {
        joint.home = 0.5 * (joint.positionLower + joint.positionUpper);
    }
    if (!(joint.velocity > 0.0) || !std::isfinite(joint.velocity)) {
        blank(joint.velocity > 0.0 ? "it has no velocity limit"
                                   : "its velocity limit is " + show(joint.velocity) + ", so it could not move",
              "velocity_radps");
        joint.velocity = kNan;
    }
    if (!(joint.effort > 0.0) || !std::isfinite(joint.effort)) {
        blank(joint.effort == 0.0 ? "its effort limit is 0 or missing: it has no torque"
                                  : "its effort limit is " + show(joint.effort),
              "torque_limit_Nm");
        joint.effort = kNan;
    }
    return joint;
}

/** What mjcf_to_urdf.py writes into <dynamics>. */
void readModelFigures(detail::UrdfDocument& document, RobotDraft& draft) {
    std::map<std::string, const detail::XmlElement*> figures;
    for (const detail::XmlElement* element : document.list("joint"))
        figures[detail::getAttribute(element, "name")] = element->FirstChildElement("dynamics");
    draft.isModel = draft.hasHome = true;
    for (DraftJoint& joint : draft.joints) {
        const auto read = [&](const char* name) {
            return detail::parseNumber(detail::getAttribute(figures[joint.name], name)).value_or(kNan);
        };
        joint.rotorInertia = read("armature");
        joint.coulomb = read("friction");
        joint.damping = read("damping");
        const double home = read("home");
        const bool isInside = home >= joint.positionLower && home <= joint.positionUpper;
        if (isInside) joint.home = home;
        draft.hasHome = draft.hasHome && isInside;
    }
}

// ---------------------------------------------------------------------------------------- links

/** Distance from `center` to the farthest corner of what is drawn of a link. Meshes are not read. [m] */
double calcShapeReach(const UrdfRobot& robot, const std::string& link, const Eigen::Vector3d& center) {
    const auto found = robot.shapes.find(link);
    double reach = 0.0;
    if (found == robot.shapes.end()) return reach;
    for (const LinkShape& shape : found->second.shapes) {
        using Kind = LinkShape::Kind;
        if (shape.kind == Kind::Capsule || shape.kind == Kind::Mesh) continue;
        const double size = shape.kind == Kind::Sphere ? shape.radius
                            : shape.kind == Kind::Box  ? 0.5 * shape.size.norm()
                                                       : std::hypot(0.5 * shape.length, shape.radius);
        reach = std::max(reach, (shape.pose.translation() - center).norm() + size);
    }
    return reach;
}

/** Distance from `center` to the farthest joint or corner of a link. [m] */
double calcReach(const UrdfRobot& robot, const UrdfRobot::Link& link, const Eigen::Vector3d& center) {
    double reach = calcShapeReach(robot, link.name, center);
    for (const Eigen::Vector3d& joint : link.joints) reach = std::max(reach, (joint - center).norm());
    return reach;
}

void reviewInertia(const UrdfRobot& robot, const UrdfRobot::Link& link, std::vector<std::string>& warnings) {
    const std::string who = place(link.place, "link", link.name);
    const BodyInertia& body = link.body;
    if (body.mass == 0.0) {
        if (robot.shapes.count(link.name))
            warnings.push_back(who + "it is drawn but has no mass" + (link.hasInertial ? "" : " (no <inertial>)") +
                               ", so it weighs nothing in the simulation. Give it its mass and "
                               "inertia, unless another link has them already.");
        return;
    }
    if (body.mass > kHeaviestLink)
        warnings.push_back(who + "its mass is " + show(body.mass) + " kg. URDF takes kilograms; are these grams?");

    const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    const double distance = body.com.norm();
    const double known = std::max(calcReach(robot, link, origin), kAssumedReach);
    const bool isFar = distance > kFarCenter * known;
    if (isFar)
        warnings.push_back(who + "its centre of mass is " + show(distance) +
                           " m from the link's origin, while nothing else of it is farther than " + show(known) +
                           " m. URDF takes metres; correct <origin> in its <inertial> (is it in "
                           "millimetres, or seen from another frame?).");

    const Eigen::Vector3d moments =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(body.inertia, Eigen::EigenvaluesOnly).eigenvalues();
    if (moments[0] <= kZeroMoment * moments[2]) {
        warnings.push_back(who +
                           (moments[2] > 0.0 ? "its smallest principal moment of inertia is zero, as of a rod "
                                               "without thickness"
                                             : "it has a mass but no inertia, as a point has") +
                           ". Correct <inertia>: every real body has three positive moments.");
        if (!(moments[2] > 0.0)) return;
    }
    const double gyration = std::sqrt(moments[2] / body.mass);
    const double size = std::max(isFar ? 0.0 : distance, calcReach(robot, link, body.com));
    const std::string compared =
        "for its mass of " + show(body.mass) + " kg: the radius of gyration is " + show(gyration) + " m, ";
    const char* const units = " URDF takes kg m^2 about the centre of mass; ";
    if (gyration > kLargeGyration * std::max(size, kAssumedSize))
        warnings.push_back(who + "its inertia is too large " + compared + "but the link reaches only " +
                           show(std::max(size, kAssumedSize)) + " m from there." + units +
                           "is it in kg mm^2 or g m^2, about another point, or a placeholder?");
    else if (gyration < kSmallGyration * size)
        warnings.push_back(who + "its inertia is too small " + compared + "but the link reaches " + show(size) +
                           " m from there." + units + "is it in t m^2, or a placeholder?");
}

}  // namespace

RobotDraft readRobotDraft(const std::filesystem::path& file, const DraftOptions& options) {
    RobotDraft draft;
    const bool isModel = !options.mjcfConverter.empty();
    bool isConverted = false;
    const auto expand = [&](const std::string& element, const std::string& where) {
        isConverted = element == "mujoco";
        if (isModel != isConverted)
            throw badInput(where, "this is " + std::string(isModel ? "no" : "a") + " MuJoCo model (MJCF)",
                           std::string("Give it with ") + (isModel ? "--urdf." : "--mjcf."));
        return isModel ? detail::convertMjcf(options.mjcfConverter, file, draft.repairs)
                       : detail::expandXacro(file, where);
    };
    detail::UrdfDocument document(file, isModel || options.assumes ? expand : detail::UrdfDocument::Expand());
    if (isModel && !isConverted)
        throw badInput(file.string(), "this is no MuJoCo model (MJCF): its root is <robot>", "Give it with --urdf.");
    detail::ErrorList urdfErrors;
    draft.repairs.insert(draft.repairs.begin(), document.notes().begin(), document.notes().end());
    const auto addRepairs = [&](const std::vector<std::string>& notes) {
        draft.repairs.insert(draft.repairs.end(), notes.begin(), notes.end());
    };
    if (options.assumes) addRepairs(detail::repairUrdfTree(document));
    draft.hasBodies = options.hasBodies;
    if (!options.hasBodies) {
        document.dropBodies();
        draft.repairs.push_back(document.file() + ": masses and inertias are left out");
    }
    detail::checkUrdfTree(document, urdfErrors);
    const detail::UrdfRepairs repairs = detail::repairUrdf(document, options.choice, options.assumes, urdfErrors);
    addRepairs(repairs.notes);
    UrdfRobot robot = detail::readUrdf(document, urdfErrors);
    draft.links = detail::draftLinks(robot, std::filesystem::absolute(file).parent_path());
    if (!repairs.bodies.empty()) {
        detail::assumeBodies(document, robot, repairs.bodies, draft);
        robot = detail::readUrdf(document, {});
    }
    if (!repairs.inertias.empty())
        draft.assumptions.push_back(
            {"inertia",
             detail::join(repairs.inertias) + ": the tensor that a body can have and that is nearest to the given"});
    draft.urdf = draft.repairs.empty() ? document.text() : document.print();

    for (int i = 0; i < static_cast<int>(robot.joints.size()); ++i)
        draft.joints.push_back(draftJoint(robot, i, options, draft.warnings));
    if (isModel) readModelFigures(document, draft);
    for (const UrdfRobot::Link& link : robot.bodies) {
        if (link.carrier < 0) continue;
        if (options.hasBodies) reviewInertia(robot, link, draft.warnings);
        if (link.joints.empty()) draft.toolLinks.push_back(link.name);
    }
    if (!repairs.tip.empty())
        draft.tool = repairs.tip;
    else if (draft.toolLinks.size() == 1)
        draft.tool = draft.toolLinks.front();
    for (const auto& [name, link] : robot.shapes)
        for (const LinkShape& shape : link.shapes)
            if (shape.kind == LinkShape::Kind::Mesh &&
                std::find(draft.meshes.begin(), draft.meshes.end(), shape.mesh) == draft.meshes.end())
                draft.meshes.push_back(shape.mesh);
    const detail::LinkDistances distances(robot, draft.links);
    draft.contacts = detail::draftContacts(robot, draft, distances);
    if (options.assumes) detail::assumeFigures(robot, distances, draft);
    for (DraftContact& contact : detail::draftHomeContacts(draft, distances))
        draft.contacts.push_back(std::move(contact));
    return draft;
}

}  // namespace viable
