#include "draft/UrdfRepair.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/Text.h"

namespace viable::detail {

namespace {

/** A tensor that is off by more is not rounded but wrong. */
constexpr double kLargestInertiaSlip = 0.05;
/** Moments are mended to this much better than the limit, so that rounding does not undo it. */
constexpr double kInertiaMargin = 1e-9;
/** Of an assumed tensor: smallest moment, as a share of the largest. That of a rod ten times as long as thick. */
constexpr double kThinShare = 0.01;

/** Joints that mimic each other in a row; more go in a circle. */
constexpr int kMostFollowed = 16;

/** Words in the names of joints that open and close something. */
constexpr std::initializer_list<const char*> kGripperWords = {"finger", "gripper", "jaw", "knuckle", "claw", "thumb"};

/** Names for a message, not all of a large robot's. */
std::string listSome(std::vector<std::string> names) {
    constexpr std::size_t kMost = 40;
    if (names.size() <= kMost) return join(names);
    const std::string more = " and " + std::to_string(names.size() - kMost) + " more";
    names.resize(kMost);
    return join(names) + more;
}

void setVector(XmlElement& element, const char* name, const Eigen::Vector3d& v) {
    element.SetAttribute(name, (formatNumber(v.x()) + " " + formatNumber(v.y()) + " " + formatNumber(v.z())).c_str());
}

/** Writes the six entries of an <inertia>. */
void writeTensor(XmlElement& tensor, const Eigen::Matrix3d& I) {
    const char* const names[3][3] = {{"ixx", "ixy", "ixz"}, {"", "iyy", "iyz"}, {"", "", "izz"}};
    for (int i = 0; i < 3; ++i)
        for (int k = i; k < 3; ++k) tensor.SetAttribute(names[i][k], formatNumber(I(i, k)).c_str());
}

/** The element in it of that name, added where there is none. */
XmlElement& demandChild(XmlElement& parent, const char* name) {
    XmlElement* child = parent.FirstChildElement(name);
    return child ? *child : *parent.InsertNewChildElement(name);
}

/** The nearest principal moments (Frobenius norm) that a body can have, of ones in ascending order that none has; zeros
where there are none.
@param thickens  a rod without thickness gets one */
Eigen::Vector3d findNearestMoments(const Eigen::Vector3d& moments, bool thickens) {
    // A third of the excess to each, and a hair more, so that rounding does not undo it.
    const double share = std::max(0.0, moments[2] - moments[0] - moments[1] + kInertiaMargin * moments[2]) / 3.0;
    const Eigen::Vector3d near = moments + Eigen::Vector3d(share, share, -share);
    const double least = kInertiaMargin * near[2];  // or the second moment would pass the sum of the others
    if (near[0] > least) return near;
    if (!thickens && moments[0] >= 0.0 && least > 0.0) return {least, near[1], near[2]};
    const double rod = 0.5 * (moments[1] + moments[2]);
    return rod > 0.0 ? Eigen::Vector3d(kThinShare * rod, rod, rod) : Eigen::Vector3d::Zero();
}

std::string showMoments(const Eigen::Vector3d& m) {
    return format("%.3g, %.3g, %.3g kg m^2", m[0], m[1], m[2]);
}

class Repair {
public:
    Repair(UrdfDocument& document, const UrdfChoice& choice, bool assumes, ErrorList& errors)
        : document_(document), tree_(document), choice_(choice), assumes_(assumes), errors_(errors) {}

    UrdfRepairs run() {
        const bool isWhole = errors_.isEmpty();
        for (std::size_t j = 0; j < tree_.joints.size(); ++j)
            byName_.emplace(tree_.joints[j].name, static_cast<int>(j));
        readChoice();
        findRests();
        for (const int j : fixed_) freezeAndNote(joint(j), "--fix");
        if (assumes_)
            for (UrdfTree::Joint& joint : tree_.joints)
                if (joint.type == "floating" || joint.type == "planar")
                    freezeAndNote(joint, "it is of type " + joint.type + ", and the base of an arm stays where it is");
        if (isWhole && errors_.isEmpty()) freezeOutsideOfChain();
        freezeCoupled();
        freezeGrippers();
        if (assumes_)
            for (const UrdfTree::Link& link : tree_.links) dropFalseBody(link);
        if (document_.hasBodies()) freezeWeightless();
        if (isWhole && errors_.isEmpty() && choice_.tip == kAutoTip) chooseTip();
        for (const auto& [j, value] : places_)
            if (joint(j).isMoving)
                errors_.add("--at", "joint " + quoteName(joint(j).name) + " is one of those that move",
                            "Write --fix " + joint(j).name + "=" + formatNumber(value) + " to freeze it there.");
        if (std::count_if(tree_.joints.begin(), tree_.joints.end(),
                          [](const UrdfTree::Joint& joint) { return joint.isMoving; }) > kMaxJoints)
            return std::move(repairs_);  // refused in any case
        for (const UrdfTree::Joint& joint : tree_.joints)
            if (joint.isMoving) addLimits(joint);
        const std::vector<bool> isMoved = tree_.findMoved();
        for (std::size_t i = 0; i < tree_.links.size(); ++i) mendInertia(tree_.links[i], assumes_ && isMoved[i]);
        if (assumes_ && isWhole && document_.hasBodies()) addBodies();
        return std::move(repairs_);
    }

private:
    UrdfTree::Joint& joint(int j) { return tree_.joints[j]; }
    const UrdfTree::Link& link(int i) const { return tree_.links[i]; }
    std::string place(const UrdfTree::Joint& joint) const { return document_.place(*joint.element); }
    void note(const XmlElement& element, const std::string& text) {
        repairs_.notes.push_back(document_.place(element) + ": " + text);
    }

    // ------------------------------------------------------------------------------------ choice

    int findJoint(const std::string& name) const {
        const auto found = byName_.find(name);
        return found != byName_.end() ? found->second : -1;
    }

    /** Index of the link that an option names, -1: none. */
    int requireLink(const char* option, const std::string& name) {
        if (name.empty()) return -1;
        const auto found = tree_.find.find(name);
        if (found != tree_.find.end()) return found->second;
        std::vector<std::string> names;
        for (const UrdfTree::Link& known : tree_.links) names.push_back(known.name);
        const std::string closest = findClosestName(name, names);
        errors_.add(option, "the robot has no link " + quoteName(name),
                    (closest.empty() ? "" : "Did you mean " + quoteName(closest) + "? ") + "Its links are " +
                        listSome(names) + ".");
        return -1;
    }

    void readChoice() {
        const int base = requireLink("--base", choice_.base);
        const int tip = choice_.tip == kAutoTip ? -1 : requireLink("--tip", choice_.tip);
        setTip(tip);
        if (base >= 0) {
            below_.assign(tree_.joints.size(), false);
            std::vector<bool> isBelow(tree_.links.size());
            isBelow[base] = true;
            for (const int j : tree_.outwards)
                if (isBelow[joint(j).parentLink]) below_[j] = isBelow[joint(j).childLink] = true;
            if (tip >= 0 && !isBelow[tip])
                errors_.add(
                    "--tip", "link " + quoteName(choice_.tip) + " does not hang on the base " + quoteName(choice_.base),
                    "Name a base on the way to the tip" +
                        std::string(onTip_.empty() ? "."
                                                   : ", such as " + quoteName(joint(onTip_.back()).parent) + "."));
        }
        if (tip >= 0 && std::none_of(onTip_.begin(), onTip_.end(),
                                     [&](int j) { return joint(j).isMoving && (below_.empty() || below_[j]); }))
            errors_.add("--tip", "no joint moves link " + quoteName(choice_.tip), "Name a link at the end of the arm.");
        for (const std::string& text : choice_.fixed) readPlace(text, "--fix");
        for (const std::string& text : choice_.at) readPlace(text, "--at");
    }

    void setTip(int tip) {
        if (tip >= 0) repairs_.tip = link(tip).name;
        onTip_ = tip < 0 ? std::vector<int>{} : tree_.listJointsAbove(tip);
        isOnTip_.assign(tree_.joints.size(), false);
        for (const int j : onTip_) isOnTip_[j] = true;
    }

    /** The end of the longest arm there is, and all else frozen. */
    void chooseTip() {
        const std::vector<UrdfChain> chains = tree_.listChains();
        if (chains.empty()) return;
        setTip(tree_.findEnd(chains.front()));
        note(*link(tree_.find.at(repairs_.tip)).element,
             "--tip auto takes the longest arm, that of " + tree_.describe(chains.front()) +
                 (chains.size() > 1 ? "; the next is that of " + tree_.describe(chains[1]) + ": --tip " +
                                          link(tree_.findEnd(chains[1])).name
                                    : ""));
        freezeOutsideOfChain();
    }

    /** @param option  --fix or --at */
    void readPlace(const std::string& text, const std::string& option) {
        const std::size_t sign = text.rfind('=');
        const std::string name = findJoint(text) >= 0 ? text : text.substr(0, sign);
        const int j = findJoint(name);
        if (j < 0) {
            std::vector<std::string> names;
            for (const UrdfTree::Joint& known : tree_.joints)
                if (known.isMoving) names.push_back(known.name);
            const std::string closest = findClosestName(name, names);
            return errors_.add(option, "the robot has no joint " + quoteName(name),
                               (closest.empty() ? "" : "Did you mean " + quoteName(closest) + "? ") +
                                   "Its moving joints are " + listSome(names) + ".");
        }
        if (!joint(j).isMoving)
            return errors_.add(option, "joint " + quoteName(name) + " is fixed already", "Leave it out.");
        if (fixed_.count(j) + places_.count(j) > 0)
            return errors_.add(option, "joint " + quoteName(name) + " is named twice", "Name it once.");
        if (name != text && (joint(j).type == "floating" || joint(j).type == "planar"))
            return errors_.add(option,
                               "joint " + quoteName(name) + " of type " + joint(j).type + " has no single position",
                               "Write --fix " + name + ": it stays where its <origin> puts it.");
        if (name != text) {
            const std::optional<double> given = parseNumber(text.substr(sign + 1));
            double lower, upper;
            if (!given)
                return errors_.add(option,
                                   "`" + text.substr(sign + 1) + "` is no position for joint " + quoteName(name),
                                   "Write " + option + " " + name + "=0.5, in radians or metres.");
            if (readRange(joint(j), lower, upper) && (*given < lower || *given > upper))
                return errors_.add(option,
                                   "joint " + quoteName(name) + " cannot be at " + formatNumber(*given) +
                                       ": its limits are " + formatNumber(lower) + " to " + formatNumber(upper),
                                   "Choose a position inside them.");
            places_[j] = *given;
        } else if (option == "--at") {
            return errors_.add(option, "no position is given for joint " + quoteName(name),
                               "Write --at " + name + "=0.5, in radians or metres.");
        }
        if (option == "--fix") fixed_.insert(j);
    }

    /** The position limits of a joint that has a range. */
    static bool readRange(const UrdfTree::Joint& joint, double& lower, double& upper) {
        const XmlElement* limit = joint.element->FirstChildElement("limit");
        if (joint.type != "revolute" && joint.type != "prismatic") return false;
        lower = parseNumber(getAttribute(limit, "lower")).value_or(0.0);
        upper = parseNumber(getAttribute(limit, "upper")).value_or(0.0);
        return lower < upper;
    }

    /** Where a joint is that nobody moves: where --fix or --at puts it, where the joint that it mimics leaves it, at zero, or in the
    middle of a range that does not hold zero. Nothing where its <mimic>, or one of those that it follows, leads nowhere. */
    std::optional<double> findRest(int j, int followed) const {
        if (const auto place = places_.find(j); place != places_.end()) return place->second;
        const UrdfTree::Joint& at = tree_.joints[j];
        if (const XmlElement* mimic = at.element->FirstChildElement("mimic")) {
            const int leader = findJoint(getAttribute(mimic, "joint"));
            if (leader < 0 || followed == kMostFollowed) return {};
            const std::optional<double> there = findRest(leader, followed + 1);
            const auto multiplier = mimic->Attribute("multiplier") ? parseNumber(mimic->Attribute("multiplier")) : 1.0;
            const auto offset = mimic->Attribute("offset") ? parseNumber(mimic->Attribute("offset")) : 0.0;
            if (!there || !multiplier || !offset) return {};
            return *multiplier * *there + *offset;
        }
        double lower, upper;
        if (!readRange(at, lower, upper) || (lower <= 0.0 && upper >= 0.0)) return 0.0;
        return 0.5 * (lower + upper);
    }

    void findRests() {
        for (std::size_t j = 0; j < tree_.joints.size(); ++j) {
            const UrdfTree::Joint& joint = tree_.joints[j];
            if (!joint.isMoving) continue;
            const std::optional<double> rest = findRest(static_cast<int>(j), 0);
            rest_[static_cast<int>(j)] = rest.value_or(0.0);
            if (rest) continue;
            const std::string leader = getAttribute(joint.element->FirstChildElement("mimic"), "joint");
            if (assumes_ && findJoint(leader) < 0) continue;  // told where it is frozen
            errors_.add(
                place(joint),
                "joint " + quoteName(joint.name) + " mimics joint " + quoteName(leader) +
                    (findJoint(leader) < 0 ? ", which is not there"
                                           : ", but where that leaves it is not known: a multiplier or an offset "
                                             "is no number, or joints mimic each other in a circle"),
                "Correct <mimic>, or write --fix " + joint.name + "=VALUE.");
        }
    }

    // ------------------------------------------------------------------------------------ joints

    double getRest(const UrdfTree::Joint& joint) const {
        return rest_.at(static_cast<int>(&joint - tree_.joints.data()));
    }

    /** Makes a joint fixed at rest; one whose frame cannot be read stays, for the checks. */
    bool freeze(UrdfTree::Joint& joint) {
        const double value = getRest(joint);
        const auto origin = readOrigin(*joint.element);
        const auto axis = readAxis(*joint.element);
        if (!origin || (!axis && value != 0.0)) return false;
        XmlElement& element = *joint.element;
        if (value != 0.0) {
            Eigen::Isometry3d pose = *origin;
            if (joint.type == "prismatic")
                pose.translate(value * *axis);
            else
                pose.rotate(Eigen::AngleAxisd(value, *axis));
            const Eigen::Matrix3d& R = pose.linear();
            const double pitch = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
            // Upright, roll and yaw turn about one axis: all of it is yaw.
            const bool isUpright = std::hypot(R(0, 0), R(1, 0)) < 1e-9;
            const double roll = isUpright ? 0.0 : std::atan2(R(2, 1), R(2, 2));
            const double yaw = isUpright ? std::atan2(-R(0, 1), R(1, 1)) : std::atan2(R(1, 0), R(0, 0));
            XmlElement& to = demandChild(element, "origin");
            setVector(to, "xyz", pose.translation());
            setVector(to, "rpy", {roll, pitch, yaw});
        }
        element.SetAttribute("type", "fixed");
        for (const char* tag : {"axis", "limit", "mimic", "calibration", "dynamics", "safety_controller"})
            while (XmlElement* child = element.FirstChildElement(tag)) element.DeleteChild(child);
        joint.isMoving = false;
        return true;
    }

    void freezeAndNote(UrdfTree::Joint& joint, const std::string& why) {
        const XmlElement& element = *joint.element;
        if (freeze(joint))
            note(element,
                 "joint " + quoteName(joint.name) + " is frozen at " + formatNumber(getRest(joint)) + ": " + why);
    }

    bool isOnChain(int j) const { return isOnTip_[j]; }

    void freezeOutsideOfChain() {
        std::vector<std::string> frozen;
        for (std::size_t j = 0; j < tree_.joints.size(); ++j) {
            const bool isOutside =
                (!below_.empty() && !below_[j]) || (!repairs_.tip.empty() && !isOnChain(static_cast<int>(j)));
            UrdfTree::Joint& outside = tree_.joints[j];
            if (!isOutside || !outside.isMoving) continue;
            if (freeze(outside)) frozen.push_back(outside.name + " at " + formatNumber(getRest(outside)));
        }
        if (!frozen.empty())
            repairs_.notes.push_back(document_.file() + ": outside of the chosen chain, and frozen: " + join(frozen));
    }

    void freezeCoupled() {
        for (UrdfTree::Joint& coupled : tree_.joints) {
            const XmlElement* mimic = coupled.element->FirstChildElement("mimic");
            if (!coupled.isMoving || !mimic || isOnChain(findJoint(coupled.name))) continue;
            const std::string leader = getAttribute(mimic, "joint");
            leaders_.insert(findJoint(leader));
            freezeAndNote(coupled, "it mimics joint " + quoteName(leader) +
                                       (findJoint(leader) < 0 ? ", which is not there" : ""));
        }
    }

    /** Freezes moving joints, from the ends inwards, for which `isFree` holds once no joint beyond them moves; none where
    that would leave no joint to move. `explain`: why. */
    template <class IsFree, class Explain>
    void freezeEnds(const IsFree& isFree, const Explain& explain) {
        std::vector<bool> beyond(tree_.joints.size());
        std::vector<int> ends;
        int moving = 0;
        for (auto at = tree_.outwards.rbegin(); at != tree_.outwards.rend(); ++at) {
            const int j = *at;
            moving += joint(j).isMoving ? 1 : 0;
            const bool isEnd = joint(j).isMoving && !beyond[j] && isFree(j);
            if (isEnd) ends.push_back(j);
            const int before = link(joint(j).parentLink).carrier;
            if (before >= 0 && ((joint(j).isMoving && !isEnd) || beyond[j])) beyond[before] = true;
        }
        if (static_cast<int>(ends.size()) == moving) return;
        for (const int j : ends) freezeAndNote(joint(j), explain(j));
    }

    /** What the names of all moving joints begin with, such as that of the robot. */
    std::size_t findCommonPrefix() const {
        const std::string* first = nullptr;
        std::size_t length = 0;
        for (const UrdfTree::Joint& joint : tree_.joints) {
            if (!joint.isMoving) continue;
            if (!first) {
                first = &joint.name;
                length = first->size();
                continue;
            }
            length =
                std::mismatch(first->begin(), first->begin() + length, joint.name.begin(), joint.name.end()).first -
                first->begin();
        }
        // Whole words, or it would cut into `jaw` where others are called `joint1`.
        const std::size_t last = first ? first->find_last_of("_-/.:", length) : std::string::npos;
        return length == 0 || last == std::string::npos || last >= length ? 0 : last + 1;
    }

    void freezeGrippers() {
        const std::size_t prefix = findCommonPrefix();
        const auto isLed = [&](int j) { return leaders_.count(j) > 0; };
        freezeEnds(
            [&](int j) {
                return !isOnChain(j) && (isLed(j) || holdsWord(joint(j).name.substr(prefix), kGripperWords));
            },
            [&](int j) {
                return std::string(isLed(j) ? "it ends the arm and others mimic it, as the joint of a gripper"
                                            : "it ends the arm and is named as the joint of a gripper") +
                       " (to move it: --tip " + joint(j).child + ")";
            });
    }

    void freezeWeightless() {
        std::vector<bool> hasMass(tree_.links.size());
        for (std::size_t i = 0; i < tree_.links.size(); ++i) {
            const XmlElement* inertial = tree_.links[i].element->FirstChildElement("inertial");
            const auto read = inertial ? readInertial(*inertial) : std::nullopt;
            hasMass[i] = inertial && (!read || read->mass != 0.0);  // what cannot be read is told by the checks
            const XmlElement& element = *tree_.links[i].element;    // a drawn link gets its mass where it has none
            if (assumes_ && (element.FirstChildElement("visual") || element.FirstChildElement("collision")))
                hasMass[i] = true;
        }
        const std::vector<bool> carries = tree_.findCarried(hasMass);
        freezeEnds([&](int j) { return !carries[j]; }, [](int) { return "nothing that it moves has a mass"; });
    }

    void addLimits(const UrdfTree::Joint& joint) {
        if (joint.type != "revolute" && joint.type != "prismatic" && joint.type != "continuous") return;
        XmlElement* limit = joint.element->FirstChildElement("limit");
        if (!limit && joint.type == "continuous") return;
        std::string added;
        if (!limit) {
            limit = joint.element->InsertNewChildElement("limit");
            added = "<limit>";
        }
        for (const char* name : {"effort", "velocity"}) {
            if (limit->Attribute(name)) continue;
            limit->SetAttribute(name, "0");
            if (added != "<limit>") addItem(added, quoteName(name), " and ");
        }
        if (!added.empty())
            note(*joint.element, "joint " + quoteName(joint.name) + " had no " + added +
                                     (added == "<limit>" ? "" : " in its <limit>") + ": 0 stands for it");
    }

    // ------------------------------------------------------------------------------------ bodies

    /** Takes away an <inertial> that states no mass that a body can have. What is no number stays, for the checks. */
    void dropFalseBody(const UrdfTree::Link& link) {
        XmlElement* inertial = link.element->FirstChildElement("inertial");
        if (!inertial) return;
        const std::string written = getAttribute(inertial->FirstChildElement("mass"), "value");
        const std::optional<double> mass = parseNumber(written);
        const auto read = readInertial(*inertial);
        if (!written.empty() && (!mass || *mass > 0.0 || (*mass == 0.0 && read && read->inertia.isZero(0.0)))) return;
        note(*link.element, "link " + quoteName(link.name) + ": its <inertial> is left out, because " +
                                (written.empty() ? "it states no mass" : "its mass is " + written + " kg"));
        link.element->DeleteChild(inertial);
    }

    /** @param assumes  what is further off than rounding becomes that of a body, too */
    void mendInertia(const UrdfTree::Link& link, bool assumes) {
        XmlElement* inertial = link.element->FirstChildElement("inertial");
        if (!inertial) return;
        const auto mass = parseNumber(getAttribute(inertial->FirstChildElement("mass"), "value"));
        const auto read = readInertial(*inertial);
        if (!mass || !(*mass > 0.0)) return;
        if (!read) {
            if (assumes && isIncomplete(inertial->FirstChildElement("inertia")))
                leaveInertia(link, *inertial, *mass, "no inertia is given");
            return;
        }
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(read->inertia);
        const Eigen::Vector3d moments = solver.eigenvalues();
        const double excess = moments[2] - moments[0] - moments[1];
        if (assumes && read->inertia.isZero(0.0)) return leaveInertia(link, *inertial, *mass, "its inertia is zero");
        const bool isRod = assumes && std::abs(moments[0]) <= kInertiaMargin * moments[2];
        if (!isRod && moments[0] >= 0.0 && !(excess > 1e-14 * moments.sum())) return;
        const bool isSlip = !isRod && moments[0] >= 0.0 && excess < kLargestInertiaSlip * moments[2];
        if (!isSlip && !assumes) return;
        const Eigen::Vector3d near = findNearestMoments(moments, isRod);
        if (near.isZero(0.0))
            return leaveInertia(link, *inertial, *mass,
                                "no body is near its principal moments " + showMoments(moments));
        const Eigen::Matrix3d& axes = solver.eigenvectors();
        writeTensor(*inertial->FirstChildElement("inertia"), axes * near.asDiagonal() * axes.transpose());
        if (!isSlip) {
            markAssumed(*link.element, "inertia");
            repairs_.inertias.push_back(link.name);
        }
        note(
            *link.element,
            "link " + quoteName(link.name) + ": " +
                (isRod              ? "a principal moment of inertia was zero, as of a rod without thickness"
                 : moments[0] < 0.0 ? "a principal moment of inertia was negative"
                                    : "the largest principal moment of inertia was above the sum of the other two by " +
                                          format("%.2g", 100.0 * excess / moments[2]) + " %") +
                ", which no body has; changed to the nearest tensor that one can have, from " + showMoments(moments) +
                " to " + showMoments(near));
    }

    /** Whether a tensor lacks entries, and those that it has are numbers. */
    static bool isIncomplete(const XmlElement* tensor) {
        bool lacks = !tensor;
        for (const char* name : {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}) {
            const char* const text = tensor ? tensor->Attribute(name) : nullptr;
            if (text && !parseNumber(text)) return false;
            lacks = lacks || !text;
        }
        return lacks;
    }

    void leaveInertia(const UrdfTree::Link& link, XmlElement& inertial, double mass, const std::string& why) {
        constexpr double kPlaceholder_m2 = 1e-4;
        writeTensor(demandChild(inertial, "inertia"), mass * kPlaceholder_m2 * Eigen::Matrix3d::Identity());
        markAssumed(*link.element, "inertia");
        repairs_.bodies.emplace(link.name, MissingBody::Inertia);
        note(*link.element,
             "link " + quoteName(link.name) + ": " + why + "; that of its shape with its mass is assumed");
    }

    /** A placeholder for each moving joint that moves no mass. */
    void addBodies() {
        std::vector<bool> hasMass(tree_.links.size());
        for (std::size_t i = 0; i < tree_.links.size(); ++i) {
            const XmlElement* inertial = tree_.links[i].element->FirstChildElement("inertial");
            hasMass[i] = inertial && getAttribute(inertial->FirstChildElement("mass"), "value") != "" &&
                         parseNumber(getAttribute(inertial->FirstChildElement("mass"), "value")) != 0.0;
        }
        const std::vector<bool> carries = tree_.findCarried(hasMass);
        for (const int j : tree_.outwards) {
            if (!joint(j).isMoving || carries[j]) continue;
            const UrdfTree::Link& bare = link(joint(j).childLink);
            writeBody(*bare.element, {1.0, Eigen::Vector3d::Zero(), 1e-3 * Eigen::Matrix3d::Identity()});
            markAssumed(*bare.element, "mass");
            repairs_.bodies[bare.name] = MissingBody::All;
            note(*bare.element, "link " + quoteName(bare.name) + ", moved by joint " + quoteName(joint(j).name) +
                                    ", had no mass; one is assumed");
        }
    }

    UrdfDocument& document_;
    UrdfTree tree_;
    const UrdfChoice& choice_;
    const bool assumes_;
    ErrorList& errors_;
    UrdfRepairs repairs_;
    std::map<std::string, int> byName_;  ///< joints
    std::set<int> fixed_;                ///< joints of --fix
    std::map<int, double> places_;       ///< where --fix and --at put joints
    std::map<int, double> rest_;         ///< where each moving joint is when nobody moves it
    std::vector<int> onTip_;             ///< joints that carry the tip, nearest first
    std::vector<bool> isOnTip_;          ///< the same, by joint
    std::vector<bool> below_;            ///< by joint: hangs on the base; empty: no base is chosen
    std::set<int> leaders_;              ///< joints that others mimic
};

}  // namespace

bool holdsWord(std::string name, std::initializer_list<const char*> words) {
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    return std::any_of(words.begin(), words.end(),
                       [&](const char* word) { return name.find(word) != std::string::npos; });
}

void markAssumed(XmlElement& element, const std::string& what) {
    std::string text = getAttribute(&element, kAssumed);
    addItem(text, what, " ");
    element.SetAttribute(kAssumed, text.c_str());
}

void writeBody(XmlElement& link, const BodyInertia& body) {
    while (XmlElement* before = link.FirstChildElement("inertial")) link.DeleteChild(before);
    XmlElement& inertial = *link.InsertNewChildElement("inertial");
    setVector(demandChild(inertial, "origin"), "xyz", body.com);
    demandChild(inertial, "mass").SetAttribute("value", formatNumber(body.mass).c_str());
    writeTensor(demandChild(inertial, "inertia"), body.inertia);
}

UrdfRepairs repairUrdf(UrdfDocument& document, const UrdfChoice& choice, bool assumes, ErrorList& errors) {
    return Repair(document, choice, assumes, errors).run();
}

}  // namespace viable::detail
