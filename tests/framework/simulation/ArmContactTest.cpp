// Contact by itself: forces, energies and friction against closed forms.
#include "viable/simulation/ArmContact.h"

#include <Simbody.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "Joints.h"
#include "RobotFolder.h"
#include "viable/robot/RobotModel.h"

namespace viable::test {
namespace {

/** A mass that slides along x and z, its ball above a floor at z = 0. */
void makeSlider(RobotFolder& folder, double mass) {
    folder.urdf = "<robot name='arm'>\n<link name='base'/>\n" +
                  makeJoint("along", "prismatic", "base", "cart", "xyz='0 0 0' rpy='0 0 0'", "1 0 0") +
                  makeLink("cart", 1e-3, "0 0 0", "0 0 0", kSomeInertia) +
                  makeJoint("up", "prismatic", "cart", "ball", "xyz='0 0 0' rpy='0 0 0'", "0 0 1") +
                  makeLink("ball", mass, "0 0 0", "0 0 0", kSomeInertia) + "</robot>\n";
    folder.limits = kSomeLimits;
}

Environment makeFloor() {
    Environment environment;
    Solid floor;
    floor.name = "floor";
    floor.kind = Solid::Kind::HalfSpace;
    environment.solids.push_back(floor);
    return environment;
}

struct PlantOptions {
    int substeps = 1;
    ContactOptions contact;
    template <class V>
    void describe(V& v) {
        v(substeps, "substeps", "Of a tick.");
        contact.describe(v);
    }
};

class Contact {
public:
    Contact(RobotDescription arm, Environment around, const std::string& text, int substeps = 50)
        : robot(std::move(arm)),
          environment(std::move(around)),
          model_(robot),
          start_{JointVector::Zero(robot.size()), JointVector::Zero(robot.size()), JointVector::Zero(robot.size())},
          setup_{robot, robot.limits, 1e-3, 10.0, start_, {}} {
        setup_.environment = &environment;
        const ConfigNode root = parseConfig("block: {contact: tool, " + text + "}\n", "experiment.yaml");
        const std::vector<ParameterSpec>& specs = settingsOf<PlantOptions>();
        const Parameters parameters = readParameters(*root.find("block"), specs.data(), specs.size(), robot.size());
        contact.configure(setup_, robot, substeps, parameters.get<PlantOptions>().contact, parameters);
        h_ = 1e-3 / substeps;
    }

    /** One sub-step by Runge and Kutta under `torque` and gravity; the last contact's normal force. */
    double step(const JointVector& torque) {
        const auto accelerate = [&](const JointState& at) {
            JointVector total = torque, qdd;
            contact.addTorque(0.0, at, total);
            model_.calcDynamics(at.q, at.qd, dynamics_);
            EXPECT_TRUE(calcForwardDynamics(dynamics_, total, qdd));
            return qdd;
        };
        const JointVector a1 = accelerate(state);
        const JointVector v2 = state.qd + h_ / 2 * a1, a2 = accelerate({state.q + h_ / 2 * state.qd, v2});
        const JointVector v3 = state.qd + h_ / 2 * a2, a3 = accelerate({state.q + h_ / 2 * v2, v3});
        const JointVector v4 = state.qd + h_ * a3, a4 = accelerate({state.q + h_ * v3, v4});
        state.q += h_ / 6 * (state.qd + 2 * v2 + 2 * v3 + v4);
        state.qd += h_ / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
        EXPECT_TRUE(contact.endStep(0.0, state));
        return contact.report().pressing;
    }

    const RobotDescription robot;
    const Environment environment;
    ArmContact contact;
    JointState state;

private:
    RobotModel model_;
    Dynamics dynamics_;
    MotionState start_;
    RunSetup setup_;
    double h_ = 0.0;
};

constexpr double kRadius = 0.02, kMass = 2.0, kStill = 1e-3;
const double kWeight = 9.81 * kMass;

/** A ball that comes down at `speed`, without weight. */
struct Blow {
    double peak = 0.0, depth = 0.0, rebound = 0.0;
};
Blow strike(const std::string& text, double speed, int substeps) {
    RobotFolder folder;
    makeSlider(folder, kMass);
    RobotDescription robot = folder.load();
    robot.gravity.setZero();
    Contact c(robot, makeFloor(), text, substeps);
    c.state = {joints(0.0, kRadius + 1e-9), joints(0.0, -speed)};
    Blow blow;
    for (int k = 0; k < 1000 * substeps && (k == 0 || c.contact.report().contacts > 0 || c.state.qd[1] < 0.0); ++k) {
        blow.peak = std::max(blow.peak, c.step(joints(0.0, 0.0)));
        blow.depth = std::max(blow.depth, c.contact.report().depth);
    }
    blow.rebound = c.state.qd[1];
    return blow;
}

TEST(ArmContact, ABlowOnASpringIsThatOfAMassOnASpring) {
    for (const double k : {250.0, 2.5e3, 2.5e4, 2.5e5, 1e6})
        for (const double speed : {0.05, 0.2, 0.5}) {
            const Blow blow =
                strike("contact_dissipation_spm: 0, contact_stiffness_Npm: " + std::to_string(k), speed, 20);
            EXPECT_NEAR(blow.peak, speed * std::sqrt(kMass * k), 5e-3 * blow.peak) << k << " " << speed;
            EXPECT_NEAR(blow.rebound, speed, 2e-3 * speed) << k << " " << speed;
        }
}

// Timoshenko and Goodier: the depth by 1/2 m v^2 = 8/15 E* sqrt(r) x^(5/2).
TEST(ArmContact, ABlowByHertzIsThatOfTheBooks) {
    for (const double modulus : {1e6, 1e7, 1e9})
        for (const double speed : {0.05, 0.5}) {
            const Blow blow =
                strike("contact_law: hertz, contact_dissipation_spm: 0, contact_modulus_Pa: " + std::to_string(modulus),
                       speed, 50);
            const double depth = std::pow(15.0 / 16.0 * kMass * speed * speed / (modulus * std::sqrt(kRadius)), 0.4);
            const double peak = 4.0 / 3.0 * modulus * std::sqrt(kRadius) * std::pow(depth, 1.5);
            EXPECT_NEAR(blow.depth, depth, 0.01 * depth) << modulus << " " << speed;
            EXPECT_NEAR(blow.peak, peak, 0.02 * peak) << modulus << " " << speed;
            EXPECT_NEAR(blow.rebound, speed, 5e-3 * speed) << modulus << " " << speed;
        }
}

// Hunt and Crossley: e = 1 - c v as long as that is nearly 1.
TEST(ArmContact, ABlowComesBackAsTheCoefficientSays) {
    for (const char* law : {"spring", "hertz"})
        for (const double loss : {0.01, 0.03, 0.06}) {
            const double speed = 0.2;
            const Blow blow = strike(
                std::string("contact_law: ") + law + ", contact_dissipation_spm: " + std::to_string(loss / speed),
                speed, 50);
            EXPECT_NEAR(1.0 - blow.rebound / speed, loss, 0.12 * loss) << law << " " << loss;
        }
}

/** The same blow in Simbody's own compliant contact, a rigid floor and a ball of that modulus. */
Blow strikeInSimbody(double modulus, double dissipation, double speed) {
    using namespace SimTK;
    MultibodySystem system;
    SimbodyMatterSubsystem matter(system);
    ContactTrackerSubsystem tracker(system);
    CompliantContactSubsystem forces(system, tracker);
    const ContactMaterial soft(modulus, dissipation, 0, 0, 0), rigid(1e30, dissipation, 0, 0, 0);
    const Rotation down(Pi / 2, YAxis);  // x to -z: the solid half of Simbody's half-space
    matter.updGround().updBody().addContactSurface(Transform(down),
                                                   ContactSurface(ContactGeometry::HalfSpace(), rigid));
    Body::Rigid ball(MassProperties(kMass, Vec3(0), Inertia(1)));
    ball.addContactSurface(Transform(), ContactSurface(ContactGeometry::Sphere(kRadius), soft));
    const Transform along(Rotation(-Pi / 2, YAxis));  // x to z
    MobilizedBody::Slider slider(matter.updGround(), along, ball, along);
    State state = system.realizeTopology();
    slider.setLength(state, kRadius + 1e-9);
    slider.setRate(state, -speed);
    RungeKuttaMersonIntegrator integrator(system);
    integrator.setAccuracy(1e-8);
    integrator.setMaximumStepSize(1e-5);
    integrator.initialize(state);
    Blow blow;
    for (int k = 1;
         k < 100000 && (k < 100 || integrator.getState().getU()[0] < 0.0 || integrator.getState().getQ()[0] < kRadius);
         ++k) {
        integrator.stepTo(1e-5 * k);
        const State& now = integrator.getState();
        system.realize(now, Stage::Dynamics);
        blow.depth = std::max(blow.depth, kRadius - slider.getLength(now));
        if (forces.getNumContactForces(now) > 0)
            blow.peak = std::max(blow.peak, forces.getContactForce(now, 0).getForceOnSurface2()[1].norm());
    }
    blow.rebound = slider.getRate(integrator.getState());
    return blow;
}

TEST(ArmContact, ABlowIsThatOfSimbodysOwnContact) {
    for (const double modulus : {1e6, 1e8})
        for (const double dissipation : {0.0, 0.2, 1.0})
            for (const double speed : {0.05, 0.5}) {
                const Blow ours = strike("contact_law: hertz, contact_modulus_Pa: " + std::to_string(modulus) +
                                             ", contact_dissipation_spm: " + std::to_string(dissipation),
                                         speed, 50);
                const Blow theirs = strikeInSimbody(modulus, dissipation, speed);
                std::printf("  %.0e Pa, %.1f s/m, %.2f m/s: peak %.2f and %.2f N, rebound %.4f and %.4f m/s\n", modulus,
                            dissipation, speed, ours.peak, theirs.peak, ours.rebound, theirs.rebound);
                EXPECT_NEAR(ours.peak, theirs.peak, 0.01 * theirs.peak);
                EXPECT_NEAR(ours.depth, theirs.depth, 0.01 * theirs.depth);
                EXPECT_NEAR(ours.rebound, theirs.rebound, 0.01 * speed);
            }
}

TEST(ArmContact, FrictionHoldsWhatItCanAndThenSlides) {
    for (const double share : {0.5, 0.95, 1.5}) {
        RobotFolder folder;
        makeSlider(folder, kMass);
        Contact c(folder.load(), makeFloor(), "contact_friction: 0.4", 10);
        c.state = {joints(0.0, kRadius - kWeight / 1e5), joints(0.0, 0.0)};
        for (int k = 0; k < 5000; ++k) c.step(joints(0.0, 0.0));
        const double from = c.state.q[0], most = 0.4 * c.contact.report().pressing;
        EXPECT_NEAR(c.contact.report().pressing, kWeight + 9.81e-3, 1e-3 * kWeight);
        for (int k = 0; k < 5000; ++k) c.step(joints(std::min(share, 1.0) * most * k / 5000.0, 0.0));
        const double begun = share > 1.0 ? c.state.q[0] : from, v = c.state.qd[0];
        for (int k = 0; k < 10000; ++k) c.step(joints(share * most, 0.0));
        const double moved = c.state.q[0] - begun, free = v + 0.5 * (share - 1.0) * most / kMass;
        if (share < 1.0)
            EXPECT_NEAR(moved, share * most / 1e5, 2e-5) << "the spring's stretch alone";
        else
            EXPECT_NEAR(moved, free, 0.02 * free);
        EXPECT_LT(share < 1.0 ? std::abs(c.state.qd[0]) : 0.0, kStill);
    }
}

/** Without friction and loss the torque is the slope of the springs' energy, whatever the arm and the solid. */
TEST(ArmContact, TheTorqueIsTheSlopeOfTheEnergy) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    const double k = 1e4;
    int touched = 0;
    for (const bool isSlanted : {true, false})
        for (const Solid::Kind kind :
             {Solid::Kind::Box, Solid::Kind::Sphere, Solid::Kind::Cylinder, Solid::Kind::HalfSpace})
            for (int round = 0; round < 40; ++round) {
                RobotFolder folder;
                isSlanted ? makeSlantedArm(folder) : makeBranchedArm(folder);
                const RobotDescription robot = folder.load();
                const int n = robot.size();
                JointState at{JointVector(n), JointVector::Zero(n)};
                for (int i = 0; i < n; ++i) at.q[i] = share(random);
                RobotModel model(robot);
                Dynamics dynamics;
                model.calcDynamics(at.q, at.qd, dynamics);
                Environment environment;
                Solid solid;
                solid.name = "thing";
                solid.kind = kind;
                solid.size = {0.1, 0.2, 0.3};
                solid.radius = 0.1;
                solid.length = 0.2;
                const Eigen::Vector3d turn(share(random), share(random), share(random));
                solid.pose.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
                solid.pose.translation() =
                    dynamics.tool.position + 0.12 * Eigen::Vector3d(share(random), share(random), share(random));
                environment.solids.push_back(solid);
                Contact c(robot, environment,
                          "contact_friction: 0, contact_dissipation_spm: 0, contact_tool_radius_m: 0.05, "
                          "contact_stiffness_Npm: 1e4");
                const auto calcEnergy = [&](const JointVector& q) {
                    c.contact.endStep(0.0, {q, at.qd});
                    return 0.5 * k * std::pow(c.contact.report().depth, 2);
                };
                JointVector torque = JointVector::Zero(n);
                c.contact.addTorque(0.0, at, torque);
                const bool isNear = calcEnergy(at.q) > 0.0 && c.contact.report().depth < 0.1;
                touched += isNear;
                for (int i = 0; i < n && isNear; ++i) {
                    const JointVector moved = 1e-6 * JointVector::Unit(n, i);
                    const double slope = (calcEnergy(at.q + moved) - calcEnergy(at.q - moved)) / 2e-6;
                    EXPECT_NEAR(torque[i], -slope, 1e-4 * k * 0.05) << static_cast<int>(kind) << " " << i;
                }
            }
    EXPECT_GT(touched, 100);
}

TEST(ArmContact, WhatCannotBeIsRefused) {
    RobotFolder folder;
    makeSlider(folder, kMass);
    const RobotDescription robot = folder.load();
    expectError({"there is nothing to touch"}, [&] { Contact(robot, {}, ""); });
    expectError({"1 is too few for so stiff a contact", "Write substeps: "},
                [&] { Contact(robot, makeFloor(), "contact_stiffness_Npm: 1e8", 1); });
}

}  // namespace
}  // namespace viable::test
