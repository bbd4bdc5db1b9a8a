#include <algorithm>
#include <cctype>

#include "core/Text.h"
#include "draft/UrdfRepair.h"

namespace viable::detail {

namespace {

std::string printElement(const XmlElement& element) {
    tinyxml2::XMLPrinter printer(nullptr, true);
    element.Accept(&printer);
    return printer.CStr();
}

/** The words of a name in small letters, digits apart: what stays the same where it is misspelt. */
std::vector<std::string> splitName(const std::string& name) {
    std::vector<std::string> words(1);
    for (const unsigned char c : name) {
        const bool isDigit = std::isdigit(c) != 0;
        if (!words.back().empty() && (!std::isalnum(c) || isDigit != (std::isdigit(words.back()[0]) != 0)))
            words.emplace_back();
        if (std::isalnum(c)) words.back() += static_cast<char>(std::tolower(c));
    }
    if (words.back().empty()) words.pop_back();
    return words;
}

/** Whether a name can be a slip of another: with the same numbers, and letters wrong in words of four or more only (`l_arm` is
not `r_arm`). */
bool isSlip(const std::string& name, const std::string& other) {
    constexpr std::size_t kLongWord = 4;
    const std::vector<std::string> words = splitName(name), others = splitName(other);
    return std::equal(words.begin(), words.end(), others.begin(), others.end(),
                      [&](const std::string& a, const std::string& b) {
                          return a == b || (std::min(a.size(), b.size()) >= kLongWord && !std::isdigit(a[0]) &&
                                            !std::isdigit(b[0]) && !findClosestName(a, {b}).empty());
                      });
}

class TreeRepair {
public:
    explicit TreeRepair(UrdfDocument& document) : document_(document) {}

    std::vector<std::string> run() {
        if (getAttribute(&document_.root(), "name").empty()) document_.root().SetAttribute("name", "robot");
        nameJoints();
        for (const char* tag : {"link", "joint"}) separate(tag);
        for (XmlElement* joint : document_.list("joint")) correctType(*joint);
        findLinks();
        dropLost();
        return std::move(notes_);
    }

private:
    void note(const XmlElement& element, const std::string& text) {
        notes_.push_back(document_.place(element) + ": " + text);
    }

    void nameJoints() {
        for (XmlElement* joint : document_.list("joint")) {
            const std::string child = getAttribute(joint->FirstChildElement("child"), "link");
            if (!getAttribute(joint, "name").empty() || child.empty()) continue;
            joint->SetAttribute("name", (child + "_joint").c_str());
            note(*joint, "the joint without a name is called " + quoteName(child + "_joint"));
        }
    }

    /** Of two that are the same one goes; joints of one name get a second one. */
    void separate(const std::string& tag) {
        struct First {
            XmlElement* element;
            std::string printed;  // once it is compared
            int next;             // number for the name of another one
        };
        std::map<std::string, First> first;
        std::set<std::string> names;
        for (XmlElement* element : document_.list(tag.c_str())) names.insert(getAttribute(element, "name"));
        for (XmlElement* element : document_.list(tag.c_str())) {
            const std::string name = getAttribute(element, "name");
            const auto [other, isNew] = first.emplace(name, First{element, "", 2});
            if (isNew || name.empty()) continue;
            auto& [one, printed, next] = other->second;
            if (printed.empty()) printed = printElement(*one);
            if (printElement(*element) == printed) {
                note(*element, "the second " + tag + " " + quoteName(name) + " is left out: both are the same");
                element->Parent()->DeleteChild(element);
            } else if (tag == "joint") {
                std::string free;
                do free = name + "_" + std::to_string(next++);
                while (!names.insert(free).second);
                element->SetAttribute("name", free.c_str());
                note(*element, "the second joint " + quoteName(name) + " is called " + quoteName(free));
            }
        }
    }

    void correctType(XmlElement& joint) {
        const std::vector<std::string> kinds = {"fixed", "revolute", "continuous", "prismatic", "floating", "planar"};
        const std::string type = getAttribute(&joint, "type");
        if (type.empty() || std::find(kinds.begin(), kinds.end(), type) != kinds.end()) return;
        std::string plain = type;
        std::transform(plain.begin(), plain.end(), plain.begin(), [](unsigned char c) { return std::tolower(c); });
        const std::string closest = findClosestName(plain, kinds);
        if (closest.empty()) return;
        joint.SetAttribute("type", closest.c_str());
        markAssumed(joint, "type");
        note(joint, "joint " + quoteName(getAttribute(&joint, "name")) + " of type " + quoteName(type) +
                        " is taken as " + closest);
    }

    /** Links that joints name and that are not there: the only one whose name was misspelt, else one without a body. A parent is
    new only where all else hangs on it, or there would be two bases. */
    void findLinks() {
        const UrdfTree tree(document_);
        std::vector<std::string> roots, names;
        for (const UrdfTree::Link& link : tree.links) {
            names.push_back(link.name);
            if (link.carrier < 0) roots.push_back(link.name);
        }
        std::map<std::string, std::vector<const UrdfTree::Joint*>> parents, children;  // joints by missing link
        for (const UrdfTree::Joint& joint : tree.joints) {
            if (joint.parentLink < 0 && !joint.parent.empty()) parents[joint.parent].push_back(&joint);
            if (joint.childLink < 0 && !joint.child.empty()) children[joint.child].push_back(&joint);
        }
        if (parents.size() + children.size() > kMostMissing) return;
        const auto takeMeant = [&](const auto& missing, const char* tag, std::vector<std::string> known) {
            const auto& [name, joints] = missing;
            known.erase(std::remove_if(known.begin(), known.end(),
                                       [&, at = name](const std::string& link) {
                                           if (!isSlip(at, link)) return true;
                                           for (const int j : tree.listJointsAbove(tree.find.at(link)))
                                               if (tree.joints[j].parent == at) return true;
                                           return false;  // else it would be inside of itself
                                       }),
                        known.end());
            if (known.size() != 1) return false;
            for (const UrdfTree::Joint* joint : joints) take(*joint, tag, known.front());
            return true;
        };
        for (const auto& missing : children)
            if (roots.size() < 2 || missing.second.size() > 1 || parents.count(missing.first) > 0 ||
                !takeMeant(missing, "child", {roots.begin() + 1, roots.end()}))
                addLink(missing.first);
        for (const auto& missing : parents)
            if (children.count(missing.first) == 0 && !takeMeant(missing, "parent", names) && roots.empty() &&
                parents.size() == 1)
                addLink(missing.first);
    }

    void addLink(const std::string& name) {
        XmlElement* link = document_.root().InsertNewChildElement("link");
        link->SetAttribute("name", name.c_str());
        markAssumed(*link, "link");
        notes_.push_back(document_.file() + ": link " + quoteName(name) +
                         ", which joints name and nobody describes, is added without a body");
    }

    void take(const UrdfTree::Joint& joint, const char* tag, const std::string& name) {
        note(*joint.element, "the " + std::string(tag) + " link of joint " + quoteName(joint.name) + ", " +
                                 quoteName(getAttribute(joint.element->FirstChildElement(tag), "link")) +
                                 ", is not there; " + quoteName(name) + " is taken");
        joint.element->FirstChildElement(tag)->SetAttribute("link", name.c_str());
        markAssumed(*joint.element, tag);
    }

    /** What hangs on another base than most links do, and moves nothing. */
    void dropLost() {
        const UrdfTree tree(document_);
        std::vector<int> base(tree.links.size(), -1);
        std::map<int, std::pair<int, int>> sizes;  // by base: moving joints, links
        for (std::size_t i = 0; i < tree.links.size(); ++i)
            if (tree.links[i].carrier < 0) sizes[base[i] = static_cast<int>(i)].second = 1;
        for (const int j : tree.outwards) {
            const UrdfTree::Joint& joint = tree.joints[j];
            const int at = base[joint.childLink] = base[joint.parentLink];
            sizes[at].first += joint.isMoving ? 1 : 0;
            ++sizes[at].second;
        }
        if (sizes.size() < 2) return;
        const auto largest = std::max_element(sizes.begin(), sizes.end(),
                                              [](const auto& a, const auto& b) { return a.second < b.second; });
        const auto isLost = [&](int link) {
            const int at = link < 0 ? -1 : base[link];
            return at >= 0 && at != largest->first && sizes[at].first == 0;
        };
        std::vector<XmlElement*> lost;
        for (const UrdfTree::Joint& joint : tree.joints)
            if (isLost(joint.childLink)) lost.push_back(joint.element);
        for (std::size_t i = 0; i < tree.links.size(); ++i) {
            if (!isLost(static_cast<int>(i))) continue;
            lost.push_back(tree.links[i].element);
            note(*tree.links[i].element, "link " + quoteName(tree.links[i].name) +
                                             " is left out: it is not connected, and nothing of it moves");
        }
        for (XmlElement* element : lost) element->Parent()->DeleteChild(element);
    }

    static constexpr std::size_t kMostMissing = 20;
    UrdfDocument& document_;
    std::vector<std::string> notes_;
};

}  // namespace

std::vector<std::string> repairUrdfTree(UrdfDocument& document) {
    return TreeRepair(document).run();
}

}  // namespace viable::detail
