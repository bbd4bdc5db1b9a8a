#pragma once

#include <vector>

#include "viable/core/JointTypes.h"

namespace viable {

/** Joint-space inertias [kg m^2] at `count` random poses: of the robot indy7 for n = 6; for other n
random positive definite matrices of similar conditioning. The same ones in every run. */
std::vector<JointMatrix> makeArmMatrices(int n, int count);

}  // namespace viable
