#include "Complaint.h"
#include "host/IsolatedPlugin.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cfenv>
#include <chrono>
#include <cstdlib>
#include <thread>

namespace viable {
namespace {

constexpr int kJoints = 3;
constexpr double kPatience_s = 0.3;

JointVector vector(double first) {
    JointVector v(kJoints);
    for (int i = 0; i < kJoints; ++i) v[i] = first + i;
    return v;
}
MotionState state(double first) {
    return {vector(first), vector(first + 10), vector(first + 20)};
}

template <class Interface, class Class>
PluginPtr<Interface> makePtr(Class* plugin) {
    return {plugin, [](void* p) { delete static_cast<Interface*>(p); }};
}
/** A plugin of another process, told of to `watch`. */
PluginWatch watch("the plugin");
template <class Interface, class Class, class... Arguments>
PluginPtr<Interface> isolate(double watchdog_s, Arguments... arguments) {
    watch = PluginWatch("the plugin");
    return isolatePlugin<Interface>([=] { return makePtr<Interface>(new Class(arguments...)); }, watch, watchdog_s);
}

/** Calls `action` and returns the text of the PluginFault that it throws. */
template <class Action>
std::string faultOf(const Action& action) {
    try {
        action();
    } catch (const PluginFault& e) {
        EXPECT_STRNE(e.remedy(), "");
        return e.what();
    }
    ADD_FAILURE() << "no fault was thrown";
    return {};
}

class Command : public CommandSource {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override { start_ = start.q; }
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double t, MotionCommand& out) override {
        out.q = start_ + vector(t);
        out.qd = vector(2 * t);
        out.space = MotionCommand::Space::Tool;
        out.tool.position.x() = t;
        return t < 1.0 ? TickStatus::Ok : TickStatus::InvalidInput;
    }
    const JointLimits* sampleLimits(double t) override {
        limits_.position = {vector(-t), vector(t)};
        limits_.velocity = limits_.acceleration = limits_.jerk = limits_.position;
        return t < 0.5 ? nullptr : &limits_;
    }

private:
    JointVector start_;
    JointLimits limits_;
};

TEST(IsolatedPlugin, ACommandSourceAnswersAsItWouldHere) {
    const auto plugin = isolate<CommandSource, Command>(kDefaultWatchdog_s);
    EXPECT_EQ(plugin->traits().space, MotionCommand::Space::Tool);
    plugin->reset(state(1.0));
    MotionCommand command;
    EXPECT_EQ(plugin->sample(0.25, command), TickStatus::Ok);
    EXPECT_EQ(command.q, vector(1.0) + vector(0.25));
    EXPECT_EQ(command.qd, vector(0.5));
    EXPECT_EQ(command.tool.position.x(), 0.25);
    EXPECT_EQ(command.space, MotionCommand::Space::Tool);
    EXPECT_EQ(plugin->sampleLimits(0.25), nullptr);
    EXPECT_EQ(plugin->sample(1.5, command), TickStatus::InvalidInput);
    const JointLimits* limits = plugin->sampleLimits(1.5);
    ASSERT_NE(limits, nullptr);
    EXPECT_EQ(limits->jerk.upper, vector(1.5));
}

struct Controller : NominalController {
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    ControllerTraits traits() const override { return {true, false}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        const auto& [command, nominal, dynamics, tick] = input;
        output.torque = dynamics.M * (command.q - nominal.q) + dynamics.b;
        output.hasAccelerationRate = tick.missed > 0;
        output.accelerationRate = vector(tick.time_s);
        return TickStatus::Ok;
    }
};

TEST(IsolatedPlugin, AControllerAnswersAsItWouldHere) {
    const auto plugin = isolate<NominalController, Controller>(kDefaultWatchdog_s);
    EXPECT_TRUE(plugin->traits().follows(MotionCommand::Space::Joint));
    EXPECT_FALSE(plugin->traits().follows(MotionCommand::Space::Tool));
    MotionCommand command;
    command.q = vector(5.0);
    Dynamics dynamics;
    dynamics.M = 2.0 * JointMatrix::Identity(kJoints, kJoints);
    dynamics.b = vector(1.0);
    ControllerOutput output;
    EXPECT_EQ(plugin->compute({command, state(2.0), dynamics, {0.5, 3}}, output), TickStatus::Ok);
    EXPECT_EQ(output.torque, JointVector(6.0 * JointVector::Ones(kJoints) + vector(1.0)));
    ASSERT_TRUE(output.hasAccelerationRate);
    EXPECT_EQ(output.accelerationRate, vector(0.5));
    EXPECT_EQ(plugin->compute({command, state(2.0), dynamics, {0.75, 0}}, output), TickStatus::Ok);
    EXPECT_FALSE(output.hasAccelerationRate);
}

/** Does `what` in its third tick. */
class Filter : public SafetyFilter {
public:
    enum class What {
        Nothing,
        Segfault,
        Abort,
        Exit,
        Hang,
        Throw,
        ThrowInt,
        ThrowError,
        Rounding,
        HugeVector,
        WildStatus,
        CrashWhenDestroyed
    };
    explicit Filter(What what = What::Nothing) : what_(what) {}
    ~Filter() override {
        if (crashes_) std::abort();
    }
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override { ticks_ = 0; }
    FilterTraits traits() const override { return {LimitSet::joints(), true}; }
    bool changeLimits(const JointLimits& limits) override { return limits.jerk.upper[0] > 0.0; }
    void skipTicks(std::int64_t ticks) override { ticks_ += ticks; }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override {
        ++ticks_;
        decision.holdJerk(vector(static_cast<double>(ticks_)));
        if (input.accelerationRate) decision.holdAcceleration(input.torque + *input.accelerationRate);
        decision.joints[1] = {LimitKind::Velocity, LimitSide::Lower};
        decision.hasStops = true;
        return ticks_ < 3 ? FilterStatus::Recovering : misbehave(decision);
    }

private:
    FilterStatus misbehave(FilterDecision& decision) {
        if (what_ == What::Segfault) raise(SIGSEGV);
        if (what_ == What::Abort) std::abort();
        if (what_ == What::Exit) std::exit(0);
        while (what_ == What::Hang) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        if (what_ == What::Throw) throw std::runtime_error("temper");
        if (what_ == What::ThrowInt) throw 3;
        if (what_ == What::ThrowError) throw badInput("file:1:2", "wrong", "Mend it.");
        if (what_ == What::Rounding) std::fesetround(FE_UPWARD);
        if (what_ == What::HugeVector) {
            // What a stray write makes of a vector's size.
            std::array<Eigen::Index, sizeof(JointVector) / sizeof(Eigen::Index)> words;
            std::memcpy(&words, static_cast<void*>(&decision.value), sizeof(JointVector));
            for (Eigen::Index& word : words) word = 100000;
            std::memcpy(static_cast<void*>(&decision.value), &words, sizeof(JointVector));
        }
        crashes_ = what_ == What::CrashWhenDestroyed;
        return what_ == What::WildStatus ? static_cast<FilterStatus>(99) : FilterStatus::Passed;
    }
    What what_;
    std::int64_t ticks_ = 0;
    bool crashes_ = false;
};
using What = Filter::What;

struct IsolatedFilterTest : ::testing::Test {
    void make(What what) {
        plugin_.reset();  // its watch is used again
        plugin_ = isolate<SafetyFilter, Filter>(what == What::Hang ? kPatience_s : 30.0, what);
        plugin_->reset(state(0.0));
        for (int i = 0; i < 2; ++i) ASSERT_EQ(tick(), FilterStatus::Recovering);
    }
    FilterStatus tick() { return plugin_->filter({state(0.0), vector(7.0), dynamics_}, decision_); }
    std::string faultOf(What what) {
        make(what);
        const std::string text = viable::faultOf([&] { tick(); });
        EXPECT_EQ(viable::faultOf([&] { tick(); }).empty(), false);  // it stays lost
        return text;
    }

    Dynamics dynamics_;
    FilterDecision decision_;
    PluginPtr<SafetyFilter> plugin_{nullptr, nullptr};
};

TEST_F(IsolatedFilterTest, AnswersAsItWouldHere) {
    make(What::Nothing);
    EXPECT_TRUE(plugin_->traits().guarantees.hasJoints());
    EXPECT_TRUE(plugin_->traits().recovers);
    EXPECT_EQ(decision_.held, HeldQuantity::Jerk);
    EXPECT_EQ(decision_.value, vector(2.0));
    EXPECT_EQ(decision_.joints[1].limit, LimitKind::Velocity);
    EXPECT_TRUE(decision_.hasStops);
    JointLimits limits;
    limits.jerk.upper = vector(1.0);
    EXPECT_TRUE(plugin_->changeLimits(limits));
    limits.jerk.upper = vector(-1.0);
    EXPECT_FALSE(plugin_->changeLimits(limits));
    plugin_->skipTicks(5);
    EXPECT_EQ(tick(), FilterStatus::Passed);
    EXPECT_EQ(decision_.value, vector(8.0));
    plugin_->reset(state(0.0));
    EXPECT_EQ(tick(), FilterStatus::Recovering);
    EXPECT_EQ(decision_.value, vector(1.0));
    const JointVector rate = vector(3.0);
    plugin_->filter({state(0.0), vector(7.0), dynamics_, &rate}, decision_);
    EXPECT_EQ(decision_.held, HeldQuantity::Acceleration);
    EXPECT_EQ(decision_.value, JointVector(vector(7.0) + rate));
}

TEST_F(IsolatedFilterTest, ADeathIsTold) {
    EXPECT_EQ(faultOf(What::Segfault), "its process died: signal 11 (Segmentation fault)");
    EXPECT_EQ(faultOf(What::Abort), "its process died: signal 6 (Aborted)");
    EXPECT_EQ(faultOf(What::Exit), "its process ended: it called exit(0)");
}

TEST_F(IsolatedFilterTest, AHangIsEndedByTheWatchdog) {
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(faultOf(What::Hang), "it did not return for 0.3 s; its process was ended");
    const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
    EXPECT_GE(waited.count(), kPatience_s);
}

TEST_F(IsolatedFilterTest, WhatItThrowsIsThrownHereAndItLivesOn) {
    make(What::Throw);
    try {
        tick();
        ADD_FAILURE();
    } catch (const std::runtime_error& e) {
        EXPECT_STREQ(e.what(), "temper");
    }
    plugin_->reset(state(0.0));
    EXPECT_EQ(tick(), FilterStatus::Recovering);
    make(What::ThrowInt);
    EXPECT_THROW(tick(), std::runtime_error);
    make(What::ThrowError);
    EXPECT_EQ(test::catchError([&] { tick(); }), "file:1:2: wrong. Mend it.");
}

TEST_F(IsolatedFilterTest, AChangeOfArithmeticIsToldAndUndoneThere) {
    make(What::Rounding);
    for (int i = 0; i < 2; ++i)  // had it not been set back, the second time would change nothing
        EXPECT_EQ(viable::faultOf([&] { tick(); }),
                  "it changed the floating point arithmetic of the whole thread (the rounding mode; set back)");
}

TEST_F(IsolatedFilterTest, ACrashInItsDestructorIsItsLastWord) {
    make(What::CrashWhenDestroyed);
    EXPECT_EQ(tick(), FilterStatus::Passed);
    EXPECT_EQ(watch.lastWords, "");
    plugin_.reset();
    EXPECT_EQ(watch.lastWords, "its process died: signal 6 (Aborted)");
}

TEST_F(IsolatedFilterTest, ADeathIsSeenWhereTheLauncherIgnoredSigchld) {
    signal(SIGCHLD, SIG_IGN);
    EXPECT_EQ(faultOf(What::Segfault), "its process died: signal 11 (Segmentation fault)");
}

TEST_F(IsolatedFilterTest, ADamagedAnswerIsAFault) {
    make(What::HugeVector);
    const FilterDecision before = decision_;
    EXPECT_EQ(tick(), FilterStatus::Faulted);
    EXPECT_EQ(decision_.value, before.value);
    make(What::WildStatus);
    EXPECT_EQ(tick(), FilterStatus::Faulted);
}

TEST_F(IsolatedFilterTest, AProcessThatWasKilledFromOutsideIsTold) {
    make(What::Nothing);
    pid_t child = -1;  // the only one
    {
        const std::string file = "/proc/self/task/" + std::to_string(getpid()) + "/children";
        FILE* stream = fopen(file.c_str(), "r");
        ASSERT_NE(stream, nullptr);
        EXPECT_EQ(fscanf(stream, "%d", &child), 1);
        fclose(stream);
    }
    ASSERT_GT(child, 0);
    kill(child, SIGKILL);
    EXPECT_EQ(viable::faultOf([&] { tick(); }), "its process died: signal 9 (Killed)");
}

TEST_F(IsolatedFilterTest, NoProcessIsLeftBehind) {
    make(What::Nothing);
    plugin_.reset();
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
    EXPECT_EQ(errno, ECHILD);
}

TEST(IsolatedPlugin, WhatFailsWhileItIsMadeIsThrownHere) {
    const auto failing = [](const std::function<void()>& fail) {
        return isolatePlugin<SafetyFilter>(
            [&]() -> PluginPtr<SafetyFilter> {
                fail();
                return {nullptr, nullptr};
            },
            watch);
    };
    EXPECT_EQ(test::catchError([&] { failing([] { throw Error(ErrorKind::PluginFailed, "x.so", "could not"); }); },
                               ErrorKind::PluginFailed),
              "x.so: could not");
    EXPECT_EQ(faultOf([&] { failing([] { raise(SIGSEGV); }); }), "its process died: signal 11 (Segmentation fault)");
}

class Loop : public RobustLoop {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override {
        torque = nominal.q - real.q + filterTorque;
        if (isHeld_) torque *= 2.0;
        return TickStatus::Ok;
    }
    void holdIntegral() override { isHeld_ = true; }
    RobustTraits traits() const override { return {law_}; }

private:
    static LinearErrorLoop makeLaw() {
        LinearErrorLoop law;
        law.kr = vector(1.0);
        law.kp = vector(2.0);
        law.ki = vector(3.0);
        law.integralLimit = vector(4.0);
        law.torqueRate = vector(5.0);
        return law;
    }
    LinearErrorLoop law_ = makeLaw();
    bool isHeld_ = false;
};

class Plant : public RealPlant {
public:
    explicit Plant(bool hasSensors = false) : hasSensors_(hasSensors) {}
    const JointVector* externalTorque() const override { return hasSensors_ ? &state_.q : nullptr; }
    PlantTraits traits() const override { return {hasSensors_ ? Encoder::Counts : Encoder::Exact, 0, {}, hasSensors_}; }
    TickStatus read(std::int64_t& ticksPassed) override {
        ticksPassed = 4;
        state_.qd = vector(4.0);
        return TickStatus::Ok;
    }
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override { state_ = {start.q, start.qd}; }
    const JointState& measured() const override { return state_; }
    const JointState& actual() const override { return state_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        state_.q += torque;
        applied = 0.5 * torque;
        if (state_.q[0] > 10.0) raise(SIGSEGV);
        return TickStatus::Ok;
    }

private:
    bool hasSensors_;
    JointState state_;
};

TEST(IsolatedPlugin, ARobustLoopAnswersAsItWouldHere) {
    const auto plugin = isolate<RobustLoop, Loop>(kDefaultWatchdog_s);
    JointVector torque;
    EXPECT_EQ(plugin->compute({vector(1.0), vector(0.0)}, state(3.0), vector(5.0), torque), TickStatus::Ok);
    const JointVector expected = 2.0 * JointVector::Ones(kJoints) + vector(5.0);
    EXPECT_EQ(torque, expected);
    plugin->holdIntegral();
    plugin->compute({vector(1.0), vector(0.0)}, state(3.0), vector(5.0), torque);
    EXPECT_EQ(torque, JointVector(2.0 * expected));
    const std::optional<LinearErrorLoop> law = plugin->traits().errorLoop;
    ASSERT_TRUE(law);
    EXPECT_EQ(law->kr, vector(1.0));
    EXPECT_EQ(law->torqueRate, vector(5.0));
}

TEST(IsolatedPlugin, APlantAnswersAsItWouldHereAndItsLastStateOutlivesIt) {
    const auto plugin = isolate<RealPlant, Plant>(kDefaultWatchdog_s);
    plugin->reset(state(1.0));
    EXPECT_EQ(plugin->measured().q, vector(1.0));
    JointVector applied;
    EXPECT_EQ(plugin->advance(vector(1.0), applied), TickStatus::Ok);
    EXPECT_EQ(applied, JointVector(0.5 * vector(1.0)));
    EXPECT_EQ(plugin->actual().q, JointVector(2.0 * vector(1.0)));
    EXPECT_EQ(faultOf([&] { plugin->advance(vector(20.0), applied); }),
              "its process died: signal 11 (Segmentation fault)");
    EXPECT_EQ(plugin->measured().q, JointVector(2.0 * vector(1.0)));
    EXPECT_EQ(plugin->externalTorque(), nullptr);
    EXPECT_FALSE(plugin->traits().hasClock);
    EXPECT_EQ(plugin->traits().encoder, Encoder::Exact);
}

TEST(IsolatedPlugin, APlantsClockIsHeardFromHere) {
    const auto plugin = isolate<RealPlant, Plant>(kDefaultWatchdog_s, true);
    EXPECT_TRUE(plugin->traits().hasClock);
    EXPECT_EQ(plugin->traits().encoder, Encoder::Counts);
    plugin->reset(state(1.0));
    std::int64_t passed = 0;
    EXPECT_EQ(plugin->read(passed), TickStatus::Ok);
    EXPECT_EQ(passed, 4);
    EXPECT_EQ(plugin->measured().qd, vector(4.0));
}

TEST(IsolatedPlugin, APlantsExternalTorqueComesAlong) {
    const auto plugin = isolate<RealPlant, Plant>(kDefaultWatchdog_s, true);
    ASSERT_NE(plugin->externalTorque(), nullptr);  // before reset() only that there is one
    plugin->reset(state(1.0));
    EXPECT_EQ(*plugin->externalTorque(), vector(1.0));
    JointVector applied;
    EXPECT_EQ(plugin->advance(vector(1.0), applied), TickStatus::Ok);
    EXPECT_EQ(*plugin->externalTorque(), JointVector(2.0 * vector(1.0)));
}

}  // namespace
}  // namespace viable
