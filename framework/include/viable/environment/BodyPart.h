#pragma once

#include <string>
#include <vector>

namespace viable {

/** What an arm may touch of a person in passing. Head, face and neck are not among them: here nothing that moves may touch
them. */
enum class BodyPart : unsigned char { Back, Chest, Abdomen, Pelvis, UpperArm, Forearm, Hand, Thigh, LowerLeg };

/** As in experiment files, in the order of BodyPart: back, chest, abdomen, pelvis, upper_arm, forearm, hand, thigh, lower_leg. */
const std::vector<std::string>& bodyPartNames();

/** The speed at which an arm that moves `movingMass_kg` (> 0, tool and payload included) may touch a part that can give
way: v = F / sqrt(mu k) [m/s], with mu the reduced mass of both, and force F (twice the one for clamping), stiffness k and mass
of the part by ISO/TS 15066:2016, tables A.2 and A.3 (now in ISO 10218-2:2025).

This is the speed of one against the other, for a blunt contact: what the person's own speed takes of it is not the arm's. The
standard takes half of the arm's mass and the payload; here all that moves counts, which allows less. As in the standard,
motors behind gears do not count. Nothing here knows edges (the standard limits the pressure, too) or somebody who
cannot give way. */
double calcContactSpeed(BodyPart part, double movingMass_kg);

}  // namespace viable
