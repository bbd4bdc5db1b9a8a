#pragma once

#include "analysis/smoothing/SplineFit.h"

/** The search for what a SplineFit takes as given: distance of the knots, roughness along the record, weights of the
readings. */
namespace viable::detail {

/** One step of Fisher's scoring for a roughness that changes slowly along the record: the likelihood's slope over its
information, both averaged over some pieces, each drawn towards 1. */
Roughness refine(const SplineFit& fit);

/** With a geometric mean of 1: what is common to all is the fit's own density. */
void normalise(Roughness& roughness);

/** The distance of the knots with the largest restricted likelihood: from coarse to fine in steps of 2^(1/2) until it
falls for good, then a parabola's least point.
@param maxWorseSteps  steps without a better one after which it has fallen for good */
double findKnotStep(const Readings& readings, const Roughness& roughness, double coarsest_s, std::size_t maxWorseSteps);

/** Weighs the readings by what a fit says of them: outliers, and the part of the rounding errors that does not change
from one reading to the next. True where it made a difference. */
bool reweigh(Readings& readings, const SplineFit& fit);

}  // namespace viable::detail
