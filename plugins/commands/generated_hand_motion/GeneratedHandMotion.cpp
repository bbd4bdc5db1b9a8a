#include "GeneratedHandMotion.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "core/MinimumJerk.h"
#include "core/RotationVector.h"
#include "core/Text.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

constexpr double kMostReaches = 1e6;  // about 150 MB

// Random numbers that are the same with every standard library: its distributions are not.
class Draw {
public:
    Draw(std::uint64_t seed, std::uint64_t stream) {
        std::seed_seq words{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                            static_cast<std::uint32_t>(stream)};
        engine_.seed(words);
    }
    double between(double low, double high) {
        return low + (static_cast<double>(engine_() >> 11) * 0x1p-53) * (high - low);
    }
    // Evenly distributed in the ball; by rejection, which needs no cube roots.
    Eigen::Vector3d inBall(double radius) {
        Eigen::Vector3d v;
        do {
            for (int axis = 0; axis < 3; ++axis) v[axis] = between(-1.0, 1.0);
        } while (v.squaredNorm() > 1.0);
        return radius * v;
    }

private:
    std::mt19937_64 engine_;
};

struct GeneratedHandMotionOptions {
    std::uint64_t seed = 1;
    Eigen::Vector3d reach{0.1, 0.2, 0.1};
    double rotation = 0.5, fastest = 0.5, slowest = 1.4, topSpeed = 1.5, pause = 0.3, tremor_m = 1e-4,
           tremor_rad = 5e-4;

    template <class V>
    void describe(V& v) {
        v(seed, "seed", "Another number is another motion.").atLeast(0);
        v(reach, "reach_m", "m", "Targets lie this far from the start at most, along each base axis.")
            .atLeast(0)
            .upTo(10);
        v(rotation, "rotation_rad", "rad", "Targets are turned by at most this angle.").atLeast(0).upTo(3);
        v(fastest, "fastest_s", "s", "Shortest time of one reach.").atLeast(0.05).upTo(100);
        v(slowest, "slowest_s", "s", "Longest time drawn for one reach.").atLeast(0.05).upTo(100);
        v(topSpeed, "top_speed_mps", "m/s", "A reach that would be faster than this takes longer.")
            .above(0)
            .orInfinite();
        v(pause, "pause_s", "s", "Longest pause after a reach.").atLeast(0).upTo(100);
        v(tremor_m, "tremor_m", "m",
          "Largest offset by tremor along each base axis; grows from zero in the first second.")
            .atLeast(0)
            .upTo(0.1);
        v(tremor_rad, "tremor_rad", "rad", "Largest rotation by tremor about each base axis.").atLeast(0).upTo(0.1);
    }
};

}  // namespace

void GeneratedHandMotion::configure(const RunSetup& setup, const Parameters& parameters) {
    start_ = setup.startTool;
    const auto [seed, reach, rotation, fastest, slowest, topSpeed, pause, tremor_m, tremor_rad] =
        parameters.get<GeneratedHandMotionOptions>();
    if (slowest < fastest)
        throw badInput(parameters.place("slowest_s"),
                       detail::format("slowest_s = %g s is shorter than fastest_s = %g s", slowest, fastest),
                       "Give a time that is not shorter than fastest_s");
    const double end = setup.duration_s + kMargin_s;
    if (!(end / fastest <= kMostReaches))
        throw badInput(parameters.place("fastest_s"),
                       detail::format("a run of %g s may need more than %g reaches of fastest_s = %g s",
                                      setup.duration_s, kMostReaches, fastest),
                       "Make the run shorter or fastest_s longer");

    // Two streams, so that more reaches never change the tremor, nor the tremor the reaches.
    Draw tremorDraw(seed, 1);
    for (auto& axis : sines_)
        for (Sine& sine : axis)
            sine = {2.0 * kPi * tremorDraw.between(kTremorLowest_Hz, kTremorHighest_Hz),
                    tremorDraw.between(0.0, 2.0 * kPi)};
    tremor_.head<3>().setConstant(tremor_m);
    tremor_.tail<3>().setConstant(tremor_rad);

    Draw draw(seed, 0);
    reaches_.clear();
    Vector6 from = Vector6::Zero();
    for (double t = 0.0; t < end;) {
        Vector6 to;
        for (int axis = 0; axis < 3; ++axis) to[axis] = draw.between(-reach[axis], reach[axis]);
        to.tail<3>() = draw.inBall(rotation);
        const Vector6 way = to - from;
        const double shortest = kMinimumJerkPeakSlope * way.head<3>().norm() / topSpeed;
        const double duration = std::max(draw.between(fastest, slowest), shortest);
        reaches_.push_back({t, duration, from, way});
        t += duration + draw.between(0.0, pause);
        from = to;
    }
}

TickStatus GeneratedHandMotion::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    const auto next =
        std::upper_bound(reaches_.begin(), reaches_.end(), t, [](double s, const Reach& r) { return s < r.begin_s; });
    const Reach& reach = *(next - 1);  // the first begins at 0
    const MinimumJerk share = calcMinimumJerk((t - reach.begin_s) / reach.duration_s);
    Vector6 offset = reach.from + share.value * reach.way;
    Vector6 rate = (share.slope / reach.duration_s) * reach.way;

    const MinimumJerk blend = calcMinimumJerk(t / kTremorBlend_s);
    for (int axis = 0; axis < 6; ++axis) {
        double sum = 0.0, sumRate = 0.0;
        for (const Sine& sine : sines_[axis]) {
            sum += std::sin(sine.omega * t + sine.phase);
            sumRate += sine.omega * std::cos(sine.omega * t + sine.phase);
        }
        const double amplitude = tremor_[axis] / kSinesPerAxis;
        offset[axis] += amplitude * blend.value * sum;
        rate[axis] += amplitude * (blend.value * sumRate + blend.slope / kTremorBlend_s * sum);
    }

    out.space = MotionCommand::Space::Tool;
    out.tool.position = start_.position + offset.head<3>();
    out.tool.orientation = calcRotation(offset.tail<3>()) * start_.orientation;
    out.toolTwist.head<3>() = rate.head<3>();
    out.toolTwist.tail<3>() = calcAngularVelocity(offset.tail<3>(), rate.tail<3>());
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::GeneratedHandMotion, "generated_hand_motion",
              "An operator's hand reaching around the start pose, made from a seed.",
              viable::GeneratedHandMotionOptions)
