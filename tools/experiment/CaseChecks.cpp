#include "experiment/CaseChecks.h"

#include <cmath>

#include "core/Text.h"
#include "viable/simulation/ArmHardware.h"

namespace viable::detail {

void checkRealArmIsWhole(const ConfigNode* robustLoop, const ConfigNode* realPlant) {
    if (robustLoop && !realPlant)
        throw badInput(robustLoop->place(), "there is a robust_loop but no real_plant for it to act on",
                       "Add `real_plant: {plugin: simbody}` or remove robust_loop.");
    if (realPlant && !robustLoop)
        throw badInput(
            realPlant->place(), "there is a real_plant but no robust_loop",
            "Add `robust_loop: {plugin: nric}`, or `robust_loop: {plugin: none, accept_unstable: true}` to run the "
            "real arm on the filter's torque alone.");
}

void checkExternalTorqueHasPlant(const CasePlan& plan) {
    if (plan.feedsExternalTorque && !plan.realPlant)
        throw badInput(plan.externalTorquePlace, "there is no real_plant that could measure an external torque",
                       "Add `real_plant` and `robust_loop`, or remove external_torque.");
}

void checkDisturbancesHavePlant(const CasePlan& plan) {
    if (plan.disturbances && !plan.realPlant)
        throw badInput(plan.disturbances->resolved().place(),
                       "there is a disturbance_set but no real_plant that it could disturb",
                       "Add real_plant and robust_loop, or remove it.");
}

void checkHoldsOnBound(const CasePlan& plan, bool mayHave) {
    if (plan.holdsOnReal && !mayHave)
        throw badInput(plan.limitsPlace, "hold_on: real needs a tracking bound, and this case has none",
                       "State a disturbance_set and use the robust loop nric.");
}

void checkTold(const PlantTraits& plant, int joints, const std::string& title) {
    const int ticks = plant.delayTicks;
    if (ticks < 0 || ticks > ArmHardware::kMaxDelay)
        throw Error(ErrorKind::PluginFailed, title, "gave a delay of " + std::to_string(ticks) + " ticks",
                    "delayTicks is from 0 to " + std::to_string(ArmHardware::kMaxDelay) + ".");
    const JointVector& rate = plant.motorRate;
    if (rate.size() != 0 && (rate.size() != joints || !(rate.array() > 0.0).all()))
        throw Error(ErrorKind::PluginFailed, title,
                    "gave a fastest change of the torque of the wrong size or not above 0",
                    "motorRate has one number above 0 per joint, or none at all.");
}

void checkStartsAtRest(const CasePlan& plan) {
    for (int i = 0; i < plan.robot.size(); ++i)
        if (plan.start.qd[i] != 0.0 || plan.start.qdd[i] != 0.0)
            throw badInput(
                plan.startPlace,
                "the tracking bound is for arms that start at rest, and " + plan.robot.joints[i].name + " does not",
                "Start at rest, or remove the disturbance_set.");
}

void checkBoundAssumptions(const CasePlan& plan, const TrackingBound& bound, const LinearErrorLoop& loop,
                           const JointVector& motorRate, Encoder encoder) {
    const auto check = [&](const char* what, const char* unit, const JointVector& given, double factor,
                           const JointVector& needed) {
        for (int i = 0; i < plan.robot.size(); ++i) {
            if (std::isinf(given[i]) || factor * given[i] >= needed[i]) continue;
            throw badInput(plan.robustLoop->parameters.resolved().place(),
                           "with " + formatNumber(given[i]) + " " + unit + " at " + plan.robot.joints[i].name + " as " +
                               what + " the tracking bound does not hold: within the disturbance_set it takes up to " +
                               format("%.4g", needed[i] / factor) + " " + unit,
                           "Raise it, leave it out, or remove the disturbance_set.");
        }
    };
    check("the limit of the robust loop's integral", "Nm", loop.integralLimit, 1.0, bound.integralTorque);
    check("the fastest change of the robust loop's torque", "Nm/s", loop.torqueRate, plan.tick_s, bound.torqueStep);
    if (motorRate.size() > 0)
        throw badInput(plan.robustLoop->parameters.resolved().place(),
                       "no tracking bound covers a limited change of the motor's whole torque",
                       "Leave `motor_rate_Nmps` of robust loop and plant out, limit the robust loop's share by "
                       "`torque_rate_Nmps`, or remove the disturbance_set.");
    if (encoder == Encoder::Exact)
        throw badInput(plan.realPlant->parameters.resolved().place(),
                       "the tracking bound is for encoders that tell positions in counts, and velocities as their "
                       "difference; this plant's tells the truth",
                       "Use encoders that count (simulated plants: `encoder: robot`), or remove the disturbance_set.");
    if (plan.feedsExternalTorque && plan.disturbances->get<DisturbanceSet>().delayTicks > 0)
        throw badInput(plan.externalTorquePlace,
                       "pushes that are fed to the nominal arm reach the motors of the real one later, by the "
                       "delay_ticks of the disturbance_set: no tracking bound covers that",
                       "Use `external_torque: ignored` and state external_torque_Nm, or no delay.");
}

void checkMotors(const CasePlan& plan, const TrackingBound& bound) {
    for (int i = 0; i < plan.robot.size(); ++i) {
        if (bound.lastingTorque[i] <= bound.motorTorque[i]) continue;
        throw badInput(plan.disturbances->resolved().place(),
                       "the motor of " + plan.robot.joints[i].name + " gives " + format("%.4g", bound.motorTorque[i]) +
                           " Nm; motion within the limits and these disturbances need up to " +
                           format("%.4g", bound.lastingTorque[i]) + " Nm, so the real arm cannot follow",
                       "`viable bound` shows what asks for it: state smaller disturbances, or lower the limits of "
                       "acceleration and velocity.");
    }
}

void checkExternalTorqueIsMeasured(const CasePlan& plan, const RealPlant& plant) {
    if (plan.feedsExternalTorque && !plant.externalTorque())
        throw badInput(plan.externalTorquePlace,
                       "the real plant " + plan.realPlant->plugin.name + " has no sensors for an external torque",
                       "Use a plant that measures it, or `external_torque: ignored`.");
}

void checkContactCanBeFelt(const CasePlan& plan, const RealPlant& plant) {
    if (!plan.robustLoop || plan.robustLoop->host.contactForce == 0.0) return;
    const std::string place = plan.robustLoop->parameters.place("contact_force_N");
    if (!plant.externalTorque())
        throw badInput(
            place,
            "the real plant " + plan.realPlant->plugin.name +
                " has no torque sensors, and without them a contact is not told from an encoder that is stuck",
            "Use a plant that measures the external torque, or leave it out: the arm is then stopped.");
    const char* const other = plan.feedsExternalTorque                ? "external_torque: to_nominal"
                              : plan.disturbances                     ? "a disturbance_set"
                              : plan.robustLoop->host.acceptsUnstable ? "accept_unstable: true"
                                                                      : nullptr;
    if (other)
        throw badInput(place, std::string("it does not go with ") + other,
                       "Leave one of them out: both say what the arm does when something acts on it.");
    requireJerkLimits(plan.limits, place, "a nominal arm that waits");
}

void checkControllerFollows(const CasePlan& plan, const CommandSource& command, const NominalController& controller) {
    if (controller.traits().follows(command.traits().space)) return;
    const bool joint = command.traits().space == MotionCommand::Space::Joint;
    throw badInput(plan.controller.parameters.resolved().place(),
                   "the controller " + plan.controller.plugin.name + " cannot follow the command " +
                       plan.command.plugin.name + ", which gives " + (joint ? "joint positions" : "tool poses"),
                   joint ? "Use the controller joint_pd, or a command such as generated_hand_motion."
                         : "Use the controller task_space_pd, or a command such as waypoints.");
}

}  // namespace viable::detail
