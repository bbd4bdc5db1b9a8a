#pragma once

#include "Report.h"

namespace viable {

/** Each prints what it measured; true when nothing was wrong. */

/** From starts that can keep the limits: they hold at the ticks and between, also where stops are followed; the barrier
holds; an admissible want is granted bit for bit; and the arm does move. */
bool checkLimits(const Options& options);

/** From a start anywhere, or after limits changed: nothing passes a limit farther than the stop of one tick before would
have; hardly farther, and hardly longer, than the fastest way back in continuous time. */
bool checkRecovery(const Options& options);
bool checkChangingLimits(const Options& options);

/** For states from which the fastest stop in continuous time keeps the limits: is there one on the grid, and what does
it cost? */
bool checkStops(const Options& options);

/** The host's monitor never accuses the law, and always does when its decision is spoilt. */
bool checkMonitor(const Options& options);

/** Whole arms among random obstacles under hostile torques: nothing is ever touched, no torque beyond the motors', and
neither along the stops. */
bool checkObstacles(const Options& options);

/** Whole arms with steering in random scenes that are asked to go from pose to pose: at most one run
in 500 has a rest of 2 s in which a joint could go alone where it is asked to. */
bool checkFreezing(const Options& options);

/** The same behind JointFollower, for one target each, which an obstacle may bar: at most one arm in 200 still moves after 11 s
(a joint by more than a count of its encoder in a second). */
bool checkSwinging(const Options& options);

/** The same behind ToolFollower, also on random arms of 7 and 8 joints, whose spare joints lead them apart: no more go to and fro.
*/
bool checkTrembling(const Options& options);

/** Whole arms with random speed limits of their points, of joints and regions, under hostile torques and with missed ticks: no
point is ever too fast, nor along the stops, and the arm runs at the limit. */
bool checkSpeeds(const Options& options);

/** Whole arms with random joint and speed limits among people who come, go, are lost and jump: nobody who keeps to the stated speed
is touched by what is too fast for it, nor along stops; and the arm does move. */
bool checkPeople(const Options& options);

/** Runs of 20 s among people, half of whom go for the arm, with the filter, without it, and with the textbook rule: contacts that
are too fast, how far arm and people were apart, and what the arm got done. --steps counts runs. */
bool checkPeopleRuns(const Options& options);

/** Reference guards of random chains under hostile targets, missed ticks and changing limits: the limits hold, resting
targets are reached. */
bool checkReferences(const Options& options);

/** Plausible random arms with default plugins and a real arm that has friction and a payload: every run follows, or is
refused or stopped with its cause; none fails silently. */
bool checkAnyArm(const Options& options);

/** Random trees of turning and sliding joints with rotors, under any gravity: the recursive dynamics are Simbody's. */
bool checkDynamics(const Options& options);

/** The worst that can be found inside a DisturbanceSet, on nominal arms at rest and moving: no error leaves the
TrackingBound, and some come near it. */
bool checkTracking(const Options& options);
/** The same at rest, in poses that are looked for: those of the bound's sample are not the worst. */
bool checkTrackingPoses(const Options& options);

/** Random arms, gains and disturbance sets, also with figures that cannot be: the TrackingBound is finite and positive, or
refused with a reason. */
bool checkBound(const Options& options);

/** Both ends of the link under packets of somebody who has recorded all that went over it: replayed, changed, cut, forged. No
torque, state or session is another than without him, and who calls gets the robot. */
bool checkLink(const Options& options);

}  // namespace viable
