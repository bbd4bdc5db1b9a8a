#pragma once

#include <memory>

#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {

/** What came of a limit law in a closed loop with the nominal arm. */
struct LawOutcome {
    LimitExcess excess;
    int ticks = 0, passed = 0, modified = 0, infeasible = 0;
    double firstInfeasible_s = -1.0;  ///< -1: never
    std::int64_t allocations = 0;     ///< in the filter, where they can be counted
    MotionState end;
};

/** A filter class that is linked into the test, with a robot. Change `arm` before make() or run(). */
template <class Filter>
class LawBench {
public:
    /** @param name  the plugin's */
    LawBench(const std::string& robot, const std::string& name, double tick_s = 1e-3)
        : arm(robot, tick_s), name_(name) {}

    TestArm arm;

    /** Configured and reset. */
    std::unique_ptr<Filter> make(const std::string& parameters = "") {
        auto filter = std::make_unique<Filter>();
        filter->configure(arm.setup(), arm.read(PluginKind::SafetyFilter, name_, parameters));
        filter->reset(arm.start);
        return filter;
    }

    /** What configure() complains about; empty when it does not. */
    std::string findConfigureComplaint(const std::string& parameters) {
        return findComplaint([&] { make(parameters); });
    }

    /** Of a law with k_alpha, gamma and needs of the jerk, on a tick of 0.01 s. Changes the limits of `arm`. */
    void expectMisfitsRefused() {
        EXPECT_CONTAINS(findConfigureComplaint("k_alpha: 101"), "k_alpha * tick_s is 1.01");
        EXPECT_CONTAINS(findConfigureComplaint("gamma: 200"), "gamma * tick_s is 2.0");
        arm.limits.jerk.upper[0] = kInfinity;
        EXPECT_CONTAINS(findConfigureComplaint(""), name_ + " needs a finite jerk limit");
    }

    /** One answer of a fresh filter on a joint of unit mass. @param push  desired acceleration */
    FilterStatus decide(const std::string& parameters, const AxisState& s, double push, FilterDecision& decision) {
        const MotionState state{JointVector::Constant(1, s.p), JointVector::Constant(1, s.v),
                                JointVector::Constant(1, s.a)};
        return make(parameters)->filter({state, JointVector::Constant(1, push), makeUnitDynamics(1)}, decision);
    }

    /** From the start. @param wanted  the desired accelerations in a tick; @param check  sees the state before each
    tick and the decision */
    template <class Wanted, class Check>
    LawOutcome run(const std::string& parameters, double duration_s, Wanted wanted, Check check) {
        const std::unique_ptr<Filter> filter = make(parameters);
        MotionState state = arm.start;
        FilterDecision decision;
        Dynamics dynamics = makeUnitDynamics(arm.size());
        JointVector torque;
        LawOutcome outcome;
        outcome.ticks = static_cast<int>(std::lround(duration_s / arm.tick_s));
        for (int k = 0; k < outcome.ticks; ++k) {
            if (arm.size() > 1) arm.model().calcDynamics(state.q, state.qd, dynamics);
            calcInverseDynamics(dynamics, wanted(state), torque);
            const testing::AllocationCounter counter;
            const FilterStatus status = filter->filter({state, torque, dynamics}, decision);
            outcome.allocations += counter.count();
            EXPECT_LE(status, FilterStatus::Infeasible) << "tick " << k;
            EXPECT_TRUE(isFinite(decision.value, arm.size())) << "tick " << k;
            if (::testing::Test::HasFailure()) break;
            outcome.passed += status == FilterStatus::Passed;
            outcome.modified += status == FilterStatus::Modified;
            if (status == FilterStatus::Infeasible && outcome.infeasible++ == 0)
                outcome.firstInfeasible_s = k * arm.tick_s;
            check(state, decision, *filter);
            const JointVector jerk = calcJerk(decision, state.qdd, arm.tick_s);
            advanceNominal(decision, arm.tick_s, state);
            outcome.excess.observe(jerk, state, arm.limits);
        }
        outcome.end = state;
        return outcome;
    }
    template <class Wanted>
    LawOutcome run(const std::string& parameters, double duration_s, Wanted wanted) {
        return run(parameters, duration_s, wanted, [](const MotionState&, const FilterDecision&, const Filter&) {});
    }
    /** Pushed about (see PushingCommand). */
    LawOutcome push(const std::string& parameters, double duration_s, double size, bool bangBang, unsigned seed) {
        PushingCommand command(arm.size(), size, bangBang, seed);
        return run(parameters, duration_s, [&](const MotionState&) { return command.next(); });
    }
    /** The paper's (24) with (26): qdd_d = 5 (q_d - q) - qd, one joint. @param target  q_d at a time */
    template <class Target, class Check>
    LawOutcome follow(const std::string& parameters, double duration_s, Target target, Check check) {
        int k = 0;
        return run(
            parameters, duration_s,
            [&](const MotionState& s) {
                return JointVector(5.0 * (JointVector::Constant(1, target(k++ * arm.tick_s)) - s.q) - s.qd);
            },
            check);
    }

    /** The limits of the teleoperation experiment (30), for the robot indy7. */
    void setPapersArmLimits() {
        const auto both = [](const JointVector& size) { return JointBounds{-size, size}; };
        arm.limits.velocity = both(JointVector::Constant(6, 2 * kPi / 3));
        arm.limits.acceleration = both(JointVector::Constant(6, 4 * kPi));
        arm.limits.jerk = both(JointVector::Constant(6, 12 * kPi));
        JointVector range(6);
        range << kPi / 6, kPi / 12, kPi / 6, kPi / 12, kPi / 6, kPi / 3;
        arm.limits.position = {arm.robot.home - range, arm.robot.home + range};
    }

    /** Limits of a single joint such as a run accepts, each side its own; braking reaches the acceleration limit or does
    not. */
    void drawLimits(std::mt19937& random) {
        const auto draw = [&](double low, double high) {  // evenly in the logarithm
            return std::exp(std::uniform_real_distribution<double>(std::log(low), std::log(high))(random));
        };
        do {
            const double A = draw(1.0, 30.0), J = draw(10.0, 1000.0), V = draw(0.1, 4.0) * A * A / J;
            const auto set = [&](JointBounds& bounds, double size) {
                bounds.upper[0] = size * draw(0.5, 1.0);
                bounds.lower[0] = -size * draw(0.5, 1.0);
            };
            set(arm.limits.acceleration, A);
            set(arm.limits.jerk, J);
            set(arm.limits.velocity, V);
            set(arm.limits.position, (V * V / A + V * A / J) * draw(0.5, 4.0));
        } while (!areUsable(arm.limits, 1, arm.tick_s));
    }

private:
    std::string name_;
};

/** A single joint under 200 sets of limits drawn at random, pushed about: jerk and acceleration hold, and nothing is
allocated. Returns the number of ticks without an admissible answer.
@param parameters  gives those of the filter for the bench's limits; @param holdsAcceleration  false: it need not hold */
template <class Filter, class MakeParameters>
long expectRatesHeldUnderRandomLimits(const std::string& name, unsigned seed, const MakeParameters& parameters,
                                      bool holdsAcceleration = true) {
    LawBench<Filter> bench("single_joint", name);
    std::mt19937 random(seed);
    LimitExcess worst;
    long ticks = 0, infeasible = 0;
    for (unsigned k = 0; k < 200 && !::testing::Test::HasFailure(); ++k) {
        bench.drawLimits(random);
        const double size = 3.0 * bench.arm.limits.acceleration.upper[0];
        const LawOutcome outcome = bench.push(parameters(bench.arm.limits), 20.0, size, k % 2 == 0, k);
        SCOPED_TRACE("limits " + std::to_string(k));
        EXPECT_LE(outcome.excess.jerk, 1e-9);
        if (holdsAcceleration) {
            EXPECT_LE(outcome.excess.acceleration, 1e-9);
        }
        EXPECT_EQ(outcome.allocations, 0);
        worst.position = std::max(worst.position, outcome.excess.position);
        worst.velocity = std::max(worst.velocity, outcome.excess.velocity);
        worst.acceleration = std::max(worst.acceleration, outcome.excess.acceleration);
        ticks += outcome.ticks;
        infeasible += outcome.infeasible;
    }
    std::printf(
        "  worst excess: %.2g rad, %.2g of the velocity, %.2g of the acceleration limit; %.2g %% of the ticks "
        "infeasible\n",
        worst.position, worst.velocity, worst.acceleration, 100.0 * infeasible / ticks);
    return infeasible;
}

/** The same for an Indy7 with the paper's limits, once. */
template <class Filter>
void expectRatesHeldOnTheArm(const std::string& name, const std::string& parameters) {
    LawBench<Filter> bench("indy7", name);
    bench.setPapersArmLimits();
    const LawOutcome outcome = bench.push(parameters, 10.0, 40.0, true, 8);
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
    EXPECT_EQ(outcome.allocations, 0);
    std::printf("  arm: %.2g rad, %.2g of the velocity limit; %d of %d ticks infeasible\n", outcome.excess.position,
                outcome.excess.velocity, outcome.infeasible, outcome.ticks);
}

/** The library's own object gives the same answers as the class linked into the test. */
template <class Filter>
void expectSameAsLibrary(const std::string& name) {
    TestArm arm("indy7");
    const auto plugin = PluginLoader::create<SafetyFilter>(findPlugin(PluginKind::SafetyFilter, name));
    EXPECT_TRUE(plugin->traits().guarantees.isEmpty());
    Filter own;
    FilterDecision decisions[2];
    FilterStatus statuses[2];
    const Dynamics dynamics = arm.calcDynamics(arm.start);
    int k = 0;
    for (SafetyFilter* filter : {plugin.get(), static_cast<SafetyFilter*>(&own)}) {
        filter->configure(arm.setup(), arm.read(PluginKind::SafetyFilter, name, ""));
        filter->reset(arm.start);
        statuses[k] = filter->filter({arm.start, JointVector::LinSpaced(6, 5.0, 50.0), dynamics}, decisions[k]);
        ++k;
    }
    EXPECT_EQ(statuses[0], statuses[1]);
    EXPECT_EQ(decisions[0].held, decisions[1].held);
    EXPECT_EQ(decisions[0].value, decisions[1].value);
}

}  // namespace viable
