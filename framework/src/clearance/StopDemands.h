#pragma once

#include "clearance/ArmStopCheck.h"

namespace viable::detail {

/** What the next stop must keep, as it follows from what the backup stop keeps: the safety distance, or where that is lost
(surroundings that changed, a start too near) to come no nearer. Of speeds nothing less is asked: where a limit is lost
(a start too fast) the backup stop goes on until it is kept. Real time after construction. */
class StopDemands {
public:
    /** @param share  in (0, 1]: of the clearance or speed left, how much one tick may use up: a discrete barrier */
    StopDemands(int elements, double share);

    void setRequired(double distance_m) { required_m_ = distance_m; }
    double required() const { return required_m_; }  ///< safety distance [m]

    /** For a look at the backup stop alone: what it keeps is measured. */
    const ArmStopCheck::Demands& measure();
    /** Begins anew from what the backup stop was measured to keep. */
    void begin(const ArmStopCheck::Result& stored);
    /** What has become better stays so; and how near the next stop may come of what is left. */
    void raise(const ArmStopCheck::Result& kept);
    /** In the next look what is kept may come nearer than it is, within the guard: balls that cover a capsule are bumps on
    it, which bar its way along an obstacle. */
    void ease();
    /** Ends that. Of the stop that was looked at and is taken no more is asked until it is kept; null: it is not taken. */
    void harden(const ArmStopCheck::Result* taken);
    /** The torque that the stop taken now uses: the next one may use no more. */
    void lowerTorqueUse(double use) { demands_.torqueUse = std::max(1.0, std::min(demands_.torqueUse, use)); }

    /** Of every element the safety distance is asked, of none less because the backup stop does not keep it. */
    bool isKept() const;
    /** Of every jerk that is taken. */
    const ArmStopCheck::Demands& get() const { return demands_; }

private:
    double aim() const { return required_m_ + bisection::kGuard_m; }

    double share_, required_m_ = 0.0;
    ArmStopCheck::Demands demands_, measures_;
    std::vector<double> hard_;
};

}  // namespace viable::detail
