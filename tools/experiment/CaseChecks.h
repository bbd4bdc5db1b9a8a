#pragma once

#include "experiment/CasePlan.h"
#include "tracking/TrackingBound.h"
#include "viable/tracking/LoopStability.h"

// What the blocks of a case make of each other. Each throws Error (BadInput) at the place to be changed.

namespace viable::detail {

// --- as soon as they are read

/** robust_loop and real_plant stand together. @param robustLoop, realPlant  the blocks, or null */
void checkRealArmIsWhole(const ConfigNode* robustLoop, const ConfigNode* realPlant);
void checkExternalTorqueHasPlant(const CasePlan& plan);
void checkDisturbancesHavePlant(const CasePlan& plan);
/** Limits that are held on the real arm have a bound. @param mayHave  as far as is known */
void checkHoldsOnBound(const CasePlan& plan, bool mayHave);

// --- once the plugins are configured

/** A plant's delay and rate are ones that there can be; else Error (PluginFailed). @param title  the plant's */
void checkTold(const PlantTraits& plant, int joints, const std::string& title);
/** The sampled loop is stable on this arm, or its block accepts that it is not. Its margins are remembered.
@param loop  finite, gains at least 0 */
LoopMargins checkStability(const CasePlan& plan, const LinearErrorLoop& loop, int delayTicks);
/** The tracking bound is for arms that start at rest. */
void checkStartsAtRest(const CasePlan& plan);
/** What the bound assumes of robust loop, plant and pushes. @param loop  that the bound is of */
void checkBoundAssumptions(const CasePlan& plan, const TrackingBound& bound, const LinearErrorLoop& loop,
                           const JointVector& motorRate, Encoder encoder);
/** The motors carry what motion and disturbances ask for in the long run. */
void checkMotors(const CasePlan& plan, const TrackingBound& bound);
/** A plant that tells contacts from bad readings is there where `contact_force_N` asks for it. */
void checkContactCanBeFelt(const CasePlan& plan, const RealPlant& plant);
/** An external torque that is fed is one that the plant measures. */
void checkExternalTorqueIsMeasured(const CasePlan& plan, const RealPlant& plant);
/** The controller can follow what the command asks for. */
void checkControllerFollows(const CasePlan& plan, const CommandSource& command, const NominalController& controller);

}  // namespace viable::detail
