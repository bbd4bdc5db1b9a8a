
#include "Complaint.h"
#include "limits/LimitRows.h"
#include "log/LimitKinds.h"
#include "log/LogFields.h"

namespace viable::test {
namespace {

TEST(LimitSet, IsASetOfKinds) {
    LimitSet set{LimitKind::Speed, LimitKind::Jerk};
    EXPECT_TRUE(set.has(LimitKind::Speed));
    EXPECT_FALSE(set.has(LimitKind::Clearance) || set.hasJoints());
    EXPECT_EQ(set & LimitSet::joints(), LimitSet{LimitKind::Jerk});
    EXPECT_TRUE((set | LimitSet::joints()).hasJoints());
    set.set(LimitKind::Speed, false);
    EXPECT_EQ(set, LimitSet{LimitKind::Jerk});
    set.set(LimitKind::Jerk, false);
    EXPECT_TRUE(set.isEmpty());
    EXPECT_NE(LimitSet::joints(), set);
}

TEST(LimitReports, WhatIsNotKnownIsAsBefore) {
    LimitReports before, now;
    before[LimitKind::Clearance].isKnown = before[LimitKind::Speed].isKnown = true;
    before[LimitKind::Clearance].margin = 1.0;
    before[LimitKind::Speed].value = 2.0;
    now[LimitKind::Speed].isKnown = true;
    now[LimitKind::Speed].value = 3.0;
    now.complete(before);
    EXPECT_EQ(now[LimitKind::Clearance].margin, 1.0);
    EXPECT_EQ(now[LimitKind::Speed].value, 3.0);
    EXPECT_FALSE(now[LimitKind::Separation].isKnown);
}

bool isLimit(const std::string& name) {
    for (const LimitKind kind : listArmLimits())
        if (name == getName(kind, LimitSide::Neither)) return true;
    return false;
}

class Nothing : public ArmLimit {
    LimitSample sample(const ArmSample&) override { return {}; }
};

TEST(LimitRows, WhatARowLeavesOpenFollowsFromNameAndUnit) {
    const LimitKind sway = addLimit("sway", "rad/s^2", {});
    const LimitRow& row = getLimitRow(sway);
    EXPECT_EQ(row.kept, "sway kept");
    EXPECT_EQ(row.broken, "the arm broke its limit of sway");
    EXPECT_EQ(row.verdict, "the %s arm broke its limit of sway: ");
    EXPECT_EQ(row.heading, "sway[rad/s^2]");
    EXPECT_EQ(row.block, "sway");
    EXPECT_EQ(row.limitKey, "limit_radps2");
    ASSERT_EQ(row.columns.size(), 4u);
    EXPECT_EQ(row.columns[1].name, "value_radps2");
    ASSERT_FALSE(row.figures.empty());
    EXPECT_EQ(row.figures[0].key, "worst_radps2");
    EXPECT_STREQ(getName(sway, LimitSide::Lower), "sway_lower");
    EXPECT_STREQ(getUnit(sway, true), "rad/s^2");
    ArmLimitRecord record;
    record.worst = 2.5;
    record.worst_s = 0.25;
    record.part = "hand";
    EXPECT_EQ(row.tellWorst(record), "worst 2.5 (hand) at 0.250 s");
    LimitAccount account;
    account.limit = 2.0;
    record.brokenTicks = 3;
    record.firstBroken_s = 0.125;
    EXPECT_EQ(row.tellArm(account, record),
              "worst 2.5 (hand) at 0.250 s, limit 2, beyond it in 3 ticks (first at 0.125 s)");
    LimitRow distance;
    distance.lessIsWorse = true;
    EXPECT_EQ(getLimitRow(addLimit("gap", "m", distance)).columns[1].name, "margin_m");
}

TEST(LimitRows, AKindIsCountedByTheFirstRowThatCanCountIt) {
    const LimitKind named = addLimit("read_from_a_log", "m", {});
    static LimitRow row;
    row.make = [](const LimitScene&) -> std::unique_ptr<ArmLimit> { return std::make_unique<Nothing>(); };
    row.kept = "one";
    detail::addLimitsOf("/one.so", [] { addLimit("read_from_a_log", "m", row); });
    EXPECT_EQ(getLimitRow(named).kept, "one");
    row.kept = "two";
    detail::addLimitsOf("/two.so", [] { addLimit("read_from_a_log", "m", row); });  // by the same code
    EXPECT_EQ(getLimitRow(named).kept, "one");
    EXPECT_EQ(detail::findLimitLibraries(named), (std::set<std::string>{"/one.so", "/two.so"}));
    row.make = [](const LimitScene&) -> std::unique_ptr<ArmLimit> { return nullptr; };
    expectError({"it is counted by /one.so already"}, [&] { addLimit("read_from_a_log", "m", row); });
    expectError({"the unit 'm' here already, not 'cm'"}, [] { addLimit("read_from_a_log", "cm", {}); });
    EXPECT_EQ(addLimit("speed", "m/s", {}), LimitKind::Speed);
    EXPECT_EQ(getLimitRow(LimitKind::Speed).kept, "speed limits kept");
}

/** The columns of a kind's log channel. */
std::string listColumns(const std::string& kind) {
    std::string names;
    for (const LogChannel* channel : listLogChannels())
        for (const LogField& field : channel->fields)
            if (channel->name == kind) names += field.name + " ";
    return names;
}

TEST(LimitRows, ALogTellsItsReaderOfKindsThatOthersHaveAdded) {
    LimitRow row;
    row.lessIsWorse = true;
    row.side = LimitSide::Lower;
    row.block = "gaps";
    row.columns = {{"near_m", &LimitReport::margin}, {"late", &PeopleFaults::lost}};
    row.figures = {{"least_m", &ArmLimitRecord::worst}, {"guilty", &ArmLimitRecord::violatedTicks}};
    const LimitKind gap = addLimit("gap", "m", row);
    EXPECT_EQ(listColumns("gap"), "near_m late ");
    const std::string told = writeLimitKinds();
    addLimit("gap", "m", {});  // as where nobody knows it
    EXPECT_EQ(listColumns("gap"), "known value_m limit_m link ");
    readLimitKinds(told);
    EXPECT_EQ(listColumns("gap"), "near_m late ");
    EXPECT_EQ(writeLimitKinds(), told);
    const LimitRow& read = getLimitRow(gap);
    EXPECT_TRUE(read.lessIsWorse);
    EXPECT_EQ(read.side, LimitSide::Lower);
    EXPECT_EQ(read.block, "gaps");
    EXPECT_EQ(read.limitKey, "");
    ASSERT_EQ(read.figures.size(), 2u);
    EXPECT_EQ(read.figures[1].key, "guilty");
    EXPECT_EQ(read.figures[1].member, row.figures[1].member);
    readLimitKinds(told);
    readLimitKinds(R"({"gap": "m", "position": "rad", "motor": "Nm", "sway": {"unit": 7}})");  // of before, or damaged
    std::string later = told;  // of a version that tells more
    const std::string columns = "\"columns\":[";
    later.replace(later.find(columns), columns.size(), "\"brand\":1," + columns + "[\"far_m\",\"farthest\"],");
    readLimitKinds(later);
    EXPECT_EQ(&getLimitRow(gap), &read);
    expectError({"has it in 'mm', here it is in 'm'"}, [] { readLimitKinds(R"({"gap": "mm"})"); });
    for (const char* name : {"motor", "position"}) EXPECT_FALSE(isLimit(name));
}

TEST(LimitRows, NamesThatCannotBeAreRefused) {
    expectError({"is no word of small letters"}, [] { addLimit("Sway", "", {}); });
    expectError({"is no word of small letters"}, [] { addLimit("", "", {}); });
    expectError({"that is a limit of the joints"}, [] { addLimit("jerk", "rad/s^3", {}); });
    for (const LogChannel* channel : listLogChannels())
        if (!isLimit(channel->name))
            expectError({"is the name of a channel of the log"}, [&] { addLimit(channel->name, "", {}); });
    expectError({"is the name of another limit's block"}, [] { addLimit("collisions", "", {}); });
}

TEST(LimitRows, WhereThereIsNoRoomForOneMoreItIsSaid) {
    std::string error;
    for (int k = 0; k < kMostLimitKinds && error.empty(); ++k)
        error = catchError([&] { addLimit("more_" + std::to_string(k), "m", {}); });
    EXPECT_CONTAINS(error, "there is no room for it beside 11 others");
    EXPECT_EQ(countLimitKinds(), kMostLimitKinds);
    int count = static_cast<int>(kFirstArmLimit);
    for (const LimitKind kind : listArmLimits()) EXPECT_EQ(static_cast<int>(kind), count++);
    EXPECT_EQ(count, kMostLimitKinds);
}

}  // namespace
}  // namespace viable::test
