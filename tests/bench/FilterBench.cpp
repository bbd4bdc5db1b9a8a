#include <benchmark/benchmark.h>

#include <cmath>

#include "ArmMatrices.h"
#include "Paths.h"
#include "TickTimes.h"
#include "host/PluginLoader.h"
#include "viable/loop/NominalPlant.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
constexpr int kTicks = 6000;

enum class Load {
    Free,     // slow waves far inside the limits: every tick passes
    Limited,  // every joint is pushed at its limits, to and fro
};

/** A filter plugin in a closed loop with the nominal arm. A first pass records what it is asked; replaying that gives
the same answers again, so that nothing but the filter is timed. */
class FilterLoop {
public:
    FilterLoop(const std::string& name, int n, Load load)
        : plugin_(loader().find(PluginKind::SafetyFilter, name, "bench", {})),
          robot_(makeRobot(n)),
          setup_{robot_, makeLimits(n), kTick_s, 1.0, makeStart(n), {}},
          filter_(PluginLoader::create<SafetyFilter>(plugin_)) {
        const ConfigNode block = parseConfig("filter: {plugin: " + name + "}\n", "bench");
        filter_->configure(
            setup_, readParameters(*block.find("filter"), plugin_.entry->parameters, plugin_.entry->parameterCount, n));
        dynamics_.M = makeArmMatrices(n, 1).front();
        dynamics_.b.setZero(n);
        dynamics_.gravity.setZero(n);
        dynamics_.J.setZero(6, n);
        record(load);
    }

    void rewind() {
        tick_ = 0;
        filter_->reset(setup_.start);
    }

    FilterStatus step() {
        if (tick_ == states_.size()) rewind();
        const FilterStatus status = filter_->filter({states_[tick_], torques_[tick_], dynamics_}, decision_);
        ++tick_;
        return status;
    }

    double passedShare() const { return passed_ / static_cast<double>(kTicks); }

private:
    static const PluginLoader& loader() {
        static const PluginLoader loader({VIABLE_PLUGIN_DIR});
        return loader;
    }
    static RobotDescription makeRobot(int n) {
        RobotDescription robot;
        robot.name = "bench";
        robot.joints.resize(n);
        return robot;
    }
    /** The paper's (30), around zero. */
    static JointLimits makeLimits(int n) {
        const auto bounds = [n](double size) {
            return JointBounds{JointVector::Constant(n, -size), JointVector::Constant(n, size)};
        };
        return {bounds(EIGEN_PI / 6), bounds(2 * EIGEN_PI / 3), bounds(4 * EIGEN_PI), bounds(12 * EIGEN_PI)};
    }
    static MotionState makeStart(int n) { return {JointVector::Zero(n), JointVector::Zero(n), JointVector::Zero(n)}; }

    void record(Load load) {
        const int n = robot_.size();
        MotionState nominal = setup_.start;
        JointVector wanted(n);
        filter_->reset(nominal);
        for (int k = 0; k < kTicks; ++k) {
            for (int i = 0; i < n; ++i) {
                const double t = k * kTick_s;
                wanted[i] = load == Load::Free ? 0.2 * std::cos(3.0 * t) : ((k / 700 + i) % 2 == 0 ? 1e3 : -1e3);
            }
            states_.push_back(nominal);
            torques_.push_back(dynamics_.M.lazyProduct(wanted));
            passed_ += filter_->filter({nominal, torques_.back(), dynamics_}, decision_) == FilterStatus::Passed;
            advanceNominal(decision_, kTick_s, nominal);
        }
        rewind();
    }

    PluginInfo plugin_;
    RobotDescription robot_;
    RunSetup setup_;
    PluginPtr<SafetyFilter> filter_;
    Dynamics dynamics_;
    FilterDecision decision_;
    std::vector<MotionState> states_;
    std::vector<JointVector> torques_;
    std::size_t tick_ = 0;
    int passed_ = 0;
};

/** The 99.9th percentile over the median. */
double calcTailRatio(std::vector<double> times) {
    std::sort(times.begin(), times.end());
    return times[times.size() * 999 / 1000] / times[times.size() / 2];
}

void runFilter(benchmark::State& state, const std::string& name, int n, Load load) {
    FilterLoop loop(name, n, load);
    for (auto _ : state) benchmark::DoNotOptimize(loop.step());
    state.counters["n"] = n;
    state.counters["passed"] = loop.passedShare();
    if (n != 6) return;
    constexpr int kReplays = 20;
    const TickTimes times = TickTimes::measure(loop, kTicks, kReplays);
    state.counters["p999_over_median"] = calcTailRatio(times.all);
    state.counters["p999_over_median_own"] = calcTailRatio(times.fastest);
}

bool registerAll() {
    const auto add = [](const std::string& filter, int n, Load load) {
        const std::string name = filter + (load == Load::Free ? "_free" : "_limited") + "/n:" + std::to_string(n);
        benchmark::RegisterBenchmark(name.c_str(), runFilter, filter, n, load);
    };
    for (const Load load : {Load::Free, Load::Limited}) {
        add("certified_braking", 6, load);
        add("tosbp", 6, load);
    }
    for (int n = 1; n <= kMaxJoints; ++n)
        if (n != 6) add("certified_braking", n, Load::Limited);
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
