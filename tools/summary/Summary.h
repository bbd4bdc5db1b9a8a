#pragma once

#include <functional>

#include "realtime/LatencyHistogram.h"
#include "tracking/TrackingBound.h"
#include "viable/log/TickRecord.h"
#include "viable/loop/GuardSummary.h"

namespace viable {

/** What one side of one limit did to one joint. An episode is a row of ticks without a gap. */
struct InterventionRecord {
    std::int64_t ticks = 0, episodes = 0, longestTicks = 0;
    double largestTorque = 0.0;  ///< |tau_d - tau_c| while it acted [Nm, N]
    double squaredTorque = 0.0;  ///< sum over the ticks [Nm^2]

    double torqueRms() const { return ticks ? std::sqrt(squaredTorque / static_cast<double>(ticks)) : 0.0; }  ///< [Nm]
};

/** An extreme and where it was. */
struct ExtremeRecord {
    double value = 0.0;
    int joint = 0;
    double time_s = 0.0;
};

/** What the real arm (its true state, where the plant knows it) is measured against. */
struct RealArmReference {
    /** Its own limits, of which position and velocity count; none: the nominal arm's, as in force. */
    std::optional<JointLimits> limits;
    std::optional<TrackingBound> bound;
    JointVector torqueLimit;  ///< of the motors [Nm]; empty: not looked at
    /** The tool's pose at joint positions; empty: how far the real tool is from the commanded one is not looked at. */
    std::function<Pose(const JointVector&)> calcTool;
    JointVector torqueRate{};  ///< fastest change of the motors' torque [Nm/s]; empty: not looked at
};

/** What a joint or a tool can do: largest speed, acceleration and jerk. */
struct Pace {
    double speed = kInfinity, acceleration = kInfinity, jerk = kInfinity;
    /** Of a way from rest to rest, about the least [s]. */
    double duration(double way) const;
    /** From a speed to rest, or back [s]. */
    double stop(double from) const;
    static constexpr double kAllowance = 1.25;
    /** What is left to a joint or a tool for a way: its stop from the speed that it has, perhaps away, and kAllowance times what
    it needs from there [s]. */
    double patience(double way, double from) const {
        return kAllowance * duration(way + 0.5 * from * stop(from)) + stop(from);
    }
};

/** How something followed its command: a joint's position in the first entry, the command moved into the position limits
[rad, m], a tool's position [m], or its orientation, as twice its quaternion with the sign of the one before [rad]. */
class Following {
public:
    using Point = Eigen::Vector4d;
    /** @param error  its size  @param acting  the limits that act: bit k for the LimitKind k */
    void add(const Point& at, const Point& target, double error, const Pace& pace, unsigned acting, double tick_s);

    /** Ticks were left out: the way back from them counts as that of a jump. */
    void skip() { isFirst_ = true; }
    const Point& lastAt() const { return lastAt_; }
    const Point& lastTarget() const { return lastTarget_; }
    std::int64_t ticks() const { return ticks_; }
    double errorRms() const { return calcRms(squaredError_, ticks_); }  ///< not a number without ticks
    static double errorRms(const std::vector<Following>& joints);       ///< of all together
    double largestError() const { return ticks_ ? largest_ : kNan; }
    double spread() const;  ///< RMS distance of the command from its mean place
    double speedRms() const { return ticks_ > 1 ? calcRms(squaredSpeed_, ticks_ - 1) : 0.0; }  ///< [rad/s, m/s]
    /** Of the command. */
    double targetSpeedRms() const { return ticks_ > 1 ? calcRms(squaredTargetSpeed_, ticks_ - 1) : 0.0; }
    /** Of the sum of squared errors: the part while a limit of that kind acted on a joint, 0 to 1. A clearance counts for
    kWayBack_s more: an arm that was held off has its way back before it. It counts, too, where no limit acts and the arm
    is as near to something as references that keep clear go. */
    double share(LimitKind kind) const;
    static constexpr double kWayBack_s = 1.0;

    double moved() const { return moved_; }  ///< at most, from where it was first
    /** The command jumps, at its begin or after rests, and moves no more often: it is one of set-points. */
    bool jumps() const { return jumps_ > 0 && jumps_ >= moves_; }
    /** What is asked for: the command's spread, of set-points also half the largest distance to one when it came. */
    double asked() const { return jumps() ? std::max(spread(), jump_ / 2.0) : spread(); }
    /** The ticks that are judged: all but those of Pace::patience() after a jump, which no arm follows at once; and of a
    command that rests those after that time. */
    struct Judged {
        double squared = 0.0;
        std::int64_t ticks = 0;
        /** Not a number with less than half a second. */
        double rms(double tick_s) const;
    };
    const Judged& judged() const { return judged_; }
    const Judged& atRest() const { return atRest_; }
    /** Largest amplitude of a joint's swing about a command at rest that did not die out: six half-swings in a row of 0.005 and
    more, none less than 0.7 of the one before. 0: none. */
    double swing() const { return swing_; }

private:
    static double calcRms(double squared, std::int64_t ticks) {
        return ticks > 0 ? std::sqrt(squared / static_cast<double>(ticks)) : kNan;
    }
    void addSwing(double error, bool isAtRest);
    void addCauses(double squaredError, unsigned acting, double tick_s);

    Point first_ = Point::Zero(), firstAt_ = first_, lastAt_ = first_, lastTarget_ = first_, sum_ = first_;
    double moved_ = 0.0, squared_ = 0.0, squaredError_ = 0.0, largest_ = 0.0, squaredSpeed_ = 0.0,
           squaredTargetSpeed_ = 0.0;
    std::int64_t ticks_ = 0, jumps_ = 0, moves_ = 0;
    bool isFirst_ = true;
    double jump_ = 0.0;
    double rested_s_ = 0.0, patience_s_ = 0.0, arrival_s_ = 0.0;  // of the command; left after a jump; after any motion
    Judged judged_, atRest_;
    std::array<double, kMostLimitKinds> squaredBy_{};
    double heldOff_s_ = 0.0;                           // that is left of it
    double side_ = 0.0, peak_ = 0.0, lastPeak_ = 0.0;  // of the half-swing that goes on; of the one before
    int halfSwings_ = 0;
    double swing_ = 0.0;
};

/** What of a tool command is a task of this arm. */
struct ToolTask {
    Eigen::Matrix3d ways = Eigen::Matrix3d::Identity();  ///< projects on directions in which the joints move the tool
    bool hasTurns = true;                                ///< false: the joints give some directions up, turns first
    bool isRelative = false;  ///< the command's motion counts from where the tool is at the start
};

/** When the real arm, as measured, was first farther from the nominal one than its bound. */
struct TrackingTrip {
    int joint = 0;
    double time_s = 0.0;
    double error = 0.0;  ///< |q_measured - q_nominal| [rad, m]
    double bound = 0.0;  ///< [rad, m]
};

/** How one motor was used. Its torque is that of the motor after its limit, without ripple. */
struct MotorRecord {
    double worstUse = 0.0;     ///< largest share of the robot's torque limit
    double worstTime_s = 0.0;  ///< when
    double worstAdded = 0.0;   ///< largest share of it that the robust loop added
    /** Ticks at the robot's limit or beyond. For a weaker motor, those at the largest torque that it ever gave, when
    more was asked of it by the last of them: so it counts whatever its limit, and late commands do not. */
    std::int64_t ticksSaturated = 0;
    /** Ticks in which it changed as fast as it may, see RealArmReference::torqueRate. */
    std::int64_t ticksRateLimited = 0;
    /** Times the robust loop's torque went from a fifth of the robot's limit to as much the other way. */
    std::int64_t reversals = 0;
};

/** An arm that was asked to move and stood on its backup stop (FilterStatus::StoppedByPlan), at rest, in one go for
kLongStandstill_s or more. */
struct StandstillRecord {
    double longest_s = 0.0, begin_s = 0.0;  ///< the longest one and when it began
    double total_s = 0.0;                   ///< of all
    LimitKind limit = LimitKind::None;      ///< that acted at the end of the longest one
    LimitReport nearest;                    ///< the nearest obstacle or link then
};
inline constexpr double kLongStandstill_s = 2.0;

/** What a run came to, from its tick records alone (so a log gives the same summary again), but for limits
of the whole arm, which somebody else counts. */
class Summary {
public:
    /** @param reference  without a real plant: not looked at */
    Summary(std::vector<std::string> jointNames, JointLimits limits, bool hasRealPlant,
            RealArmReference reference = {});
    /** @param slides  by joint, see RobotDescription::slides(); empty: none does. For the units of what is written. */
    void setSliding(std::vector<bool> slides);

    void add(const TickRecord& record);
    /** The state that the last tick led to, which no record holds. */
    void addEnd(const MotionState& nominal, double time_s);

    /** In the order of their kinds. */
    void addAccount(LimitAccount account) { accounts_.push_back(std::move(account)); }

    static constexpr int kQuantities = 4;  ///< position, velocity, acceleration, jerk: LimitKind 1..4
    /** Per quantity (LimitKind Position..Jerk), one entry per joint. */
    const std::vector<LimitRecord>& limit(LimitKind kind) const { return limits_[static_cast<int>(kind) - 1]; }
    /** The joint with the worst use, and the sum of ticks outside over the joints. */
    int worstJoint(LimitKind kind) const;
    std::int64_t ticksOutside(LimitKind kind) const;
    /** A limit was passed while the arm was not recovering. */
    bool anyLimitBroken() const { return broken_; }
    /** The last tick or the state after it is still beyond a limit. */
    bool endsOutside() const;

    std::int64_t ticks() const { return ticks_; }
    std::int64_t ticksWith(FilterStatus status) const { return statusTicks_[static_cast<int>(status)]; }
    /** When a tick first had no admissible choice; meaningless without such ticks. */
    double firstInfeasible_s() const { return firstInfeasible_s_; }
    double changedShare() const;  ///< of the ticks: the filter changed the motion
    std::int64_t substitutedTicks() const { return substituted_; }
    /** What acted, by joint and limit name, such as {"joint0", "jerk_upper"}. */
    std::map<std::pair<std::string, std::string>, InterventionRecord> interventions() const;

    double tick_s() const { return tick_s_; }  ///< between two rows; 0 with fewer than two
    std::int64_t missedTicks() const { return missed_; }
    /** Ticks whose decision led to a state from which no stop within the limits was found; of a filter that
    guarantees limits no such decision is applied. */
    std::int64_t unviableTicks() const { return unviable_; }
    double firstUnviable_s() const { return firstUnviable_s_; }
    std::int64_t recoveringTicks() const { return recovering_; }
    /** Least margin of a tick and its stop to a position limit [rad, m]; infinity without such limits. */
    const ExtremeRecord& worstMargin() const { return worstMargin_; }
    const ExtremeRecord& longestStop() const { return longestStop_; }  ///< [s]

    /** RMS over ticks and joints of nominal - commanded position, the command moved into the position limits [rad, m].
    Not a number without joint commands. */
    double commandErrorRms() const { return Following::errorRms(following_); }
    /** RMS over ticks of the distance between the nominal tool and the commanded one [m]; not a number without tool
    commands. */
    double toolErrorRms() const { return tool_.errorRms(); }
    /** The nominal tool's position and orientation, and the real one's (its true state, where the plant knows it); without
    ticks where there are no tool commands. */
    const Following& tool() const { return tool_; }
    const Following& turn() const { return turn_; }
    const Following& realTool() const { return realTool_; }
    const Following& realTurn() const { return realTurn_; }
    /** Of a joint with joint commands; without ticks otherwise. */
    const Following& following(int joint) const { return following_[joint]; }
    /** RMS over ticks and joints of the real arm's - commanded position, as commandErrorRms() [rad]. */
    double realCommandErrorRms() const { return Following::errorRms(realFollowing_); }
    void setTask(const ToolTask& task) { task_ = task; }
    /** Distance that the filter keeps the arm at [m]. */
    void setSafetyDistance(double distance_m) { safetyDistance_m_ = distance_m; }
    const ToolTask& task() const { return task_; }
    /** RMS over ticks and joints of the nominal arm's jerk [rad/s^3, m/s^3]. */
    double jerkRms() const;
    /** RMS jerk of joints that a joint command presses against a position limit at rest, as a share of the jerk limit.
    Pressed: commanded to the limit or beyond, by the same command for 0.5 s. At rest: within 5 % of the range of that
    limit or beyond it, and for 0.5 s not moved by more than 0.1 % of the range. Not a number with less than one
    joint-second of it. */
    double chatter() const;

    /** Accounts of the limits of the whole arm. */
    const std::vector<LimitAccount>& accounts() const { return accounts_; }
    /** Null: the run has no such limit, or it was not counted. */
    const LimitAccount* account(LimitKind kind) const;
    const StandstillRecord& standstill() const { return standstill_; }

    bool hasRealPlant() const { return hasRealPlant_; }
    double trackingRms(int joint) const;                                  ///< of actual - nominal position [rad, m]
    double trackingMax(int joint) const { return largestError_[joint]; }  ///< [rad, m]
    double trackingRms() const;                                           ///< over all joints
    double trackingMax() const { return largestError_.maxCoeff(); }

    const RealArmReference& reference() const { return reference_; }
    /** The real arm's position or velocity against its limits, one entry per joint. */
    const std::vector<LimitRecord>& realLimit(LimitKind kind) const { return real_[findReal(kind)]; }
    /** The same from the trip on. */
    const std::vector<LimitRecord>& realStop(LimitKind kind) const { return realStop_[findReal(kind)]; }
    /** The real arm passed a position or velocity limit before it tripped, if it did at all, and while the nominal
    one was not recovering. */
    bool anyRealLimitBroken() const;
    /** Largest share of the tracking bound that actual - nominal position or velocity used; 0 without a bound. */
    double boundShare(LimitKind kind, int joint) const { return boundShare_[findReal(kind)][joint]; }
    /** The joint whose position or velocity used the largest share of its bound. */
    int worstBoundJoint(LimitKind kind) const;
    const std::optional<TrackingTrip>& trip() const { return trip_; }
    /** Fastest joint of the real arm in the last tick [rad/s, m/s]. */
    double realEndSpeed() const { return realEndSpeed_; }
    const MotorRecord& motor(int joint) const { return motors_[joint]; }
    /** Ticks without a usable external torque. */
    std::int64_t externalTorqueMissing() const { return externalTorqueMissing_; }

    /** What the real arm touched; none: it could not touch anything. */
    struct Touching {
        std::int64_t ticks = 0, touches = 0;  ///< that touch; times that it begins
        double first_s = 0.0, peak_s = 0.0;   ///< when [s]
        ContactReport peak;                   ///< where it pressed hardest
        double last = 0.0;                    ///< pressing in the last tick [N]
    };
    const std::optional<Touching>& touching() const { return touching_; }
    void watchContact() { touching_.emplace(); }
    /** How the nominal arm waited for a tool that is held (MATH 13); none: no contact force is asked for. */
    struct Waiting {
        double force = 0.0;                        ///< asked for in the file [N]
        std::int64_t ticks = 0;                    ///< that it waited
        double first_s = 0.0;                      ///< when first [s]
        double sum = 0.0, leastAsked = kInfinity;  ///< of the force along the normal; of what the joints may give [N]
        std::int64_t pressed = 0;                  ///< ticks that it pressed with at least half of that
        double mean() const { return pressed > 0 ? sum / static_cast<double>(pressed) : 0.0; }
    };
    const std::optional<Waiting>& waiting() const { return waiting_; }
    void watchTouch(double force) { waiting_.emplace().force = force; }

    const LatencyHistogram& tickTime() const { return tickTime_; }
    const LatencyHistogram& stageTime(Stage stage) const { return stageTimes_[static_cast<int>(stage)]; }
    const std::vector<std::string>& jointNames() const { return jointNames_; }
    const std::string& jointName(int joint) const { return jointNames_[joint]; }
    int size() const { return static_cast<int>(jointNames_.size()); }  ///< joints
    /** The joint's figures are in m and N, not in rad and Nm. */
    bool slides(int joint) const { return slides_[joint]; }

private:
    /** Adds `values` at a time to `records`; true when any is outside. */
    bool check(std::vector<LimitRecord>& records, LimitKind kind, const JointBounds& bounds, const JointVector& values,
               double time_s) const;
    void addIntervention(int joint, const TickRecord& record);
    void addStops(const TickRecord& record);
    bool hasJointCommand(const TickRecord& record) const;
    void addCommand(int joint, const TickRecord& record);
    void addTool(const TickRecord& record);
    Pose findAsked(const TickRecord& record, const Pose& tool) const;
    void addRest(int joint, const TickRecord& record);
    void addReading(const TickRecord& record);
    void addContact(const TickRecord& record);
    void addWaiting(const TickRecord& record);
    void addMotors(const TickRecord& record);
    void addMotor(int joint, const TickRecord& record);
    static std::size_t findReal(LimitKind kind) { return kind == LimitKind::Position ? 0 : 1; }

    std::vector<std::string> jointNames_;
    std::vector<bool> slides_;  // by joint
    JointLimits bounds_;
    bool hasRealPlant_;
    std::array<std::vector<LimitRecord>, kQuantities> limits_;
    RealArmReference reference_;
    std::array<std::vector<LimitRecord>, 2> real_, realStop_;  // position, velocity
    std::array<JointVector, 2> boundShare_;                    // likewise
    std::optional<TrackingTrip> trip_;
    std::vector<MotorRecord> motors_;
    /** Of one motor, magnitudes [Nm]: the largest torque given, and its ticks; the largest asked for; ticks at the
    robot's limit. */
    struct MotorPeak {
        double given = 0.0, asked = 0.0;
        std::int64_t ticks = 0, ticksAtLimit = 0;
        int pushedTo = 0;   // 1 upwards, -1 downwards: by the robust loop, last
        double last = 0.0;  // given in the tick before
    };
    std::vector<MotorPeak> peaks_;
    double realEndSpeed_ = 0.0, squaredJerk_ = 0.0;
    std::int64_t externalTorqueMissing_ = 0;
    std::optional<Touching> touching_;
    std::optional<Waiting> waiting_;
    std::array<std::int64_t, 8> statusTicks_{};  // by FilterStatus
    /** Of one joint: by kind and side, and what acted in the tick before. */
    struct Acting {
        std::array<std::array<InterventionRecord, 2>, kMostLimitKinds> records;
        JointIntervention last;
        std::int64_t episodeTicks = 0;
    };
    std::vector<Acting> acting_;
    bool isRecovering_ = false;  // in the last tick
    double tick_s_ = 0.0, lastTime_s_ = 0.0;
    std::int64_t missed_ = 0, unviable_ = 0, recovering_ = 0;
    double firstUnviable_s_ = 0.0, firstInfeasible_s_ = 0.0;
    ExtremeRecord worstMargin_, longestStop_;
    /** Where a joint came to rest and when; not a number before the first tick. */
    struct RestPeriod {
        double q, target, since_s;
    };
    std::vector<RestPeriod> rests_;
    double squaredRestJerk_ = 0.0;  // of jerk / limit
    double rested_s_ = 0.0;
    std::int64_t restTicks_ = 0;                        // joint-ticks
    std::vector<Following> following_, realFollowing_;  // by joint
    Following tool_, turn_, realTool_, realTurn_;
    ToolTask task_;
    double safetyDistance_m_ = -kInfinity;
    Pose commandOrigin_, toolOrigin_;  // where both were first
    unsigned actingKinds_ = 0;         // in this tick
    bool broken_ = false, isTouching_ = false;
    std::vector<LimitAccount> accounts_;
    StandstillRecord standstill_;
    std::int64_t standingTicks_ = 0;  ///< in a row
    double standingSince_s_ = 0.0;
    void addStandstill(const TickRecord& record);
    std::int64_t ticks_ = 0, substituted_ = 0;
    JointVector squaredError_, largestError_;
    std::int64_t readings_ = 0;  // of the real arm
    LatencyHistogram tickTime_;
    std::array<LatencyHistogram, kStageCount> stageTimes_;
};

}  // namespace viable
