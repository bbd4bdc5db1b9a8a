#include "viable/filter/CertifiedBrakingFilter.h"

#include "LawBench.h"

namespace viable {
namespace {

/** What counts as rounding beyond a limit: relative to max(1, limit), position in rad. */
constexpr double kAllowed = 1e-12;

Parameters read(const TestArm& arm, const std::string& text) {
    return arm.read(PluginKind::SafetyFilter, "certified_braking", text);
}

std::string findConfigureComplaint(TestArm& arm, const std::string& text) {
    return findComplaint([&] {
        CertifiedBrakingFilter filter;
        filter.configure(arm.setup(), read(arm, text));
    });
}

double getWorst(const LimitExcess& e) {
    return std::max({e.position, e.velocity, e.acceleration, e.jerk});
}

/** The nominal arm under the filter, through its library. */
class FilteredArm {
public:
    FilteredArm(TestArm& arm, const std::string& parameters, const char* name = "certified_braking")
        : arm_(arm),
          filter_(arm.load<SafetyFilter>(PluginKind::SafetyFilter, name, parameters)),
          state(arm.start),
          limits(arm.limits) {
        realizeDynamics();
    }

    SafetyFilter& filter() { return *filter_; }
    const Dynamics& dynamics() const { return dynamics_; }

    FilterStatus decide(const JointVector& torque) { return filter_->filter({state, torque, dynamics_}, decision); }
    /** The decision is carried out; looked at at its quarters. */
    void move() {
        for (int i = 1; i <= 4; ++i) {
            MotionState within = state;
            advanceNominal(decision, arm_.tick_s * i / 4.0, within);
            excess.observe(decision.value, within, limits);
        }
        advanceNominal(decision, arm_.tick_s, state);
        realizeDynamics();
    }
    FilterStatus tick(const JointVector& torque) {
        const FilterStatus status = decide(torque);
        if (status <= FilterStatus::Infeasible) move();
        return status;
    }
    /** A tick with desired accelerations. */
    FilterStatus push(const JointVector& qdd) {
        JointVector torque;
        calcInverseDynamics(dynamics_, qdd, torque);
        return tick(torque);
    }
    /** A tick without a decision: the stops of the last one go on. */
    void miss() {
        for (int i = 0; i < arm_.size(); ++i) decision.value[i] = decision.stops[i].popJerk();
        move();
    }

private:
    void realizeDynamics() { arm_.model().calcDynamics(state.q, state.qd, dynamics_); }

    TestArm& arm_;
    PluginPtr<SafetyFilter> filter_;
    Dynamics dynamics_;

public:
    MotionState state;
    JointLimits limits;  ///< that `excess` refers to
    FilterDecision decision;
    LimitExcess excess;
};

// --- The paper's single joint ---------------------------------------------------------------------

/** The paper's controller (24): towards `target` [rad]. */
JointVector calcPaperTorque(const MotionState& s, double target) {
    return JointVector::Constant(1, 5.0 * (target - s.q[0]) - s.qd[0]);
}

/** Largest jerk, as a share of its limit, in the last 5 of 10 s. */
template <class TorqueOf>
double runTenSeconds(FilteredArm& run, double tick_s, TorqueOf torqueOf) {
    const int ticks = static_cast<int>(std::lround(10.0 / tick_s));
    double jerk = 0.0;
    for (int k = 0; k < ticks; ++k) {
        EXPECT_LE(run.tick(torqueOf(run.state)), FilterStatus::Modified) << "tick " << k;
        if (2 * k >= ticks) jerk = std::max(jerk, std::abs(run.decision.value[0]));
    }
    return jerk / std::min(run.limits.jerk.upper[0], -run.limits.jerk.lower[0]);
}

/** single_joint, or the same with limits that differ by side. */
void setAsymmetric(TestArm& arm) {
    arm.limits.position = {JointVector::Constant(1, -2.0), JointVector::Constant(1, kPi)};
    arm.limits.velocity = {JointVector::Constant(1, -5.0), JointVector::Constant(1, 4.0)};
    arm.limits.acceleration = {JointVector::Constant(1, -7.0), JointVector::Constant(1, 11.0)};
    arm.limits.jerk = {JointVector::Constant(1, -9.0), JointVector::Constant(1, 14.0)};
}

TEST(CertifiedBraking, Figure6RestsOnThePositionLimitWithoutChatter) {
    for (const bool asymmetric : {false, true})
        for (const double tick_s : {1e-4, 1e-3, 4e-3})
            for (const double target : {2.0 * kPi, -2.0 * kPi}) {
                TestArm arm("single_joint", tick_s);
                if (asymmetric) setAsymmetric(arm);
                FilteredArm run(arm, "gamma: 100");
                const double jerk =
                    runTenSeconds(run, tick_s, [&](const MotionState& s) { return calcPaperTorque(s, target); });
                std::printf("  target %.3g, tick %.1g ms: jerk at rest %.2g of J, overshoot %.2g\n", target,
                            tick_s * 1e3, jerk, run.excess.position);
                EXPECT_LT(jerk, 1e-3);
                EXPECT_LT(run.excess.position, 1e-12);
                EXPECT_LE(getWorst(run.excess), kAllowed);
                EXPECT_NEAR(run.state.q[0], target > 0 ? arm.limits.position.upper[0] : arm.limits.position.lower[0],
                            1e-6);
            }
}

TEST(CertifiedBraking, RidesTheVelocityLimitWithoutChatter) {
    for (const bool asymmetric : {false, true})
        for (const double tick_s : {1e-4, 1e-3, 4e-3})
            for (const double push : {100.0, -100.0}) {
                TestArm arm("single_joint", tick_s);
                if (asymmetric) setAsymmetric(arm);
                arm.limits.position = {JointVector::Constant(1, -kInfinity), JointVector::Constant(1, kInfinity)};
                FilteredArm run(arm, "gamma: 100");
                const double jerk =
                    runTenSeconds(run, tick_s, [&](const MotionState&) { return JointVector::Constant(1, push); });
                std::printf("  push %.3g, tick %.1g ms: jerk at V %.2g of J, overshoot %.2g\n", push, tick_s * 1e3,
                            jerk, run.excess.velocity);
                EXPECT_LT(jerk, 1e-3);
                EXPECT_LT(run.excess.velocity, 1e-12);
                EXPECT_NEAR(run.state.qd[0], push > 0 ? arm.limits.velocity.upper[0] : arm.limits.velocity.lower[0],
                            1e-8);
            }
}

/** Root mean square distance to the target of Fig. 5 (2 pi / -2 pi every 2 s, 1 ms). */
double calcFigure5Error(const char* filter, const char* parameters, int seconds) {
    TestArm arm("single_joint");
    FilteredArm run(arm, parameters, filter);
    double sum = 0.0;
    const int ticks = 1000 * seconds;
    for (int k = 0; k < ticks; ++k) {
        const double target = k / 2000 % 2 ? -2.0 * kPi : 2.0 * kPi;
        EXPECT_LE(run.tick(calcPaperTorque(run.state, target)), FilterStatus::Infeasible);
        const double error = run.state.q[0] - target;
        sum += error * error;
    }
    return std::sqrt(sum / ticks);
}

TEST(CertifiedBraking, Figure5TracksNoWorseThanTosbp) {
    for (const int seconds : {8, 20}) {
        const double certified = calcFigure5Error("certified_braking", "gamma: 100", seconds);
        const double tosbp = calcFigure5Error("tosbp", "gamma: 100, k_alpha: 5", seconds);
        std::printf("  RMS distance to the target in %d s: certified %.4f rad, tosbp %.4f rad\n", seconds, certified,
                    tosbp);
        const std::string length = std::to_string(seconds) + "s";
        RecordProperty("certified_rad_" + length, std::to_string(certified));
        RecordProperty("tosbp_rad_" + length, std::to_string(tosbp));
        EXPECT_LE(certified, tosbp) << seconds << " s";
    }
}

// --- What passes, what is modified ----------------------------------------------------------------

TEST(CertifiedBraking, AdmissibleDesiredJerkPassesBitForBit) {
    const unsigned seed = 5;
    SCOPED_TRACE("seed " + std::to_string(seed));
    for (const char* robot : {"single_joint", "indy7"}) {
        TestArm arm(robot);
        CertifiedBrakingFilter filter;
        filter.configure(arm.setup(), read(arm, ""));
        std::mt19937 random(seed);
        for (int k = 0; k < 200; ++k) {
            const MotionState state = makeRandomState(arm, 0.05, 0.1, 0.3, random);
            const Dynamics dynamics = arm.calcDynamics(state);
            JointVector torque, desired;
            calcInverseDynamics(dynamics, state.qdd + makeRandomVector(arm.size(), 0.3, random), torque);
            ASSERT_TRUE(calcForwardDynamics(dynamics, torque, desired));
            FilterDecision decision;
            filter.reset(state);
            ASSERT_EQ(filter.filter({state, torque, dynamics}, decision), FilterStatus::Passed);
            ASSERT_EQ(decision.value, JointVector(-20.0 * (state.qdd - desired)));
            for (int i = 0; i < arm.size(); ++i) ASSERT_EQ(decision.joints[i].limit, LimitKind::None);
        }
    }
}

TEST(CertifiedBraking, HandsOverStopsThatEndAtRestWithinTheLimits) {
    TestArm arm("indy7");
    setPaperLimits(arm);
    FilteredArm run(arm, "");
    PushingCommand push(6, 40.0, true, 8);
    for (int k = 0; k < 10000; ++k) {
        ASSERT_LE(run.push(push.next()), FilterStatus::Modified);
        ASSERT_TRUE(run.decision.hasStops);
        if (k % 50 != 0) continue;
        MotionState s = run.state;
        FilterDecision stop = run.decision;
        LimitExcess excess;
        const auto ends = [&] {
            for (int i = 0; i < 6; ++i)
                if (!stop.stops[i].atRest()) return false;
            return true;
        };
        int ticks = 0;
        for (; !ends() && ticks < 5000; ++ticks) {
            for (int i = 0; i < 6; ++i) stop.value[i] = stop.stops[i].popJerk();
            advanceNominal(stop, arm.tick_s, s);
            excess.observe(stop.value, s, arm.limits);
        }
        ASSERT_LT(ticks, 5000);
        ASSERT_LE(getWorst(excess), kAllowed) << "tick " << k;
        ASSERT_LE(s.qd.lpNorm<Eigen::Infinity>(), 1e-11);
        ASSERT_LE(s.qdd.lpNorm<Eigen::Infinity>(), 1e-11);
    }
    EXPECT_LE(getWorst(run.excess), kAllowed);
}

TEST(CertifiedBraking, AllocatesNothingInAMillionTicks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TestArm arm("indy7");
    setPaperLimits(arm);
    CertifiedBrakingFilter filter;
    arm.configure(filter, PluginKind::SafetyFilter, "certified_braking");
    const Dynamics dynamics = arm.calcDynamics(arm.start);
    PushingCommand push(6, 40.0, false, 7);
    MotionState state = arm.start;
    FilterDecision decision;
    JointVector torque;
    std::int64_t allocations = 0, limited = 0;
    constexpr int kTicks = 1000000;
    for (int k = 0; k < kTicks; ++k) {
        const bool quiet = k / 2000 % 2;  // two seconds each
        const JointVector aim = quiet ? JointVector(-2.0 * (state.q - arm.start.q) - 3.0 * state.qd) : push.next();
        calcInverseDynamics(dynamics, aim, torque);
        const testing::AllocationCounter counter;
        const FilterStatus status = filter.filter({state, torque, dynamics}, decision);
        allocations += counter.count();
        ASSERT_LE(status, FilterStatus::Modified);
        limited += status == FilterStatus::Modified;
        advanceNominal(decision, arm.tick_s, state);
    }
    std::printf("  %lld of %d ticks limited\n", static_cast<long long>(limited), kTicks);
    EXPECT_EQ(allocations, 0);
    EXPECT_GT(limited, 4 * kTicks / 10);
    EXPECT_LT(limited, 8 * kTicks / 10);
}

// --- Parameters -----------------------------------------------------------------------------------

TEST(CertifiedBraking, Fault08GainsThatTheTickCannotCarryAreRefused) {
    TestArm arm("indy7", 0.01);
    expectContains(findConfigureComplaint(arm, "k_alpha: 101"),
                   {"experiment.yaml:1:", "plugin_block.k_alpha", "k_alpha * tick_s is 1.01", "allowed (0, 1]"});
    expectContains(findConfigureComplaint(arm, "gamma: 200"),
                   {"plugin_block.gamma", "gamma * tick_s is 2.0", "below 2 / tick_s"});
    EXPECT_EQ(findConfigureComplaint(arm, "k_alpha: 100, gamma: 199"), "");
    EXPECT_EQ(findConfigureComplaint(arm, "k_alpha: .inf"), "");
    EXPECT_CONTAINS(findConfigureComplaint(arm, "k_alpha: 0"), "k_alpha");
}

TEST(CertifiedBraking, OptionsInCodeAreCheckedInWordsOfTheirOwn) {
    TestArm arm("indy7");
    const auto complain = [&](const CertifiedBrakingOptions& options) {
        return findComplaint([&] { CertifiedBrakingFilter().configure(arm.setup(), options); });
    };
    EXPECT_EQ(complain({}), "");
    for (const double bad : {0.0, -1.0, 1001.0, -kInfinity, kNan})
        expectContains(complain({bad}), {"CertifiedBrakingOptions::kAlpha: k_alpha * tick_s is", "or infinity"});
    for (const double bad : {0.0, -1.0, 2000.0, kInfinity, kNan})
        EXPECT_CONTAINS(complain({kInfinity, bad}), "CertifiedBrakingOptions::gamma: gamma * tick_s is");
    arm.start.q[2] = arm.limits.position.upper[2] + 0.1;
    expectContains(complain({}), {"outside its limits: position",
                                  "Start inside the limits, or set CertifiedBrakingOptions::recovery"});
    EXPECT_EQ(complain({kInfinity, 20.0, true}), "");
    arm.limits.jerk.upper[0] = kInfinity;
    EXPECT_CONTAINS(complain({}), "JointLimits::jerk");
}

TEST(CertifiedBraking, UnlimitedJerkIsRefused) {
    TestArm arm("single_joint");
    FilteredArm run(arm, "");
    JointLimits unlimited = arm.limits;
    unlimited.jerk.upper[0] = kInfinity;
    EXPECT_FALSE(run.filter().changeLimits(unlimited));
    EXPECT_TRUE(run.filter().changeLimits(arm.limits));
    arm.limits.jerk.lower[0] = -kInfinity;
    expectContains(findConfigureComplaint(arm, ""), {"finite jerk limit", "limits.jerk_radps3"});
}

TEST(CertifiedBraking, AFiniteKAlphaSlowsTheApproach) {
    const auto calcWay = [](const char* parameters) {
        TestArm arm("single_joint");
        FilteredArm run(arm, parameters);
        for (int k = 0; k < 1500; ++k) run.push(JointVector::Constant(1, 100.0));
        EXPECT_LE(getWorst(run.excess), kAllowed);
        return run.state.q[0];
    };
    const double slow = calcWay("k_alpha: 2"), fast = calcWay("k_alpha: 1000");
    EXPECT_LT(slow, fast - 0.1);
    EXPECT_EQ(fast, calcWay("k_alpha: .inf"));
}

// --- Starts outside -------------------------------------------------------------------------------

/** Least and largest state of a joint on its way, looked at four times a tick. */
struct Extent {
    AxisState least, largest;

    explicit Extent(const AxisState& s) : least(s), largest(s) {}
    void seeTick(const AxisState& s, double jerk, double tick_s) {
        for (int i = 1; i <= 4; ++i) {
            const AxisState x = advance(s, jerk, tick_s * i / 4.0);
            least = {std::min(least.p, x.p), std::min(least.v, x.v), std::min(least.a, x.a)};
            largest = {std::max(largest.p, x.p), std::max(largest.v, x.v), std::max(largest.a, x.a)};
        }
    }
    void follow(AxisState s, GridStop stop, double tick_s) {
        while (!stop.atRest()) {
            const double jerk = stop.popJerk();
            seeTick(s, jerk, tick_s);
            s = advance(s, jerk, tick_s);
        }
    }
};

AxisState getAxis(const MotionState& s, int i) {
    return {s.q[i], s.qd[i], s.qdd[i]};
}

/** Limits of all joints, moved out to what `extents` reach. */
JointLimits widen(JointLimits limits, const std::vector<Extent>& extents) {
    for (int i = 0; i < limits.size(); ++i) {
        const auto reach = [i](JointBounds& bounds, double least, double largest) {
            bounds.lower[i] = std::min(bounds.lower[i], least);
            bounds.upper[i] = std::max(bounds.upper[i], largest);
        };
        const Extent& e = extents[static_cast<std::size_t>(i)];
        reach(limits.position, e.least.p, e.largest.p);
        reach(limits.velocity, e.least.v, e.largest.v);
        reach(limits.acceleration, e.least.a, e.largest.a);
    }
    return limits;
}

/** How many ticks were Recovering. From the start to there nothing passes a limit farther than the
stop from the start does; from then on all limits hold. */
int expectReturn(TestArm& arm, double push, int ticks) {
    FilteredArm run(arm, "recovery: true");
    EXPECT_TRUE(run.filter().traits().recovers);
    std::vector<Extent> stops;
    for (int i = 0; i < arm.size(); ++i) {
        GridStop stop;
        const AxisState s = getAxis(arm.start, i);
        stop.plan(s.v, s.a, arm.limits.axis(i), arm.tick_s);
        stops.emplace_back(s);
        stops.back().follow(s, stop, arm.tick_s);
    }
    run.limits = widen(arm.limits, stops);
    int recovering = 0;
    bool met = false;
    for (int k = 0; k < ticks; ++k) {
        JointVector torque;
        calcInverseDynamics(run.dynamics(), JointVector::Constant(arm.size(), push), torque);
        const FilterStatus status = run.decide(torque);
        EXPECT_LE(status, FilterStatus::Recovering);
        if (met) {
            EXPECT_NE(status, FilterStatus::Recovering) << "tick " << k << ": again";
        } else if (status == FilterStatus::Recovering) {
            ++recovering;
        } else {
            met = true;
            EXPECT_LE(getWorst(run.excess), kAllowed) << "worse than the stop from the start";
            run.limits = arm.limits;
        }
        run.move();
        if (::testing::Test::HasFailure()) break;
    }
    EXPECT_TRUE(met) << "a limit is still not met";
    EXPECT_LE(getWorst(run.excess), kAllowed);
    return recovering;
}

TEST(Fault12, StartsOutsideAreRefusedByJointSideAndDistance) {
    for (int joint = 0; joint < 6; ++joint)
        for (const double side : {1.0, -1.0})
            for (const double distance : {1e-9, 1e-3, 0.25}) {
                const struct {
                    const char* name;
                    JointVector MotionState::*quantity;
                    JointBounds JointLimits::*bounds;
                    const char* unit;
                } faces[] = {{"position", &MotionState::q, &JointLimits::position, " rad"},
                             {"velocity", &MotionState::qd, &JointLimits::velocity, " rad"},
                             {"acceleration", &MotionState::qdd, &JointLimits::acceleration, " rad/s^2"}};
                for (const auto& face : faces) {
                    TestArm arm("indy7");
                    setPaperLimits(arm);
                    const JointBounds& b = arm.limits.*face.bounds;
                    (arm.start.*face.quantity)[joint] =
                        side > 0 ? b.upper[joint] + distance : b.lower[joint] - distance;
                    const std::string complaint = findConfigureComplaint(arm, "");
                    expectContains(complaint, {"plugin_block", "start of " + arm.robot.joints[joint].name + " ",
                                               "recovery: true", face.unit});
                    // A stop from beyond the velocity limit may also leave the position range,
                    // and that is named first.
                    if (std::string(face.name) != "velocity") {
                        char expected[64];
                        std::snprintf(expected, sizeof expected, "%s_%s by %.3g", face.name,
                                      side > 0 ? "upper" : "lower", distance);
                        EXPECT_CONTAINS(complaint, expected);
                    }
                    EXPECT_EQ(findConfigureComplaint(arm, "recovery: true"), "");
                }
            }
}

TEST(Fault12, WithRecoveryTheArmIsLedBackFromAroundEveryFace) {
    int starts = 0, longest = 0;
    for (const double tick_s : {1e-3, 4e-3})
        for (const double p : {-1.2, -1.001, 0.0, 1.001, 1.2})
            for (const double v : {-1.3, -1.001, 0.0, 1.001, 1.3})
                for (const double a : {-1.4, -1.001, 0.0, 1.001, 1.4})
                    for (const double push : {100.0, -100.0}) {
                        TestArm arm("single_joint", tick_s);
                        setAsymmetric(arm);
                        const auto place = [](const JointBounds& b, double share) {
                            return JointVector::Constant(1, share > 0 ? share * b.upper[0] : -share * b.lower[0]);
                        };
                        arm.start.q = place(arm.limits.position, p);
                        arm.start.qd = place(arm.limits.velocity, v);
                        arm.start.qdd = place(arm.limits.acceleration, a);
                        SCOPED_TRACE("p " + std::to_string(p) + " v " + std::to_string(v) + " a " + std::to_string(a) +
                                     " push " + std::to_string(push) + " tick " + std::to_string(tick_s));
                        longest = std::max(longest, expectReturn(arm, push, std::lround(20.0 / tick_s)));
                        if (HasFailure()) return;
                        ++starts;
                    }
    std::printf("  %d starts, at most %d ticks on the way back\n", starts, longest);
    EXPECT_GT(longest, 0);
}

TEST(Fault12, WithRecoveryAnArmOutsideInAllJointsIsLedBack) {
    TestArm arm("indy7");
    setPaperLimits(arm);
    for (int i = 0; i < 6; ++i) {
        arm.start.q[i] = i % 2 ? arm.limits.position.upper[i] + 0.1 * i : arm.limits.position.lower[i] - 0.1;
        arm.start.qd[i] = i % 3 ? 0.5 : -0.5;
        arm.start.qdd[i] = i < 3 ? 15.0 : -15.0;
    }
    EXPECT_GT(expectReturn(arm, 50.0, 8000), 0);
}

TEST(Fault13, InsideButUnviableStartsAreRefusedByDistance) {
    TestArm arm("indy7");
    setPaperLimits(arm);
    arm.start.q[1] = arm.limits.position.upper[1] - 1e-3;
    arm.start.qd[1] = 0.3;
    arm.start.qdd[1] = -11.0;  // type II with v > 0: it turns inside, but after passing the limit
    const std::string complaint = findConfigureComplaint(arm, "");
    expectContains(complaint, {"start of " + arm.robot.joints[1].name + " is not viable", "position_upper by "});
    // The way to v = 0 at jerk J from a = -11: an own evaluation; 3.2e-3 rad beyond the limit.
    const double J = 12 * kPi, root = std::sqrt(11.0 * 11.0 - 2.0 * J * 0.3), t = (11.0 - root) / J;
    const double beyond = 0.3 * t - 11.0 * t * t / 2 + J * t * t * t / 6 - 1e-3;
    EXPECT_NEAR(beyond, 3.2e-3, 1e-4);
    const double named = std::strtod(complaint.c_str() + complaint.find("position_upper by ") + 18, nullptr);
    EXPECT_NEAR(named, beyond, 0.02 * beyond);
    EXPECT_CONTAINS(complaint, " rad");
    EXPECT_GT(expectReturn(arm, 50.0, 3000), 0);
    arm.start.qd[1] = 0.0;
    arm.start.qdd[1] = 0.0;
    EXPECT_EQ(findConfigureComplaint(arm, ""), "");
}

TEST(Fault38, ConflictingLimitsAtTheStartAreAcceptedWithRecoveryAndNothingGetsWorse) {
    for (const double push : {100.0, -100.0, 0.0})
        for (const double side : {1.0, -1.0}) {
            TestArm arm("single_joint");
            // Acceleration must go down, position up, velocity down.
            arm.start.q[0] = -side * 1.1 * kPi;
            arm.start.qd[0] = side * 2.2 * kPi;
            arm.start.qdd[0] = side * 3.3 * kPi;
            EXPECT_CONTAINS(findConfigureComplaint(arm, ""), "acceleration");
            EXPECT_GT(expectReturn(arm, push, 20000), 0);
        }
}

// --- Bad input ------------------------------------------------------------------------------------

TEST(Fault28, WhatIsNotFiniteOrOfTheWrongSizeIsRefusedAndLeavesNoTrace) {
    LawBench<CertifiedBrakingFilter> bench("indy7", "certified_braking");
    expectNoTraceOfBadInput(bench.arm, [&] { return bench.make(); });
}

TEST(Fault28, ANaNTickIsAMissedTickAndTheNextGoesOn) {
    for (const bool told : {true, false}) {
        TestArm arm("indy7");
        setPaperLimits(arm);
        FilteredArm run(arm, "recovery: true");
        PushingCommand push(6, 40.0, true, 28);
        int missed = 0, recovering = 0, modified = 0;
        for (int k = 0; k < 20000; ++k) {
            const JointVector& aim = push.next();
            if (k % 7 == 3 || k % 500 > 480) {
                JointVector torque = JointVector::Zero(6);
                torque[k % 6] = k % 2 ? kNan : kInfinity;
                ASSERT_EQ(run.decide(torque), FilterStatus::InvalidInput);
                run.miss();
                if (told) run.filter().skipTicks(1);
                ++missed;
                continue;
            }
            const FilterStatus status = run.push(aim);
            ASSERT_LE(status, FilterStatus::Recovering);
            recovering += status == FilterStatus::Recovering;
            modified += status == FilterStatus::Modified;
        }
        std::printf("  %s: %d ticks missed, %d modified, %d recovering, worst %.2g\n", told ? "told" : "not told",
                    missed, modified, recovering, getWorst(run.excess));
        EXPECT_EQ(recovering, 0);
        EXPECT_GT(modified, 5000);
        EXPECT_LE(getWorst(run.excess), kAllowed);
    }
}

TEST(Fault29, HugeTinyAndAlternatingTorquesKeepTheLimits) {
    for (const char* parameters : {"gamma: 1999", "gamma: 20, k_alpha: 5"}) {
        TestArm arm("indy7");
        AbsurdTorques torques(6);
        FilteredArm run(arm, parameters);
        for (int k = 0; k < AbsurdTorques::kTicks; ++k) {
            ASSERT_LE(run.tick(torques.next()), FilterStatus::Modified) << "tick " << k;
            ASSERT_TRUE(isFinite(run.decision.value, 6));
        }
        EXPECT_LE(getWorst(run.excess), kAllowed);
    }
}

TEST(Fault30, SetPointJumpsThroughJointPdKeepTheLimits) {
    for (const char* robot : {"single_joint", "indy7"})
        for (const double jump : {2.0 * kPi, 1e6}) {
            TestArm arm(robot);
            JumpingSetPoint setPoint(arm, jump);
            FilteredArm run(arm, "gamma: 100");
            int modified = 0;
            for (int k = 0; k < 20000; ++k) {
                const FilterStatus status = run.tick(setPoint.next(run.state, run.dynamics()));
                ASSERT_LE(status, FilterStatus::Modified);
                modified += status == FilterStatus::Modified;
            }
            EXPECT_LE(getWorst(run.excess), kAllowed) << robot << ", jump " << jump;
            EXPECT_GT(modified, 1000);
        }
}

TEST(Fault31, AControllerThatPushesIntoTheCornersFindsNoWayThrough) {
    enum { Greedy, Bang, TwoTickBang, kKinds };
    for (const double tick_s : {1e-3, 4e-3})
        for (int kind = Greedy; kind < kKinds; ++kind) {
            TestArm arm("indy7", tick_s);
            setPaperLimits(arm);
            FilteredArm run(arm, "gamma: 400");
            PushingCommand bang(6, 1000.0, true, 31);
            JointVector corner(6);
            int modified = 0;
            for (int k = 0; k < 10000; ++k) {
                for (int i = 0; i < 6; ++i)  // a joint here and there, into its own corner
                    corner[i] = (k / 1500 + i) % 3 ? 1000.0 : -1000.0;
                const JointVector& aim = kind == Bang ? bang.next() : corner;
                const double sign = kind == TwoTickBang && k / 2 % 2 ? -1.0 : 1.0;
                const FilterStatus status = run.push(sign * aim);
                ASSERT_LE(status, FilterStatus::Modified) << "kind " << kind << ", tick " << k;
                modified += status == FilterStatus::Modified;
            }
            EXPECT_LE(getWorst(run.excess), kAllowed) << "kind " << kind << ", tick_s " << tick_s;
            EXPECT_GT(modified, 5000);
        }
}

TEST(Fault34, AnIllConditionedMassMatrixStillGivesACheckedDecision) {
    TestArm arm("indy7");
    setPaperLimits(arm);
    CertifiedBrakingFilter filter;
    filter.configure(arm.setup(), read(arm, ""));
    MotionState state = arm.start;
    LimitExcess excess;
    FilterDecision decision;
    Dynamics dynamics = makeUnitDynamics(6);
    JointVector v = JointVector::LinSpaced(6, 1.0, 2.0).normalized();
    dynamics.M = v * v.transpose() + 1e-12 * JointMatrix::Identity(6, 6);
    PushingCommand push(6, 40.0, true, 34);
    for (int k = 0; k < 5000; ++k) {
        ASSERT_LE(filter.filter({state, push.next(), dynamics}, decision), FilterStatus::Modified);
        advanceNominal(decision, arm.tick_s, state);
        excess.observe(decision.value, state, arm.limits);
    }
    EXPECT_LE(getWorst(excess), kAllowed);
}

TEST(Fault35, AfterAMassMatrixThatIsOfNoUseTheNextTickIsRight) {
    TestArm arm("indy7");
    setPaperLimits(arm);
    const Dynamics good = arm.calcDynamics(arm.start);
    const auto play = [&](const JointMatrix* M, FilterStatus expected) {
        CertifiedBrakingFilter filter;
        arm.configure(filter, PluginKind::SafetyFilter, "certified_braking");
        FilterDecision decision;
        if (M) {
            Dynamics bad = good;
            bad.M = *M;
            EXPECT_EQ(filter.filter({arm.start, good.gravity, bad}, decision), expected);
            EXPECT_EQ(decision.value.size(), 0);
        }
        JointVector torque;
        calcInverseDynamics(good, JointVector::Constant(6, 40.0), torque);
        EXPECT_EQ(filter.filter({arm.start, torque, good}, decision), FilterStatus::Modified);
        return decision.value;
    };
    const JointVector right = play(nullptr, FilterStatus::Passed);
    const JointMatrix zero = JointMatrix::Zero(6, 6), negative = -good.M;
    JointMatrix singular = good.M;
    singular.row(4).setZero();
    singular.col(4).setZero();
    for (const JointMatrix& M : {zero, negative, singular}) EXPECT_EQ(play(&M, FilterStatus::Faulted), right);
    const JointMatrix nan = JointMatrix::Constant(6, 6, kNan);
    EXPECT_EQ(play(&nan, FilterStatus::InvalidInput), right);
}

// --- Limits that change ---------------------------------------------------------------------------

/** New limits while the arm moves: never beyond what the stop of that moment would have reached, and
met after a while. Returns how many ticks were Recovering. */
int expectChange(FilteredArm& run, const TestArm& arm, PushingCommand& push, const JointLimits& limits) {
    std::vector<Extent> stops;
    for (int i = 0; i < arm.size(); ++i) {
        const AxisState s = getAxis(run.state, i);
        stops.emplace_back(s);
        stops.back().follow(s, run.decision.stops[i], arm.tick_s);
    }
    EXPECT_TRUE(run.filter().changeLimits(limits));
    run.limits = widen(limits, stops);
    // A jerk beyond its new limit is the old stop's.
    const JointBounds jerk{limits.jerk.lower.cwiseMin(arm.limits.jerk.lower),
                           limits.jerk.upper.cwiseMax(arm.limits.jerk.upper)};
    run.limits.jerk = jerk;
    int recovering = 0;
    bool met = false;
    for (int k = 0; k < 4000 && !::testing::Test::HasFailure(); ++k) {
        JointVector torque;
        calcInverseDynamics(run.dynamics(), push.next(), torque);
        const FilterStatus status = run.decide(torque);
        EXPECT_LE(status, FilterStatus::Recovering);
        if (status == FilterStatus::Recovering) {
            EXPECT_FALSE(met) << "tick " << k << ": again";
            ++recovering;
        } else if (!met) {
            met = true;
            EXPECT_LE(getWorst(run.excess), kAllowed);
            run.limits = limits;
        }
        run.move();
    }
    EXPECT_TRUE(met) << "a limit is still not met";
    EXPECT_LE(getWorst(run.excess), kAllowed);
    return recovering;
}

TEST(CertifiedBraking, LimitsThatChangeWhileMovingAreMetWithoutEverGettingWorse) {
    const struct {
        const char* name;
        JointBounds JointLimits::*bounds;
        double shrink;
    } kinds[] = {{"position", &JointLimits::position, 0.3},
                 {"velocity", &JointLimits::velocity, 0.3},
                 {"acceleration", &JointLimits::acceleration, 0.3},
                 {"jerk", &JointLimits::jerk, 0.4}};
    for (const auto& kind : kinds) {
        TestArm arm("indy7");
        setPaperLimits(arm);
        FilteredArm run(arm, "gamma: 400");
        PushingCommand push(6, 40.0, true, 3);
        int recovering = 0;
        for (int round = 0; round < 6; ++round) {
            const int ticks = 300 + 137 * round;
            for (int k = 0; k < ticks; ++k) ASSERT_LE(run.push(push.next()), FilterStatus::Modified);
            JointLimits narrow = arm.limits;
            JointBounds& b = narrow.*kind.bounds;
            const JointVector center = 0.5 * (b.lower + b.upper);
            b.lower = center + kind.shrink * (b.lower - center);
            b.upper = center + kind.shrink * (b.upper - center);
            SCOPED_TRACE(std::string(kind.name) + ", round " + std::to_string(round));
            recovering += expectChange(run, arm, push, narrow);
            // Growing asks for nothing: no tick on the way back.
            EXPECT_EQ(expectChange(run, arm, push, arm.limits), 0);
            ASSERT_FALSE(HasFailure());
        }
        std::printf("  %s: %d ticks on the way back in 6 changes\n", kind.name, recovering);
        EXPECT_GT(recovering, 0);
    }
}

// --- The plugin -----------------------------------------------------------------------------------

TEST(CertifiedBraking, ResetGivesTheSameAnswersAgain) {
    TestArm arm("indy7");
    CertifiedBrakingFilter filter;
    filter.configure(arm.setup(), read(arm, ""));
    expectSameAnswersAfterReset(filter, arm);
}

TEST(CertifiedBraking, LoadsAsALibrary) {
    expectSameAsLibrary<CertifiedBrakingFilter>("certified_braking", true);
}

}  // namespace
}  // namespace viable
