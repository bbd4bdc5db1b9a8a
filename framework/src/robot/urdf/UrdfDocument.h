#pragma once

#include <tinyxml2.h>

#include <Eigen/Geometry>
#include <filesystem>
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

/** A URDF file as XML elements, which can be changed before the robot is read from them. */
class UrdfDocument {
public:
    /** Throws Error (BadInput): the file cannot be read, or is no URDF at all. */
    explicit UrdfDocument(const std::filesystem::path& file);
    ~UrdfDocument();  // there, so that other libraries need not link to tinyxml2

    const std::string& file() const { return file_; }
    /** The file's bytes. */
    const std::string& text() const { return text_; }
    /** The elements as they are now. */
    std::string print() const;
    /** The robot's elements with this tag, in file order. */
    std::vector<XmlElement*> list(const char* tag);
    /** file:line:column. */
    std::string place(const XmlElement& element) const;

private:
    std::string file_, text_;
    tinyxml2::XMLDocument xml_{true, tinyxml2::COLLAPSE_WHITESPACE};
    std::unordered_map<const XmlElement*, std::size_t> columns_;  ///< where the file's elements begin in their lines
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
    /** Moving joints with none beyond them, each with the number of moving joints from the base to it. */
    std::vector<std::pair<int, int>> listChains() const;
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
