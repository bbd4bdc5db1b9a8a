#pragma once

#include "clearance/TorqueRate.h"
#include "robot/ArmRecursion.h"

namespace viable::detail {

/** Looks whether the torque along a path stays within its limits, tick by tick. How many ticks may be left out follows from
the bound of TorqueRate and from what is missing to the limit. Real time after construction, bounded work. */
class TorqueScan {
public:
    struct Limits {
        JointVector torque;  ///< [Nm]; infinite: none
        JointVector rate;    ///< [Nm/s]; infinite: none
    };
    /** A joint's torque, or its change since the tick before, beyond its limit at a tick of the path. */
    struct Fault {
        std::int64_t tick = 0;
        int joint = 0;
        double value = 0.0;    ///< beyond the limit of its sign [Nm]
        double missing = 0.0;  ///< by how much [Nm]
        bool isChange = false;
    };
    /** Torques computed in a tick, at most; beyond them nothing that needs another is proven. */
    static constexpr int kMaxTorques = 1500;

    TorqueScan(const RobotDescription& robot, const Limits& limits, double tick_s);

    /** kMaxTorques may be computed until the next call, in which all paths begin with the same tick. */
    void beginTick();
    /** What was seen in ticks before. */
    void forget() { suspectCount_ = 0; }

    struct Result {
        bool bearsTorque = true;  ///< within `torqueUse` of the limits; when it is only measured: all of it was
        double torqueUse = 0.0;   ///< largest |tau| / limit or |change| / limit seen
        int joint = 0;            ///< that has it
        std::int64_t tick = 0;    ///< of the path, when it has it
        double torque = 0.0;      ///< then [Nm]
        bool isChange = false;    ///< it is that of a change
        JointVector proven;       ///< no |tau| of any tick is larger; infinite: not known [Nm]
    };
    /** What is known of another path. */
    struct Neighbour {
        const JointVector* proven;         ///< of its scan
        const ArmPath::Difference* apart;  ///< how far it is from the path that is looked at
    };
    /** @param extremes    of the path and of the neighbours
        @param torqueUse   the most that torque may use of its limits; infinite: it is only measured
        @param lastTorque  of the tick before the path's first
        @param neighbours  `count` of them. Where the torques of one, and how far those of this path can be from them, leave no
                           doubt that the limits are kept, nothing is computed, and torqueUse is a bound
        `result.proven` is to have the arm's size. */
    void scan(const ArmPath& path, const ArmPath::Extremes& extremes, double torqueUse, const JointVector& lastTorque,
              const Neighbour* neighbours, int count, Result& result);

    /** Found by the last scan(), the first ones. */
    int faultCount() const { return faultCount_; }
    const Fault& fault(int k) const { return faults_[static_cast<std::size_t>(k)]; }

    /** In the last scan() a torque changed too fast, or there were more ticks to look at for that than may be. */
    bool failsByRate() const { return isTooLong_ || (faultCount_ > 0 && faults_[0].isChange); }
    /** Then: the joint of `path` that mends most of it when it alone moves as in `other`, from the same state and with another
    jerk in the first tick; -1: none does. */
    int findWorstJoint(const ArmPath& path, const JointVector& jerk, const ArmPath& other,
                       const JointVector& otherJerk);

    /** The torque of a tick of a path. */
    void calcTorque(const ArmPath& path, std::int64_t tick, JointVector& torque);

private:
    int n_;
    Limits limits_;
    double tick_s_;
    ArmRecursion arm_;
    TorqueRate torqueRate_;
    bool limitsTorque_, limitsRate_;
    int left_ = kMaxTorques;
    std::array<Fault, 4> faults_;
    int faultCount_ = 0;
    bool isTooLong_ = false;
    /** Ticks of paths at which changes failed, the newest first: where others, and those of the next tick, probably do, too. */
    std::array<std::int64_t, 4> suspects_{};
    int suspectCount_ = 0;
    JointVector lastTorque_;  ///< of the last scan()
    JointVector position_, velocity_, acceleration_, torque_, torqueBefore_, rate_;

    void addFault(std::int64_t tick, int joint, double value, double allowed, bool isChange);
    bool failsAgain(const ArmPath& path, double torqueUse);
    bool isKnown(const ArmPath::Extremes& extremes, const Neighbour& neighbour, Result& result);
};

}  // namespace viable::detail
