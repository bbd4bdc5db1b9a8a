#include "Complaint.h"
#include "filter/FilterChain.h"

#include <cfenv>
#include <functional>

namespace viable {
namespace {

constexpr double kTick_s = 0.001;

/** Holds the acceleration that it makes of the desired one. */
class Law : public SafetyFilter {
public:
    using Change = std::function<double(double)>;
    explicit Law(Change change, bool guarantees = false, FilterStatus changed = FilterStatus::Modified)
        : change_(std::move(change)), guarantees_(guarantees), changed_(changed) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {
        ++resets;
        if (throwsInReset) throw std::runtime_error("no way back");
    }
    FilterTraits traits() const override {
        FilterTraits traits{guarantees_ ? LimitSet::joints() : LimitSet(), recovery};
        traits.guarantees.set(LimitKind::Clearance, clearance > 0.0);
        return traits;
    }
    bool changeLimits(const JointLimits&) override {
        ++limitChanges;
        return takesLimits;
    }
    void skipTicks(std::int64_t ticks) override { skipped += ticks; }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override {
        seen = input.torque;
        seesRate = input.accelerationRate != nullptr;
        JointVector wanted;
        calcForwardDynamics(input.dynamics, input.torque, wanted);
        JointVector chosen = wanted;
        for (double& a : chosen) a = change_(a);
        decision.holdJerk(2.0 / kTick_s * (chosen - input.nominal.qdd));
        if (clearance > 0.0) {
            LimitReport& nearest = decision.reports[LimitKind::Clearance];
            nearest.isKnown = true;
            nearest.margin = clearance;
            nearest.age_s = 10.0 * clearance;
        }
        if (faults.lost > 0) decision.reports[LimitKind::Separation].isKnown = true;
        decision.peopleFaults = faults;
        if (chosen == wanted) return FilterStatus::Passed;
        decision.joints[0] = {LimitKind::Jerk, LimitSide::Upper};
        decision.hasStops = guarantees_;
        return changed_;
    }

    JointVector seen;
    bool seesRate = false;
    int resets = 0, limitChanges = 0;
    std::int64_t skipped = 0;
    bool recovery = false, takesLimits = true, throwsInReset = false;
    double clearance = 0.0;  // that it tells of; 0: of none
    PeopleFaults faults;     // likewise

private:
    Change change_;
    bool guarantees_;
    FilterStatus changed_;
};

double pass(double a) {
    return a;
}
Law::Change atMost(double limit) {
    return [limit](double a) { return std::min(a, limit); };
}

struct Chain : ::testing::Test {
    Law& add(Law::Change change, bool guarantees = false, FilterStatus changed = FilterStatus::Modified) {
        auto* law = new Law(std::move(change), guarantees, changed);
        chain_.add(makePtr(law), nullptr);
        return *law;
    }
    static PluginPtr<SafetyFilter> makePtr(Law* law) {
        return {law, [](void* p) { delete static_cast<SafetyFilter*>(p); }};
    }
    void expectFault(const std::string& text) {
        try {
            filter(2.0);
            ADD_FAILURE();
        } catch (const PluginFault& e) {
            EXPECT_EQ(e.what(), text);
            EXPECT_STRNE(e.remedy(), "");
        }
    }
    FilterStatus filter(double acceleration) {
        return chain_.filter({nominal_, JointVector::Constant(1, acceleration), dynamics_}, decision_);
    }
    static JointVector zero() { return JointVector::Zero(1); }

    /** That the decision in force reaches, on the mean. */
    double acceleration() const { return 0.5 * kTick_s * decision_.value[0]; }

    FilterChain chain_{kTick_s};
    MotionState nominal_{zero(), zero(), zero()};
    Dynamics dynamics_{JointMatrix::Identity(1, 1), zero(), zero(), {}, {}};
    FilterDecision decision_;
};

TEST_F(Chain, EachFilterIsTheNextOnesController) {
    const Law& first = add(atMost(5.0));
    const Law& second = add(atMost(3.0));
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);
    EXPECT_EQ(first.seen[0], 10.0);
    EXPECT_EQ(second.seen[0], 5.0);
    EXPECT_EQ(acceleration(), 3.0);
    EXPECT_EQ(chain_.answerable(), 1u);
}

TEST_F(Chain, TheRateOfTheDesiredAccelerationGoesNoFurtherThanTheDesiredTorque) {
    const Law& first = add(atMost(5.0));
    const Law& second = add(pass);
    const JointVector rate = JointVector::Constant(1, 7.0);
    for (const double wanted : {4.0, 10.0}) {
        chain_.filter({nominal_, JointVector::Constant(1, wanted), dynamics_, &rate}, decision_);
        EXPECT_TRUE(first.seesRate);
        EXPECT_EQ(second.seesRate, wanted < 5.0);
    }
    EXPECT_EQ(filter(4.0), FilterStatus::Passed);
    EXPECT_FALSE(first.seesRate || second.seesRate);
}

TEST_F(Chain, WhatAnEarlierFilterChangedCountsAsModifiedThoughTheLastOnePasses) {
    add(atMost(5.0), false, FilterStatus::Infeasible);
    add(pass);
    EXPECT_EQ(filter(1.0), FilterStatus::Passed);
    EXPECT_EQ(acceleration(), 1.0);
    EXPECT_EQ(decision_.joints[0].limit, LimitKind::None);
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);
    EXPECT_EQ(acceleration(), 5.0);
    EXPECT_EQ(decision_.joints[0].limit, LimitKind::Jerk);  // still told
}

TEST_F(Chain, TheGuaranteeIsThatOfTheLastFilterThatMakesOne) {
    add(pass);
    EXPECT_FALSE(chain_.traits().guarantees.hasJoints());
    EXPECT_FALSE(chain_.traits().recovers);
    add(atMost(2.0), true).recovery = true;
    EXPECT_TRUE(chain_.traits().guarantees.hasJoints());
    EXPECT_EQ(chain_.guaranteeing(), 1);
    add(atMost(4.0));
    EXPECT_TRUE(chain_.traits().guarantees.hasJoints());
    EXPECT_TRUE(chain_.traits().recovers);
    EXPECT_EQ(chain_.guaranteeing(), 1);
    add(pass, true);
    EXPECT_EQ(chain_.guaranteeing(), 3);
    EXPECT_FALSE(chain_.traits().recovers);
}

TEST_F(Chain, NoObjectionBehindTheGuaranteeLeavesTheGuaranteedDecisionWithItsStops) {
    add(atMost(2.0), true);
    add(pass);
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);
    EXPECT_TRUE(decision_.hasStops);
    EXPECT_EQ(chain_.answerable(), 0u);
}

TEST_F(Chain, TheReportsOfALastFilterThatPassesAreToldWithTheGuaranteedDecision) {
    add(atMost(2.0), true);
    Law& last = add(pass);
    last.clearance = 0.5;
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);
    EXPECT_TRUE(decision_.hasStops);
    EXPECT_EQ(decision_.reports[LimitKind::Clearance].margin, 0.5);
    EXPECT_EQ(decision_.peopleFaults.lost, 0);
    last.faults.lost = 3;
    filter(10.0);
    EXPECT_EQ(decision_.peopleFaults.lost, 3);
}

TEST_F(Chain, AClearanceIsToldAsLongAsItIsThatOfTheMotionThatStands) {
    Law& looking = add(atMost(4.0));
    add(atMost(3.0));
    looking.clearance = 0.5;
    EXPECT_EQ(filter(2.0), FilterStatus::Passed);  // the second passes it
    EXPECT_TRUE(decision_.reports[LimitKind::Clearance].isKnown);
    EXPECT_EQ(decision_.reports[LimitKind::Clearance].margin, 0.5);
    EXPECT_EQ(decision_.reports[LimitKind::Clearance].age_s, 5.0);
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);  // the second changes it and has not looked
    EXPECT_FALSE(decision_.reports[LimitKind::Clearance].isKnown);
    EXPECT_EQ(decision_.reports[LimitKind::Clearance].age_s, 0.0);
    looking.clearance = 0.0;
    EXPECT_EQ(filter(2.0), FilterStatus::Passed);
    EXPECT_FALSE(decision_.reports[LimitKind::Clearance].isKnown);  // nothing of an earlier tick
}

TEST_F(Chain, AChangeBehindTheGuaranteeStandsWithoutItsStopsAndIsAnsweredFor) {
    add(atMost(4.0), true);
    add(atMost(2.0));
    EXPECT_EQ(filter(10.0), FilterStatus::Modified);
    EXPECT_EQ(acceleration(), 2.0);
    EXPECT_FALSE(decision_.hasStops);
    EXPECT_EQ(chain_.answerable(), 1u);
}

TEST_F(Chain, AFilterThatGivesUpIsTheOneToName) {
    add(pass);
    add(atMost(1.0), false, FilterStatus::Faulted);
    const Law& never = add(pass);
    EXPECT_EQ(filter(2.0), FilterStatus::Faulted);
    EXPECT_EQ(chain_.answerable(), 1u);
    EXPECT_EQ(never.seen.size(), 0);
}

TEST_F(Chain, AFilterThatThrowsIsTheOneToName) {
    add(pass);
    add([](double) -> double { throw std::runtime_error("no"); });
    EXPECT_THROW(filter(2.0), std::runtime_error);
    EXPECT_EQ(chain_.answerable(), 1u);
}

TEST_F(Chain, NoNumberIsNotHandedOn) {
    add([](double) { return std::nan(""); });
    const Law& never = add(pass);
    expectFault("its decision has the wrong size or is not finite");
    EXPECT_EQ(chain_.answerable(), 0u);
    EXPECT_EQ(never.seen.size(), 0);
}

TEST_F(Chain, AChangeOfArithmeticIsThatFiltersAndUndone) {
    add([](double a) {
        std::fesetround(FE_UPWARD);
        return a;
    });
    const Law& never = add(pass, true);
    expectFault("it changed the floating point arithmetic of the whole thread (the rounding mode; set back)");
    EXPECT_EQ(std::fegetround(), FE_TONEAREST);
    EXPECT_EQ(chain_.answerable(), 0u);
    EXPECT_EQ(never.seen.size(), 0);
}

TEST_F(Chain, GuaranteesClearanceOnlyWhereItsLastFilterDoes) {
    const LimitSet clearance{LimitKind::Clearance};
    add(pass).clearance = 0.1;
    EXPECT_EQ(chain_.traits().guarantees, clearance);
    add(pass, true).clearance = 0.1;
    EXPECT_EQ(chain_.traits().guarantees, LimitSet::joints() | clearance);
    add(pass);
    EXPECT_EQ(chain_.traits().guarantees, LimitSet::joints());
    add(pass).clearance = 0.1;
    EXPECT_EQ(chain_.traits().guarantees, LimitSet::joints() | clearance);
    EXPECT_EQ(chain_.guaranteeing(), 1);
}

TEST_F(Chain, EndedEndsAChainOnlyWhereNobodyGuarantees) {
    add(atMost(1.0), false, FilterStatus::Ended);
    EXPECT_EQ(filter(2.0), FilterStatus::Ended);
    add(pass, true);
    expectFault("it ended the case, but a filter beside it guarantees all limits");
    EXPECT_EQ(chain_.answerable(), 0u);
}

TEST_F(Chain, AThrowInResetNamesTheFilter) {
    PluginWatch first("the first filter"), second("the second filter");
    chain_.add(makePtr(new Law(pass)), &first);
    auto* law = new Law(pass);
    law->throwsInReset = true;
    chain_.add(makePtr(law), &second);
    const std::string told = test::catchError([&] { chain_.reset(nominal_); }, ErrorKind::PluginFailed);
    EXPECT_EQ(told.find("the second filter: threw in reset(): no way back. "), 0u) << told;
}

TEST_F(Chain, EverythingElseReachesAllFilters) {
    Law& first = add(pass);
    Law& second = add(pass);
    chain_.reset(nominal_);
    chain_.skipTicks(7);
    EXPECT_TRUE(chain_.changeLimits({}));
    for (const Law* law : {&first, &second}) {
        EXPECT_EQ(law->resets, 1);
        EXPECT_EQ(law->skipped, 7);
        EXPECT_EQ(law->limitChanges, 1);
    }
    second.takesLimits = false;
    EXPECT_FALSE(chain_.changeLimits({}));
    EXPECT_EQ(chain_.answerable(), 1u);
}

}  // namespace
}  // namespace viable
