#include "robot/urdf/UrdfRepair.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/Text.h"
#include "viable/core/JointTypes.h"

namespace viable::detail {

namespace {

/** A tensor that is off by more is not rounded but wrong. */
constexpr double kLargestInertiaSlip = 0.05;
/** Moments are mended to this much better than the limit, so that rounding does not undo it. */
constexpr double kInertiaMargin = 1e-9;

/** Joints that mimic each other in a row; more go in a circle. */
constexpr int kMostFollowed = 16;

/** Words in the names of joints that open and close something. */
constexpr const char* kGripperWords[] = {"finger", "gripper", "jaw", "knuckle", "claw", "thumb"};

bool namesGripper(std::string name) {
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    return std::any_of(std::begin(kGripperWords), std::end(kGripperWords),
                       [&](const char* word) { return name.find(word) != std::string::npos; });
}

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

class Repair {
public:
    Repair(UrdfDocument& document, const UrdfChoice& choice, ErrorList& errors)
        : document_(document), tree_(document), choice_(choice), errors_(errors) {}

    std::vector<std::string> run() {
        const bool isWhole = errors_.isEmpty();
        for (std::size_t j = 0; j < tree_.joints.size(); ++j)
            byName_.emplace(tree_.joints[j].name, static_cast<int>(j));
        readChoice();
        findRests();
        for (const auto& [j, value] : fixed_) freezeAndNote(joint(j), "--fix");
        if (isWhole && errors_.isEmpty()) freezeOutsideOfChain();
        freezeCoupled();
        freezeGrippers();
        freezeWeightless();
        for (const UrdfTree::Joint& joint : tree_.joints)
            if (joint.isMoving) addLimits(joint);
        for (const UrdfTree::Link& link : tree_.links) mendInertia(link);
        return std::move(notes_);
    }

private:
    UrdfTree::Joint& joint(int j) { return tree_.joints[static_cast<std::size_t>(j)]; }
    const UrdfTree::Link& link(int i) const { return tree_.links[static_cast<std::size_t>(i)]; }
    std::string place(const UrdfTree::Joint& joint) const { return document_.place(*joint.element); }
    void note(const XmlElement& element, const std::string& text) {
        notes_.push_back(document_.place(element) + ": " + text);
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
        const int base = requireLink("--base", choice_.base), tip = requireLink("--tip", choice_.tip);
        onTip_ = tip < 0 ? std::vector<int>{} : tree_.listJointsAbove(tip);
        isOnTip_.assign(tree_.joints.size(), false);
        for (const int j : onTip_) isOnTip_[static_cast<std::size_t>(j)] = true;
        if (base >= 0) {
            below_.assign(tree_.joints.size(), false);
            std::vector<bool> isBelow(tree_.links.size());
            isBelow[static_cast<std::size_t>(base)] = true;
            for (const int j : tree_.outwards)
                if (isBelow[static_cast<std::size_t>(joint(j).parentLink)])
                    below_[static_cast<std::size_t>(j)] = isBelow[static_cast<std::size_t>(joint(j).childLink)] = true;
            if (tip >= 0 && !isBelow[static_cast<std::size_t>(tip)])
                errors_.add(
                    "--tip", "link " + quoteName(choice_.tip) + " does not hang on the base " + quoteName(choice_.base),
                    "Name a base on the way to the tip" +
                        std::string(onTip_.empty() ? "."
                                                   : ", such as " + quoteName(joint(onTip_.back()).parent) + "."));
        }
        if (tip >= 0 && std::none_of(onTip_.begin(), onTip_.end(), [&](int j) {
                return joint(j).isMoving && (below_.empty() || below_[static_cast<std::size_t>(j)]);
            }))
            errors_.add("--tip", "no joint moves link " + quoteName(choice_.tip), "Name a link at the end of the arm.");
        for (const std::string& text : choice_.fixed) readFixed(text);
    }

    void readFixed(const std::string& text) {
        const std::size_t sign = text.rfind('=');
        const std::string name = findJoint(text) >= 0 ? text : text.substr(0, sign);
        const int j = findJoint(name);
        if (j < 0) {
            std::vector<std::string> names;
            for (const UrdfTree::Joint& known : tree_.joints)
                if (known.isMoving) names.push_back(known.name);
            const std::string closest = findClosestName(name, names);
            return errors_.add("--fix", "the robot has no joint " + quoteName(name),
                               (closest.empty() ? "" : "Did you mean " + quoteName(closest) + "? ") +
                                   "Its moving joints are " + listSome(names) + ".");
        }
        if (!joint(j).isMoving)
            return errors_.add("--fix", "joint " + quoteName(name) + " is fixed already", "Leave it out.");
        if (fixed_.count(j) > 0)
            return errors_.add("--fix", "joint " + quoteName(name) + " is named twice", "Name it once.");
        std::optional<double> value;  // as at rest
        if (name != text && (joint(j).type == "floating" || joint(j).type == "planar"))
            return errors_.add("--fix",
                               "joint " + quoteName(name) + " of type " + joint(j).type + " has no single position",
                               "Write --fix " + name + ": it stays where its <origin> puts it.");
        if (name != text) {
            const std::optional<double> given = parseNumber(text.substr(sign + 1));
            double lower, upper;
            if (!given)
                return errors_.add("--fix",
                                   "`" + text.substr(sign + 1) + "` is no position for joint " + quoteName(name),
                                   "Write --fix " + name + "=0.5, in radians or metres.");
            if (readRange(joint(j), lower, upper) && (*given < lower || *given > upper))
                return errors_.add("--fix",
                                   "joint " + quoteName(name) + " cannot be at " + formatNumber(*given) +
                                       ": its limits are " + formatNumber(lower) + " to " + formatNumber(upper),
                                   "Choose a position inside them.");
            value = *given;
        }
        fixed_[j] = value;
    }

    /** The position limits of a joint that has a range. */
    static bool readRange(const UrdfTree::Joint& joint, double& lower, double& upper) {
        const XmlElement* limit = joint.element->FirstChildElement("limit");
        if (joint.type != "revolute" && joint.type != "prismatic") return false;
        lower = parseNumber(getAttribute(limit, "lower")).value_or(0.0);
        upper = parseNumber(getAttribute(limit, "upper")).value_or(0.0);
        return lower < upper;
    }

    /** Where a joint is that nobody moves: where --fix puts it, where the joint that it mimics leaves it, at zero, or in the
    middle of a range that does not hold zero. Nothing where its <mimic>, or one of those that it follows, leads nowhere. */
    std::optional<double> findRest(int j, int followed) const {
        if (const auto fixed = fixed_.find(j); fixed != fixed_.end() && fixed->second) return fixed->second;
        const UrdfTree::Joint& at = tree_.joints[static_cast<std::size_t>(j)];
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
            XmlElement* to = element.FirstChildElement("origin");
            if (!to) to = element.InsertNewChildElement("origin");
            setVector(*to, "xyz", pose.translation());
            setVector(*to, "rpy", {roll, pitch, yaw});
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

    bool isOnChain(int j) const { return isOnTip_[static_cast<std::size_t>(j)]; }

    void freezeOutsideOfChain() {
        std::vector<std::string> frozen;
        for (std::size_t j = 0; j < tree_.joints.size(); ++j) {
            const bool isOutside =
                (!below_.empty() && !below_[j]) || (!choice_.tip.empty() && !isOnChain(static_cast<int>(j)));
            UrdfTree::Joint& outside = tree_.joints[j];
            if (!isOutside || !outside.isMoving) continue;
            if (freeze(outside)) frozen.push_back(outside.name + " at " + formatNumber(getRest(outside)));
        }
        if (!frozen.empty())
            notes_.push_back(document_.file() + ": outside of the chosen chain, and frozen: " + join(frozen));
    }

    void freezeCoupled() {
        for (UrdfTree::Joint& coupled : tree_.joints) {
            const XmlElement* mimic = coupled.element->FirstChildElement("mimic");
            if (!coupled.isMoving || !mimic || isOnChain(findJoint(coupled.name))) continue;
            const std::string leader = getAttribute(mimic, "joint");
            leaders_.insert(findJoint(leader));
            freezeAndNote(coupled, "it mimics joint " + quoteName(leader));
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
            const bool isEnd = joint(j).isMoving && !beyond[static_cast<std::size_t>(j)] && isFree(j);
            if (isEnd) ends.push_back(j);
            const int before = link(joint(j).parentLink).carrier;
            if (before >= 0 && ((joint(j).isMoving && !isEnd) || beyond[static_cast<std::size_t>(j)]))
                beyond[static_cast<std::size_t>(before)] = true;
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
            length = static_cast<std::size_t>(std::mismatch(first->begin(),
                                                            first->begin() + static_cast<std::ptrdiff_t>(length),
                                                            joint.name.begin(), joint.name.end())
                                                  .first -
                                              first->begin());
        }
        // Whole words, or it would cut into `jaw` where others are called `joint1`.
        const std::size_t last = first ? first->find_last_of("_-/.:", length) : std::string::npos;
        return length == 0 || last == std::string::npos || last >= length ? 0 : last + 1;
    }

    void freezeGrippers() {
        const std::size_t prefix = findCommonPrefix();
        const auto isLed = [&](int j) { return leaders_.count(j) > 0; };
        freezeEnds([&](int j) { return !isOnChain(j) && (isLed(j) || namesGripper(joint(j).name.substr(prefix))); },
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
        }
        const std::vector<bool> carries = tree_.findCarried(hasMass);
        freezeEnds([&](int j) { return !carries[static_cast<std::size_t>(j)]; },
                   [](int) { return "nothing that it moves has a mass"; });
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

    void mendInertia(const UrdfTree::Link& link) {
        XmlElement* inertial = link.element->FirstChildElement("inertial");
        if (!inertial) return;
        const auto read = readInertial(*inertial);
        if (!read || !(read->mass > 0.0)) return;
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(read->inertia);
        Eigen::Vector3d moments = solver.eigenvalues();
        const double excess = moments[2] - moments[0] - moments[1];
        if (!(moments[0] >= 0.0) || !(excess > 1e-14 * moments.sum()) || !(excess < kLargestInertiaSlip * moments[2]))
            return;
        // The nearest tensor that a body can have (Frobenius norm): a third of the excess to each moment.
        const double share = (excess + kInertiaMargin * moments[2]) / 3.0;
        moments += Eigen::Vector3d(share, share, -share);
        const Eigen::Matrix3d& axes = solver.eigenvectors();
        const Eigen::Matrix3d mended = axes * moments.asDiagonal() * axes.transpose();
        XmlElement& tensor = *inertial->FirstChildElement("inertia");
        tensor.SetAttribute("ixx", formatNumber(mended(0, 0)).c_str());
        tensor.SetAttribute("ixy", formatNumber(mended(0, 1)).c_str());
        tensor.SetAttribute("ixz", formatNumber(mended(0, 2)).c_str());
        tensor.SetAttribute("iyy", formatNumber(mended(1, 1)).c_str());
        tensor.SetAttribute("iyz", formatNumber(mended(1, 2)).c_str());
        tensor.SetAttribute("izz", formatNumber(mended(2, 2)).c_str());
        note(*link.element, "link " + quoteName(link.name) +
                                ": the largest principal moment of inertia was above the sum of the other two by " +
                                format("%.2g", 100.0 * excess / solver.eigenvalues()[2]) +
                                " %, which no body has; changed to the nearest tensor that one can have");
    }

    UrdfDocument& document_;
    UrdfTree tree_;
    const UrdfChoice& choice_;
    ErrorList& errors_;
    std::vector<std::string> notes_;
    std::map<std::string, int> byName_;           ///< joints
    std::map<int, std::optional<double>> fixed_;  ///< joints of --fix, and where
    std::map<int, double> rest_;                  ///< where each moving joint is when nobody moves it
    std::vector<int> onTip_;                      ///< joints that carry the tip, nearest first
    std::vector<bool> isOnTip_;                   ///< the same, by joint
    std::vector<bool> below_;                     ///< by joint: hangs on the base; empty: no base is chosen
    std::set<int> leaders_;                       ///< joints that others mimic
};

}  // namespace

std::vector<std::string> repairUrdf(UrdfDocument& document, const UrdfChoice& choice, ErrorList& errors) {
    return Repair(document, choice, errors).run();
}

}  // namespace viable::detail
