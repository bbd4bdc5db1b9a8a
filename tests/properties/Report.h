#pragma once

#include "viable/filter/CertifiedBrakingFilter.h"

namespace viable {

/** What the command line says. */
struct Options {
    std::int64_t steps = 20'000'000;
    std::uint64_t seed = 1;
    std::int64_t arm = 0;                     ///< only this one; 0: all
    Objective objective = Objective::Torque;  ///< of `limits`
};

/** One run of a property: which arms it has, how far it is, and what was wrong. */
class Run {
public:
    Run(const char* property, const Options& options) : property_(property), options_(options) {}
    const Options& options() const { return options_; }

    /** On to the next arm; false when there is none. */
    bool nextArm();
    /** Number of the present arm, from 1 on. */
    std::int64_t arm() const { return arm_; }
    std::uint64_t seed() const { return options_.seed; }
    void addSteps(std::int64_t steps) { done_ += steps; }
    std::int64_t steps() const { return done_; }

    /** Counts a violation; prints the first in full, with the call that repeats its arm. */
    void fail(const char* what, double excess, int joint, const AxisState& s, const AxisLimits& l, double tick_s);
    /** The same without a joint to blame. */
    void fail(const char* what, double excess);
    /** The call that repeats the present arm alone. */
    void printRepeat() const;
    std::int64_t violations() const { return violations_; }

    /** A share that must not be smaller than `least`, which is asked of whole runs with enough arms and cases. */
    void expectShare(const char* name, std::int64_t count, std::int64_t of, double least);

    /** "limits: seed 1, 20000000 joint steps on 1400 arms, 0 violations" */
    void print() const;
    bool isGood() const { return violations_ == 0 && shortfalls_ == 0; }

private:
    const char* property_;
    Options options_;
    std::int64_t arm_ = 0, done_ = 0, violations_ = 0;
    int shortfalls_ = 0;
};

/** Measured numbers, printed as median, 99 % and worst; nothing without any. */
class Figures {
public:
    void add(double x) { all_.push_back(x); }
    void print(const char* name);
    double worst() const;
    std::int64_t count() const { return static_cast<std::int64_t>(all_.size()); }

private:
    std::vector<double> all_;
};

/** What rounding is relative to: the larger limit, or the largest number there was; where a side is open at least one
radian (per second, ...). */
double calcSize(double lower, double upper, double seen);

}  // namespace viable
