#pragma once

#include "viable/core/JointTypes.h"

namespace viable::test {

/** One number per joint. */
template <class... Numbers>
JointVector joints(Numbers... numbers) {
    return JointVector{{static_cast<double>(numbers)...}};
}

}  // namespace viable::test
