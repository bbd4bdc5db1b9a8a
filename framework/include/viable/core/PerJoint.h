#pragma once

#include "viable/core/JointTypes.h"

namespace viable {

/** A quantity of every joint: one number for all of them, or one each. */
class PerJoint {
public:
    PerJoint(double all) : values_(JointVector::Constant(1, all)) {}
    PerJoint(const JointVector& each) : values_(each) {}

    /** True for one number, or for n of them. */
    bool fits(int n) const { return values_.size() == 1 || values_.size() == n; }
    /** The value for one joint; requires fits(number of joints). */
    double operator[](int joint) const { return values_[values_.size() == 1 ? 0 : joint]; }
    /** One entry for each of n joints; requires fits(n). */
    JointVector expand(int n) const { return values_.size() == 1 ? JointVector::Constant(n, values_[0]) : values_; }
    int count() const { return static_cast<int>(values_.size()); }

private:
    JointVector values_;
};

}  // namespace viable
