#include <chrono>
#include <cmath>
#include <random>
#include <thread>

#include "BrokenPlugin.h"

namespace {

struct ChangingLimitsOptions {
    double size = 0.5, at_s = viable::kInfinity, positionShare = 1.0, rateShare = 1.0;
    std::string fault = "none";
    int sleep_us = 0;

    template <class V>
    void describe(V& v) {
        v(size, "size_rad", "rad", "Set-points are so far from the start.").atLeast(0.0);
        v(at_s, "at_s", "s", "When the limits change.").orInfinite();
        v(positionShare, "position_share", "1", "New position range by the old one.");
        v(rateShare, "rate_share", "1", "The same for the other limits.");
        v(fault, "fault", "none|nan|size|throw", "What the new limits are.");
        v(sleep_us, "sleep_us", "Longest random sleep in a tick.").atLeast(0);
    }
};

/** Set-points to and fro, once a second; limits that change; a tick that takes its time. */
class ChangingLimits : public broken::Command {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        options_ = parameters.get<ChangingLimitsOptions>();
        limits_ = setup.limits;
        const double share = options_.positionShare;
        const viable::JointVector middle = (limits_.position.lower + limits_.position.upper) / 2.0;
        for (viable::JointVector* side : {&limits_.position.lower, &limits_.position.upper})
            *side = middle + share * (*side - middle);
        for (viable::JointBounds* bounds : {&limits_.velocity, &limits_.acceleration, &limits_.jerk})
            for (viable::JointVector* side : {&bounds->lower, &bounds->upper}) *side *= options_.rateShare;
        if (options_.fault == "nan") limits_.velocity.upper[0] = std::numeric_limits<double>::quiet_NaN();
        if (options_.fault == "size") limits_.jerk.lower.conservativeResize(setup.size() + 1);
    }
    void reset(const viable::MotionState& start) override {
        Command::reset(start);
        isGiven_ = false;
        random_.seed(7);
    }
    viable::TickStatus sample(double t, viable::MotionCommand& out) override {
        if (options_.sleep_us > 0)
            std::this_thread::sleep_for(
                std::chrono::microseconds(std::uniform_int_distribution<int>(0, options_.sleep_us)(random_)));
        return setPoint(std::fmod(t, 2.0) < 1.0 ? options_.size : -options_.size, out);
    }
    const viable::JointLimits* sampleLimits(double t) override {
        if (isGiven_ || t < options_.at_s) return nullptr;
        if (options_.fault == "throw") throw std::runtime_error("no limits today");
        isGiven_ = true;
        return &limits_;
    }

private:
    ChangingLimitsOptions options_;
    viable::JointLimits limits_;
    bool isGiven_ = false;
    std::mt19937 random_;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, ChangingLimits, "changing_limits",
              "Set-points to and fro, and limits that change once.", ChangingLimitsOptions)
