#include <cmath>

#include "analysis/smoothing/Smoothing.h"
#include "analysis/smoothing/SplinePiece.h"

namespace viable {

using detail::factorial;

/** The times-fold integral from 0 to t of a step to 1 that takes rise_s, as 10 u^3 - 15 u^4 + 6 u^5. */
static double integrateStep(double t, double rise_s, int times) {
    if (t <= 0.0) return 0.0;
    if (t < rise_s) {
        const double u = t / rise_s;
        double sum = 0.0;
        for (const auto& [power, factor] : {std::pair{3, 10.0}, {4, -15.0}, {5, 6.0}})
            sum += factor * std::pow(u, power + times) * factorial(power) / factorial(power + times);
        return sum * std::pow(rise_s, times);
    }
    double sum = std::pow(t - rise_s, times) / factorial(times);
    for (int i = 0; i < times && rise_s > 0.0; ++i) {
        double atEnd = 0.0;
        for (const auto& [power, factor] : {std::pair{3, 10.0}, {4, -15.0}, {5, 6.0}})
            atEnd += factor * factorial(power) / factorial(power + times - i);
        sum += atEnd * std::pow(rise_s, times - i) * std::pow(t - rise_s, i) / factorial(i);
    }
    return sum;
}

double MotionPulse::calcPosition(double time_s) const {
    const double rise = middle_s - 0.5 * duration_s - rise_s, fall = middle_s + 0.5 * duration_s;
    return height * (integrateStep(time_s - rise, rise_s, order) - integrateStep(time_s - fall, rise_s, order));
}

}  // namespace viable
