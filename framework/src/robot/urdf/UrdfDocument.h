#pragma once

#include <tinyxml2.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

namespace viable::detail {

using XmlElement = tinyxml2::XMLElement;

/** Largest URDF file, deepest nesting and most attributes of an element accepted: the XML reader works by recursion and
compares each attribute with all others. */
inline constexpr std::uintmax_t kMaxUrdfBytes = 4u << 20;
inline constexpr int kMaxUrdfDepth = 64;
inline constexpr int kMaxUrdfAttributes = 100;
/** Most joints that move, of a robot out of which an arm may be taken. */
inline constexpr int kMaxUrdfMoving = 1000;

/** Attribute of joints and links: what of them nobody gave, words apart by blanks. */
inline constexpr const char* kAssumed = "assumed";

/** A URDF file as XML elements, which can be changed before the robot is read from them. */
class UrdfDocument {
public:
    /** Gives the text of a xacro file or a MuJoCo model as URDF.
    @param element  that needs it, <mujoco> for a model
    @param where  file:line:column of it */
    using Expand = std::function<std::string(const std::string& element, const std::string& where)>;

    /** Throws Error (BadInput): the file cannot be read, or is no URDF at all. What of xacro changes nothing is left out.
    @param expand  for other xacro and for models; none: they are refused */
    explicit UrdfDocument(const std::filesystem::path& file, const Expand& expand = {});
    ~UrdfDocument();  // there, so that other libraries need not link to tinyxml2

    const std::string& file() const { return file_; }
    /** The file's bytes. */
    const std::string& text() const { return text_; }
    /** What of the file was left out or expanded, one sentence each. */
    const std::vector<std::string>& notes() const { return notes_; }
    /** Takes every <inertial> out; from now on no link needs one. */
    void dropBodies();
    bool hasBodies() const { return hasBodies_; }
    /** The elements as they are now. */
    std::string print() const;
    XmlElement& root() { return *xml_.RootElement(); }
    /** The robot's elements with this tag, in file order. */
    std::vector<XmlElement*> list(const char* tag);
    /** file:line:column. */
    std::string place(const XmlElement& element) const;

private:
    /** Parses the text.
    @param dropsUnknown  leaves calls of macros out that the file neither defines nor includes
    @return  the first element that xacro must expand, or the root of a MuJoCo model; null: none */
    const XmlElement* parse(bool dropsUnknown);

    std::string file_, shown_, text_;  ///< `shown_`: for places
    std::vector<std::string> notes_;
    bool hasBodies_ = true;
    tinyxml2::XMLDocument xml_{true, tinyxml2::COLLAPSE_WHITESPACE};
    std::unordered_map<const XmlElement*, std::size_t> columns_;  ///< where the file's elements begin in their lines
};

/** Moving joints in a row, from the base to one with no moving joint beyond it. */
struct UrdfChain {
    int last = -1;  ///< joint
    int count = 0;
    double length = 0.0;  ///< of the way along their origins [m]
};

/** Joints and links of a document that have a name, and what hangs on what. */
struct UrdfTree {
    struct Joint {
        XmlElement* element = nullptr;
        std::string name, type, parent, child;
        int parentLink = -1, childLink = -1;  ///< -1: there is no such link
        bool isMoving = false;                ///< of any type but fixed
    };
    struct Link {
        XmlElement* element = nullptr;
        std::string name;
        int carrier = -1;         ///< joint whose child it is; -1: none
        std::vector<int> joints;  ///< that hang on it
    };
    std::vector<Joint> joints;        ///< in file order
    std::vector<Link> links;          ///< in file order
    std::map<std::string, int> find;  ///< links by name
    /** Joints that hang on a base, those nearer to it first; without those of a loop. */
    std::vector<int> outwards;

    explicit UrdfTree(UrdfDocument& document);

    /** Joints from `link` to its base, nearest first; ends where a loop closes. */
    std::vector<int> listJointsAbove(int link) const;
    /** By joint: whether joints beyond it move. */
    std::vector<bool> findMovingBeyond() const;
    /** By link: whether a joint moves it. */
    std::vector<bool> findMoved() const;
    /** By joint: whether it carries a link for which `has` is true, itself or through fixed joints.
    @param has  by link */
    std::vector<bool> findCarried(const std::vector<bool>& has) const;
    /** All of them; those of most joints first, of these the longest. */
    std::vector<UrdfChain> listChains() const;
    /** Of a chain, base first. */
    std::vector<int> listJoints(const UrdfChain& chain) const;
    /** The link in which a chain ends: the last joint's, or where there is one, the only one fixed to it. */
    int findEnd(const UrdfChain& chain) const;
    /** "`tip` (2: a, b)" */
    std::string describe(const UrdfChain& chain) const;
};

std::string quoteName(const std::string& name);

/** An attribute of an element that may be missing; empty where there is none. */
std::string getAttribute(const XmlElement* element, const char* name);

/** Finite numbers, separated by blanks; none where the text is anything else. */
std::optional<std::vector<double>> parseNumbers(const std::string& text);
/** A single number. */
std::optional<double> parseNumber(const std::string& text);

/** The <origin> of an element, the identity where it has none; nothing where its numbers cannot be read. */
std::optional<Eigen::Isometry3d> readOrigin(const XmlElement& element);
/** The direction of a joint's <axis>, x where it has none; nothing where it has no direction. */
std::optional<Eigen::Vector3d> readAxis(const XmlElement& joint);

/** Mass and inertia about the centre of mass, as <inertial> writes them. */
struct UrdfInertial {
    double mass = 0.0;        ///< [kg]
    Eigen::Matrix3d inertia;  ///< [kg m^2]
};
/** Nothing where the numbers cannot be read or are missing. */
std::optional<UrdfInertial> readInertial(const XmlElement& inertial);

}  // namespace viable::detail
