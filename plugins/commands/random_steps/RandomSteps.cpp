#include "RandomSteps.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct RandomStepsOptions {
    std::uint64_t seed = 1;
    double shortest = 0.5, longest = 3.0, beyondShare = 0.3, beyond = 0.5;

    template <class V>
    void describe(V& v) {
        v(seed, "seed", "Another number is another sequence.").atLeast(0);
        v(shortest, "shortest_s", "s", "Shortest time that a set-point is held; times are drawn evenly.")
            .atLeast(0.001)
            .upTo(1000);
        v(longest, "longest_s", "s", "Longest time that a set-point is held.").atLeast(0.001).upTo(1000);
        v(beyondShare, "beyond_share", "",
          "Share of the set-points that lie beyond a limit, either side alike; the others are drawn evenly between the "
          "limits.")
            .atLeast(0)
            .upTo(1);
        v(beyond, "beyond_rad", "rad", "How far beyond a limit at most, drawn evenly.").atLeast(0).upTo(100);
    }
};

constexpr double kMostSteps = 1e6;  // per joint: 16 MB

}  // namespace

void RandomSteps::configure(const RunSetup& setup, const Parameters& parameters) {
    const auto options = parameters.get<RandomStepsOptions>();
    const double shortest = options.shortest, longest = options.longest;
    char message[200];
    if (longest < shortest) {
        std::snprintf(message, sizeof message, "longest_s = %g s is shorter than shortest_s = %g s", longest, shortest);
        throw badInput(parameters.place("longest_s"), message, "Give a time that is not shorter than shortest_s");
    }
    const double end = setup.duration_s + kMargin_s;
    if (!(end / shortest <= kMostSteps)) {
        std::snprintf(message, sizeof message, "a run of %g s may need more than %g steps of shortest_s = %g s",
                      setup.duration_s, kMostSteps, shortest);
        throw badInput(parameters.place("shortest_s"), message, "Make the run shorter or shortest_s longer");
    }
    joints_.assign(static_cast<std::size_t>(setup.size()), {});
    for (int i = 0; i < setup.size(); ++i) {
        const double lower = setup.limits.position.lower[i], upper = setup.limits.position.upper[i];
        if (!std::isfinite(lower) || !std::isfinite(upper))
            throw badInput(
                parameters.resolved().place(),
                "the command random_steps needs a position limit on both sides of " + setup.robot.joints[i].name,
                "Set limits.position_rad, or use the command waypoints.");
        // The standard's engine is the same with every library, its distributions are not.
        std::seed_seq words{static_cast<std::uint32_t>(options.seed), static_cast<std::uint32_t>(options.seed >> 32),
                            static_cast<std::uint32_t>(i)};
        std::mt19937_64 engine(words);
        const auto draw = [&](double low, double high) {
            return low + static_cast<double>(engine() >> 11) * 0x1p-53 * (high - low);
        };
        for (double t = 0.0; t < end; t += draw(shortest, longest)) {
            const bool isBeyond = draw(0.0, 1.0) < options.beyondShare;
            const double inside = draw(lower, upper), side = draw(-1.0, 1.0);
            const double past = draw(0.0, options.beyond);
            joints_[i].push_back({t, !isBeyond ? inside : side < 0.0 ? lower - past : upper + past});
        }
    }
}

TickStatus RandomSteps::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    const auto n = static_cast<Eigen::Index>(joints_.size());
    out.space = MotionCommand::Space::Joint;
    out.q.resize(n);
    out.qd.setZero(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const std::vector<Step>& steps = joints_[i];
        const auto next = std::upper_bound(steps.begin(), steps.end(), t,
                                           [](double s, const Step& step) { return s < step.begin_s; });
        out.q[i] = (next - 1)->position;
    }
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::RandomSteps, "random_steps",
              "Random joint set-points held for random times, some beyond the limits, made from a seed.",
              viable::RandomStepsOptions)
