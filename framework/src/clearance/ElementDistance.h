#pragma once

#include "clearance/ArmElement.h"
#include "clearance/CapsuleMotion.h"
#include "viable/environment/Surroundings.h"

namespace viable::detail {

/** The clearance of an element at one pose of the arm: roughly by one ball around each capsule, or by the balls that cover a
capsule (against the surroundings) and exactly (two capsules). Every answer is a lower bound of the capsules' own clearance
as far as Surroundings::calcDistance is one. Real time after construction. */
class ElementDistance {
public:
    /** Where an element was nearest. */
    struct Place {
        double distance = std::numeric_limits<double>::infinity();
        int sample = 0;
        int obstacle = -1;
        Eigen::Vector3d gradient = Eigen::Vector3d::Zero();  ///< unit, from the obstacle to the first capsule
        Eigen::Vector3d onFirst = Eigen::Vector3d::Zero(), onSecond = Eigen::Vector3d::Zero();
        bool isSeen() const { return distance < std::numeric_limits<double>::infinity(); }
    };
    struct Rough {
        double clearance;  ///< [m]
        double ofMiddle;   ///< distance of a capsule's middle from the surroundings; infinite for a pair [m]
    };

    explicit ElementDistance(std::vector<LinkCapsule> capsules);

    /** How much farther than its clearance an element's points are away: of a capsule's segment from the surroundings, or of
    two segments from each other [m]. */
    double getRadius(const ArmElement& element) const {
        const auto first = static_cast<std::size_t>(element.first);
        return element.isPair() ? capsules_[first].radius + capsules_[element.second].radius : covers_[first].radius;
    }
    /** Of the balls that cover each capsule [m]. */
    std::vector<double> getRadii() const;

    /** Null: nothing stands around; then only pairs may be asked for. */
    void setSurroundings(const Surroundings* surroundings) { surroundings_ = surroundings; }
    bool hasSurroundings() const { return surroundings_ != nullptr; }
    void setTime(double time_s) { time_s_ = time_s; }
    /** Obstacles that do not count from now on; none at first. */
    Surroundings::LeftOut& leftOut() { return leftOut_; }

    Rough calcRough(const ArmElement& element, const CapsuleMotion::Pose& pose) const;
    /** @param ofMiddle  as calcRough() gives it
        @param sample    of the pose, for `nearest`
        @param nearest   replaced where this is nearer
        @param distances how many are left; less by those that are computed */
    double calc(const ArmElement& element, const CapsuleMotion::Pose& pose, double ofMiddle, int sample, Place& nearest,
                int& distances) const;
    /** The places at the ends of capsules, which come to be the nearest where the arm turns a little: of one capsule from the
    obstacle of `nearest`, of two each end from the other. Where `nearest` is at an end, that one is left out.
    @return how many */
    int calcEnds(const ArmElement& element, const CapsuleMotion::Pose& pose, const Place& nearest,
                 std::array<Place, 4>& ends) const;

private:
    double calcToOthers(const Eigen::Vector3d& p) const;
    /** A capsule as balls that cover it, their centres evenly along its segment. */
    struct Cover {
        int gaps = 0;                        ///< one less than balls
        double radius = 0.0, spacing = 0.0;  ///< of each ball, of their centres [m]
        double reach = 0.0;                  ///< radius of one ball around them all [m]
    };
    static std::vector<Cover> makeCovers(const std::vector<LinkCapsule>& capsules);
    double calcToSurroundings(int capsule, const CapsuleMotion::Segment& segment, double ofMiddle, int sample,
                              Place& nearest, int& distances) const;
    double calcBetween(const ArmElement& element, const CapsuleMotion::Pose& pose, int sample, Place& nearest) const;
    static Place makePlace(const Eigen::Vector3d& centre, double radius, const Surroundings::Nearest& found,
                           int sample);
    Place makePlace(const ArmElement& pair, const Eigen::Vector3d& onA, const Eigen::Vector3d& onB, int sample) const;

    std::vector<LinkCapsule> capsules_;
    std::vector<Cover> covers_;
    const Surroundings* surroundings_ = nullptr;
    double time_s_ = 0.0;
    Surroundings::LeftOut leftOut_;
};

/** How the distance at a place changes with each joint [m/rad].
@param frames  of the arm there
@param row     of the arm's size */
void calcDistanceGradient(const ElementDistance::Place& place, const ArmElement& element,
                          const std::vector<LinkCapsule>& capsules, const ArmRecursion& arm,
                          const ArmRecursion::Frames& frames, JointVector& row);

}  // namespace viable::detail
