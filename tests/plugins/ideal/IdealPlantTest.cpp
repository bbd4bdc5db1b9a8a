#include "IdealPlant.h"

#include "CaseSupport.h"
#include "TestArm.h"

namespace viable {
namespace {

/** The largest correction of NRIC over 10 s of the hand motion [Nm]. */
double findLargestCorrection(const std::string& filter, const std::string& plant) {
    test::TestLoop loop(test::kTeleoperation,
                        {"duration_s=10", "filter={plugin: " + filter + "}", "real_plant={" + plant + "}"});
    TickRecord record;
    double largest = 0.0;
    for (int tick = 0; tick < 10000; ++tick) {
        loop.loop.tick(record);
        largest = std::max(largest, record.robustTorque.lpNorm<Eigen::Infinity>());
    }
    EXPECT_FALSE(loop.loop.isStopping()) << loop.loop.stopMessage();
    return largest;
}

/** Silence: what rounding amounts to through NRIC's gain of 600 Nms/rad [Nm]. */
constexpr double kSilence = 1e-9;

TEST(IdealPlant, NricStaysSilent) {
    const double jerk = findLargestCorrection("certified_braking", "plugin: ideal");
    const double acceleration = findLargestCorrection("acceleration_viability", "plugin: ideal, held: acceleration");
    std::printf("  |tau_a| at most %.1e Nm (jerk held), %.1e Nm (acceleration held)\n", jerk, acceleration);
    EXPECT_LE(jerk, kSilence);
    EXPECT_LE(acceleration, kSilence);
}

// The figure above means something: an arm without friction that is integrated as arms are, and one that takes the
// torque for another quantity, make NRIC speak.
TEST(IdealPlant, OtherPlantsAreHeard) {
    const double simbody =
        findLargestCorrection("certified_braking", "plugin: simbody, friction: none, encoder: exact");
    const double wrong = findLargestCorrection("certified_braking", "plugin: ideal, held: acceleration");
    std::printf("  |tau_a| at most %.1e Nm (simbody without friction), %.1e Nm (wrong quantity)\n", simbody, wrong);
    EXPECT_GT(simbody, 1e3 * kSilence);
    EXPECT_GT(wrong, 1e3 * kSilence);
}

TEST(IdealPlant, RefusesTorqueThatIsNotFiniteAndStaysAsItWas) {
    TestArm arm("indy7");
    IdealPlant plant;
    arm.configure(plant, PluginKind::RealPlant, "ideal");
    JointVector torque = arm.calcDynamics(arm.start).gravity, applied;
    EXPECT_EQ(plant.advance(torque, applied), TickStatus::Ok);
    EXPECT_LE((plant.actual().q - arm.start.q).lpNorm<Eigen::Infinity>(), 1e-15);
    const JointState before = plant.actual();
    torque[3] = kNan;
    EXPECT_EQ(plant.advance(torque, applied), TickStatus::InvalidInput);
    EXPECT_EQ(plant.actual().q, before.q);
    ASSERT_NE(plant.externalTorque(), nullptr);
    EXPECT_EQ(*plant.externalTorque(), JointVector::Zero(6));
    EXPECT_FALSE(plant.traits().hasClock);
}

}  // namespace
}  // namespace viable
