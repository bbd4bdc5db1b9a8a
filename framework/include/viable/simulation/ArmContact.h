#pragma once

#include "viable/environment/Environment.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** The parts of a simulated arm that meet obstacles. */
enum class ContactParts : unsigned char { None, Tool, Arm };
/** How the force grows with the depth. */
enum class ContactLaw : unsigned char { Spring, Hertz };

struct ContactOptions {
    ContactParts parts = ContactParts::None;
    double toolRadius = 0.02;
    ContactLaw law = ContactLaw::Spring;
    double stiffness = 1e5, modulus = 1e7, dissipation = 0.5, friction = 0.3;

    template <class V>
    void describe(V& v) {
        v(parts, "contact", "none|tool|arm",
          "What of the arm meets the obstacles of `environment`: nothing, a ball at the tool, or that and the capsules "
          "of collision.yaml.");
        v(toolRadius, "contact_tool_radius_m", "m", "Of the ball around the tool frame's origin.").above(0).upTo(1);
        v(law, "contact_law", "spring|hertz",
          "How the force grows with the depth: as a spring, or as two round solids press each other.");
        v(stiffness, "contact_stiffness_Npm", "N/m", "Of the spring.").above(0).upTo(1e8);
        v(modulus, "contact_modulus_Pa", "Pa", "Hertz: 1 / ((1 - nu1^2) / E1 + (1 - nu2^2) / E2).").above(0).upTo(1e13);
        v(dissipation, "contact_dissipation_spm", "s/m",
          "c: a blow at speed v comes back with 1 - c v of it, as long as that is nearly 1.")
            .atLeast(0)
            .upTo(10);
        v(friction, "contact_friction", "", "Coulomb's coefficient, at rest and in motion.").atLeast(0).upTo(10);
    }
};

/** Contact of a simulated arm with solids, moving spheres and a map's cells.

Method: the arm is balls, one at the tool and rows along the capsules, half a radius apart. Each ball is pressed out of each
obstacle by

    N = F(x) (1 + 3/2 c x'),  >= 0;    F = k x, or by Hertz 4/3 E* sqrt(r) x^(3/2)

(Hunt and Crossley, "Coefficient of restitution interpreted as damping in vibroimpact", J. Applied Mechanics 42, 1975),
x [m] how far it is inside along the shortest way out, r its radius. The obstacle is taken for flat there. In a map the
nearest cell alone counts, so a wall of cells is one wall. Friction is a spring along the surface, as stiff as the normal
one is there, and damped. It slides where it would be more than mu N.
Order: 1 in the memory of friction, else as the integration that asks.
Not modelled: flattening of edges, rolling and spinning friction, obstacles that give way.
Allocates in a tick where there is a map. */
class ArmContact {
public:
    struct Shortest {
        double distance;         ///< [m], negative inside
        Eigen::Vector3d normal;  ///< out of the solid
    };
    /** The shortest way from the solid's surface to a point, both in the solid's frame. */
    static Shortest findShortest(const Solid& solid, const Eigen::Vector3d& p);
    /** The velocity of a moving sphere at a time of the run [m/s]. */
    static Eigen::Vector3d calcVelocity(const MovingSphere& sphere, double time_s);

    /** A point that moves along with a joint. */
    struct Point {
        int carrier = -1;
        Eigen::Vector3d place = Eigen::Vector3d::Zero();  ///< in the carrier's frame [m]
    };
    /** How easily each point moves where that is easiest [1/kg]. It is the largest eigenvalue of J M^-1 J' over a fixed
    sample of poses within the position limits. */
    static std::vector<double> findMobility(const RobotDescription& robot, const std::vector<Point>& points);
    /** False: without contact. Throws Error (BadInput) where there is nothing to touch. */
    static bool isWanted(const RunSetup& setup, const ContactOptions& options, const Parameters& parameters);
    /** Throws Error (BadInput) for sub-steps too long for an arm that swings on its contacts with a frequency of so
    much [1/s^2], squared. */
    static void checkSteps(double frequencySquared, double tick_s, int substeps, const Parameters& parameters);

    ArmContact();
    ~ArmContact();
    ArmContact(ArmContact&&) noexcept;
    ArmContact& operator=(ArmContact&&) noexcept;

    /** Throws Error (BadInput) where there is nothing to touch, and for sub-steps too long for its springs.
    @param robot      the arm with its real masses
    @param substeps   of a tick
    @param parameters where `options` were written */
    void configure(const RunSetup& setup, const RobotDescription& robot, int substeps, const ContactOptions& options,
                   const Parameters& parameters);
    bool isOn() const { return scene_ != nullptr; }
    /** Nothing has been touched before. */
    void reset();

    /** Adds the torque that the surroundings put on the joints [Nm, N]. @param time_s  of the run */
    void addTorque(double time_s, const JointState& arm, JointVector& torque) const;
    /** A sub-step is over: what touches has moved along. False where a ball's centre is inside a cell of the map: the way out
    is not known. */
    bool endStep(double time_s, const JointState& arm);

    /** After the last endStep(). */
    const ContactReport& report() const { return report_; }
    /** The torque on the joints likewise [Nm, N]. */
    const JointVector& torque() const { return torque_; }

private:
    struct Scene;
    std::unique_ptr<Scene> scene_;
    ContactReport report_;
    JointVector torque_;
};

}  // namespace viable
