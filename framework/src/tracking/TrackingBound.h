#pragma once

#include "viable/tracking/Nric.h"

namespace viable {

/** The set of disturbances that a TrackingBound is for: properties of the real arm that the nominal one has not.
They act all at once, in any combination. Dry friction, ripple, pushes and reading errors change at any time within
these sizes. So does the factor on the friction, unless it is constant. Masses, payload and tilt are constant in a
run. The names are those of the simulated plants' parameters. */
struct DisturbanceSet {
    PerJoint frictionScale = 1.0;     ///< largest factor on the robot's friction figures; 0: no friction
    PerJoint frictionScaleMin = 0.0;  ///< least factor: so much is sure to damp, and may be fed forward
    /** The factor of each joint is the same all through a run: its viscous friction changes only with the velocity. */
    bool isFrictionConstant = false;
    double breakawayRatio = 1.0;   ///< largest Fs / Fc
    PerJoint loadFriction = 0.0;   ///< friction per torque that the joint carries []
    PerJoint massError = 0.0;      ///< mass_factor lies in [1 - massError, 1 + massError]
    double payload_kg = 0.0;       ///< largest
    double payloadOffset_m = 0.0;  ///< farthest from the tool frame's origin, in any direction
    double baseTilt_rad = 0.0;     ///< largest angle of the base against the vertical
    PerJoint torqueRipple_Nm = 0.0;
    PerJoint externalTorque_Nm = 0.0;  ///< pushes that are not fed to the nominal arm
    double torqueLimitFactor = 1.0;    ///< least motor torque over the robot's figure
    /** Largest error of a reading besides its rounding to counts: four times the plants' encoder_noise_rad. */
    double readingError_rad = 0.0;
    int delayTicks = 0;  ///< between the computed torque and the motors

    template <class V>
    void describe(V& v) {
        v(frictionScale, "friction_scale", "", "Largest factor on the robot's friction figures; 0: no friction.")
            .atLeast(0);
        v(frictionScaleMin, "friction_scale_min", "",
          "Smallest factor; it counts where the robust loop feeds friction forward.")
            .atLeast(0);
        v(isFrictionConstant, "friction", "jumps|constant_in_a_run",
          "Whether that factor changes at any time, or is the same all through a run.");
        v(breakawayRatio, "breakaway_ratio", "", "Largest friction at standstill over Coulomb friction.").atLeast(1);
        v(loadFriction, "load_friction", "", "Largest friction per torque that the joint carries.").atLeast(0).below(1);
        v(massError, "mass_error", "", "Masses and inertias are within 1 - this and 1 + this of the model's.")
            .atLeast(0)
            .below(1);
        v(payload_kg, "payload_kg", "kg", "Largest payload.").atLeast(0).upTo(1000);
        v(payloadOffset_m, "payload_offset_m", "m", "Its largest distance from the tool frame's origin.").atLeast(0);
        v(baseTilt_rad, "base_tilt_rad", "rad", "Largest tilt of the base.").atLeast(0).upTo(3.15);
        v(torqueRipple_Nm, "torque_ripple_Nm", "Nm", "Largest torque ripple.").atLeast(0);
        v(externalTorque_Nm, "external_torque_Nm", "Nm",
          "Largest torque of pushes that are not fed to the nominal arm.")
            .atLeast(0);
        v(torqueLimitFactor, "torque_limit_factor", "", "Smallest motor torque, as a share of the robot's figure.")
            .above(0)
            .orInfinite();
        v(readingError_rad, "reading_error_rad", "rad",
          "Largest error of a reading besides its rounding; of a plant with encoder_noise_rad (a standard deviation, "
          "cut at four) four times that.")
            .atLeast(0);
        v(delayTicks, "delay_ticks", "Between the computed torque and the motors.").atLeast(0).upTo(20);
    }
};

/** How far the real arm can get from the nominal one at a tick, within a disturbance set. */
struct TrackingBound {
    JointVector position;        ///< bound of |q_real - q_nominal|, the true one [rad]
    JointVector velocity;        ///< bound of the rate of that [rad/s]
    JointVector measured;        ///< bound of |e| as the encoders show it: where a run trips [rad]
    JointVector torque;          ///< bound of |tau_c + tau_a|, for moments [Nm]
    JointVector lastingTorque;   ///< bound of what motion and disturbances need for longer than that [Nm]
    JointVector motorTorque;     ///< torque that the motors can give [Nm]; see calcTrackingBound()
    JointVector torqueStep;      ///< bound of the change of tau_a from tick to tick [Nm]
    JointVector integralTorque;  ///< bound of K_r K_i |sum of e dt| [Nm]

    /** One source of error and the most that it adds to the bounds, at any time of a run and in any pose. Not all
    sources do their worst at once, so the sum is larger than the bound. */
    struct Part {
        std::string source;
        JointVector torque;    ///< largest torque that it puts on each joint [Nm]
        JointVector position;  ///< [rad]
        JointVector velocity;  ///< [rad/s]
    };
    std::vector<Part> parts;
};

/** The bound for Nric with constant gains.

Method: the error obeys M edd = tau_a + w around the inertia of a pose, w less the friction that is fed forward. The
bound uses the sampled loop's peak gains from w and from the readings to e and de. A peak gain is the l1 norm of the
impulse response, joint by joint (Desoer and Vidyasagar 1975). The rest of both arms' equations of motion is w:
friction, load, mass error, tilt, and the effects of reading and of holding a tick. Terms in e and de (stiffness,
Coriolis, inertia that has changed since) make the bound a fixed point. The inertia that changes enters by parts,
integral of K dM edd = - integral of (K dM)' de. So only as much of it counts as the response is long. All of it
includes the coupling between joints. A run is taken in phases. Soon after the start a response has little past and the
nominal arm is slow. Later the step at the start (payload) has faded (MATH 10).
Assumes: a run starts at rest, and with a delay the first torque holds from the start on. Velocities are the difference
of two positions over a tick, positions whole encoder counts. The nominal arm stays within `limits`, no torque beyond
the motors, and neither Nric's rate nor its integral at their limits. Joints are rigid.
Sampling: extremes over poses are those of a fixed sample within the position limits (192, gradients at 64, loops at
32). For the loops a climb from the worst of them finds the fastest and the slowest mode and the least inertia of each
joint. Between these poses nothing is proven. Masses and places of the payload are sampled, too, where they are not
affine, and nothing is proven between them. Loops are those of the heaviest, the lightest and two mixed arms, places the
corners of an octahedron around the ball.
@param limits  of the nominal arm; velocity and acceleration finite
@param place   of the gains or the set, for messages.
Throws Error (BadInput) for unstable gains (with the largest stable ones), where no bound exists, and for input that is
not finite.
Motors: the function does not check them. With motorTorque below lastingTorque the real arm cannot follow. Between
that and torque it can, but nothing proves that no motor is ever at its limit. Takes some seconds; not for a loop. */
TrackingBound calcTrackingBound(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                                const NricOptions& gains, const DisturbanceSet& set, const std::string& place = {});

}  // namespace viable
