#include "viable/filter/BrakingPolicyFilter.h"

namespace viable {

namespace {

/** A stop or a peak this little beyond its limit is on the limit, up to rounding. [rad, rad/s] */
constexpr double kRounding = 1e-12;

/** The upper end of the jerk interval that a row sets, `-J + weight h / slope`, or `open` where it
does not restrict; the quotient is formed only where it does, so `slope` may be zero. Beyond the
limit (h < 0) the row asks for less than -J: no jerk does that. */
double calcRow(double J, double h, double weight, double slope, double open) {
    if (h < -kRounding) return -std::numeric_limits<double>::infinity();
    if (h <= 0.0) return -J;
    const double gain = weight * h;
    if (gain >= slope * (J + open)) return open;
    return -J + gain / slope;
}

}  // namespace

void BrakingPolicyFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    kAlpha_ = parameters.get<BrakingPolicyOptions>().kAlpha;
    checkKAlpha(kAlpha_, setup, parameters);
    JerkIntervalFilter::configure(setup, parameters);
}

JerkIntervalFilter::Rows BrakingPolicyFilter::calcRows(const AxisState& s, const AxisLimits& l) const {
    const double Ju = l.jerkUpper, Jd = -l.jerkLower;
    JointInterval jerk = calcHardLimits(s, l);

    const double peak = calcVelocityPeak(s.v, s.a, l);
    if (s.a > 0.0) jerk.restrictUpper(calcRow(Jd, l.velocityUpper - peak, Jd * kAlpha_, s.a, Ju), LimitKind::Velocity);
    if (s.a < 0.0)
        jerk.restrictLower(-calcRow(Ju, peak - l.velocityLower, Ju * kAlpha_, -s.a, Jd), LimitKind::Velocity);

    const BrakingStop stop = calcStop(s.v, s.a, l);
    const double stopPosition = s.p + stop.displacement;
    if (stop.side == LimitSide::Upper) {
        const double h = l.positionUpper - stopPosition;
        jerk.restrictUpper(calcRow(Jd, h, kAlpha_, stop.gradientA, Ju), LimitKind::Position);
    } else {
        const double h = stopPosition - l.positionLower;
        jerk.restrictLower(-calcRow(Ju, h, kAlpha_, stop.gradientA, Jd), LimitKind::Position);
    }
    return finishRows(jerk, stop.jerk, s, l);
}

}  // namespace viable
