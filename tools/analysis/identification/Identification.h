#pragma once

#include <array>

#include "analysis/records/MotionRecord.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** What a payload error is taken for. */
enum class PayloadModel : unsigned char {
    None,           ///< the description's masses are right
    Mass,           ///< a point mass at the tool frame's origin
    MassAndCentre,  ///< a point mass anywhere in the tool frame
};

struct IdentificationOptions {
    PayloadModel payload = PayloadModel::MassAndCentre;
    bool bodyMasses = false;     ///< a factor on mass and inertia of the body behind each joint, too
    bool rotorInertias = false;  ///< an error of each joint's reflected rotor inertia, too
    bool torqueOffsets = false;  ///< a constant torque error of each joint, too
    /** A common delay of all torques' effect behind their times, and one of the friction behind the velocity, too: where
    friction is strong, a millisecond looks like inertia. */
    bool delays = true;
    /** A torque acts from its row to the next, as in logs of this program; otherwise it is that at its row's time. */
    bool isTorqueHeld = true;
    double window_s = 0.0;  ///< of one equation; 0: chosen by the noise
};

/** An estimate with what is known of its error. Not a number throughout where it was not estimated. */
struct IdentifiedFigure {
    double value = std::numeric_limits<double>::quiet_NaN();
    double deviation = std::numeric_limits<double>::quiet_NaN();  ///< standard error
    /** 95 % interval, not symmetric where the error is not; infinity: open to that side. */
    double lower = std::numeric_limits<double>::quiet_NaN();
    double upper = std::numeric_limits<double>::quiet_NaN();
    bool isKnown = false;  ///< the motion tells it
    std::string reason;    ///< why it is not
};

/** Which friction law the motion of a joint tells, from most to least. */
enum class FrictionForm : unsigned char {
    Saturating,     ///< all three figures
    KnownVelocity,  ///< coulomb and viscous, with the viscous velocity that the robot has
    Line,           ///< coulomb and a slope: straight, where the robot's viscous velocity would bend it
    CoulombOnly,    ///< with the robot's viscous figures
    None,           ///< the robot's figures stay
};

/** "saturating", "line", ...: the words used in reports. */
const char* getName(FrictionForm form);

/** A law that was not fitted, and how much of the residual it would explain. */
struct ResidualCheck {
    std::string name;      ///< "load friction", ...
    double share = 0.0;    ///< RMS torque that it explains over the RMS friction torque
    double t = 0.0;        ///< its factor over the factor's standard error
    bool isFound = false;  ///< beyond chance, and large enough to matter
};

/** Does the law that was fitted describe the joint? */
enum class ModelVerdict : unsigned char {
    NotIdentified,
    Adequate,     ///< what is left over is noise, or too small to matter
    Approximate,  ///< some of it is not, and is named; errors may be larger than they say
    Doubtful,     ///< much of it is not, or most torque is unexplained
};

/** "not identified", "adequate", ...: the words used in reports. */
const char* getName(ModelVerdict verdict);

/** What a record tells of one joint. Prismatic joints: [m], [N], [kg] in place of [rad], [Nm], [kg m^2]. */
struct JointIdentification {
    std::string name;
    bool isPrismatic = false;
    FrictionForm form = FrictionForm::None;
    std::string reason;  ///< why the form is not Saturating; empty where it is

    /** tau_f(qd) = sign(qd) (coulomb + viscous (1 - exp(-|qd| / viscousVelocity))). */
    IdentifiedFigure coulomb;          ///< [Nm]
    IdentifiedFigure viscous;          ///< [Nm]
    IdentifiedFigure viscousVelocity;  ///< [rad/s]
    IdentifiedFigure slope;            ///< viscous / viscousVelocity, at rest [Nm s/rad]
    Eigen::Matrix3d covariance;        ///< of coulomb, slope and 1 / viscousVelocity; zero where not fitted
    IdentifiedFigure rotorInertia;     ///< error of the description's, reflected [kg m^2]
    IdentifiedFigure torqueOffset;     ///< [Nm]

    std::array<double, 3> old{};      ///< coulomb, viscous, viscousVelocity of the description
    std::array<double, 3> written{};  ///< the same for actuation.yaml

    int equations = 0;
    int blocks = 0;  ///< segments of time with equations: what the errors are counted from
    double moving_s = 0.0;
    double slowest = 0.0, fastest = 0.0;  ///< speeds that were used [rad/s]
    double frictionRms = 0.0;             ///< of the friction that was found [Nm]
    double residualRms = 0.0;             ///< of the equations [Nm]
    double explained = 0.0;               ///< share of the square of what the nominal rigid arm leaves open
    double correlation = 0.0;             ///< of the residuals of windows that follow each other without overlap
    std::vector<ResidualCheck> checks;
    ModelVerdict verdict = ModelVerdict::NotIdentified;
};

/** A point mass at the tool that the description does not have; below zero: it has too much. */
struct PayloadIdentification {
    PayloadModel model = PayloadModel::None;  ///< that was fitted in the end
    std::string reason;                       ///< why it is less than was asked for
    IdentifiedFigure mass;                    ///< [kg]
    std::array<IdentifiedFigure, 3> moment;   ///< mass times place, tool frame [kg m]
    std::array<IdentifiedFigure, 3> centre;   ///< place, tool frame [m]; unknown where the mass may be zero
    bool isFound() const { return mass.isKnown && (mass.lower > 0.0 || mass.upper < 0.0); }
};

struct Identification {
    std::string robot;
    std::vector<std::string> sources;
    std::vector<JointIdentification> joints;  ///< as in the description
    PayloadIdentification payload;
    IdentifiedFigure torqueDelay;  ///< of the torques' effect behind their times [s]
    /** Of friction behind the velocity (frictional lag: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30,
    1994) [s]. A simulation that finds friction from the velocity at a step's end shows minus half a step. */
    IdentifiedFigure frictionDelay;
    std::vector<IdentifiedFigure> bodyMasses;  ///< factor per joint's body; empty: not asked for
    double duration_s = 0.0;
    double window_s = 0.0;
    double block_s = 0.0;
    int equations = 0;
    int blocks = 0;
};

/** Finds joint friction and a payload's mass from positions and torques of arms that moved.

Method: tau = M(q) qdd + b(q, qd) + f(qd) + Y(q, qd, qdd) (m, m c), M and b of `nominal`,
tau and f with a delay to first order. Both sides are averaged over
windows with the weight 1 - cos(2 pi s), s from 0 to 1: the weak form, in which an error of qdd counts by its integral
only, and torque and motion pass the same filter (cf. Swevers, Verdonck and De Schutter, "Dynamic model identification for
industrial robots", IEEE Control Systems 27, 2007; Preisig and Rippin, Computers and Chem. Eng. 17, 1993). q, qd and qdd
are those of smoothMotion(). A window lies where the joint's velocity surely has one sign: near a reversal, and at rest,
friction is anything between two values.
All joints at once by Gauss-Newton on (Fc, Fv1 / Fv2, 1 / Fv2) of each and the shared payload: weighted by each
joint's own residuals, normal equations by sparse L D L' (SuiteSparse). In 1 / Fv2 the straight line is an inner point,
not infinity; so whether the friction saturates is an ordinary test.
Errors: delete-a-block jackknife over segments of time (Kuensch, Ann. Statist. 17, 1989): residuals may be correlated in
time within a segment and between joints, and need not have one variance. Intervals by Student's t with one degree
of freedom less than segments; of Fv1 and Fv2 by those of their inverses.
Checks: of each joint's residuals by laws that were left out (offset, Stribeck, load, inertia, masses, tilt of the
base, place, speed squared, direction), each as if it had been added to the fit (score test), at 1 % over all of them
together; and by what of the residuals lasts longer than a window.

Assumes: nothing touches the arm; torques are those of the motors at the joints. What lies outside the model and changes
as slowly as a segment of time lasts, is not in the standard errors.
@param nominal  the description to be corrected; its folder is not read
@param records  each with all of its joints
Throws Error (BadInput): a joint that is missing or unknown, no torques, too short. */
Identification identify(const RobotDescription& nominal, const std::vector<MotionRecord>& records,
                        const IdentificationOptions& options = {});

/** For a console: tables, and what to do with them. */
std::string writeText(const Identification& found);

/** The same as JSON, with all digits. What is not known is null, an open end of an interval too. */
std::string writeJson(const Identification& found);

/** The text of nominal.folder's actuation.yaml with the friction that was found; everything else, comments too, as it is.
Joints of which nothing was found keep their figures. Throws Error (BadInput) where that file cannot be read. */
std::string writeActuation(const RobotDescription& nominal, const Identification& found);

}  // namespace viable
