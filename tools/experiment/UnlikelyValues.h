#pragma once

#include "experiment/CasePlan.h"

namespace viable::detail {

/** What a number far from the robot's own figure may mean: degrees, or millimetres where the figure is a length. Empty: it
is near, or there is no figure.
@param kind  of a position, which is sensible up to 3 times the figure, or of a jerk, which is sensible but from 0.8 to 1.25 times
of what degrees would be; else sensible up to a tenth of that */
std::string explainUnlikely(double value, double own, bool isLength, LimitKind kind);

/** The first number of the start that is so; empty: none. A start is refused where it is outside the limits. */
std::string findUnlikelyStart(const CasePlan& plan);

/** The limits and numbers of the command that are far from the robot's own figures, each in one line with the likely meaning. */
std::vector<std::string> findUnlikelyValues(const CasePlan& plan);

}  // namespace viable::detail
