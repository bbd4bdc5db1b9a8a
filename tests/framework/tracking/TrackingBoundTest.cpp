#include "Paths.h"

#include <cstdio>
#include <functional>

#include "Complaint.h"
#include "tracking/ArmExtremes.h"
#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

RobotDescription loadTestRobot(const char* name) {
    return loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name);
}

/** Nothing disturbs: sums start from here. */
DisturbanceSet makeNone() {
    DisturbanceSet none;
    none.frictionScale = 0.0;
    return none;
}

/** The loop of one joint of inertia m, written down a second time: nominal at rest, torque `w(k)` within tick k. */
class OneJoint {
public:
    OneJoint(double m, double kr, double kp, double ki, double h, int delay)
        : m_(m), kr_(kr), kp_(kp), ki_(ki), h_(h), late_(static_cast<std::size_t>(delay), 0.0) {}
    /** e at the ticks 0 .. ticks. */
    std::vector<double> run(int ticks, const std::function<double(int)>& w) {
        double e = 0.0, de = 0.0, before = 0.0, sum = 0.0;
        std::vector<double> queue = late_, errors{e};
        for (int k = 0; k < ticks; ++k) {
            sum += e * h_;
            queue.push_back(-kr_ * ((e - before) / h_ + kp_ * e + ki_ * sum));
            const double a = (queue.front() + w(k)) / m_;
            queue.erase(queue.begin());
            before = e;
            e += h_ * de + 0.5 * h_ * h_ * a;
            de += h_ * a;
            errors.push_back(e);
        }
        return errors;
    }

private:
    double m_, kr_, kp_, ki_, h_;
    std::vector<double> late_;
};

/** The error that the worst of all torques up to 1 Nm, constant within ticks, has caused after `ticks`. */
double findWorst(OneJoint loop, int ticks) {
    const std::vector<double> impulse = loop.run(ticks, [](int k) { return k == 0 ? 1.0 : 0.0; });
    return loop.run(ticks, [&](int k) { return impulse[static_cast<std::size_t>(ticks - k)] < 0.0 ? -1.0 : 1.0; })
        .back();
}

double findMass(const RobotDescription& robot) {
    const BodyInertia& body = robot.joints[0].body;
    const Eigen::Vector3d axis = robot.joints[0].axis;
    return robot.actuation.rotorInertia[0] +
           (robot.joints[0].type == JointType::Prismatic
                ? body.mass
                : axis.dot(body.inertia * axis) + body.mass * axis.cross(body.com).squaredNorm());
}

/** A joint that nothing but the disturbance moves: slow limits. */
JointLimits makeSlow(const RobotDescription& robot) {
    JointLimits limits = robot.limits;
    const int n = robot.size();
    const auto set = [&](JointBounds& bounds, double size) {
        bounds = {JointVector::Constant(n, -size), JointVector::Constant(n, size)};
    };
    set(limits.velocity, 1e-3);
    set(limits.acceleration, 1e-3);
    set(limits.jerk, 1e-3);
    return limits;
}

// The peak gain is the largest error that any torque can cause: no bigger, and nearly reached by the worst one.
TEST(TrackingBound, IsReachedByTheWorstTorqueOnOneJoint) {
    const RobotDescription robot = loadTestRobot("single_joint");
    const double m = findMass(robot), h = 1e-3, force = 3.0;
    for (const int delay : {0, 2})
        for (const double kappa : {0.1, 0.4}) {
            const NricOptions gains{kappa * m / h, 20.0, 30.0};
            DisturbanceSet set = makeNone();
            set.delayTicks = delay;
            const double none = calcTrackingBound(robot, makeSlow(robot), h, gains, set).position[0];
            set.externalTorque_Nm = force;
            const double bound = calcTrackingBound(robot, makeSlow(robot), h, gains, set).position[0];
            const double worst = force * findWorst(OneJoint(m, kappa * m / h, 20.0, 30.0, h, delay), 8000);
            std::printf("  k_r dt / m %.1f, delay %d: bound %.6g, worst torque %.6g rad\n", kappa, delay, bound - none,
                        worst);
            EXPECT_LE(worst, bound);
            EXPECT_GT(worst, 0.99 * (bound - none));
        }
}

// One number for gains that diverge, found by the program itself, against the loop written down here.
TEST(TrackingBound, UnstableGainsAreRefusedWithTheLargestStableOnes) {
    const RobotDescription robot = loadTestRobot("single_joint");
    const double m = findMass(robot), h = 1e-3;
    const auto reach = [&](double kr) {
        return std::abs(OneJoint(m, kr, 20.0, 8.0, h, 0).run(4000, [](int k) { return k == 0 ? 1.0 : 0.0; }).back());
    };
    const DisturbanceSet read = makeNone();
    const auto calc = [&](double gain, const char* place) {
        calcTrackingBound(robot, makeSlow(robot), h, {gain, 20.0, 8.0}, read, place);
    };
    std::string told = test::catchError([&] { calc(3.0 * m / h, "here"); });
    EXPECT_EQ(told.find("here: the robust loop is unstable with k_r = "), 0u) << told;
    const std::string before = "the other gains kept, is ";
    ASSERT_NE(told.find(before), std::string::npos) << told;
    const double stable = std::stod(told.substr(told.find(before) + before.size()));
    EXPECT_LT(reach(0.99 * stable), 1e-3);
    EXPECT_GT(reach(1.02 * stable), 1.0);
    EXPECT_NO_THROW(calcTrackingBound(robot, makeSlow(robot), h, {0.98 * stable, 20.0, 8.0}, read));

    // Between the two a response takes so long to die out that it counts as unstable.
    double good = 0.98 * stable, bad = 1.02 * stable;
    for (int k = 0; k < 50; ++k) {
        const double middle = 0.5 * (good + bad);
        told = test::findComplaint([&] { calc(middle, ""); });
        if (told.find("hardly dies out, it is next to unstable, at q = ") != std::string::npos) break;
        (told.empty() ? good : bad) = middle;
    }
    EXPECT_EQ(told.find("the response of the error loop at "), 0u) << told;
    EXPECT_CONTAINS(told, "take half of them.");
}

// Each disturbance makes the bound larger, and the parts name it.
TEST(TrackingBound, GrowsWithEveryDisturbance) {
    const RobotDescription robot = loadTestRobot("planar_two_link");
    JointLimits limits = robot.limits;
    limits.velocity = {JointVector::Constant(2, -0.3), JointVector::Constant(2, 0.3)};
    limits.acceleration = {JointVector::Constant(2, -1.0), JointVector::Constant(2, 1.0)};
    NricOptions gains = scaleNric(robot, limits, 1e-3);
    gains.kr = JointVector(0.5 * gains.kr.expand(2));  // room for a delay
    const TrackingBound none = calcTrackingBound(robot, limits, 1e-3, gains, makeNone());
    const auto expectLarger = [&](const char* source, const std::function<void(DisturbanceSet&)>& add) {
        DisturbanceSet set = makeNone();
        add(set);
        const TrackingBound bound = calcTrackingBound(robot, limits, 1e-3, gains, set);
        EXPECT_GT(bound.position.minCoeff(), none.position.minCoeff()) << source;
        EXPECT_GT(bound.position.sum(), 1.001 * none.position.sum()) << source;
        EXPECT_GT(bound.velocity.sum(), none.velocity.sum()) << source;
        bool named = false;
        for (const TrackingBound::Part& part : bound.parts)
            named |= part.source.find(source) == 0 && part.position.maxCoeff() > 0.0;
        EXPECT_TRUE(named) << source;
        EXPECT_TRUE(((bound.measured - bound.position).array() >= 0.0).all());
    };
    expectLarger("payload", [](auto& set) { set.payload_kg = 0.2; });
    expectLarger("payload", [](auto& set) {
        set.payload_kg = 0.2;
        set.payloadOffset_m = 0.1;
    });
    expectLarger("mass error", [](auto& set) { set.massError = 0.05; });
    expectLarger("torque ripple", [](auto& set) { set.torqueRipple_Nm = 0.5; });
    expectLarger("external torque", [](auto& set) { set.externalTorque_Nm = 0.5; });
    expectLarger("tilted base", [](auto& set) { set.baseTilt_rad = 0.05; });
    expectLarger("held and late torque", [](auto& set) { set.delayTicks = 1; });
    expectLarger("encoder", [](auto& set) { set.readingError_rad = 1e-5; });
}

TEST(TrackingBound, RefusesWhatHasNoBound) {
    const RobotDescription robot = loadTestRobot("single_joint");
    const auto expectRefused = [&](const JointLimits& limits, const NricOptions& gains, const DisturbanceSet& set,
                                   const char* what) {
        test::expectError({what}, [&] { calcTrackingBound(robot, limits, 1e-3, gains, set, "here"); });
    };
    JointLimits open = makeSlow(robot);
    open.velocity.upper.setConstant(INFINITY);
    expectRefused(open, {100.0, 20.0, 8.0}, makeNone(), "no limit on velocity or acceleration");
    expectRefused(makeSlow(robot), {100.0, 20.0, 0.0}, makeNone(), "a gain of the robust loop is 0");
}

/** A small arm with friction figures, slow limits and gains for both. */
struct FrictionCase {
    RobotDescription robot = loadTestRobot("planar_two_link");
    JointLimits limits = robot.limits;
    NricOptions gains;
    FrictionCase() {
        limits.velocity = {JointVector::Constant(2, -0.5), JointVector::Constant(2, 0.5)};
        limits.acceleration = {JointVector::Constant(2, -2.0), JointVector::Constant(2, 2.0)};
        robot.actuation.friction = {JointVector::Constant(2, 0.2), JointVector::Constant(2, 1.0),
                                    JointVector::Constant(2, 0.4)};
        gains = scaleNric(robot, limits, 1e-3);
    }
    TrackingBound calc(const DisturbanceSet& set) const {
        return calcTrackingBound(robot, limits, 1e-3, gains, set, "here");
    }
};

// A factor that stays the same disturbs less than one that jumps; one that is nearly known and fed forward hardly at all.
TEST(TrackingBound, KnowsWhetherFrictionJumpsAndWhatIsFedForward) {
    FrictionCase c;
    c.robot.actuation.friction.coulomb.setZero();
    DisturbanceSet set;
    const TrackingBound jumping = c.calc(set);
    set.isFrictionConstant = true;
    const TrackingBound constant = c.calc(set);
    EXPECT_TRUE((constant.position.array() <= jumping.position.array()).all());
    EXPECT_TRUE((constant.velocity.array() < 0.95 * jumping.velocity.array()).all());
    set.frictionScaleMin = 0.9;
    // Friction that is never less than that damps.
    EXPECT_TRUE((c.calc(set).velocity.array() < 0.99 * constant.velocity.array()).all());
    c.gains.friction = scaleFriction(c.robot.actuation.friction, 0.95, c.limits, 1e-3);
    const TrackingBound known = c.calc(set);
    EXPECT_TRUE((known.position.array() < 0.6 * constant.position.array()).all())
        << known.position.transpose() << " / " << constant.position.transpose();
    // The motors carry the friction all the same.
    for (int i = 0; i < 2; ++i) EXPECT_NEAR(known.lastingTorque[i], constant.lastingTorque[i], 1e-9);
}

// Nothing of it is left where friction is known exactly: as many sources in every view and phase, and no bound of zero.
TEST(TrackingBound, TakesFrictionThatIsKnownExactly) {
    FrictionCase c;
    c.robot.actuation.friction.coulomb.setZero();
    DisturbanceSet set;
    const TrackingBound unknown = c.calc(set);
    for (const bool isConstant : {false, true}) {
        set.isFrictionConstant = isConstant;
        set.frictionScaleMin = set.frictionScale = 1.0;
        c.gains.friction = scaleFriction(c.robot.actuation.friction, 1.0, c.limits, 1e-3);
        const TrackingBound known = c.calc(set);
        EXPECT_TRUE(known.position.allFinite() && known.velocity.allFinite());
        EXPECT_GT(known.position.minCoeff(), 0.0);
        EXPECT_TRUE((known.position.array() < 0.6 * unknown.position.array()).all())
            << known.position.transpose() << " / " << unknown.position.transpose();
        for (const TrackingBound::Part& part : known.parts)
            if (part.source == "viscous friction" && isConstant)
                EXPECT_LT(part.position.maxCoeff(), 0.5 * known.position.maxCoeff());
    }
}

// Of a body that is heavier and one that is lighter than the nominal one, in any mixture: the sums hold for the poses sampled.
TEST(ArmExtremes, HoldForAnyMixtureOfMasses) {
    std::mt19937 engine(7);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    for (const char* name : {"planar_two_link", "ur5e"}) {
        const RobotDescription robot = loadTestRobot(name);
        const int n = robot.size();
        DisturbanceSet set;
        set.massError = 0.4;
        set.payload_kg = 2.0;
        set.baseTilt_rad = 0.1;
        const detail::MotionSize motion{JointVector::Ones(n), JointVector::Ones(n), JointVector::Ones(n)};
        const detail::ArmExtremes x =
            detail::findArmExtremes(robot, robot.limits, motion, set, JointVector::Ones(n), "here");
        const std::vector<JointVector> poses = detail::samplePoses(robot.limits, 192);
        double nearest = 0.0;
        for (int draw = 0; draw < 20; ++draw) {
            JointVector factors(n);
            for (double& f : factors)
                f = 1.0 + 0.4 * (draw % 2 == 0 ? share(engine) : share(engine) < 0.0 ? -1.0 : 1.0);
            RobotModel real(
                withPayload(withScaledMasses(robot, factors), (0.5 + 0.5 * share(engine)) * 2.0, {0, 0, 0}));
            Eigen::MatrixXd least = Eigen::MatrixXd::Constant(n, n, INFINITY), greatest = -least;
            Dynamics dynamics;
            for (const JointVector& q : poses) {
                real.calcDynamics(q, JointVector::Zero(n), dynamics);
                least = least.cwiseMin(Eigen::MatrixXd(dynamics.M));
                greatest = greatest.cwiseMax(Eigen::MatrixXd(dynamics.M));
            }
            const Eigen::MatrixXd size = greatest.cwiseMax(-least), range = greatest - least;
            // Tilted by so much to some side: what gravity's torque changes by.
            RobotDescription upright =
                withPayload(withScaledMasses(robot, factors), share(engine) < 0.0 ? 0.0 : 2.0, {0, 0, 0});
            RobotDescription tilted = upright;
            const Eigen::Vector3d axis =
                Eigen::AngleAxisd(kPi * share(engine), Eigen::Vector3d::UnitZ()) * Eigen::Vector3d::UnitX();
            tilted.gravity = Eigen::AngleAxisd(0.1, axis) * upright.gravity;
            RobotModel straight(upright), leaning(tilted);
            for (const JointVector& q : poses) {
                straight.calcDynamics(q, JointVector::Zero(n), dynamics);
                const JointVector before = dynamics.gravity;
                leaning.calcDynamics(q, JointVector::Zero(n), dynamics);
                EXPECT_LE(((dynamics.gravity - before).cwiseAbs() - x.tilt.upper).maxCoeff(), 1e-9) << name;
            }
            EXPECT_LE((size - x.inertia).maxCoeff(), 1e-9 * x.inertia.maxCoeff()) << name << " " << factors.transpose();
            EXPECT_LE((range - x.inertiaRange).maxCoeff(), 1e-9 * x.inertiaRange.maxCoeff())
                << name << " " << factors.transpose();
            nearest = std::max(nearest, range(0, 0) / x.inertiaRange(0, 0));
        }
        EXPECT_GT(nearest, 0.5) << name;  // and no wider than that
    }
}

// The sizes of what is not known, against a fine grid over velocities and factors, for figures of another shape.
TEST(TrackingBound, TakesTheLargestFrictionThatIsNotFedForward) {
    for (const double otherVelocity : {0.1, 0.4, 1.5}) {
        FrictionCase c;
        c.robot.actuation.friction.coulomb.setZero();
        DisturbanceSet set;
        set.frictionScaleMin = 0.7;
        set.frictionScale = 1.2;
        set.isFrictionConstant = true;
        JointFriction figures = c.robot.actuation.friction;
        figures.viscousVelocity.setConstant(otherVelocity);
        c.gains.friction = scaleFriction(figures, 0.8, c.limits, 1e-3);
        double largest = 0.0;
        for (const double scale : {0.7, 1.2})
            for (double v = 0.0; v <= 0.5; v += 1e-4) {
                const double real = -scale * std::expm1(-v / 0.4), fed = -0.8 * std::expm1(-v / otherVelocity);
                largest = std::max(largest, std::abs(real - fed));
            }
        bool found = false;
        for (const TrackingBound::Part& part : c.calc(set).parts) {
            if (part.source != "viscous friction") continue;
            found = true;
            // As such, or with all that the velocity error adds.
            EXPECT_GE(part.torque[0], largest * (1.0 - 1e-12)) << otherVelocity;
            EXPECT_LE(part.torque[0], largest + 2.0 * 1.2) << otherVelocity;
        }
        EXPECT_TRUE(found);
    }
}

// Friction far above what the loop is strong enough for has a bound, or the reason why it has none; never 0.
TEST(TrackingBound, IsPositiveAndGrowsWithFriction) {
    FrictionCase c;
    c.robot.actuation.friction.viscousVelocity.setConstant(1e-4);  // damping x tick / inertia far above 1
    double last = 0.0;
    for (const double scale : {0.0, 0.01, 0.03, 0.1, 0.2}) {
        DisturbanceSet set;
        set.frictionScale = scale;
        const TrackingBound bound = c.calc(set);
        EXPECT_TRUE(bound.position.allFinite() && bound.velocity.allFinite());
        EXPECT_GT(bound.position.minCoeff(), last) << scale;
        last = bound.position.minCoeff();
    }
}

TEST(TrackingBound, RefusesFrictionThatCannotBe) {
    FrictionCase c;
    const auto expectRefused = [&](const DisturbanceSet& set, const char* what) {
        test::expectError({what}, [&] { c.calc(set); });
    };
    DisturbanceSet set;
    set.frictionScaleMin = 1.3;
    expectRefused(set, "is 1.3; allowed is from 0 to its friction_scale, 1");
    c.robot.actuation.friction.viscous[1] = NAN;
    expectRefused({}, "the friction of elbow is below 0 or not finite");
    c.robot.actuation.friction.viscous[1] = -1.0;
    expectRefused({}, "the friction of elbow is below 0 or not finite");
    c = FrictionCase();
    c.robot.actuation.friction.coulomb[1] = -1.0;
    expectRefused({}, "the friction of elbow is below 0 or not finite");
    c = FrictionCase();
    for (const auto& spoil : std::vector<std::function<void(DisturbanceSet&)>>{
             [](DisturbanceSet& d) { d.breakawayRatio = 0.5; }, [](DisturbanceSet& d) { d.loadFriction = 1.0; },
             [](DisturbanceSet& d) { d.massError = 1.0; }, [](DisturbanceSet& d) { d.torqueLimitFactor = 0.0; },
             [](DisturbanceSet& d) { d.torqueLimitFactor = NAN; }, [](DisturbanceSet& d) { d.payload_kg = -1.0; }}) {
        DisturbanceSet spoilt;
        spoil(spoilt);
        expectRefused(spoilt, "a number of the disturbance_set is below 0");
    }
    DisturbanceSet strong;
    strong.torqueLimitFactor = INFINITY;
    EXPECT_TRUE(c.calc(strong).motorTorque.array().isInf().all());
    c = FrictionCase();
    c.gains.motorRate = 100.0;
    expectRefused({}, "no bound is known");
}

// A Panda with rotors: finite, positive and without jumps from no friction to five times its figures.
TEST(TrackingBound, OfAPandaIsContinuousInItsFriction) {
    RobotDescription robot = loadTestRobot("panda");
    robot.actuation.rotorInertia.setConstant(0.1);
    JointLimits limits = robot.limits;
    const JointVector room = JointVector::Constant(7, 0.3);
    limits.position = {robot.home - room, robot.home + room};
    limits.velocity = {JointVector::Constant(7, -0.2), JointVector::Constant(7, 0.2)};
    limits.acceleration = {JointVector::Constant(7, -0.5), JointVector::Constant(7, 0.5)};
    limits.jerk = {JointVector::Constant(7, -5.0), JointVector::Constant(7, 5.0)};
    JointVector kr = JointVector::Constant(7, 60.0);
    kr[1] = 90.0;
    DisturbanceSet set;
    set.payload_kg = 0.08;
    set.massError = 0.01;
    std::vector<JointVector> bounds;
    for (const double scale : {0.0, 2.45, 2.46, 5.0}) {
        set.frictionScale = scale;
        bounds.push_back(calcTrackingBound(robot, limits, 1e-3, {kr, 40.0, 10.0}, set).velocity);
        ASSERT_TRUE(bounds.back().allFinite());
        EXPECT_GT(bounds.back().minCoeff(), 0.0);
        std::printf("  friction scale %4.2f: %.4f to %.4f rad/s\n", scale, bounds.back().minCoeff(),
                    bounds.back().maxCoeff());
    }
    for (std::size_t k = 1; k < bounds.size(); ++k)
        EXPECT_TRUE((bounds[k].array() >= bounds[k - 1].array() * (1.0 - 1e-9)).all()) << k;
    EXPECT_LT((bounds[2] - bounds[1]).maxCoeff(), 0.005 * bounds.back().maxCoeff());
}

// What stands in the way is named, with the joint, and by how much: with a little less of it there is a bound.
TEST(TrackingBound, TellsWhatStandsInTheWay) {
    FrictionCase c;
    DisturbanceSet set;
    double scale = 1.0;
    std::string told;
    while (told.empty() && scale < 1e3) {
        scale *= 2.0;
        set.frictionScale = scale;
        told = test::findComplaint([&] { c.calc(set); });
    }
    const std::string share = "most at elbow; there would be one with ";
    EXPECT_CONTAINS(told, "mainly: ");
    ASSERT_NE(told.find(share), std::string::npos) << told;
    const double less = std::stod(told.substr(told.find(share) + share.size()));
    EXPECT_GT(less, 0.3) << told;  // half the scale had a bound
    EXPECT_LT(less, 1.0) << told;
}

}  // namespace
}  // namespace viable
