#include "TrackingSubjects.h"

#include "Joints.h"
#include "Paths.h"

namespace viable {

using test::joints;

const char* getName(Kind kind) {
    constexpr const char* kNames[] = {"friction", "constant", "known", "pushes", "payload", "readings", "all"};
    return kNames[static_cast<int>(kind)];
}

void setLimits(JointLimits& limits, double velocity, double acceleration, double jerk) {
    const auto n = limits.position.lower.size();
    const auto set = [&](JointBounds& bounds, double size) {
        bounds = {JointVector::Constant(n, -size), JointVector::Constant(n, size)};
    };
    set(limits.velocity, velocity);
    set(limits.acceleration, acceleration);
    set(limits.jerk, jerk);
}

Subject loadSubject(const std::string& name, bool anywhere) {
    Subject s;
    s.name = name;
    const std::string folder = name == "late_two_link" ? "planar_two_link" : name == "geared_panda" ? "panda" : name;
    s.robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + folder);
    const int n = s.robot.size();
    s.limits = s.robot.limits;
    JointFriction& friction = s.robot.actuation.friction;
    const auto stayNearHome = [&] {  // where the inertias let gains be large enough for a bound
        if (anywhere) return;
        s.limits.position = {s.robot.home - JointVector::Constant(n, 0.5),
                             s.robot.home + JointVector::Constant(n, 0.5)};
    };
    DisturbanceSet& set = s.all;
    if (name == "indy7") {  // experiments/indy7_real_limits.yaml, with pushes and reading errors
        const JointVector center = kPi * joints(0.0, -1.0 / 12.0, -0.5, 0.0, -5.0 / 12.0, 0.0);
        const JointVector half = kPi * joints(1.0 / 6.0, 1.0 / 12.0, 1.0 / 6.0, 1.0 / 12.0, 1.0 / 6.0, 1.0 / 3.0);
        s.limits.position = {center - half, center + half};
        setLimits(s.limits, 0.8, 2.0, 10.0);
        s.gains = {joints(1950, 2600, 1000, 400, 450, 390), 78.0, 8.0};
        set.frictionScale = 3.0;
        set.payload_kg = 7.0;
        set.massError = 0.05;
        set.externalTorque_Nm = 3.0;
        set.torqueRipple_Nm = 1.0;
        set.readingError_rad = 2e-6;
    } else if (name == "late_two_link") {
        setLimits(s.limits, 0.5, 2.0, 20.0);
        set.delayTicks = 2;
        s.gains = scaleNric(s.robot, s.limits, s.tick_s);
        s.gains.kr = JointVector(0.3 * s.gains.kr.expand(n));
        set.frictionScale = 0.1;
        set.payload_kg = 0.05;
        set.massError = 0.01;
        set.externalTorque_Nm = joints(0.3, 0.05);
        set.readingError_rad = 1e-5;
    } else if (name == "planar_two_link") {
        setLimits(s.limits, 0.5, 2.0, 20.0);
        s.gains = scaleNric(s.robot, s.limits, s.tick_s);
        set.breakawayRatio = 1.3;
        set.loadFriction = 0.02;
        set.payload_kg = 0.2;
        set.payloadOffset_m = 0.05;
        set.massError = 0.05;
        set.baseTilt_rad = 0.02;
        set.externalTorque_Nm = joints(1.0, 0.2);
        set.torqueRipple_Nm = joints(0.3, 0.1);
        set.readingError_rad = 1e-5;
    } else if (name == "ur5e") {
        stayNearHome();
        setLimits(s.limits, 0.3, 1.0, 10.0);
        s.gains = scaleNric(s.robot, s.limits, s.tick_s);
        const JointVector kr = s.gains.kr.expand(n);
        friction = {0.003 * kr, 0.005 * kr, JointVector::Constant(n, 0.2)};  // none is public
        set.payload_kg = 0.2;
        set.massError = 0.02;
        set.externalTorque_Nm = JointVector(0.005 * kr);
        set.readingError_rad = 1e-6;
    } else if (name == "geared_panda") {  // with rotors that a public model assumes
        stayNearHome();
        setLimits(s.limits, 0.5, 1.0, 10.0);
        s.robot.actuation.rotorInertia.setConstant(0.1);
        s.gains = scaleNric(s.robot, s.limits, s.tick_s);
        set.frictionScale = 1.2;
        set.payload_kg = 0.08;
        set.massError = 0.01;
        set.externalTorque_Nm = JointVector(0.001 * s.gains.kr.expand(n));
        set.readingError_rad = 1e-6;
    } else if (name == "panda") {
        stayNearHome();
        setLimits(s.limits, 0.05, 0.1, 0.5);
        s.gains = scaleNric(s.robot, s.limits, s.tick_s);
        s.gains.kp = 30.0;
        s.gains.ki = 10.0;
        set.frictionScale = 0.01;
        set.payload_kg = 0.02;
        set.externalTorque_Nm = JointVector(0.001 * s.gains.kr.expand(n));
        set.readingError_rad = 1e-6;
    } else {                                  // single_joint
        s.robot.gravity = {-9.81, 0.0, 0.0};  // else a payload would have no weight
        friction = {joints(2.0), joints(10.0), joints(0.5)};
        setLimits(s.limits, 1.0, 3.0, 30.0);
        s.gains = {300.0, 30.0, 50.0};
        set.delayTicks = 1;
        set.payload_kg = 0.5;
        set.payloadOffset_m = 0.1;
        set.massError = 0.1;
        set.externalTorque_Nm = 3.0;
        set.torqueRipple_Nm = 1.0;
        set.readingError_rad = 2e-5;
    }
    s.robot.actuation.torqueLimit = JointVector::Constant(n, kInfinity);
    return s;
}

namespace {

/** What is known of the friction lies in the middle between the largest and the least factor, 20 % from both. */
constexpr double kKnownLeast = 0.8 / 1.2, kKnownMiddle = 1.0 / 1.2;

}  // namespace

NricOptions selectGains(const Subject& subject, const JointLimits& limits, Kind kind) {
    NricOptions gains = subject.gains;
    if (kind == Kind::Known) {
        const JointVector scale = kKnownMiddle * subject.all.frictionScale.expand(subject.robot.size());
        gains.friction = scaleFriction(subject.robot.actuation.friction, scale, limits, subject.tick_s);
    }
    return gains;
}

DisturbanceSet select(const DisturbanceSet& all, Kind kind) {
    DisturbanceSet set = all;
    if (kind == Kind::All) return set;
    set.isFrictionConstant = kind == Kind::Constant || kind == Kind::Known;
    if (kind == Kind::Known) set.frictionScaleMin = kKnownLeast * set.frictionScale[0];
    if (kind != Kind::Friction && !set.isFrictionConstant) {
        set.frictionScale = set.loadFriction = 0.0;
        set.breakawayRatio = 1.0;
    }
    if (kind != Kind::Pushes) set.externalTorque_Nm = set.torqueRipple_Nm = 0.0;
    if (kind != Kind::Payload) {
        set.massError = 0.0;
        set.payload_kg = set.payloadOffset_m = set.baseTilt_rad = 0.0;
    }
    if (kind != Kind::Readings) set.readingError_rad = 0.0;
    return set;
}

FrictionRange findFrictionRange(const DisturbanceSet& set, int n) {
    return {set.frictionScaleMin.expand(n), set.frictionScale.expand(n), set.isFrictionConstant};
}

}  // namespace viable
