#pragma once

#include "clearance/ElementDistance.h"
#include "clearance/TorqueScan.h"
#include "qp/RowQp.h"

namespace viable::detail {

/** Two stops from the same state, the first one looked at: how a stop moves with the jerk of its tick is their difference. */
struct StopPair {
    const ArmPath& path;
    const JointVector& jerk;
    const ArmPath& other;
    const JointVector& otherJerk;
};

/** row . u >= bound, scaled to length 1. A row of zeros asks nothing: nothing that the arm does now changes it. */
void addRow(const JointVector& row, double bound, RowQp::Rows& rows);

/** For rows in their order, should there be no room for all: calls `use` for those `most` of the numbers below `size` that have
the least key, of equal ones the smaller number first.
@param calcKey  of a number; infinite: it is left out */
template <class Key, class Use>
void forLeast(std::size_t size, int most, const Key& calcKey, const Use& use) {
    double above = -kInfinity;
    std::size_t last = size;
    for (int count = 0; count < most; ++count) {
        std::size_t next = size;
        double least = kInfinity;
        for (std::size_t k = 0; k < size; ++k) {
            const double key = calcKey(k);
            const bool isLeft = key > above || (key == above && k > last);
            if (!(isLeft && key < least)) continue;
            least = key;
            next = k;
        }
        if (next == size) return;
        above = least;
        last = next;
        use(next);
    }
}

/** How the joints' places at time t_s of the first stop move with the jerks: multiplies the parts of a row for places by that. */
void multiplyPlaceSlopes(const StopPair& stops, double t_s, double tick_s, JointVector& row);

/** Inequalities row . u >= bound for the jerks u of a tick that lead a stop away from obstacles and back within torque
limits, to first order, as rows for RowQp: velocity dampers (Faverjon and Tournassoud, A local based approach for path
planning of manipulators with a high number of degrees of freedom, ICRA 1987) taken along the stop instead of at the present
pose. They only propose: what they lead to is checked like any other jerk. Rows have length 1. Real time. */
class SteeringRows {
public:
    SteeringRows(const RobotDescription& robot, std::vector<LinkCapsule> capsules, const TorqueScan::Limits& limits,
                 double tick_s);

    /** Keeps the clearance at a place at `bound` or more.
    @param frames  of the arm there, at time t_s of the path */
    void addClearance(const ElementDistance::Place& place, const ArmElement& element,
                      const ArmRecursion::Frames& frames, double t_s, double bound, const StopPair& stops,
                      RowQp::Rows& rows) const;
    /** The same, where the stop is one that was looked at before and is already under way.
    @param t_s  of the place, from now on; > 0
    @return     whether the other stop's jerk keeps it */
    bool addForeseen(const ElementDistance::Place& place, const ArmElement& element, double t_s, double bound,
                     const StopPair& stops, RowQp::Rows& rows) const;
    /** By how much of what the joints could do with as long a way they come nearer on the first stop than on the other: in
    [-1, 1], 0 where they lead along. */
    double calcSteepness(const ElementDistance::Place& place, const ArmElement& element,
                         const ArmRecursion::Frames& frames, double t_s, const StopPair& stops) const;
    /** Brings a torque of the stop, or its change, back within its limit, by the accelerations there. */
    void addTorque(const TorqueScan::Fault& fault, const StopPair& stops, RowQp::Rows& rows) const;
    /** Keeps the torque of the tick itself, M (qdd + u dt / 2) + b, within its limits; exact. */
    void addTick(const Dynamics& dynamics, const JointVector& qdd, double torqueUse, const JointVector& lastTorque,
                 RowQp::Rows& rows) const;

private:
    int n_;
    ArmRecursion arm_;
    std::vector<LinkCapsule> capsules_;
    TorqueScan::Limits limits_;
    double tick_s_;
};

}  // namespace viable::detail
