// A hand leads the tool into a surface, along it and away: the tool presses with the force that is asked for, and the nominal arm
// waits for it.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "CaseSupport.h"
#include "Effort.h"

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
    Figures rest, slide;
    double aside = 0.0;       ///< of the tool from the hand along the surface while it slides, at most [m]
    double leaves_s = 0.0;    ///< after the hand crossed the surface
    double jump = 0.0;        ///< fastest real joint afterwards, as a share of its limit
    double endError = 0.0;    ///< of the tool from the hand at the end [m]
    bool isStopped = false, brokeLimits = false;
    std::string message;
};

Touch run(const std::vector<std::string>& overrides, double depth, double speed) {
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
        loop.tick(record);
        result.summary.add(record);
        const double force = record.contact.pressing, t = record.time_s;
        found.peak = std::max(found.peak, force);
        model.calcDynamics(record.actual.q, record.actual.qd, dynamics);
        if (!touched && force > 0.0) {
            const JointVector pull = dynamics.J.row(2).transpose();
            const double mass = 1.0 / pull.dot(dynamics.M.llt().solve(pull));
            const double stiffness = plan.realPlant->parameters.resolved().find("contact_stiffness_Npm")
                                         ? std::stod(plan.realPlant->parameters.resolved().find("contact_stiffness_Npm")->text)
                                         : 0.0;
            found.blow = std::abs(pull.dot(record.actual.qd)) * std::sqrt(mass * stiffness);
            touched = true;
        }
        if (touched && touches && force == 0.0 && t < hand.slideFrom()) ++found.losses;
        touches = force > 0.0;
        if (t > hand.slideFrom() - 0.5 && t < hand.slideFrom()) found.rest.add(force);
        if (t > hand.slideFrom() + 0.3 && t < hand.backFrom()) {
            found.slide.add(force);
            found.aside = std::max(found.aside, (dynamics.tool.position - record.command.tool.position).head<2>().norm());
        }
        if (t > hand.backFrom() && force > 0.0) found.leaves_s = t - hand.crossing();
        if (t > hand.crossing())
            found.jump = std::max(
                found.jump, record.actual.qd.cwiseAbs().cwiseQuotient(plan.limits.velocity.upper).maxCoeff());
        if (getenv("TRACE") && k % 50 == 0) { Dynamics nom; model.calcDynamics(record.nominal.q, record.nominal.qd, nom); std::printf("t %.3f cmd %.3f %.3f %.3f nom %.3f %.3f %.3f real %.3f %.3f %.3f f %.1f\n", t, record.command.tool.position.x(), record.command.tool.position.y(), record.command.tool.position.z(), nom.tool.position.x(), nom.tool.position.y(), nom.tool.position.z(), dynamics.tool.position.x(), dynamics.tool.position.y(), dynamics.tool.position.z(), force); }
        found.endError = (dynamics.tool.position - record.command.tool.position).norm();
    }
    found.isStopped = loop.isStopping();
    found.message = loop.stopMessage();
    found.brokeLimits = result.summary.anyLimitBroken();
    return found;
}

TEST(Touch, ATo) {
    for (const char* robot : {"indy7", "panda", "ur5e"})
        for (const char* controller : {"tool_servo", "task_space_pd"})
            for (const double stiffness : {250.0, 2.5e3, 2.5e4, 2.5e5, 1e6})
                for (const double speed : {0.05, 0.2, 0.5}) {
                    if (test::getEffort() < 1.0 && speed != 0.2) continue;
                    if (const char* only = getenv("ONLY")) if (std::string(only) != std::string(robot) + controller + std::to_string(int(stiffness))) continue;
                    const int substeps = stiffness > 5e5 ? 20 : 10;
                    const std::vector<std::string> o{
                        std::string("robot=") + robot, std::string("controller={plugin: ") + controller + "}",
                        "real_plant.contact_stiffness_Npm=" + std::to_string(stiffness),
                        "real_plant.substeps=" + std::to_string(substeps)};
                    const Touch f = run(o, 0.1, speed);
                    std::printf(
                        "%-6s %-13s %8.0f %.2f peak %5.0f (blow %5.0f) lost %d rest %6.2f +- %5.2f slide %6.2f +- %5.2f least %5.1f "
                        "aside %5.1f mm leaves %.3f s jump %.2f end %.1f mm %s %s\n",
                        robot, controller, stiffness, speed, f.peak, f.blow, f.losses, f.rest.mean(), f.rest.deviation(),
                        f.slide.mean(), f.slide.deviation(), f.slide.least, 1e3 * f.aside, f.leaves_s, f.jump, 1e3 * f.endError,
                        f.brokeLimits ? "LIMITS" : "", f.isStopped ? f.message.c_str() : "");
                }
}

}  // namespace
}  // namespace viable
