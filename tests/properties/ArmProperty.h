#pragma once

#include "Arms.h"
#include "PathRange.h"
#include "Properties.h"

namespace viable {

/** Lower and upper limit of a quantity: 0 position, 1 velocity, 2 acceleration, 3 jerk. */
struct Sides {
    double lower, upper;
};
inline Sides getSides(const AxisLimits& l, int quantity) {
    const Sides sides[] = {{l.positionLower, l.positionUpper},
                           {l.velocityLower, l.velocityUpper},
                           {l.accelerationLower, l.accelerationUpper},
                           {l.jerkLower, l.jerkUpper}};
    return sides[quantity];
}
/** Of the first three. */
inline const Range& getRange(const PathRange& path, int quantity) {
    return quantity == 0 ? path.p : quantity == 1 ? path.v : path.a;
}

/** A property of random arms, one after the other. */
class ArmProperty {
public:
    ArmProperty(const char* name, const Options& options) : run_(name, options) {}
    virtual ~ArmProperty() = default;

    bool check() {
        while (run_.nextArm()) followArm();
        run_.print();
        report();
        return run_.isGood();
    }

protected:
    virtual void followArm() = 0;
    /** Prints what was measured. */
    virtual void report() = 0;

    /** A violation at joint `i` of the present arm. */
    void fail(const char* what, double excess, int i) {
        run_.fail(what, excess, i, arm_->at(i), arm_->limits.axis(i), arm_->tick_s);
    }

    Run run_;
    Arm* arm_ = nullptr;
};

}  // namespace viable
