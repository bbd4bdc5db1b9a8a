#include "None.h"

#include "TestArm.h"

namespace viable {
namespace {

struct NoneTest : ::testing::Test {
    NoneTest() {
        arm_.configure(none_, PluginKind::RobustLoop, "none");
        real_ = {arm_.start.q, arm_.start.qd};
        filterTorque_.setConstant(arm_.size(), 3.0);
    }

    TestArm arm_{"indy7"};
    None none_;
    JointState real_;
    JointVector filterTorque_;
};

TEST_F(NoneTest, AddsNoTorqueWhateverTheError) {
    std::mt19937 random(1);
    for (int k = 0; k < 100; ++k) {
        real_.q = makeRandomVector(arm_.size(), 3.0, random);
        real_.qd = makeRandomVector(arm_.size(), 3.0, random);
        JointVector torque = JointVector::Ones(2);
        ASSERT_EQ(none_.compute(real_, arm_.start, filterTorque_, torque), TickStatus::Ok);
        EXPECT_EQ(torque, JointVector::Zero(arm_.size()));
    }
}

TEST_F(NoneTest, RefusesWhatIsNotFiniteOrOfTheWrongSize) {
    const JointVector before = JointVector::Constant(arm_.size(), 7.0);
    JointVector torque = before;
    const auto expectRefused = [&](const JointState& real, const MotionState& nominal,
                                   const JointVector& filterTorque) {
        EXPECT_EQ(none_.compute(real, nominal, filterTorque, torque), TickStatus::InvalidInput);
        EXPECT_EQ(torque, before);
    };
    JointState badReal = real_;
    badReal.q[1] = kNan;
    expectRefused(badReal, arm_.start, filterTorque_);
    MotionState badNominal = arm_.start;
    badNominal.qdd[0] = kNan;
    expectRefused(real_, badNominal, filterTorque_);
    expectRefused(real_, arm_.start, JointVector::Zero(arm_.size() - 1));
}

TEST_F(NoneTest, LoadsAsALibrary) {
    EXPECT_EQ(findPlugin(PluginKind::RobustLoop, "none").entry->parameterCount, 0u);
    const auto plugin = arm_.load<RobustLoop>(PluginKind::RobustLoop, "none");
    JointVector torque;
    ASSERT_EQ(plugin->compute(real_, arm_.start, filterTorque_, torque), TickStatus::Ok);
    EXPECT_EQ(torque, JointVector::Zero(arm_.size()));
    EXPECT_FALSE(plugin->traits().errorLoop);  // no tracking bound is known
}

TEST_F(NoneTest, HasNoParameters) {
    expectError({"k_r"}, [&] { arm_.read(PluginKind::RobustLoop, "none", "k_r: 600"); });
}

}  // namespace
}  // namespace viable
