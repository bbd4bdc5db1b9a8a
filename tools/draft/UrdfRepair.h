#pragma once

#include "core/ErrorList.h"
#include "robot/urdf/UrdfDocument.h"
#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** `--tip auto` */
inline constexpr const char* kAutoTip = "auto";

/** Which joints of a URDF are to move; empty: all that can. */
struct UrdfChoice {
    std::string base;  ///< joints that do not hang on this link stay still
    std::string tip;   ///< joints that do not carry this link stay still; kAutoTip: that of the longest arm
    std::vector<std::string> fixed;    ///< joints that stay still: NAME or NAME=VALUE, VALUE in rad or m
    std::vector<std::string> at = {};  ///< NAME=VALUE: where joints are that stay still for another reason
};

/** What of a link's body nobody gave. */
enum class MissingBody : unsigned char { All, Inertia };

struct UrdfRepairs {
    std::vector<std::string> notes;  ///< what was changed, one sentence each; empty: the document is as it was
    std::map<std::string, MissingBody> bodies;  ///< by link: a placeholder stands there, to be replaced
    std::vector<std::string> inertias;          ///< links whose tensor became the nearest of a body
    std::string tip;                            ///< the chosen one, also of kAutoTip
};

/** Makes a tree of the joints and links, where that can be meant in one way only: names that are missing, given twice or
misspelt, links that nobody describes, parts that hang nowhere and move nothing, types. For `--assume`, before
checkUrdfTree(). Marks what it assumes by the attribute `assumed`. @return  as UrdfRepairs::notes */
std::vector<std::string> repairUrdfTree(UrdfDocument& document);

/** Makes an arm of a URDF as it is found, by changing the document: joints outside of the chosen chain, coupled and
gripper's joints, and end joints that move no mass become fixed where they are; inertias that miss the triangle inequality
by less than 5 % are corrected; limits that are missing become blanks (zeros). What cannot be mended is left to
checkUrdfElements().
@param assumes  bodies that are missing, or that no body is, are assumed, and the base is fixed
@param errors  of checkUrdfTree(): of an unsound tree no chain is chosen. Gets what cannot be chosen so */
UrdfRepairs repairUrdf(UrdfDocument& document, const UrdfChoice& choice, bool assumes, ErrorList& errors);

/** Whether a name, in small letters, holds one of these words. */
bool holdsWord(std::string name, std::initializer_list<const char*> words);

/** Says at a joint or a link what of it nobody gave, such as "mass"; runs repeat it. */
void markAssumed(XmlElement& element, const std::string& what);

/** Writes a link's body in place of what is there. */
void writeBody(XmlElement& link, const BodyInertia& body);

}  // namespace viable::detail
