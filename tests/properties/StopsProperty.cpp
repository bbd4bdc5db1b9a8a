#include <cstdio>

#include "Arms.h"
#include "FastestReturn.h"
#include "Properties.h"
#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** Share of the viable states for which no stop may be found (measured 1.1e-4), and how far from the edge they may be in
ticks of travel (measured 0.81, of 6e7). */
constexpr double kMostWithout = 5e-4;
constexpr double kEdge = 1.2;

bool isInside(const PathRange& path, const AxisLimits& l) {
    return path.p.largest <= l.positionUpper && path.p.least >= l.positionLower && path.v.largest <= l.velocityUpper &&
           path.v.least >= l.velocityLower;
}

class StopsProperty {
public:
    explicit StopsProperty(const Options& options) : run_("stops", options) {}

    bool check() {
        while (run_.nextArm()) checkJoint();
        run_.print();
        longer_.print("longer than in continuous time by [ticks]");
        timeRatio_.print("time ratio (stops of 50 ticks and more)");
        distanceRatio_.print("distance ratio (the same)");
        const auto without = static_cast<double>(edge_.count());
        std::printf("  no stop found for %.0f states, a share of %.2g (goal 0)\n", without,
                    without / static_cast<double>(run_.steps()));
        edge_.print("their distance from the edge [travel of one tick]");
        // What a regression would look like: many such states, or some well inside.
        const bool areFew = without <= kMostWithout * static_cast<double>(run_.steps()) + 2.0;
        const bool areAtEdge = edge_.worst() < kEdge;
        if (!areFew) std::printf("TOO MANY: a share of %g is allowed\n", kMostWithout);
        if (!areAtEdge) std::printf("TOO FAR INSIDE: %g ticks of travel are allowed\n", kEdge);
        return run_.isGood() && areFew && areAtEdge;
    }

private:
    void checkJoint() {
        Random random(run_.seed(), run_.arm());
        const double dt = drawTick(random);
        const DrawnLimits drawn = drawLimits(random, dt);
        const AxisLimits &l = drawn.limits, &f = drawn.finite;
        BrakingCertificate certificate;
        certificate.configure(l, dt, 1.0);
        for (int k = 0; k < 20; ++k) {
            const AxisState s{random.uniform(f.positionLower, f.positionUpper),
                              random.uniform(f.velocityLower, f.velocityUpper),
                              random.uniform(f.accelerationLower, f.accelerationUpper)};
            PathRange fastest(s);
            const double T = followFastestStop(fastest, l);
            if (!isInside(fastest, l)) continue;
            run_.addSteps(1);
            certificate.reset(s);
            const double displacement = static_cast<double>(fastest.endPosition() - s.p);
            if (certificate.findExcess().limit != LimitKind::None) {
                edge_.add(calcRoom(s, fastest, certificate.findExcess().limit, l, dt));
                continue;
            }
            const double duration = static_cast<double>(certificate.stop().remainingTicks()) * dt;
            longer_.add((duration - T) / dt);
            if (T > 50.0 * dt) timeRatio_.add(duration / T);
            const Real end = walkStop(s, certificate.stop(), dt).endPosition();
            if (T > 50.0 * dt && std::abs(displacement) > 0.1 * std::abs(s.v) * T)
                distanceRatio_.add(static_cast<double>(end - s.p) / displacement);
        }
    }

    /** Between the fastest stop and the limit that was the obstacle, in what one tick adds. */
    static double calcRoom(const AxisState& s, const PathRange& fastest, LimitKind limit, const AxisLimits& l,
                           double dt) {
        const double J = std::max(-l.jerkLower, l.jerkUpper);
        if (limit == LimitKind::Position) {
            const double travel = dt * (std::abs(s.v) + dt * (std::abs(s.a) / 2.0 + dt * J / 6.0));
            return static_cast<double>(
                       std::min(l.positionUpper - fastest.p.largest, fastest.p.least - l.positionLower)) /
                   travel;
        }
        const double peak = calcVelocityPeak(s.v, s.a, l);
        return std::min(l.velocityUpper - peak, peak - l.velocityLower) / (std::abs(s.a) * dt + J * dt * dt / 2.0);
    }

    Run run_;
    Figures longer_, timeRatio_, distanceRatio_, edge_;
};

}  // namespace

bool checkStops(const Options& options) {
    return StopsProperty(options).check();
}

}  // namespace viable
