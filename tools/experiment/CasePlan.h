#pragma once

#include <set>

#include "host/PluginLoader.h"
#include "viable/environment/Environment.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** In a block of a robust loop, whatever its plugin. */
struct RobustLoopSettings {
    double contactForce = 0.0;
    bool acceptsUnstable = false;

    template <class V>
    void describe(V& v) {
        v(contactForce, "contact_force_N", "N",
          "Where the tool touches something the nominal arm waits, and the tool presses with this force; 0: it goes on "
          "until the robust loop may add no more, and is stopped then. The plant must have torque sensors.")
            .atLeast(0)
            .upTo(1e4);
        v(acceptsUnstable, "accept_unstable",
          "A loop that is unstable on this arm is run all the same, an arm that does not follow is not stopped, and "
          "the loop may use all of the motors: to show what happens.");
    }
};

/** A plugin that a case uses, found and with its parameters read, not yet made. */
struct PluginChoice {
    PluginInfo plugin;
    Parameters parameters;
    RobustLoopSettings host{};  ///< of a robust loop
};

/** Ticks in a row that are missed on purpose: command, controller and filter do not run. */
struct TickGap {
    std::int64_t begin = 0;  ///< the first one missed; tick 0 is the run's first
    std::int64_t count = 0;
};

/** One case of an experiment, read and checked as far as that goes without its plugins (see configureCase). */
struct CasePlan {
    std::string name;
    RobotDescription robot;             ///< with the payload that the nominal arm knows
    std::optional<Parameters> payload;  ///< that one
    bool hasOwnSpeedLimits = false;     ///< the file says something of robot.speedLimits
    /** What the file says, checked: of the nominal arm, under `hold_on: real` of the real one. */
    JointLimits limits;
    bool allowsLargeAngles = false;
    bool holdsOnReal = false;  ///< limits: {hold_on: real}
    std::string limitsPlace;   ///< where, for messages
    double tick_s = 0.0, duration_s = 0.0;
    MotionState start;       ///< as written; configureCase() judges it
    std::string startPlace;  ///< where, for messages
    std::vector<TickGap> missedTicks;
    std::optional<Environment> environment;
    std::optional<ArmGeometry> geometry;  ///< with an environment, or speed limits that need it
    PluginChoice command, controller;
    std::optional<Parameters> stream;        ///< the line that the command comes over
    std::vector<PluginChoice> filters;       ///< at least one; several run one after the other
    std::optional<PluginChoice> robustLoop;  ///< present exactly when realPlant is
    std::optional<PluginChoice> realPlant;
    bool feedsExternalTorque = false;        ///< external_torque: to_nominal
    std::string externalTorquePlace;         ///< where, for messages
    std::optional<Parameters> disturbances;  ///< the disturbance_set

    /** "tosbp", or "tosbp + certified_braking". */
    std::string filterName() const;
    /** All plugins, in the order of the data. */
    std::vector<const PluginChoice*> plugins() const;

    std::set<std::string> libraries;  ///< of the plugins of all cases of the experiment
    ConfigNode resolved;              ///< the case as an experiment file of its own, every default filled in
};

}  // namespace viable
