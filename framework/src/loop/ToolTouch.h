#pragma once

#include "viable/log/TickRecord.h"
#include "viable/plugin/RobustLoop.h"
#include "viable/robot/RobotModel.h"

namespace viable::detail {

/** A surface that holds the real tool: the tool may be where normal' x >= offset. */
struct ToolSurface {
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< out of it, base frame
    double offset = 0.0;                                ///< [m]
};

/** The motion of the joints that moves the tool by `step` (linear, angular) while it changes `wish` least, by damped least
squares: the linear part goes before the angular one, where there are too few joints for both. @return [rad, m] */
JointVector calcJointStep(const ToolJacobian& J, const Vector6& step, const JointVector& wish);

/** The contact of the real arm's tool with what stands in its way, by its torque sensors (MATH 13).

It begins when the sensors show more at the tool than it is to press with: `force`, or what the joints may give, if that is a
tenth of it or more. The tool must have a lever there. It ends where the host says so. Its normal is the force
without the part along the tool's way: Coulomb's friction acts along that. While the tool does not move the normal stays.
Where the tool has bounced off it goes back to the surface, and on into it when that is gone.
Then the robust loop holds the tool no longer along the normal. It sees no error there, and of the velocity

    v = -(F - f) / B,  B = max(F / kApproach, kContact_s k)

f [N] the force now, F the one asked for, k [N/m] the stiffness at the deepest point of the first blow. F, and the integral of
F - f against the joints' friction, come as torques on top. All that fades in and out over kLead, in which the nominal tool is
deeper than the real one.
Assumes: the tool touches one surface, and the force has no moment about the tool.
Real time: no allocation, lock or throw after construction. */
class ToolTouch {
public:
    /** Deepest nominal tool below the real one [m]. */
    static constexpr double kLead = 0.005;
    /** Speed at which it feels for a surface that it lost [m/s]. */
    static constexpr double kApproach = 0.05;
    /** Time constants [s]: of the force, and of friction that is made up for; of the filter of the place; of the bouncing. */
    static constexpr double kContact_s = 0.1, kFriction_s = 0.05, kPlace_s = 0.02, kSettling_s = 0.5;
    /** Share of what may be added to a joint that pressing may take. */
    static constexpr double kRoom = 0.6;
    /** Way along the surface after which it shows the normal anew [m], and what then counts of that; and its largest slope: what
    is steeper shows that the surface gave way. */
    static constexpr double kWay = 0.001, kTurn = 0.3, kSlope = 0.3;

    /** @param law  of the robust loop; null: not known */
    ToolTouch(const RunSetup& setup, double force, const LinearErrorLoop* law);

    void reset();
    /** @param external  as the sensors measure it [Nm]
    @param rest     torque that may be added to each joint [Nm]
    @param driving  what drives its motor without that [Nm]: the force gives way where kRoom of both's room is not enough */
    void update(const JointState& real, const JointVector& external, const JointVector& rest,
                const JointVector& driving);
    void end() { isOn_ = false; }

    bool isOn() const { return isOn_; }
    /** It began a moment ago, and the tool may bounce. */
    bool isSettling() const { return isOn_ && since_s_ < kSettling_s; }
    /** Nothing has been felt for kContact_s. */
    bool hasLost() const { return air_s_ > kContact_s; }
    /** Where the nominal tool may be. */
    ToolSurface surface() const { return {normal_, offset_ - kLead}; }
    /** Changes `real` to what the robust loop is to see.
    @param wants  the place that the command leads the tool to [m] */
    void see(const MotionState& nominal, const Dynamics& dynamics, const Eigen::Vector3d& wants, JointState& real);
    /** What was given last [Nm]. */
    const JointVector& external() const { return external_; }
    void fill(TickRecord::Touch& record) const;
    /** The torques that press [Nm]. */
    const JointVector& push() const { return push_; }
    /** The sensors account for what was added to the joint, but for its friction. @param beyond  of the torque [Nm] */
    bool explains(int joint, double beyond) const;

private:
    void begin(const Eigen::Vector3d& force);
    void turnNormal(const Eigen::Vector3d& force);
    void limitForce(const Eigen::Vector3d& direction, const JointVector& rest, const JointVector& driving);
    bool feels(double force) const;
    double calcWanted();
    void liftNominal(const MotionState& nominal, const Dynamics& dynamics, double above, double share);
    void learnStiffness(double force);
    double calcDamping(const JointVector& pull, const JointMatrix& M) const;

    double force_ = 0.0, asked_ = 0.0, most_ = 0.0, mostBack_ = 0.0, tick_s_ = 0.0;  // [N]; most: with friction
    JointFriction friction_;
    JointVector motor_;                   // limits
    std::optional<LinearErrorLoop> law_;  // none: not known
    std::shared_ptr<RobotModel> model_;
    Dynamics dynamics_, ofLifted_;  // of the real arm; of the nominal one that is lifted
    JointVector external_, push_, lifted_, liftedRate_;
    bool isOn_ = false, hasFree_ = false;
    Eigen::Vector3d normal_ = Eigen::Vector3d::UnitZ();
    Eigen::Vector3d place_ = Eigen::Vector3d::Zero();        // of the tool, smoothed
    Eigen::Vector3d begin_ = Eigen::Vector3d::Zero();        // of the present way
    double beginForce_ = 0.0, since_s_ = 0.0, air_s_ = 0.0;  // there; since the first and the last touch
    double offset_ = 0.0;                                    // of the surface [m]
    Eigen::Vector3d free_ = Eigen::Vector3d::Zero();         // where it last touched nothing
    double measured_ = 0.0;                                  // along the normal [N]
    double deepest_ = 0.0, stiffness_ = 0.0, integral_ = 0.0, share_ = 0.0;
};

}  // namespace viable::detail
