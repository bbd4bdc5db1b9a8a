#pragma once

#include <string>
#include <vector>

namespace viable {

/** Parts of a person that an arm may touch in passing. Head, face and neck are not among them: here nothing that
moves may touch them. */
enum class BodyPart : unsigned char { Back, Chest, Abdomen, Pelvis, UpperArm, Forearm, Hand, Thigh, LowerLeg };

/** As in experiment files, in the order of BodyPart: back, chest, abdomen, pelvis, upper_arm, forearm, hand, thigh, lower_leg. */
const std::vector<std::string>& bodyPartNames();

/** The speed at which an arm may touch a part that can give way: v = F / sqrt(mu k) [m/s]. The arm moves
`movingMass_kg` (> 0, tool and payload included). Here mu is the reduced mass of both. Force F (twice the one for
clamping), stiffness k and mass of the part are those of ISO/TS 15066:2016, tables A.2 and A.3. (Now ISO 10218-2:2025.)

This is the speed of one against the other, for a blunt contact: the person's own speed is not the arm's. The
standard takes half of the arm's mass and the payload. Here all that moves counts, which allows less. As in the
standard, motors behind gears do not count. Nothing here knows edges (the standard limits the pressure, too) or
somebody who cannot give way. */
double calcContactSpeed(BodyPart part, double movingMass_kg);

}  // namespace viable
