#pragma once

#include "core/ErrorList.h"
#include "robot/LinkShapes.h"
#include "robot/urdf/UrdfDocument.h"
#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** What a URDF file says about an arm: moving joints only, links on fixed joints merged into the
body that carries them. */
struct UrdfRobot {
    /** Where a link's frame is. */
    struct LinkPlace {
        int carrier = -1;                                             ///< joint index, -1: the base
        Eigen::Isometry3d placement = Eigen::Isometry3d::Identity();  ///< in its moving frame
    };

    /** A link as written, before links on fixed joints are merged. */
    struct Link {
        std::string name;
        std::string place;                    ///< file:line:column, for messages
        int carrier = -1;                     ///< joint index, -1: the base
        bool hasInertial = false;             ///< without it `body` has no mass
        BodyInertia body;                     ///< in the link's frame
        std::vector<Eigen::Vector3d> joints;  ///< origins of the joints that hang on it, in its frame [m]
    };

    std::vector<JointDescription> joints;  ///< parents before children, in file order
    std::vector<std::string> jointPlaces;  ///< file:line:column of each joint, for messages
    std::vector<std::string> parentLinks;  ///< the link that each joint hangs on
    JointBounds position;                  ///< infinite for continuous joints
    JointBounds velocity;                  ///< infinite for continuous joints without a limit
    JointVector effort;                    ///< as written [Nm], 0 where there is none
    std::map<std::string, LinkPlace> links;
    std::vector<Link> bodies;                  ///< every link, in file order
    std::map<std::string, LinkShapes> shapes;  ///< by link: its visual elements, else its collision ones
    std::map<std::string, LinkShapes> solids;  ///< by link: its collision elements, else its visual ones
    std::vector<std::string> leafLinks;        ///< links that carry no joint, in file order
    std::vector<std::string> assumed;          ///< what of it nobody gave, such as "mass (link1, link2)"
};

/** Reads a URDF file; throws Error (BadInput) with all that is wrong with it, each with the line of the joint or link at
fault. Limits are handed on as written; the caller checks those it uses.
@param hasBodies  false: masses are not read, and need not be there */
UrdfRobot readUrdf(const std::filesystem::path& file, bool hasBodies = true);

/** The same of a document. @param errors  of checkUrdfTree(), told with those found here */
UrdfRobot readUrdf(UrdfDocument& document, ErrorList errors);

}  // namespace viable::detail
