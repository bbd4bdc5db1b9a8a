#pragma once

#include "viable/environment/Surroundings.h"
#include "viable/qp/BoxQp.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/robot/Dynamics.h"

namespace viable {

class ArmRecursion;

/** In how many directions the joints can move the tool, at a fixed sample of poses within the limits. */
struct ToolFreedom {
    int ways = 0, all = 0;                                ///< of three, and of six with the turns
    Eigen::Matrix3d place = Eigen::Matrix3d::Identity();  ///< projects on the directions of all poses together

    ToolFreedom(const RobotDescription& robot, const JointLimits& limits);
    /** For a pose with this J: the mean lever arm of the joints. Where some directions must be given up, a fiftieth of it: then
    the position comes first, and the tool turns as far as joints are left. */
    double calcRotationLength(const ToolJacobian& J) const;
    /** That, as a sentence; empty where nothing is given up. */
    std::string describe() const;
};

/** Tells a motion that leads nowhere: in so many ticks a tenth of its way or less is left between its ends. */
class Tremble {
public:
    void configure(std::int64_t ticks) { ticks_ = ticks; }
    void reset(const JointVector& q);
    /** One tick. True at the end of such a time, also of one without a motion where `countsStill`. */
    bool find(const JointVector& q, bool countsStill = false);

private:
    std::int64_t ticks_ = 1000, left_ = 0;
    double way_ = 0.0;
    JointVector from_, last_;
};

/** How a tool pose becomes a motion of the joints. */
struct ToolReferenceOptions {
    double rotationLength_m = 0.2;  ///< so far counts a rotation of 1 rad as an error; 0: the orientation is free
    double restRate = 0.5;          ///< how fast spare joints go to their rest posture [1/s]
    double apart_m = 0.1;           ///< nearer than this to obstacles or itself, spare joints lead the arm away
};

/** The joint positions whose tool is nearest to a commanded pose, within the joint position limits. They are integrated
from tick to tick, not solved anew. So the arm stays in its branch, and turns of more than half a turn are followed.

Method, per tick: a QP minimises |W (J dq - error)|^2 + damping |dq|^2 + (spare joints). It is subject to the position
limits and to the velocity limits for a tick. The damping is the remaining error times the size of J
(Levenberg-Marquardt with the residual's norm as damping: Fan and Yuan, Computing 74, 2005). So unreachable and singular
poses are approached without wild joint motion, and without an oscillation there.
Spare joints: they wait while the tool is behind. If the arm is nearer than apart_m to something, they go away from it.
They do so in the time in which they could stop if it is a whole apart_m too near.
Obstacles: with a geometry no step leads nearer to obstacles or to the arm itself than WholeArmBrakingFilter lets the
arm, to first order. This holds at the nearest place and the ends of each part, from each obstacle, by rows of that QP,
as many as RowQp takes. An arm that is nearer already is led away along its way only, and not while it rests. So the
reference rests as near to a barred pose as it comes. Otherwise it would be inside the obstacle, and the arm, held back,
would oscillate beside it.
Real time: no allocation, lock or throw after configure(). */
class ToolReference {
public:
    ToolReference();
    ~ToolReference();
    ToolReference(ToolReference&&) noexcept;
    ToolReference& operator=(ToolReference&&) noexcept;

    /** @param rest       where spare joints go
        @param geometry   null: it keeps clear of nothing, and apart_m has no effect; need not outlive this call
        @param recursion  of the robot, shared by many; null: one of its own */
    void configure(const RobotDescription& robot, const JointLimits& limits, double tick_s, const JointVector& rest,
                   const ToolReferenceOptions& options, const ArmGeometry* geometry = nullptr,
                   std::shared_ptr<const ArmRecursion> recursion = nullptr);
    void reset(const JointVector& q);
    /** Continues at `q` at once, if `q` is less than half as far from the command as q() is. The latter must be off
    by more than 1 mm. */
    void leapTo(const JointVector& q, const Pose& command);
    void leapTo(const JointVector& q, const JointVector& goal);
    /** From now on. */
    void changeLimits(const JointLimits& limits, const JointVector& rest);

    /** One tick towards `command`; its orientation is of unit length.
        @param surroundings  null: none are known
        @param time_s        of the run
        @param around        to stay within them [rad]; from outside it goes back at full speed. Null: no such bounds */
    void advance(const Pose& command, const Surroundings* surroundings = nullptr, double time_s = 0.0,
                 const JointBounds* around = nullptr);
    /** The same towards joint positions, in terms of |goal - q()|; no joint is spare. */
    void advance(const JointVector& goal, const Surroundings* surroundings, double time_s, const JointBounds* around);
    /** Goes on from `q`. */
    void moveTo(const JointVector& q);
    /** Rests at `q` until the command or what is near changes. */
    void rest(const JointVector& q);
    const JointVector& q() const { return q_; }  ///< [rad]
    /** True if in the last tick a joint had its largest velocity or reached the end of `around`, or something barred
    the way. The command then jumped, is too fast, or cannot be reached. */
    bool isHeldBack() const { return isHeldBack_; }
    /** Something barred the way in the last tick in which it did not rest. */
    bool isBarred() const { return isBarred_; }
    /** In the last tick. */
    bool hasNewGoal() const { return hasNewGoal_; }

private:
    struct Clear;
    /** From the tool at `q` to the command, weighted; fills dynamics_. */
    Vector6 findError(const JointVector& q, const Pose& command);
    void findNear(const Surroundings* surroundings, double time_s, double apart_m);
    void leadApart(double weightNear);
    void findBox(const JointBounds* around);
    void applyStep();
    void goOneByOne();
    bool isAtRest(const JointVector& goal, double same);

    int n_ = 0;
    bool isHeldBack_ = false, isBarred_ = false, hasNewGoal_ = false;
    double tick_s_ = 0.0;
    JointLimits limits_;
    ToolReferenceOptions options_;
    std::shared_ptr<const ArmRecursion> recursion_;
    Dynamics dynamics_;
    std::unique_ptr<Clear> clear_;  ///< null: no geometry
    Tremble tremble_;
    JointVector goal_;     ///< the last command, as numbers
    double near_m_ = 0.0;  ///< of all that is near, where it rests
    bool rests_ = false;
    double apartRate_ = 0.0;  ///< [1/s]
    BoxQp qp_;
    JointVector q_, rest_, still_, target_, lower_, upper_, step_, gradient_;
    JointVector slowest_, fastest_;  ///< steps at which a joint is held back
    JointMatrix normal_, factor_;
};

}  // namespace viable
