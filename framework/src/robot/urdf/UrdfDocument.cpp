#include "robot/urdf/UrdfDocument.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <locale>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "viable/core/Error.h"

namespace viable::detail {

namespace {

std::string readText(const std::filesystem::path& file) {
    std::error_code failed;
    const std::uintmax_t size = std::filesystem::file_size(file, failed);
    if (!failed && size > kMaxUrdfBytes)
        throw badInput(
            file.string(),
            "the file has " + std::to_string(size) + " bytes; at most " + std::to_string(kMaxUrdfBytes) + " are read",
            "A URDF names its meshes, it does not contain them; check the file.");
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream text;
    if (stream) text << stream.rdbuf();
    if (!stream || failed) throw badInput(file.string(), "the file cannot be read", "Check its permissions.");
    return text.str();
}

/** The end of the tag that begins at `begin`: its `>` that is not in quotes; npos: none. Counts its attributes. */
std::size_t findTagEnd(const std::string& text, std::size_t begin, int& attributes) {
    char quote = '\0';
    for (std::size_t i = begin; i < text.size(); ++i) {
        const char c = text[i];
        if (quote != '\0') {
            if (c == quote) quote = '\0';
        } else if (c == '"' || c == '\'') {
            quote = c;
        } else if (c == '=') {
            ++attributes;
        } else if (c == '>') {
            return i;
        }
    }
    return std::string::npos;
}

/** Most joints and links of a file, whatever they are. */
constexpr int kMostParts = 10000;

/** Bytes of the UTF-8 character at `i`; 0: none begins there. */
std::size_t getUtf8Length(const std::string& text, std::size_t i) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const std::size_t length = lead < 0x80                   ? 1
                               : lead >= 0xf0 && lead < 0xf8 ? 4
                               : lead >= 0xe0                ? 3
                               : lead >= 0xc2                ? 2
                                                             : 0;
    if (length == 0 || lead >= 0xf8 || i + length > text.size()) return 0;
    for (std::size_t k = 1; k < length; ++k)
        if ((static_cast<unsigned char>(text[i + k]) & 0xc0) != 0x80) return 0;
    return length;
}

/** Refuses what the XML reader would crash on, cut off, or take minutes for; and what it might take for something else than
this does, so that its depth is known. Returns the columns where the elements begin, in file order. */
std::vector<std::size_t> checkText(const std::string& text, const std::string& file) {
    if (text.find_first_not_of(" \t\r\n") == std::string::npos)
        throw badInput(file, "the file is empty", "A URDF file holds one <robot> element.");
    if (text.find('\0') != std::string::npos)
        throw badInput(file, "the file holds binary data", "A URDF file is XML text.");
    const auto refuse = [&](std::size_t at, const std::string& what) {
        const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');
        return badInput(file + ":" + std::to_string(line), "this is not XML: " + what,
                        "Check that the file is complete and every element is closed.");
    };
    if (const std::size_t at = text.find("<!ENTITY"); at != std::string::npos)
        throw refuse(at, "it declares an entity, which may grow without end");
    int depth = 0, moving = 0, parts = 0;
    std::vector<std::size_t> columns;
    std::size_t line = 0, counted = 0;  // where the line begins; how far lines are counted
    for (std::size_t i = 0; i < text.size();) {
        if (text[i] != '<') {
            const std::size_t length = getUtf8Length(text, i);
            if (length == 0) throw refuse(i, "a character that is not UTF-8");
            i += length;
            continue;
        }
        // What is no element, and may hold anything.
        std::size_t skipped = 0;
        for (const auto& [begin, end] : {std::pair("<!--", "-->"), {"<![CDATA[", "]]>"}, {"<?", "?>"}, {"<!", ">"}}) {
            const std::size_t length = std::strlen(begin);
            if (text.compare(i, length, begin) != 0) continue;
            const std::size_t at = text.find(end, i + length);
            if (at == std::string::npos || (text[i + 1] == '?' && text.find('>', i) != at + 1))
                throw refuse(i, std::string("no ") + end + " ends what " + begin + " begins");
            skipped = at + std::strlen(end);
            break;
        }
        if (skipped > 0) {
            i = skipped;
            continue;
        }
        const char next = i + 1 < text.size() ? text[i + 1] : '\0';
        const bool isEnd = next == '/';
        if (!isEnd && std::isalpha(static_cast<unsigned char>(next)) == 0 && next != '_' && next != ':' &&
            (static_cast<unsigned char>(next) < 0x80))
            throw refuse(i, "no name follows a <");
        int attributes = 0;
        const std::size_t end = isEnd ? text.find('>', i) : findTagEnd(text, i, attributes);
        if (end == std::string::npos) throw refuse(i, "a tag has no end");
        for (std::size_t k = i; k < end;) {
            const std::size_t length = getUtf8Length(text, k);
            if (length == 0) throw refuse(k, "a character that is not UTF-8");
            k += length;
        }
        if (isEnd && --depth < 0) throw refuse(i, "an element is closed that was not opened");
        for (; counted < i; ++counted)
            if (text[counted] == '\n') line = counted + 1;
        if (!isEnd) columns.push_back(i - line + 1);
        const std::string_view tag(text.data() + i, end - i);
        const std::string_view name = tag.substr(1, tag.find_first_of(" \t\r\n\v\f/", 1) - 1);
        if (name == "joint" && tag.find("type") != tag.npos)
            moving += tag.find("\"fixed\"") == tag.npos && tag.find("'fixed'") == tag.npos ? 1 : 0;
        parts += name == "joint" || name == "link" ? 1 : 0;
        if (moving > kMaxUrdfMoving || parts > kMostParts)
            throw badInput(file,
                           "the robot has more than " + (moving > kMaxUrdfMoving
                                                             ? std::to_string(kMaxUrdfMoving) + " joints that move"
                                                             : std::to_string(kMostParts) + " joints and links"),
                           "Take the arm out of the file; no robot has so many.");
        if (!isEnd && text[end - 1] != '/') ++depth;
        if (depth > kMaxUrdfDepth)
            throw badInput(file, "the elements are nested deeper than " + std::to_string(kMaxUrdfDepth) + " levels",
                           "Check that every element is closed.");
        if (attributes > kMaxUrdfAttributes)
            throw badInput(file, "an element has more than " + std::to_string(kMaxUrdfAttributes) + " attributes",
                           "Check that every attribute's value is in quotes, and every element closed.");
        i = end + 1;
    }
    return columns;
}

std::string describeFault(tinyxml2::XMLError fault) {
    if (fault == tinyxml2::XML_ERROR_MISMATCHED_ELEMENT)
        return "an element begins here that is not closed by its own name";
    if (fault == tinyxml2::XML_ERROR_PARSING_ATTRIBUTE)
        return "an attribute is not of the form name=\"value\", or stands twice in its element";
    if (fault == tinyxml2::XML_ERROR_PARSING_DECLARATION) return "an <?xml ...?> stands behind the first element";
    return std::string("it cannot be read as XML (") + tinyxml2::XMLDocument::ErrorIDToName(fault) + ")";
}

constexpr std::string_view kXacro = "xacro:", kModel = "mujoco";

bool isOneOf(std::string_view name, std::initializer_list<std::string_view> names) {
    return std::find(names.begin(), names.end(), name) != names.end();
}

/** Definitions, which change nothing where nobody uses them. */
bool isXacroDefinition(std::string_view name) {
    return isOneOf(name, {"xacro:property", "xacro:arg", "xacro:macro"});
}

/** A call of a macro, and not one of xacro's own elements. */
bool isXacroCall(std::string_view name) {
    return name.substr(0, kXacro.size()) == kXacro && !isXacroDefinition(name) &&
           !isOneOf(name, {"xacro:include", "xacro:if", "xacro:unless", "xacro:insert_block", "xacro:element",
                           "xacro:attribute", "xacro:call"});
}

bool isXacro(const XmlElement& element) {
    if (std::string_view(element.Name()).substr(0, kXacro.size()) == kXacro) return true;
    for (const tinyxml2::XMLAttribute* a = element.FirstAttribute(); a; a = a->Next())
        if (std::strstr(a->Value(), "${") || std::strstr(a->Value(), "$(")) return true;
    return false;
}

/** Calls `act` for an element and all inside of it, in file order. */
template <class Act>
void forEachElement(XmlElement& element, const Act& act) {
    act(element);
    for (XmlElement* child = element.FirstChildElement(); child; child = child->NextSiblingElement())
        forEachElement(*child, act);
}

/** Writes two blanks for each level. */
class Printer : public tinyxml2::XMLPrinter {
    void PrintSpace(int depth) override {
        for (int i = 0; i < depth; ++i) Write("  ");
    }
};

/** Shorter axes are a slip, and their direction is rounding. */
constexpr double kShortestAxis = 1e-6;

}  // namespace

UrdfDocument::UrdfDocument(const std::filesystem::path& file, const Expand& expand)
    : file_(file.string()), shown_(file_), text_(readText(file)) {
    const XmlElement* xacro = parse(static_cast<bool>(expand));
    if (xacro && expand) {
        const bool isModel = xacro->Name() == kModel;
        text_ = expand(xacro->Name(), place(*xacro));
        shown_ += isModel ? " (converted)" : " (expanded)";
        notes_ = {file_ + (isModel ? ": MuJoCo read the model" : ": xacro was expanded") +
                  "; lines are those of its output"};
        xacro = parse(false);
    }
    if (xacro && xacro->Name() == kModel)
        throw badInput(file_, "this is a MuJoCo model (MJCF), not URDF",
                       "Write `viable new robot NAME --mjcf " + file_ + "`.");
    if (xacro)
        throw badInput(place(*xacro),
                       "this is xacro input, not URDF: <" + std::string(xacro->Name()) + "> still has to be expanded",
                       "Run `xacro INPUT.xacro > NAME.urdf` and use its output; `viable new robot --assume` does so "
                       "where xacro is installed.");
}

const XmlElement* UrdfDocument::parse(bool dropsUnknown) {
    const std::vector<std::size_t> columns = checkText(text_, shown_);
    columns_.clear();
    if (const tinyxml2::XMLError fault = xml_.Parse(text_.data(), text_.size()))
        throw badInput(xml_.ErrorLineNum() > 0 ? shown_ + ":" + std::to_string(xml_.ErrorLineNum()) : shown_,
                       "this is not XML: " + describeFault(fault),
                       "Check that the file is complete and every element is closed.");
    xml_.SetBOM(false);  // the printed text begins with its first character
    const XmlElement* root = xml_.RootElement();
    if (root && root->Name() == kModel) return root;
    if (!root || std::string_view(root->Name()) != "robot")
        throw badInput(
            file_, "the file's root is " + (root ? "<" + std::string(root->Name()) + ">" : "missing") + ", not <robot>",
            "Only URDF is read; convert other formats (SDF) first.");
    std::vector<XmlElement*> found, unused, unknown;  // calls of macros that no definition can be of are unknown
    std::set<std::string> macros;
    bool includes = false;
    const XmlElement* skipped = nullptr;  // whose inside is not looked at
    forEachElement(*xml_.RootElement(), [&](XmlElement& element) {
        if (columns_.size() < columns.size()) columns_.emplace(&element, columns[columns_.size()]);
        for (const tinyxml2::XMLNode* above = element.Parent(); skipped && above; above = above->Parent())
            if (above == skipped) return;
        const std::string_view name = element.Name();
        includes = includes || name == "xacro:include";
        if (name == "xacro:macro") macros.insert(std::string(kXacro) + getAttribute(&element, "name"));
        if (isXacroDefinition(name)) {
            unused.push_back(&element);
            skipped = &element;
        } else if (element.Parent() == root && isOneOf(name, {"gazebo", "transmission", "sensor"})) {
            skipped = &element;  // says nothing about the arm
        } else if (isXacro(element)) {
            (isXacroCall(name) ? unknown : found).push_back(&element);
        }
    });
    if (includes || !dropsUnknown ||
        std::any_of(unknown.begin(), unknown.end(), [&](const XmlElement* e) { return macros.count(e->Name()) > 0; }))
        found.insert(found.end(), unknown.begin(), unknown.end());
    if (!found.empty())
        return *std::min_element(found.begin(), found.end(),
                                 [](const auto* a, const auto* b) { return a->GetLineNum() < b->GetLineNum(); });
    for (const auto& [elements, why] : {std::pair(&unused, "nothing uses it"), {&unknown, "nothing defines it"}})
        for (auto at = elements->rbegin(); at != elements->rend(); ++at) {  // inner ones first
            notes_.push_back(place(**at) + ": <" + (*at)->Name() + "> is left out: " + why);
            (*at)->Parent()->DeleteChild(*at);
        }
    return nullptr;
}

UrdfDocument::~UrdfDocument() = default;

void UrdfDocument::dropBodies() {
    hasBodies_ = false;
    for (XmlElement* link : list("link"))
        while (XmlElement* inertial = link->FirstChildElement("inertial")) link->DeleteChild(inertial);
}

std::string UrdfDocument::print() const {
    Printer printer;
    xml_.Print(&printer);
    return printer.CStr();
}

std::vector<XmlElement*> UrdfDocument::list(const char* tag) {
    std::vector<XmlElement*> elements;
    for (XmlElement* e = xml_.RootElement()->FirstChildElement(tag); e; e = e->NextSiblingElement(tag))
        elements.push_back(e);
    return elements;
}

std::string UrdfDocument::place(const XmlElement& element) const {
    const std::string line = shown_ + ":" + std::to_string(element.GetLineNum());
    const auto column = columns_.find(&element);
    return column != columns_.end() ? line + ":" + std::to_string(column->second) : line;
}

UrdfTree::UrdfTree(UrdfDocument& document) {
    for (XmlElement* element : document.list("link")) {
        const std::string name = getAttribute(element, "name");
        if (name.empty() || !find.emplace(name, static_cast<int>(links.size())).second) continue;
        links.push_back({element, name, -1, {}});
    }
    for (XmlElement* element : document.list("joint")) {
        Joint joint{element, getAttribute(element, "name"), getAttribute(element, "type"),
                    getAttribute(element->FirstChildElement("parent"), "link"),
                    getAttribute(element->FirstChildElement("child"), "link")};
        joint.isMoving = joint.type != "fixed";
        if (joint.name.empty()) continue;
        const int index = static_cast<int>(joints.size());
        if (const auto parent = find.find(joint.parent); parent != find.end()) {
            joint.parentLink = parent->second;
            links[parent->second].joints.push_back(index);
        }
        if (const auto child = find.find(joint.child); child != find.end()) {
            joint.childLink = child->second;
            links[child->second].carrier = index;
        }
        joints.push_back(std::move(joint));
    }
    std::vector<int> reached;
    for (std::size_t i = 0; i < links.size(); ++i)
        if (links[i].carrier < 0) reached.push_back(static_cast<int>(i));
    for (std::size_t k = 0; k < reached.size(); ++k)
        for (const int j : links[reached[k]].joints) {
            const int child = joints[j].childLink;
            // Of two joints with one child only the last carries it.
            if (child < 0 || links[child].carrier != j) continue;
            outwards.push_back(j);
            reached.push_back(child);
        }
}

std::vector<int> UrdfTree::listJointsAbove(int link) const {
    std::vector<int> above;
    while (link >= 0 && above.size() <= joints.size()) {
        const int joint = links[link].carrier;
        if (joint < 0) break;
        above.push_back(joint);
        link = joints[joint].parentLink;
    }
    return above;
}

std::vector<bool> UrdfTree::findMovingBeyond() const {
    std::vector<bool> beyond(joints.size());
    for (auto j = outwards.rbegin(); j != outwards.rend(); ++j) {
        const int before = links[joints[*j].parentLink].carrier;
        if (before >= 0 && (joints[*j].isMoving || beyond[*j])) beyond[before] = true;
    }
    return beyond;
}

std::vector<bool> UrdfTree::findMoved() const {
    std::vector<bool> moved(links.size());
    for (const int j : outwards) {
        const Joint& joint = joints[j];
        moved[joint.childLink] = joint.isMoving || moved[joint.parentLink];
    }
    return moved;
}

std::vector<bool> UrdfTree::findCarried(const std::vector<bool>& has) const {
    std::vector<bool> carried(joints.size());
    for (auto j = outwards.rbegin(); j != outwards.rend(); ++j) {
        const Joint& joint = joints[*j];
        if (has[joint.childLink]) carried[*j] = true;
        const int before = links[joint.parentLink].carrier;
        if (before >= 0 && !joint.isMoving && carried[*j]) carried[before] = true;
    }
    return carried;
}

std::vector<UrdfChain> UrdfTree::listChains() const {
    const std::vector<bool> beyond = findMovingBeyond();
    std::vector<UrdfChain> to(links.size()), chains;
    for (const int j : outwards) {
        const Joint& joint = joints[j];
        UrdfChain& chain = to[joint.childLink];
        chain = to[joint.parentLink];
        const auto origin = readOrigin(*joint.element);
        if (origin && chain.count > 0) chain.length += origin->translation().norm();
        if (!joint.isMoving) continue;
        ++chain.count;
        chain.last = j;
        if (!beyond[j]) chains.push_back(chain);
    }
    // To a tenth of a millimetre: of two arms alike, the first.
    for (UrdfChain& chain : chains) chain.length = std::round(1e4 * chain.length) / 1e4;
    std::stable_sort(chains.begin(), chains.end(), [](const UrdfChain& a, const UrdfChain& b) {
        return std::pair(a.count, a.length) > std::pair(b.count, b.length);
    });
    return chains;
}

int UrdfTree::findEnd(const UrdfChain& chain) const {
    int end = joints[chain.last].childLink;
    while (links[end].joints.size() == 1) end = joints[links[end].joints.front()].childLink;
    return end;
}

std::vector<int> UrdfTree::listJoints(const UrdfChain& chain) const {
    std::vector<int> moving;
    for (const int j : listJointsAbove(joints[chain.last].childLink))
        if (joints[j].isMoving) moving.push_back(j);
    std::reverse(moving.begin(), moving.end());
    return moving;
}

std::string UrdfTree::describe(const UrdfChain& chain) const {
    constexpr std::size_t kMost = 20;
    const std::vector<int> chosen = listJoints(chain);
    std::string names;
    for (std::size_t k = 0; k < std::min(chosen.size(), kMost); ++k)
        names += (k > 0 ? ", " : "") + joints[chosen[k]].name;
    return quoteName(links[findEnd(chain)].name) + " (" + std::to_string(chain.count) + ": " + names +
           (chosen.size() > kMost ? ", ..." : "") + ")";
}

std::string quoteName(const std::string& name) {
    return "`" + name + "`";
}

std::string getAttribute(const XmlElement* element, const char* name) {
    const char* text = element ? element->Attribute(name) : nullptr;
    return text ? text : "";
}

std::optional<std::vector<double>> parseNumbers(const std::string& text) {
    std::istringstream stream(text);
    stream.imbue(std::locale::classic());
    std::vector<double> numbers;
    for (double number; stream >> number;) numbers.push_back(number);
    if (!stream.eof()) return {};
    for (const double number : numbers)
        if (!std::isfinite(number)) return {};
    return numbers;
}

std::optional<double> parseNumber(const std::string& text) {
    const auto numbers = parseNumbers(text);
    if (!numbers || numbers->size() != 1) return {};
    return numbers->front();
}

std::optional<Eigen::Isometry3d> readOrigin(const XmlElement& element) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    const XmlElement* origin = element.FirstChildElement("origin");
    if (!origin) return pose;
    for (const char* name : {"xyz", "rpy"}) {
        if (!origin->Attribute(name)) continue;
        const auto v = parseNumbers(origin->Attribute(name));
        if (!v || v->size() != 3) return {};
        if (std::string(name) == "xyz")
            pose.translation() << (*v)[0], (*v)[1], (*v)[2];
        else
            pose.linear() = (Eigen::AngleAxisd((*v)[2], Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd((*v)[1], Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd((*v)[0], Eigen::Vector3d::UnitX()))
                                .toRotationMatrix();
    }
    return pose;
}

std::optional<Eigen::Vector3d> readAxis(const XmlElement& joint) {
    const XmlElement* axis = joint.FirstChildElement("axis");
    if (!axis || !axis->Attribute("xyz")) return Eigen::Vector3d::UnitX();
    const auto v = parseNumbers(axis->Attribute("xyz"));
    if (!v || v->size() != 3) return {};
    const Eigen::Vector3d direction((*v)[0], (*v)[1], (*v)[2]);
    if (!(direction.norm() >= kShortestAxis)) return {};
    return direction.normalized();
}

std::optional<UrdfInertial> readInertial(const XmlElement& inertial) {
    const auto mass = parseNumber(getAttribute(inertial.FirstChildElement("mass"), "value"));
    const XmlElement* tensor = inertial.FirstChildElement("inertia");
    if (!mass || !tensor || !readOrigin(inertial)) return {};
    double m[6];
    int k = 0;
    for (const char* name : {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}) {
        const auto entry = parseNumber(getAttribute(tensor, name));
        if (!entry) return {};
        m[k++] = *entry;
    }
    UrdfInertial read;
    read.mass = *mass;
    read.inertia << m[0], m[1], m[2], m[1], m[3], m[4], m[2], m[4], m[5];
    return read;
}

}  // namespace viable::detail
