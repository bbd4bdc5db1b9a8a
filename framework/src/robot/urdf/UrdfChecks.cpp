#include "robot/urdf/UrdfChecks.h"

#include <algorithm>

#include "core/Text.h"
#include "robot/RigidBody.h"

namespace viable::detail {

namespace {

constexpr const char* kOpenLoop = "An arm is a tree of links: open the loop.";
constexpr const char* kKinds =
    "Supported are revolute, continuous, prismatic and fixed; replace it by such joints, or freeze it: `viable new "
    "robot NAME --urdf FILE --fix JOINT`, or --assume where it is floating or planar.";
constexpr const char* kAssumesMass = "`viable new robot --assume` takes a mass from the shapes.";
constexpr std::size_t kMostChains = 12;
/** Names that are compared with all others, for a suggestion. */
constexpr int kMostSearches = 20;

/** What to do about too many joints: the chains there are, longest first, and how to take one. */
std::string proposeChains(const std::string& file, const UrdfTree& tree) {
    const std::vector<UrdfChain> chains = tree.listChains();
    std::string text;
    for (std::size_t k = 0; k < std::min(chains.size(), kMostChains); ++k) addItem(text, tree.describe(chains[k]));
    if (chains.size() > kMostChains) text += ", ...";
    const auto write = [&](const UrdfChain& chain, const std::string& name) {
        const std::vector<int> joints = tree.listJoints(chain);
        std::string command = "`viable new robot " + name + " --urdf " + quoteForShell(file) + " --tip " +
                              quoteForShell(tree.links[tree.findEnd(chain)].name);
        if (joints.size() > kMaxJoints)
            command += " --base " + quoteForShell(tree.joints[joints[joints.size() - kMaxJoints]].parent);
        return command + "`";
    };
    const bool hasTwo = chains.size() > 1 && chains[0].count == chains[1].count && chains[0].length == chains[1].length;
    return (hasTwo ? "Take one chain; the other joints are frozen, where --at JOINT=VALUE puts them. There are two "
                     "alike: " +
                         write(chains[0], "ONE") + " and " + write(chains[1], "OTHER")
                   : "Take one chain, such as " + write(chains[0], "NAME") +
                         "; the other joints are frozen, where --at JOINT=VALUE puts them") +
           ". --tip auto takes the longest. Chains end at (moving joints from the base): " + text + ".";
}

void checkJoint(const UrdfDocument& document, const UrdfTree::Joint& joint, ErrorList& errors) {
    const std::string where = document.place(*joint.element);
    const std::string who = "joint " + quoteName(joint.name);
    if (!readOrigin(*joint.element))
        errors.add(where, "the origin of " + who + " does not consist of finite numbers",
                   "Correct its xyz and rpy, three numbers each; --assume does not guess.");
    if (!joint.isMoving) return;
    const bool isLimited = joint.type == "revolute" || joint.type == "prismatic";
    if (joint.type == "floating")
        return errors.add(where, who + " is of type floating, but the base must be fixed", kKinds);
    if (joint.type == "planar") return errors.add(where, who + " is of type planar", kKinds);
    if (!isLimited && joint.type != "continuous") {
        const std::string closest = findClosestName(joint.type, {"fixed", "revolute", "continuous", "prismatic"});
        return errors.add(
            where, who + (joint.type.empty() ? " has no type" : " is of an unknown type, " + quoteName(joint.type)),
            (joint.type.empty() || closest.empty()
                 ? ""
                 : "Did you mean " + quoteName(closest) + "? `viable new robot --assume` takes it so. ") +
                kKinds);
    }
    if (const XmlElement* mimic = joint.element->FirstChildElement("mimic"))
        errors.add(
            where,
            who + " mimics joint " + quoteName(getAttribute(mimic, "joint")) + ", but coupled joints are not supported",
            "Make it fixed, or remove <mimic> to drive it by itself.");
    if (!readAxis(*joint.element))
        errors.add(where, "the axis of " + who + " has no direction",
                   "Give <axis xyz=\"...\"/> three numbers, such as \"0 0 1\".");
    const XmlElement* limit = joint.element->FirstChildElement("limit");
    std::string missing, wrong;
    if (!limit && isLimited) missing = "<limit>";
    for (const char* attribute : {"effort", "velocity"})
        if (limit && !limit->Attribute(attribute)) addItem(missing, quoteName(attribute), " and no ");
    for (const char* attribute : {"lower", "upper", "effort", "velocity"})
        if (limit && limit->Attribute(attribute) && !parseNumber(limit->Attribute(attribute)))
            addItem(wrong, quoteName(attribute) + " is \"" + limit->Attribute(attribute) + "\"");
    if (!wrong.empty())
        errors.add(where, "in the <limit> of " + who + ", " + wrong + ": no finite number",
                   "Write a number in radians, metres, newtons or newton metres.");
    if (!missing.empty())
        errors.add(where, who + " of type " + joint.type + " has no " + missing + (limit ? " in its <limit>" : ""),
                   "Write <limit lower=\"..\" upper=\"..\" effort=\"..\" velocity=\"..\"/>, with 0 for an effort or a "
                   "velocity that is not known: limits.yaml and actuation.yaml give it then.");
}

/** The mass that the link's <inertial> states, 0 where it states none. */
double checkInertial(const UrdfDocument& document, const UrdfTree::Link& link, ErrorList& errors) {
    const XmlElement* inertial = link.element->FirstChildElement("inertial");
    if (!inertial) return 0.0;
    const std::string where = document.place(*link.element);
    const std::string name = "link " + quoteName(link.name) + ": ";
    const std::optional<UrdfInertial> read = readInertial(*inertial);
    if (!read) {
        errors.add(where, name + "the <inertial> element is incomplete or holds numbers that are not finite",
                   "It takes <origin xyz=\"...\" rpy=\"...\"/>, <mass value=\"...\"/> and <inertia> with ixx, ixy, "
                   "ixz, iyy, iyz and izz. `viable new robot --assume` adds what is missing, from the link's shapes.");
        return 1.0;  // unknown, and told
    }
    if (read->mass < 0.0)
        errors.add(where, name + "the mass is " + formatNumber(read->mass) + " kg",
                   std::string("A mass is zero or positive. ") + kAssumesMass);
    else if (read->mass == 0.0 && !read->inertia.isZero(0.0))
        errors.add(where, name + "there is an inertia without a mass",
                   std::string("Give the link its mass, or make all six inertia entries zero. ") + kAssumesMass);
    else if (const std::string fault = findInertiaFault(read->inertia, false); !fault.empty())
        errors.add(where, name + fault,
                   "Correct <inertia>: URDF takes the tensor about the centre of mass, with ixy = -integral of x y dm; "
                   "some CAD programs export the other sign, or the tensor about the link's origin. `viable new robot "
                   "--assume` takes the nearest that a body can have.");
    else
        return read->mass;
    return 1.0;  // a fault of its own, told already
}

}  // namespace

void checkUrdfTree(UrdfDocument& document, ErrorList& errors) {
    for (const char* tag : {"joint", "link"}) {
        std::map<std::string, const XmlElement*> first;
        for (const XmlElement* element : document.list(tag)) {
            const std::string name = getAttribute(element, "name");
            if (name.empty()) {
                errors.add(document.place(*element), "the " + std::string(tag) + " has no name",
                           std::string("Add the attribute `name`.") +
                               (tag == std::string("joint") ? " `viable new robot --assume` names it." : ""));
                continue;
            }
            const auto [other, isNew] = first.emplace(name, element);
            if (!isNew)
                errors.add(document.place(*element),
                           "there is a second " + std::string(tag) + " " + quoteName(name) + "; the first is at line " +
                               std::to_string(other->second->GetLineNum()),
                           std::string("Give each a name of its own. `viable new robot --assume` ") +
                               (tag == std::string("joint") ? "does so." : "drops it where both are the same."));
        }
    }
    const UrdfTree tree(document);
    std::vector<std::string> names;
    for (const UrdfTree::Link& link : tree.links) names.push_back(link.name);
    int searches = 0;
    std::map<std::string, std::string> carrier;
    for (const UrdfTree::Joint& joint : tree.joints) {
        const std::string where = document.place(*joint.element);
        const std::string who = "joint " + quoteName(joint.name);
        for (const bool isChild : {false, true}) {
            const std::string& link = isChild ? joint.child : joint.parent;
            const std::string tag = isChild ? "child" : "parent";
            if (link.empty())
                errors.add(where, who + " names no " + tag + " link", "Add <" + tag + " link=\"...\"/>.");
            else if (tree.find.count(link) == 0) {
                const std::string closest = ++searches > kMostSearches ? "" : findClosestName(link, names);
                errors.add(where, "the " + tag + " link " + quoteName(link) + " of " + who + " was not found",
                           (closest.empty() ? "Add the link, or correct its name."
                                            : "Did you mean " + quoteName(closest) + "?") +
                               " `viable new robot --assume` takes the one of both that makes a tree.");
            }
        }
        const auto [other, isNew] = carrier.emplace(joint.child, joint.name);
        if (!isNew && !joint.child.empty())
            errors.add(where,
                       "link " + quoteName(joint.child) + " is the child of two joints, " + quoteName(other->second) +
                           " and " + quoteName(joint.name),
                       kOpenLoop);
    }
    if (tree.links.empty())
        return errors.add(document.file(), "the robot has no links", "A URDF names links, and joints between them.");
    if (!errors.isEmpty()) return;  // what hangs together is known only then
    std::vector<bool> isReached(tree.joints.size());
    for (const int j : tree.outwards) isReached[j] = true;
    const UrdfTree::Link* base = nullptr;
    for (const UrdfTree::Link& link : tree.links) {
        if (link.carrier < 0 && !base) {
            base = &link;
        } else if (link.carrier < 0) {
            errors.add(document.place(*link.element),
                       "link " + quoteName(link.name) + " is not connected; the base is link " + quoteName(base->name),
                       "Add the joint that carries it, or remove it. `viable new robot --assume` leaves out what has "
                       "no moving joint.");
        } else if (!isReached[link.carrier]) {
            const UrdfTree::Joint& joint = tree.joints[link.carrier];
            errors.add(document.place(*joint.element),
                       "joint " + quoteName(joint.name) + " is part of a loop, or hangs on one", kOpenLoop);
        }
    }
}

void checkUrdfElements(UrdfDocument& document, ErrorList& errors) {
    const bool isWhole = errors.isEmpty();
    const UrdfTree tree(document);
    const auto moving = std::count_if(tree.joints.begin(), tree.joints.end(),
                                      [](const UrdfTree::Joint& joint) { return joint.isMoving; });
    if (isWhole && moving > kMaxJoints)  // all else may be about joints that nobody wants to move
        return errors.add(document.file(),
                          "the robot has " + std::to_string(moving) + " moving joints; at most " +
                              std::to_string(kMaxJoints) + " are supported",
                          proposeChains(document.file(), tree));
    for (const UrdfTree::Joint& joint : tree.joints) checkJoint(document, joint, errors);
    const std::vector<bool> isMoved = tree.findMoved();
    std::vector<bool> hasMass(tree.links.size());
    for (std::size_t i = 0; i < tree.links.size(); ++i)
        if (isMoved[i]) hasMass[i] = checkInertial(document, tree.links[i], errors) > 0.0;
    const std::vector<bool> carriesMass = tree.findCarried(hasMass);
    for (const int j : tree.outwards) {
        const UrdfTree::Joint& joint = tree.joints[j];
        if (!joint.isMoving || carriesMass[j] || !document.hasBodies()) continue;
        errors.add(document.place(*tree.links[joint.childLink].element),
                   "link " + quoteName(joint.child) + ", moved by joint " + quoteName(joint.name) + ", has no mass",
                   std::string("Give it an <inertial> element with mass and inertia, or make the joint fixed. ") +
                       kAssumesMass);
    }
    if (isWhole && moving == 0)
        errors.add(document.file(), "the robot has no moving joint",
                   "At least one revolute, continuous or prismatic joint is needed.");
}

}  // namespace viable::detail
