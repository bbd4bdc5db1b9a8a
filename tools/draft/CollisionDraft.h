#pragma once

#include "draft/RobotDraft.h"
#include "robot/ArmRecursion.h"
#include "robot/urdf/UrdfReader.h"

namespace viable::detail {

/** Links that are nearer than this (the usual safety distance) touch. [m] */
inline constexpr double kNear = 0.02;

/** Distances between the capsules of links that could meet: those with a joint between them that are not next to each
other. */
class LinkDistances {
public:
    LinkDistances(const UrdfRobot& robot, const std::vector<DraftLink>& links);

    /** Indices into `links`. */
    const std::vector<std::pair<std::size_t, std::size_t>>& pairs() const { return pairs_; }
    /** Of each pair, at a pose; below zero where their capsules overlap. [m] */
    std::vector<double> calc(const JointVector& q) const;
    /** For each pair in how many of so many random poses in the range it is nearer than that [m]. */
    std::vector<int> countNear(const JointBounds& range, int poses, double distance) const;
    /** Of a point from the nearest capsule that a joint moves; infinite where there is none. [m] */
    double calcFrom(const Eigen::Vector3d& point, const JointVector& q) const;

private:
    /** A capsule where a pose puts it, base frame. */
    struct Placed {
        Eigen::Vector3d a, b;
        double radius;
    };
    /** By link. */
    std::vector<std::vector<Placed>> place(const JointVector& q) const;
    static double calcDistance(const std::vector<Placed>& one, const std::vector<Placed>& other);

    const UrdfRobot& robot_;
    const std::vector<DraftLink>& links_;
    ArmRecursion recursion_;
    std::vector<std::pair<std::size_t, std::size_t>> pairs_;
};

/** Joints and bodies of the arm, without rotors, limits or tool. */
RobotDescription makeDraftArm(const UrdfRobot& robot);
/** The position limits; of a joint that lacks one, half a turn or a metre to either side. */
JointBounds makeDraftRange(const std::vector<DraftJoint>& joints);

/** @param folder  that of the URDF, an absolute path: where the meshes are looked for, and in the package around it */
std::vector<DraftLink> draftLinks(const UrdfRobot& robot, const std::filesystem::path& folder);

/** Whether these two, in this order, are among the draft's contacts. */
bool hasContact(const RobotDraft& draft, const std::string& first, const std::string& second);
/** Links next to each other, and those nearly always near within the limits. */
std::vector<DraftContact> draftContacts(const UrdfRobot& robot, const RobotDraft& draft,
                                        const LinkDistances& distances);

/** Links near at the home pose that are not among the draft's contacts. */
std::vector<DraftContact> draftHomeContacts(const RobotDraft& draft, const LinkDistances& distances);

}  // namespace viable::detail
