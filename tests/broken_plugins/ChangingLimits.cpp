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
        const auto options = parameters.get<ChangingLimitsOptions>();
        size_ = options.size;
        at_s_ = options.at_s;
        fault_ = options.fault;
        sleep_us_ = options.sleep_us;
        limits_ = setup.limits;
        const double share = options.positionShare;
        const viable::JointVector middle = (limits_.position.lower + limits_.position.upper) / 2.0;
        for (viable::JointVector* side : {&limits_.position.lower, &limits_.position.upper})
            *side = middle + share * (*side - middle);
        for (viable::JointBounds* bounds : {&limits_.velocity, &limits_.acceleration, &limits_.jerk})
            for (viable::JointVector* side : {&bounds->lower, &bounds->upper}) *side *= options.rateShare;
        if (fault_ == "nan") limits_.velocity.upper[0] = std::numeric_limits<double>::quiet_NaN();
        if (fault_ == "size") limits_.jerk.lower.conservativeResize(setup.size() + 1);
    }
    void reset(const viable::MotionState& start) override {
        Command::reset(start);
        isGiven_ = false;
        random_.seed(7);
    }
    viable::TickStatus sample(double t, viable::MotionCommand& out) override {
        if (sleep_us_ > 0)
            std::this_thread::sleep_for(
                std::chrono::microseconds(std::uniform_int_distribution<int>(0, sleep_us_)(random_)));
        return setPoint(std::fmod(t, 2.0) < 1.0 ? size_ : -size_, out);
    }
    const viable::JointLimits* sampleLimits(double t) override {
        if (isGiven_ || t < at_s_) return nullptr;
        if (fault_ == "throw") throw std::runtime_error("no limits today");
        isGiven_ = true;
        return &limits_;
    }

private:
    double size_ = 0.0, at_s_ = 0.0;
    std::string fault_;
    int sleep_us_ = 0;
    viable::JointLimits limits_;
    bool isGiven_ = false;
    std::mt19937 random_;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, ChangingLimits, "changing_limits",
              "Set-points to and fro, and limits that change once.", ChangingLimitsOptions)
