#pragma once

#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {

/** What came of a limit law in a closed loop with the nominal arm. */
struct LawOutcome {
    LimitExcess excess;
    int ticks = 0, passed = 0, modified = 0, infeasible = 0, holdingJerk = 0;
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
        arm.configure(*filter, PluginKind::SafetyFilter, name_, parameters);
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

    /** From the start. @param torqueOf  the desired torque in a tick, of state and dynamics; @param check  sees the state
    before each tick and the decision */
    template <class TorqueOf, class Check>
    LawOutcome drive(const std::string& parameters, double duration_s, TorqueOf torqueOf, Check check) {
        const std::unique_ptr<Filter> filter = make(parameters);
        MotionState state = arm.start;
        FilterDecision decision;
        Dynamics dynamics = makeUnitDynamics(arm.size());
        LawOutcome outcome;
        outcome.ticks = static_cast<int>(std::lround(duration_s / arm.tick_s));
        for (int k = 0; k < outcome.ticks; ++k) {
            if (arm.size() > 1) arm.model().calcDynamics(state.q, state.qd, dynamics);
            const JointVector torque = torqueOf(state, dynamics);
            const testing::AllocationCounter counter;
            const FilterStatus status = filter->filter({state, torque, dynamics}, decision);
            outcome.allocations += counter.count();
            EXPECT_LE(status, FilterStatus::Infeasible) << "tick " << k;
            EXPECT_TRUE(isFinite(decision.value, arm.size())) << "tick " << k;
            if (::testing::Test::HasFailure()) break;
            outcome.passed += status == FilterStatus::Passed;
            outcome.modified += status == FilterStatus::Modified;
            outcome.holdingJerk += decision.held == HeldQuantity::Jerk;
            if (status == FilterStatus::Infeasible && outcome.infeasible++ == 0)
                outcome.firstInfeasible_s = k * arm.tick_s;
            check(state, decision, *filter);
            const JointVector jerk = calcJerk(decision, state.qdd, arm.tick_s);
            if (status == FilterStatus::Infeasible && decision.held == HeldQuantity::Jerk) {  // braking, in its limits
                EXPECT_TRUE((jerk.array() >= arm.limits.jerk.lower.array()).all()) << "tick " << k;
                EXPECT_TRUE((jerk.array() <= arm.limits.jerk.upper.array()).all()) << "tick " << k;
            }
            advanceNominal(decision, arm.tick_s, state);
            outcome.excess.observe(jerk, state, arm.limits);
        }
        outcome.end = state;
        return outcome;
    }
    template <class TorqueOf>
    LawOutcome drive(const std::string& parameters, double duration_s, TorqueOf torqueOf) {
        return drive(parameters, duration_s, torqueOf, [](const MotionState&, const FilterDecision&, const Filter&) {});
    }
    /** The same. @param wanted  the desired accelerations in a tick */
    template <class Wanted, class... Check>
    LawOutcome run(const std::string& parameters, double duration_s, Wanted wanted, Check... check) {
        JointVector torque;
        const auto torqueOf = [&](const MotionState& state, const Dynamics& dynamics) {
            calcInverseDynamics(dynamics, wanted(state), torque);
            return torque;
        };
        return drive(parameters, duration_s, torqueOf, check...);
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
        const LawOutcome outcome =
            bench.push(parameters(bench.arm.limits), 20.0, 3.0 * bench.arm.limits.acceleration.upper[0], k % 2 == 0, k);
        SCOPED_TRACE("limits " + std::to_string(k));
        EXPECT_LE(outcome.excess.jerk, 1e-9);
        if (holdsAcceleration) EXPECT_LE(outcome.excess.acceleration, 1e-9);
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
    setPaperLimits(bench.arm);
    const LawOutcome outcome = bench.push(parameters, 10.0, 40.0, true, 8);
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
    EXPECT_EQ(outcome.allocations, 0);
    std::printf("  arm: %.2g rad, %.2g of the velocity limit; %d of %d ticks infeasible\n", outcome.excess.position,
                outcome.excess.velocity, outcome.infeasible, outcome.ticks);
}

/** The library's own object gives the same answers as the class linked into the test.
@param guarantees  whether the limits of the joints; other guarantees it makes none */
template <class Filter>
void expectSameAsLibrary(const std::string& name, bool guarantees = false) {
    TestArm arm("indy7");
    const auto plugin = arm.load<SafetyFilter>(PluginKind::SafetyFilter, name);
    Filter own;
    arm.configure(own, PluginKind::SafetyFilter, name);
    FilterDecision decisions[2];
    FilterStatus statuses[2];
    const Dynamics dynamics = arm.calcDynamics(arm.start);
    int k = 0;
    for (SafetyFilter* filter : {plugin.get(), static_cast<SafetyFilter*>(&own)}) {
        EXPECT_EQ(filter->traits().guarantees.hasJoints(), guarantees);
        EXPECT_EQ(filter->traits().guarantees.isEmpty(), !guarantees);
        EXPECT_FALSE(filter->traits().recovers);
        statuses[k] = filter->filter({arm.start, JointVector::LinSpaced(6, 5.0, 50.0), dynamics}, decisions[k]);
        ++k;
    }
    EXPECT_EQ(statuses[0], statuses[1]);
    EXPECT_EQ(decisions[0].held, decisions[1].held);
    EXPECT_EQ(decisions[0].value, decisions[1].value);
}

}  // namespace viable
