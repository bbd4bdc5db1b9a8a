#include <nlohmann/json.hpp>

#include "CaseSupport.h"
#include "records/LogReader.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** The arm without any loss, so that it follows the nominal one to some 1e-6 rad. */
const std::vector<std::string> kIdeal = {"filter={plugin: certified_braking}", "real_plant={plugin: pushed}"};

std::vector<std::string> idealWith(std::vector<std::string> overrides) {
    overrides.insert(overrides.begin(), kIdeal.begin(), kIdeal.end());
    return overrides;
}

TrackingBound makeBound(int n, double size) {
    TrackingBound bound;
    bound.position = bound.measured = JointVector::Constant(n, size);
    bound.velocity = JointVector::Constant(n, 100.0 * size);
    bound.lastingTorque = JointVector::Zero(n);
    bound.motorTorque = JointVector::Ones(n);
    return bound;
}

/** An experiment whose first case may have a bound that is stated, not computed. */
struct BoundedCase {
    BoundedCase(Experiment read, std::optional<TrackingBound> stated = {})
        : experiment(std::move(read)), bound(std::move(stated)) {}
    CasePlan& plan() { return experiment.cases.front(); }
    std::unique_ptr<ConfiguredCase> configure() const {
        auto configured = configureCase(experiment.cases.front());
        configured->bound = bound;
        return configured;
    }

    Experiment experiment;
    std::optional<TrackingBound> bound;
};

BoundedCase readBounded(const std::vector<std::string>& overrides, double size) {
    Experiment e = readTestExperiment(kTeleoperation, overrides);
    const int n = e.cases.front().robot.size();
    return {std::move(e), makeBound(n, size)};
}

/** Nric, listened to. */
class HeardLoop : public RobustLoop {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override { nric_.configure(setup, parameters); }
    void reset(const MotionState& start) override {
        nric_.reset(start);
        holds = 0;
    }
    TickStatus compute(const JointState& measured, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override {
        real = measured;
        given = filterTorque;
        return nric_.compute(measured, nominal, filterTorque, torque);
    }
    void holdIntegral() override {
        ++holds;
        nric_.holdIntegral();
    }

    int holds = 0;
    JointState real;    ///< of the last tick
    JointVector given;  ///< likewise [Nm]

private:
    Nric nric_;
};

/** The first case's loop, its robust loop listened to. */
struct HeardCase {
    explicit HeardCase(BoundedCase read, bool judgesReadings = true)
        : bounded(std::move(read)), configured(bounded.configure()) {
        heard.configure(configured->setup, plan().robustLoop->parameters);
        configured->plugins.robustLoop = PluginPtr<RobustLoop>(&heard, [](void*) {});
        loop = std::make_unique<ControlLoop>(configured->setup, std::move(configured->plugins),
                                             RealArmOptions{configured->bound ? &*configured->bound : nullptr,
                                                            plan().feedsExternalTorque, judgesReadings});
    }
    const CasePlan& plan() const { return configured->plan; }

    HeardLoop heard;  // destroyed last
    BoundedCase bounded;
    std::unique_ptr<ConfiguredCase> configured;
    std::unique_ptr<ControlLoop> loop;
};

TEST(Trip, InTheTickInWhichAReadingIsBeyondItsBoundAndOnlyThen) {
    for (const double bound : {0.0101, 0.0099}) {
        HeardCase c(readBounded(
            idealWith({"real_plant.offset_rad=[0, 0, 0.01, 0, 0.005, 0]", "real_plant.offset_at_s=0.7"}), bound));
        const bool trips = bound < 0.01;
        const JointBounds& limits = c.plan().limits.position;
        TickRecord record;
        int stopTicks = 0;
        for (int k = 0; k < 2000 && !c.loop->hasStopped(); ++k) {
            c.loop->tick(record);
            const double error = (record.real.q - record.nominal.q).cwiseAbs().maxCoeff();
            ASSERT_EQ(record.braking, trips && k >= 700) << k << ", " << error;
            if (k <= 700) ASSERT_EQ(error > bound, trips && k == 700);
            stopTicks += record.braking;
            for (int i = 0; i < 6; ++i) {
                ASSERT_GE(record.nominal.q[i], limits.lower[i] - 1e-9);
                ASSERT_LE(record.nominal.q[i], limits.upper[i] + 1e-9);
            }
        }
        EXPECT_EQ(c.heard.holds, trips ? 1 : 0);
        EXPECT_EQ(c.loop->stopReason(), trips ? StopReason::TrackingLost : StopReason::None);
        if (!trips) continue;
        EXPECT_GT(stopTicks, 10);
        EXPECT_NEAR(c.loop->stopTime(), 0.7, 1e-12);
        expectContains(c.loop->stopMessage(),
                       {"joint2 was measured 0.01 rad from its nominal place, beyond its bound of 0.0099 rad",
                        "has left the stated disturbance set"});
        expectContains(c.loop->stopRemedy(), {"`disturbance_set`"});
        c.loop->reset();
        EXPECT_FALSE(c.loop->isStopping());
        c.loop->tick(record);
        EXPECT_FALSE(record.braking);
    }
}

TEST(Trip, AlsoInAMissedTickAndOverARequestedStop) {
    const BoundedCase e = readBounded(idealWith({"real_plant.offset_rad=0.01", "real_plant.offset_at_s=0.5"}), 0.005);
    TickRecord record;
    HeardCase missed(e);
    for (int k = 0; k < 500; ++k) missed.loop->tick(record);
    missed.loop->missTick(record);
    EXPECT_EQ(missed.loop->stopReason(), StopReason::TrackingLost);
    EXPECT_TRUE(record.braking);
    HeardCase requested(e);
    for (int k = 0; k < 499; ++k) requested.loop->tick(record);
    requested.loop->requestStop(StopReason::Requested, "test");
    for (int k = 0; k < 3; ++k) requested.loop->tick(record);
    EXPECT_EQ(requested.loop->stopReason(), StopReason::TrackingLost);
    EXPECT_EQ(requested.heard.holds, 1);
}

TEST(Trip, WithoutABoundThereIsNone) {
    HeardCase c(
        readTestExperiment(kTeleoperation, idealWith({"real_plant.offset_rad=0.01", "real_plant.offset_at_s=0.5"})));
    TickRecord record;
    for (int k = 0; k < 1000; ++k) c.loop->tick(record);
    EXPECT_EQ(c.loop->stopReason(), StopReason::None);
    EXPECT_EQ(c.heard.holds, 0);
}

// Fault16: 12 kg at the tool, where the robust loop is given too little torque to carry them.
TEST(Fault16, ATripEndsTheRunWith6AndTellsWhatBecameOfTheRealArm) {
    const BoundedCase e = readBounded(
        {"filter={plugin: certified_braking}", "robust_loop={plugin: nric, k_r: 20}", "real_plant.payload_kg=12"},
        0.02);
    const TemporaryFolder folder;
    RunOptions options;
    options.log = folder.path() / "A.mcap";
    const CaseResult result = runCase(e.configure(), options);
    EXPECT_EQ(result.stopReason, StopReason::TrackingLost);
    EXPECT_EQ(result.exitCode(), 6);
    ASSERT_TRUE(result.summary.trip());
    const TrackingTrip trip = *result.summary.trip();
    EXPECT_EQ(trip.time_s, result.stopTime_s);
    EXPECT_GT(trip.error, 0.02);
    EXPECT_LT(trip.error, 0.03);
    EXPECT_FALSE(result.summary.anyLimitBroken());
    expectContains(formatDetails(result),
                   {"tracking lost, the arm was stopped; all limits kept (nominal arm", "  tripped       at 0.",
                    " rad from its nominal place, bound 0.02 rad; ", "STOPPED       stopped at 0.", " because joint",
                    "bound used    position / velocity per joint [%]", "real arm      position: worst use ",
                    "\n                velocity: worst use ", "motors        largest share of the torque limit"});

    const nlohmann::json json = nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0];
    EXPECT_EQ(json["tripped"], true);
    EXPECT_EQ(json["trip"]["joint"], result.summary.jointNames()[static_cast<std::size_t>(trip.joint)]);
    EXPECT_EQ(json["trip"]["time_s"], trip.time_s);
    EXPECT_EQ(json["trip"]["error_rad"], trip.error);
    EXPECT_EQ(json["trip"]["bound_rad"], 0.02);
    EXPECT_EQ(json["exit_code"], 6);
    EXPECT_GT(json["bound"]["worst_share"], 1.0);
    EXPECT_EQ(json["bound"]["joints"]["joint0"]["velocity_radps"], 2.0);
    EXPECT_GT(json["motors"]["joint1"]["worst_use"], 0.05);

    // The stop to its end, half a second more, and the same from the log.
    LogReader reader(options.log);
    EXPECT_EQ(nlohmann::json::parse(reader.metadata().at("tracking_bound"))["measured_rad"],
              std::vector<double>(6, 0.02));
    EXPECT_EQ(reader.metadata().count("real_limits"), 0u);
    Summary again(result.summary.jointNames(), e.experiment.cases[0].limits, true, result.summary.reference());
    TickRecord record;
    double firstBraking_s = -1.0, rest_s = -1.0;
    while (reader.read(record)) {
        again.add(record);
        if (record.braking && firstBraking_s < 0.0) firstBraking_s = record.time_s;
        if (record.nominal.qd.norm() > 1e-9) rest_s = record.time_s;
    }
    EXPECT_EQ(firstBraking_s, trip.time_s);
    EXPECT_NEAR(record.time_s - rest_s, RunningCase::kSettling_s, 2e-3);
    ASSERT_TRUE(again.trip());
    EXPECT_EQ(again.trip()->time_s, trip.time_s);
    EXPECT_EQ(again.trip()->joint, trip.joint);
}

TEST(Trip, TheGravestExitCodeCounts) {
    const int order[] = {3, 6, 4, 5, 0};
    for (int i = 0; i < 5; ++i)
        for (int k = 0; k < 5; ++k) EXPECT_EQ(isGraver(order[i], order[k]), i < k);
}

TEST(RealGuarantee, APassedLimitOfTheRealArmWithoutATripEndsTheRunWith3) {
    for (const double widening : {0.05, -0.05}) {
        BoundedCase e = readBounded(idealWith({}), 0.01);
        auto configured = e.configure();
        CasePlan& plan = e.plan();  // from here on its limits are those of the real arm
        plan.holdsOnReal = true;
        for (JointBounds* bounds : {&plan.limits.position, &plan.limits.velocity}) {
            bounds->lower.array() -= widening;
            bounds->upper.array() += widening;
        }
        plan.limits.velocity.upper[5] = INFINITY;
        const TemporaryFolder folder;
        RunOptions options;
        options.log = folder.path() / "A.mcap";
        const CaseResult result = runCase(std::move(configured), options);
        EXPECT_EQ(result.stopReason, StopReason::None) << result.stopMessage;
        const bool breaks = widening < 0.0;
        EXPECT_EQ(result.isRealGuaranteeBroken(), breaks);
        EXPECT_EQ(result.exitCode(), breaks ? 3 : 0);
        const std::string verdict = formatVerdict(result);
        if (breaks)
            expectContains(verdict, {"guarantee on the real arm broken; all limits kept (nominal arm",
                                     "; the real arm exceeded its limits: position by 0."});
        else
            expectContains(verdict, {"; the real arm kept its position and velocity limits (guaranteed"});
        expectContains(verdict, {"of its acceleration and jerk nothing is)"});
        const nlohmann::json json = nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0];
        EXPECT_EQ(json["holds_on_real"], true);
        EXPECT_EQ(json["tripped"], false);
        EXPECT_TRUE(json["trip"].is_null());
        std::int64_t outside = 0;
        for (const auto& joint : json["real_limits"]["position"]) outside += joint["ticks_outside"].get<std::int64_t>();
        EXPECT_EQ(outside > 0, breaks);
        const nlohmann::json metadata = nlohmann::json::parse(LogReader(options.log).metadata().at("real_limits"));
        EXPECT_EQ(metadata["position_lower"][0], plan.limits.position.lower[0]);
        EXPECT_EQ(metadata["velocity_upper"][5], ".inf");
        EXPECT_EQ(metadata["velocity_lower"][5], plan.limits.velocity.lower[5]);

        CaseResult other = result;  // a filter that guarantees nothing breaks no guarantee
        other.guarantees = {};
        EXPECT_EQ(other.exitCode(), 0);
        expectContains(formatVerdict(other), {"of which the filter guarantees nothing"});
    }
}

TEST(RealArm, VelocityAndMotorsAreMeasuredInTheSummary) {
    RealArmReference reference;
    reference.torqueLimit = JointVector::Constant(1, 40.0);
    JointLimits limits = JointLimits::unlimited(1);
    limits.velocity = {JointVector::Constant(1, -2.0), JointVector::Constant(1, 2.0)};
    Summary s({"a"}, limits, true, reference);
    TickRecord r;
    r.limits = limits;
    r.nominal = {JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1)};
    r.real = r.actual = {JointVector::Zero(1), JointVector::Zero(1)};
    r.removedTorque = r.filterTorque = r.robustTorque = JointVector::Zero(1);
    for (const double torque : {10.0, -40.0, 40.0, 39.9}) {
        r.motorTorque.setConstant(1, torque);
        r.actual.qd.setConstant(1, 0.06 * torque);
        s.add(r);
        r.time_s += 0.001;
    }
    EXPECT_EQ(s.motor(0).ticksSaturated, 2);
    EXPECT_EQ(s.motor(0).worstUse, 1.0);
    EXPECT_EQ(s.motor(0).worstTime_s, 0.001);
    const LimitRecord& velocity = s.realLimit(LimitKind::Velocity)[0];
    EXPECT_EQ(velocity.ticksOutside, 3);
    EXPECT_NEAR(velocity.worstExcess, 0.4, 1e-12);
    EXPECT_NEAR(velocity.worstUse, 1.2, 1e-12);
    EXPECT_TRUE(s.anyRealLimitBroken());
    EXPECT_FALSE(s.anyLimitBroken());
}

/** Ticks in which a motor of 40 Nm counts as saturated: `asked` arrives `delay` ticks later, cut to `limit`. */
std::int64_t countSaturated(const std::vector<double>& asked, double limit, std::size_t delay) {
    RealArmReference reference;
    reference.torqueLimit = JointVector::Constant(1, 40.0);
    Summary s({"a"}, JointLimits::unlimited(1), true, reference);
    TickRecord r;
    r.limits = JointLimits::unlimited(1);
    r.nominal = {JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1)};
    r.real = r.actual = {JointVector::Zero(1), JointVector::Zero(1)};
    r.removedTorque.setZero(1);
    r.externalTorque = JointVector::Constant(1, 3.0);
    r.filterTorque = JointVector::Constant(1, 1.5);
    for (std::size_t k = 0; k < asked.size(); ++k) {
        r.robustTorque = JointVector::Constant(1, asked[k] - 1.5 + 3.0);
        const double arriving = asked[k < delay ? 0 : k - delay];
        r.motorTorque = JointVector::Constant(1, std::max(-limit, std::min(arriving, limit)));
        s.add(r);
        r.time_s += 0.001;
    }
    return s.motor(0).ticksSaturated;
}

TEST(RealArm, AMotorThatIsWeakerThanItsFigureCountsAsSaturatedToo) {
    const std::vector<double> asked = {0, 1, 5, 9, 6, 2, -3, -7, -4, -1, 0, 0};
    for (const std::size_t delay : {0, 2}) {
        EXPECT_EQ(countSaturated(asked, 2.0, delay), 7);  // 5 9 6 2, -3 -7 -4
        EXPECT_EQ(countSaturated(asked, 6.5, delay), 2);  // 9, -7
        EXPECT_EQ(countSaturated(asked, 9.5, delay), 0);
    }
    EXPECT_EQ(countSaturated({0, 1, 39, 39, 10}, 40.0, 1), 0);
    EXPECT_EQ(countSaturated({0, 1, 40, 41, 10}, 40.0, 0), 2);
    EXPECT_EQ(countSaturated({0, 1, 2}, 0.0, 0), 3);
}

TEST(RealGuarantee, ALimitThatWasPassedBeforeATripIsNotForgotten) {
    for (const double beyond_s : {0.002, 0.005}) {
        RealArmReference reference;
        reference.limits = JointLimits::unlimited(1);
        reference.limits->position = {JointVector::Constant(1, -1.0), JointVector::Constant(1, 1.0)};
        reference.bound = makeBound(1, 0.1);
        Summary s({"a"}, JointLimits::unlimited(1), true, reference);
        TickRecord r;
        r.limits = JointLimits::unlimited(1);
        r.nominal = {JointVector::Ones(1), JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1)};
        r.removedTorque.setZero(1);
        for (int k = 0; k < 10; ++k, r.time_s = 0.001 * k) {
            r.real = {JointVector::Constant(1, k < 5 ? 1.0 : 1.2), JointVector::Zero(1)};
            r.actual = {JointVector::Constant(1, k < 1e3 * beyond_s - 0.5 ? 1.0 : 1.01), JointVector::Zero(1)};
            s.add(r);
        }
        ASSERT_TRUE(s.trip());
        EXPECT_NEAR(s.trip()->time_s, 0.005, 1e-12);
        const bool isBroken = beyond_s < 0.005;
        EXPECT_EQ(s.anyRealLimitBroken(), isBroken);
        CaseResult result = makeResult(*readBounded(idealWith({}), 0.1).configure());
        result.holdsOnReal = true;
        result.guarantees = LimitSet::joints();
        result.stopReason = StopReason::TrackingLost;
        result.summary = s;
        EXPECT_EQ(result.isRealGuaranteeBroken(), isBroken);
        EXPECT_EQ(result.exitCode(), isBroken ? 3 : 6);
    }
}

// Noise within the disturbance set, and any up to a thousandth of a turn without one, is no jump.
TEST(RealArm, AReadingWithinTheStatedErrorIsNoJump) {
    const std::vector<std::string> slow =
        idealWith({"limits.velocity_radps=0.005", "real_plant.offset_rad=0.002", "real_plant.offset_at_s=0.7"});
    const auto run = [](BoundedCase e) {
        HeardCase c(std::move(e));
        TickRecord record;
        for (int k = 0; k < 720; ++k) c.loop->tick(record);
        return c.loop->stopReason();
    };
    EXPECT_EQ(run(readTestExperiment(kTeleoperation, slow)), StopReason::None);
    std::vector<std::string> larger = slow;
    larger.push_back("real_plant.offset_rad=3.0");
    EXPECT_EQ(run(readTestExperiment(kTeleoperation, larger)), StopReason::SensorFailed);
    for (const double readingError : {0.0009, 0.0011}) {
        BoundedCase e = readBounded(slow, 0.01);
        e.bound->velocity.setZero();
        e.bound->position.array() -= readingError;
        EXPECT_EQ(run(e), readingError < 0.001 ? StopReason::SensorFailed : StopReason::None);
    }
    // A bound on the velocity that no limit knows: 4 rad/s for a tick.
    BoundedCase e = readBounded(slow, 0.01);
    e.bound->velocity.setConstant(4.0);
    EXPECT_EQ(run(e), StopReason::None);
}

TEST(Trip, OfANominalArmBeyondItsLimitsDoesNotBlameTheDisturbances) {
    BoundedCase e =
        readBounded({"filter={plugin: pass_through}", "real_plant={plugin: pushed}", "limits.velocity_radps=0.005",
                     "real_plant.offset_rad=0.02", "real_plant.offset_at_s=1.5"},
                    0.01);
    e.bound->velocity.setConstant(100.0);
    const CaseResult result = runCase(e.configure(), {});
    EXPECT_EQ(result.exitCode(), 6);
    EXPECT_TRUE(result.summary.anyLimitBroken());
    expectContains(result.stopMessage, {"from its nominal place, beyond its bound of 0.01 rad: the nominal arm had "
                                        "left the limits that the bound is for, first at 0."});
    EXPECT_EQ(result.stopMessage.find("disturbance set"), std::string::npos) << result.stopMessage;
    expectContains(result.stopRemedy, {"certified_braking"});
}

// One-sample spike, wrap and swap all begin with a jump: nothing of it reaches the motors.
TEST(Fault23, AnEncoderWrapBrakesTheArmAndBecomesNoTorque) {
    const Experiment e = readTestExperiment(
        kTeleoperation, idealWith({"real_plant.offset_rad=[0, 2*pi, 0, 0, 0, 0]", "real_plant.offset_at_s=0.7"}));
    HeardCase c(e);
    TickRecord record;
    double before = 0.0, largest = 0.0;
    for (int k = 0; k < 5000 && !c.loop->hasStopped(); ++k) {
        c.loop->tick(record);
        ASSERT_EQ(record.braking, k >= 700);
        largest = std::max(largest, record.robustTorque.cwiseAbs().maxCoeff());
        if (k == 699) before = largest;
    }
    EXPECT_LT(largest, before + 1.0);
    EXPECT_LT((record.actual.q - record.nominal.q).cwiseAbs().maxCoeff(), 0.02);
    EXPECT_EQ(c.heard.holds, 1);
    EXPECT_EQ(c.loop->stopReason(), StopReason::SensorFailed);
    expectContains(c.loop->stopMessage(), {"of joint1 jumped by 6.28", "more than any motion of it"});
    const CaseResult result = runCase(configureCase(e.cases[0]), {});
    EXPECT_EQ(result.exitCode(), 4);
    expectContains(result.stopMessage, {"the plant plugin 'pushed' (", ") failed: the position that it reports"});

    // Where somebody else judges them, readings are taken as they are.
    HeardCase taken(e, false);
    for (int k = 0; k < 702; ++k) taken.loop->tick(record);
    EXPECT_EQ(taken.loop->stopReason(), StopReason::None);
    EXPECT_GT((taken.heard.real.q - record.nominal.q).cwiseAbs().maxCoeff(), 6.0);
}

const char* const kPush = "real_plant.push_Nm=[30, -30, 30, 10, 10, 10]";

// The same push of 1 s: fed to the nominal arm it is yielded to within all limits; ignored, the robust loop
// works against it.
TEST(ExternalTorque, APushMovesTheNominalArmWithinItsLimitsAndWindsNothingUp) {
    double largest[2], error[2], moved[2];
    for (const bool feeds : {false, true}) {
        Experiment e = readTestExperiment(
            kTeleoperation, idealWith({kPush, "real_plant.push_at_s=0.5",
                                       std::string("external_torque=") + (feeds ? "to_nominal" : "ignored")}));
        ASSERT_EQ(e.cases[0].feedsExternalTorque, feeds);
        HeardCase c(e);
        HeardCase undisturbed(readTestExperiment(kTeleoperation, idealWith({})));
        Summary summary(e.cases[0].robot.jointNames(), e.cases[0].limits, true);
        TickRecord record, other;
        largest[feeds] = error[feeds] = moved[feeds] = 0.0;
        for (int k = 0; k < 2000; ++k) {
            c.loop->tick(record);
            undisturbed.loop->tick(other);
            summary.add(record);
            ASSERT_EQ(record.externalTorque.size(), feeds ? 6 : 0);
            largest[feeds] = std::max(largest[feeds], record.robustTorque.cwiseAbs().maxCoeff());
            error[feeds] = std::max(error[feeds], (record.actual.q - record.nominal.q).cwiseAbs().maxCoeff());
            moved[feeds] = std::max(moved[feeds], (record.nominal.q - other.nominal.q).cwiseAbs().maxCoeff());
            if (!feeds) continue;
            ASSERT_EQ(record.externalTorque[1], k >= 500 && k < 1500 ? -30.0 : 0.0);
            ASSERT_EQ(c.heard.given, JointVector(record.filterTorque - record.externalTorque));
            ASSERT_LT(
                (record.removedTorque - (record.desiredTorque + record.externalTorque - record.filterTorque)).norm(),
                1e-9);
        }
        EXPECT_EQ(c.loop->stopReason(), StopReason::None) << c.loop->stopMessage();
        EXPECT_FALSE(summary.anyLimitBroken());
    }
    std::printf("push: tau_a %.3g / %.3g Nm, real - nominal %.3g / %.3g mrad, nominal moved %.3g / %.3g rad\n",
                largest[0], largest[1], 1e3 * error[0], 1e3 * error[1], moved[0], moved[1]);
    EXPECT_GT(largest[0], 25.0);
    EXPECT_LT(largest[1], 0.1);
    EXPECT_GT(error[0], 1e-3);
    EXPECT_LT(error[1], 1e-5);
    EXPECT_EQ(moved[0], 0.0);
    EXPECT_GT(moved[1], 1e-3);
}

TEST(ExternalTorque, ABadReadingIsReplacedByTheLastGoodOneForTenTicksThenTheArmIsBraked) {
    for (const char* fault : {"nan", "huge", "size"})
        for (const int ticks : {10, 11}) {
            const CaseResult result = runFirstCase(
                kTeleoperation, idealWith({kPush, "external_torque=to_nominal", "real_plant.push_s=5",
                                           std::string("real_plant.fault=") + fault, "real_plant.fault_at_s=0.4",
                                           "real_plant.fault_ticks=" + std::to_string(ticks)}));
            SCOPED_TRACE(std::string(fault) + ", " + std::to_string(ticks));
            EXPECT_FALSE(result.summary.anyLimitBroken());
            EXPECT_EQ(result.summary.externalTorqueMissing(), ticks);
            expectContains(formatDetails(result), {std::to_string(ticks) + " ticks without a usable external torque"});
            EXPECT_EQ(result.exitCode(), ticks > 10 ? 4 : 0);
            EXPECT_EQ(result.stopReason, ticks > 10 ? StopReason::SensorFailed : StopReason::None);
            if (ticks <= 10) {
                EXPECT_LT(result.summary.trackingMax(), 1e-5);  // the last good one was right
                continue;
            }
            EXPECT_NEAR(result.stopTime_s, 0.410, 1e-9);
            expectContains(result.stopMessage, {"the external torque that it reports has the wrong size"});
        }
}

TEST(ExternalTorque, WhatCannotMeasureItIsRefused) {
    const Experiment none =
        readTestExperiment(kTeleoperation, {"external_torque=to_nominal", "real_plant={plugin: failing_plant}"});
    expectError({"external_torque", "the real plant failing_plant has no sensors for an external torque",
                 "external_torque: ignored"},
                [&] { configureCase(none.cases[0]); });
    expectError({"there is no real_plant that could measure an external torque"},
                [&] { readTestExperiment(kOneJoint, {"external_torque=to_nominal"}); });
    expectError({"to_nominal"}, [&] { readTestExperiment(kTeleoperation, {"external_torque=to_nominl"}); });
    // The resolved file says the same again.
    const Experiment e = readTestExperiment(kTeleoperation, idealWith({"external_torque=to_nominal"}));
    const Experiment again = readTestExperiment(writeConfig(e.cases[0].resolved));
    EXPECT_TRUE(again.cases[0].feedsExternalTorque);
}

TEST(RealArm, ATickWithBoundAndExternalTorqueAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    HeardCase c(readBounded(
        idealWith({kPush, "external_torque=to_nominal", "real_plant.offset_rad=0.01", "real_plant.offset_at_s=1.9"}),
        0.005));
    TickRecord record;
    for (int k = 0; k < 100; ++k) c.loop->tick(record);
    const testing::AllocationCounter counter;
    for (int k = 0; k < 2000; ++k) c.loop->tick(record);
    EXPECT_EQ(counter.count(), 0);
    EXPECT_EQ(c.loop->stopReason(), StopReason::TrackingLost);
}

}  // namespace
}  // namespace viable::test
