#include <cstdio>
#include <exception>

#include "Paths.h"
#include "Properties.h"
#include "Random.h"
#include "tracking/TrackingBound.h"

namespace viable {

namespace {

/** A refusal that is shorter gives no reason and no remedy. */
constexpr std::size_t kLeastReason = 60;
/** Arms with a figure that nobody can mean. */
constexpr double kWildShare = 0.1;
/** Bounds that are compared with those of a smaller set, and up to which share. */
constexpr double kCompared = 0.3, kAgreement = 1e-6;

JointVector drawSizes(Random& random, int n, double least, double largest, double none) {
    JointVector v(n);
    for (double& x : v) x = random.chance(none) ? 0.0 : random.logUniform(least, largest);
    return v;
}

/** One joint or two, with any axes, masses, rotors and friction. */
RobotDescription drawRobot(Random& random) {
    RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") +
                                       (random.chance(0.5) ? "single_joint" : "planar_two_link"));
    const int n = robot.size();
    robot = withScaledMasses(std::move(robot), drawSizes(random, n, 1e-3, 1e3, 0.0));
    for (JointDescription& joint : robot.joints)
        if (random.chance(0.5)) joint.axis = Eigen::Vector3d::Unit(random.integer(0, 2));
    robot.gravity *= random.chance(0.3) ? 0.0 : 1.0;
    Actuation& a = robot.actuation;
    a.rotorInertia = drawSizes(random, n, 1e-4, 10.0, 0.5);
    a.torqueLimit = drawSizes(random, n, 1.0, 1e3, 0.0);
    a.friction = {drawSizes(random, n, 1e-3, 30.0, 0.3), drawSizes(random, n, 1e-3, 100.0, 0.3),
                  drawSizes(random, n, 1e-4, 10.0, 0.0)};
    return robot;
}

JointLimits drawLimits(Random& random, JointLimits limits, int n) {
    const auto set = [&](JointBounds& bounds, double least, double largest) {
        const JointVector upper = drawSizes(random, n, least, largest, 0.0);
        bounds = {-(random.chance(0.7) ? upper : drawSizes(random, n, least, largest, 0.0)), upper};
    };
    set(limits.position, 0.05, 10.0);
    set(limits.velocity, 1e-3, 10.0);
    set(limits.acceleration, 1e-2, 100.0);
    set(limits.jerk, 1e-1, 1e4);
    if (random.chance(0.1)) limits.jerk = {JointVector::Constant(n, -kInfinity), JointVector::Constant(n, kInfinity)};
    return limits;
}

DisturbanceSet drawSet(Random& random, int n) {
    DisturbanceSet set;
    const auto draw = [&](double least, double largest) {
        return random.chance(0.5) ? 0.0 : random.logUniform(least, largest);
    };
    set.frictionScale = drawSizes(random, n, 1e-3, 10.0, 0.1);
    const double known = random.chance(0.2) ? 1.0 : random.uniform(0.0, 1.0);  // 1: exactly
    if (random.chance(0.5)) set.frictionScaleMin = JointVector(known * set.frictionScale.expand(n));
    set.isFrictionConstant = random.chance(0.5);
    set.breakawayRatio = 1.0 + draw(0.01, 1.0);
    set.loadFriction = draw(1e-3, 0.3);
    set.massError = drawSizes(random, n, 1e-3, 0.5, 0.3);
    set.payload_kg = draw(1e-3, 30.0);
    set.payloadOffset_m = draw(1e-3, 0.5);
    set.baseTilt_rad = draw(1e-3, 2.0);
    set.torqueRipple_Nm = draw(1e-3, 10.0);
    set.externalTorque_Nm = drawSizes(random, n, 1e-3, 100.0, 0.5);
    set.readingError_rad = draw(1e-8, 1e-2);
    set.delayTicks = random.chance(0.5) ? 0 : random.integer(1, 5);
    return set;
}

NricOptions drawGains(Random& random, const RobotDescription& robot, const JointLimits& limits, double tick_s,
                      const DisturbanceSet& set) {
    const int n = robot.size();
    NricOptions gains = scaleNric(robot, limits, tick_s);
    if (random.chance(0.7)) {
        gains.kr = JointVector(random.logUniform(0.1, 2.5) * gains.kr.expand(n));
        gains.kp = JointVector(random.logUniform(0.1, 2.0) * gains.kp.expand(n));
        gains.ki = JointVector(random.logUniform(0.1, 2.0) * gains.ki.expand(n));
    }
    if (random.chance(0.4))
        gains.friction =
            scaleFriction(robot.actuation.friction,
                          (random.chance(0.3) ? 1.0 : random.uniform(0.3, 1.2)) * set.frictionScale[0], limits, tick_s);
    return gains;
}

/** Half of what pushes and readings add; the loop and the arm stay the same. */
DisturbanceSet halve(DisturbanceSet set, int n) {
    for (PerJoint* sizes : {&set.externalTorque_Nm, &set.torqueRipple_Nm, &set.loadFriction})
        *sizes = JointVector(0.5 * sizes->expand(n));
    set.readingError_rad *= 0.5;
    set.breakawayRatio = 1.0 + 0.5 * (set.breakawayRatio - 1.0);
    return set;
}

/** Puts a number that cannot be meant somewhere. */
void makeWild(Random& random, RobotDescription& robot, JointLimits& limits, NricOptions& gains, DisturbanceSet& set) {
    const int n = robot.size();
    const double numbers[] = {NAN, kInfinity, -1.0, 0.0, 1e300, 1e-300};
    const double number = numbers[random.integer(0, 5)];
    const int joint = random.integer(0, n - 1);
    JointFriction& friction = robot.actuation.friction;
    double* const places[] = {&robot.joints[static_cast<std::size_t>(joint)].body.mass,
                              &robot.actuation.rotorInertia[joint],
                              &friction.coulomb[joint],
                              &friction.viscous[joint],
                              &friction.viscousVelocity[joint],
                              &limits.velocity.upper[joint],
                              &limits.acceleration.upper[joint],
                              &set.payload_kg};
    PerJoint* const ofAll[] = {&gains.kr, &set.frictionScale};
    const int place = random.integer(0, 9);
    if (place == 7 || place == 8)
        *ofAll[place - 7] = number;
    else
        *places[std::min(place, 7)] = number;
}

}  // namespace

bool checkBound(const Options& options) {
    Run run("bound", options);
    std::map<std::string, int> reasons;
    std::int64_t bounds = 0;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        RobotDescription robot = drawRobot(random);
        const int n = robot.size();
        run.addSteps(n);
        JointLimits limits = drawLimits(random, robot.limits, n);
        const double tick_s = random.logUniform(2e-4, 5e-3);
        DisturbanceSet set = drawSet(random, n);
        NricOptions gains = drawGains(random, robot, limits, tick_s, set);
        if (random.chance(kWildShare)) makeWild(random, robot, limits, gains, set);
        try {
            const TrackingBound bound = calcTrackingBound(robot, limits, tick_s, gains, set, "the set");
            ++bounds;
            for (const JointVector* v : {&bound.position, &bound.velocity, &bound.measured, &bound.torque,
                                         &bound.lastingTorque, &bound.torqueStep, &bound.integralTorque})
                if (!v->allFinite() || !(v->minCoeff() > 0.0))
                    run.fail("a bound is not finite or not above 0", v->minCoeff());
            for (const TrackingBound::Part& part : bound.parts)
                if (!part.torque.allFinite() || !part.position.allFinite() || !part.velocity.allFinite())
                    run.fail("a part of the bound is not finite", 0.0);
            if (!random.chance(kCompared)) continue;
            TrackingBound less;
            try {
                less = calcTrackingBound(robot, limits, tick_s, gains, halve(set, n), "half of it");
            } catch (const Error&) {
                run.fail("less disturbance has no bound", 0.0);
                continue;
            }
            for (const auto& [small, large] : {std::pair{&less.position, &bound.position},
                                               {&less.velocity, &bound.velocity},
                                               {&less.torque, &bound.torque}})
                if (const double above = (*small - *large * (1.0 + kAgreement)).maxCoeff(); above > 0.0)
                    run.fail("less disturbance has a larger bound", above);
        } catch (const Error& e) {
            const std::string text = e.what();
            if (e.kind() != ErrorKind::BadInput || text.size() < kLeastReason) {
                run.fail("a refusal without a reason", 0.0);
                std::printf("  %s\n", text.c_str());
            }
            // Without figures, to count them.
            std::string reason = text.substr(0, text.find_first_of("=;,", text.find(": ") + 2));
            for (char& c : reason)
                if (std::isdigit(static_cast<unsigned char>(c))) c = '#';
            ++reasons[reason.substr(0, 90)];
        } catch (const std::exception& e) {
            run.fail("something else was thrown", 0.0);
            std::printf("  %s\n", e.what());
        }
    }
    run.print();
    run.expectShare("sets that have a bound", bounds, run.arm(), 0.1);
    for (const auto& [reason, count] : reasons) std::printf("  %6d refused: %s\n", count, reason.c_str());
    return run.isGood();
}

}  // namespace viable
