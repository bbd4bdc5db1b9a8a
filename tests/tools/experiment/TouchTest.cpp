// A hand leads the tool into a surface, along it and away: the tool presses with the force that is asked for, and the nominal arm
// waits for it.

#include "CaseSupport.h"
#include "Effort.h"
#include "core/Text.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

using test::readTestExperiment;

const char* const kTouch = R"(schema: 1
title: touch
robot: indy7
duration_s: 7
limits: {velocity_radps: 1.5, acceleration_radps2: 8, jerk_radps3: 100}
command: {plugin: generated_hand_motion, seed: 1}
controller: {plugin: tool_servo}
robust_loop: {plugin: nric, contact_force_N: 20}
filter: {plugin: certified_braking}
real_plant: {plugin: simbody, contact: tool, substeps: 20, dynamics: recursion, contact_stiffness_Npm: 1e5, contact_friction: 0.2}
cases: {A: {}}
)";

constexpr double kGap = 0.05, kRest_s = 0.3, kPress_s = 2.0, kSlide_s = 1.5, kSlideSpeed = 0.1, kBackSpeed = 0.2;

/** Down by `depth` below a surface that is `kGap` away, there, along y, and back. */
class Hand : public CommandSource {
public:
    Hand(Pose start, double depth, double speed) : start_(std::move(start)), way_(kGap + depth), speed_(speed) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    double pressFrom() const { return kRest_s + way_ / speed_; }
    double slideFrom() const { return pressFrom() + kPress_s; }
    double backFrom() const { return slideFrom() + kSlide_s; }
    double crossing() const { return backFrom() + (way_ - kGap) / kBackSpeed; }
    TickStatus sample(double t, MotionCommand& out) override {
        out.space = MotionCommand::Space::Tool;
        out.tool = start_;
        out.toolTwist.setZero();
        const double down = std::clamp((t - kRest_s) * speed_, 0.0, way_),
                     along = std::clamp(t - slideFrom(), 0.0, kSlide_s) * kSlideSpeed,
                     up = std::clamp((t - backFrom()) * kBackSpeed, 0.0, way_);
        out.tool.position += Eigen::Vector3d(0.0, along, up - down);
        if (t > kRest_s && down < way_) out.toolTwist[2] = -speed_;
        if (along > 0.0 && along < kSlide_s * kSlideSpeed) out.toolTwist[1] = kSlideSpeed;
        if (up > 0.0 && up < way_) out.toolTwist[2] = kBackSpeed;
        return TickStatus::Ok;
    }

private:
    Pose start_;
    double way_, speed_;
};

struct Figures {
    int ticks = 0;
    double sum = 0.0, squares = 0.0, least = kInfinity;
    void add(double x) {
        ++ticks;
        sum += x;
        squares += x * x;
        least = std::min(least, x);
    }
    double mean() const { return sum / ticks; }
    double deviation() const { return std::sqrt(std::max(0.0, squares / ticks - mean() * mean())); }
};

struct Touch {
    double peak = 0.0, blow = 0.0;  ///< force [N]; that of the arm's mass on the spring
    int losses = 0;
    Figures rest, slide, asked;    ///< [N]
    double aside = 0.0;            ///< of the tool from the hand along the surface while it slides, at most [m]
    double leaves_s = 0.0;         ///< after the hand crossed the surface
    double jump = 0.0;             ///< fastest real joint afterwards, as a share of its limit
    double endError = 0.0;         ///< of the tool from the hand at the end [m]
    std::int64_t allocations = 0;  ///< in ticks
    bool isStopped = false, brokeLimits = false;
    std::string message;

    /** Everything that is asked of it. @param F  asked for, or what the joints may give [N] */
    bool isGood() const {
        const double F = asked.mean();
        return !isStopped && peak <= 1.3 * blow + 1.5 * F && losses <= 6 && std::abs(rest.mean() - F) <= 0.1 * F &&
               rest.deviation() <= 0.1 * F && std::abs(slide.mean() - F) <= 0.3 * F && slide.deviation() <= 0.15 * F &&
               slide.least > 0.0 && aside < 0.01 && leaves_s < 0.1 && jump < 1.0 && endError < 0.005;
    }
};

Touch run(const std::vector<std::string>& overrides, double depth, double wall, double speed) {
    CasePlan plan = readTestExperiment(kTouch, overrides).cases.front();
    RobotModel model(plan.robot);
    Dynamics dynamics;
    model.calcDynamics(plan.start.q, plan.start.qd, dynamics);
    const double surface = dynamics.tool.position.z() - 0.02 - kGap;
    Solid floor;
    floor.name = "floor";
    floor.kind = Solid::Kind::HalfSpace;
    floor.pose.translation().z() = surface;
    plan.environment.emplace();
    plan.environment->solids.push_back(floor);
    plan.geometry.emplace();
    Hand hand(dynamics.tool, depth, speed);
    auto configured = configureCase(plan);
    configured->plugins.command = {&hand, [](void*) {}};
    CaseResult result = makeResult(*configured);
    result.summary.watchTouch(plan.robustLoop->host.contactForce);
    RealArmOptions options;
    options.watchesFollowing = options.limitsAuthority = true;
    options.motorRate = configured->motorRate;
    options.contactForce = plan.robustLoop->host.contactForce;
    ControlLoop loop(configured->setup, std::move(configured->plugins), options);
    Touch found;
    TickRecord record;
    bool touched = false, touches = false;
    const auto ticks = static_cast<int>(std::lround((hand.crossing() + 2.0) / plan.tick_s));
    for (int k = 0; k < ticks && !loop.hasStopped(); ++k) {
        const testing::AllocationCounter counter;
        loop.tick(record);
        found.allocations += counter.count();
        result.summary.add(record);
        const double force = record.contact.pressing, t = record.time_s;
        found.peak = std::max(found.peak, force);
        model.calcDynamics(record.actual.q, record.actual.qd, dynamics);
        if (!touched && force > 0.0) {
            const JointVector pull = dynamics.J.row(2).transpose();
            const double mass = 1.0 / pull.dot(dynamics.M.llt().solve(pull));
            found.blow = std::abs(pull.dot(record.actual.qd)) * std::sqrt(mass * wall);
            touched = true;
        }
        if (touched && touches && force == 0.0 && t < hand.slideFrom()) ++found.losses;
        touches = force > 0.0;
        if (t > hand.slideFrom() - 0.5 && t < hand.slideFrom()) {
            found.rest.add(force);
            found.asked.add(record.touch.asked);
        }
        if (t > hand.slideFrom() + 0.3 && t < hand.backFrom()) {
            found.slide.add(force);
            found.aside =
                std::max(found.aside, (dynamics.tool.position - record.command.tool.position).head<2>().norm());
        }
        if (t > hand.backFrom() && force > 0.0) found.leaves_s = t - hand.crossing();
        if (t > hand.crossing())
            found.jump =
                std::max(found.jump, record.actual.qd.cwiseAbs().cwiseQuotient(plan.limits.velocity.upper).maxCoeff());
        found.endError = (dynamics.tool.position - record.command.tool.position).norm();
    }
    const auto& waiting = result.summary.waiting();
    EXPECT_GT(waiting->ticks, 0);
    found.isStopped = loop.isStopping();
    found.message = loop.stopMessage();
    found.brokeLimits = result.summary.anyLimitBroken();
    return found;
}

TEST(Touch, PressesAsAskedSlidesAndComesAwayOnAnyWall) {
    std::mt19937 random(static_cast<unsigned>(test::getSeed(1)));
    const auto draw = [&](const auto& from) { return from[random() % std::size(from)]; };
    constexpr const char* kRobots[] = {"indy7", "panda", "ur5e"};
    constexpr const char* kControllers[] = {"tool_servo", "task_space_pd"};
    constexpr double kWalls[] = {250.0, 2.5e3, 2.5e4, 2.5e5, 1e6}, kForces[] = {10.0, 20.0, 50.0};
    const int runs = test::countOf(32);
    int good = 0;
    for (int k = 0; k < runs; ++k) {
        const char *const robot = draw(kRobots), *const controller = draw(kControllers);
        const double wall = draw(kWalls), force = draw(kForces),
                     speed = 0.05 * std::pow(10.0, 1e-3 * (random() % 1000));
        const double depth = 0.1 + (wall < 1e3 ? force / wall : 0.0);
        const Touch f = run({std::string("robot=") + robot, std::string("controller={plugin: ") + controller + "}",
                             detail::format("robust_loop.contact_force_N=%g", force),
                             detail::format("real_plant.contact_stiffness_Npm=%g", wall)},
                            depth, wall, speed);
        const std::string what = detail::format(
            "%s %-6s %-13s %8.0f N/m %.2f m/s %3.0f N (%3.0f): peak %5.0f (blow %5.0f) lost %d rest %6.2f +- %5.2f "
            "slide %6.2f +- %5.2f least %5.1f aside %5.1f mm leaves %.3f s jump %.2f end %.1f mm %s",
            f.isGood() ? "good" : "bad ", robot, controller, wall, speed, force, f.asked.mean(), f.peak, f.blow,
            f.losses, f.rest.mean(), f.rest.deviation(), f.slide.mean(), f.slide.deviation(), f.slide.least,
            1e3 * f.aside, f.leaves_s, f.jump, 1e3 * f.endError, f.message.c_str());
        std::puts(what.c_str());
        EXPECT_FALSE(f.brokeLimits) << what;
        EXPECT_EQ(f.allocations, 0) << what;
        good += f.isGood();
    }
    // Fast blows of light wrists, and dry friction with a small force, are the rest (MATH 13).
    std::printf("%d of %d\n", good, runs);
    EXPECT_GE(good, 0.6 * runs);
}

}  // namespace
}  // namespace viable
