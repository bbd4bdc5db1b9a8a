#include "host/IsolatedPlugin.h"

#include <semaphore.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <tuple>

#include "core/ChildProcess.h"
#include "host/PythonClass.h"
#include "plugin/FaultExplanation.h"
#include "viable/plugin/HostServices.h"

namespace viable {

namespace {

using Clock = std::chrono::steady_clock;

/** Between two looks whether the process still lives. */
constexpr long kLook_ns = 10'000'000;
/** How long a process may take to end by itself when it is no longer needed. */
constexpr double kFarewell_s = 1.0;

constexpr char kOnLoss[] = "Fix the plugin: without --isolate, `gdb --args viable run ...` shows the line.";

enum class Request : int {
    Quit,
    Reset,
    Sample,
    SampleLimits,
    Compute,
    ChangeLimits,
    SkipTicks,
    Filter,
    HoldIntegral,
    ReadPlant,
    Advance,
    AwaitPlant,
};

enum class Reply : int { Done, Threw, ThrewError, Faulted, Raised };

/** What both processes see. The objects hold all their numbers inside themselves, and a fork leaves them at the same
address in both. */
struct Mailbox {
    sem_t request, reply;
    CallSlot slot;  // what the other process does, outside of ticks
    Request what = Request::Quit;
    Reply how = Reply::Done;
    int errorKind = 0;
    char text[2048] = "";
    char explanation[512] = "";  // of explainFault()

    double time = 0.0;
    Tick tick;
    std::int64_t ticks = 0;  // to skip, or passed
    int status = 0;
    bool answer = false;
    std::int64_t ticksDone = 0;                              // by the plugin
    std::int64_t allocatingTicks = 0, firstAllocation = -1;  // as in PluginWatch
    char sharedChange[1024] = "";                            // as in PluginWatch
    MotionState nominal;
    Dynamics dynamics;
    MotionCommand command;
    JointVector torque, torqueOut, accelerationRate;
    bool hasAccelerationRate = false;
    ControllerOutput wanted;
    JointState real, actual;
    JointVector external;
    ContactReport contact;
    JointLimits limits;
    FilterDecision decision;

    // What a plugin is asked once, after it was configured
    std::tuple<CommandTraits, ControllerTraits, FilterTraits, RobustTraits, PlantTraits> traits;
    bool hasExternalTorque = false, hasContact = false;
};

/** The size of a vector that another process wrote: copying one of a wrong size would write over memory. */
bool isSound(const JointVector& v) {
    return v.size() >= 0 && v.size() <= kMaxJoints;
}
bool isSound(const JointState& s) {
    return isSound(s.q) && isSound(s.qd);
}
bool isSound(const JointBounds& b) {
    return isSound(b.lower) && isSound(b.upper);
}
bool isSound(const JointLimits& l) {
    return isSound(l.position) && isSound(l.velocity) && isSound(l.acceleration) && isSound(l.jerk);
}

bool isSound(const LinearErrorLoop& l) {
    return isSound(l.kr) && isSound(l.kp) && isSound(l.ki) && isSound(l.integralLimit) && isSound(l.torqueRate) &&
           isSound(l.motorRate) && isSound(l.friction.figures.coulomb) && isSound(l.friction.figures.viscous) &&
           isSound(l.friction.figures.viscousVelocity) && isSound(l.friction.speed);
}

/** Of what another process wrote. */
template <class Traits>
Traits copySound(const Traits& traits) {
    return traits;
}
/** Where it is nonsense, a law of no size, which is refused. */
RobustTraits copySound(const RobustTraits& traits) {
    if (!traits.errorLoop || isSound(*traits.errorLoop)) return traits;
    return {LinearErrorLoop{}};
}
/** Where it is nonsense, a rate of no arm, which is refused. */
PlantTraits copySound(const PlantTraits& traits) {
    const bool isNonsense = !isSound(traits.motorRate);
    return {traits.encoder, traits.delayTicks,
            isNonsense ? JointVector(JointVector::Constant(1, kNan)) : traits.motorRate, traits.hasClock};
}

timespec calcDeadline(long nanoseconds) {
    timespec deadline;
    clock_gettime(CLOCK_MONOTONIC, &deadline);
    deadline.tv_nsec += nanoseconds;
    deadline.tv_sec += deadline.tv_nsec / 1'000'000'000;
    deadline.tv_nsec %= 1'000'000'000;
    return deadline;
}

/** The plugin's own process, and the calls that go there. */
class PluginProcess {
public:
    PluginProcess(PluginWatch& watch, double watchdog_s) : watch_(watch), watchdog_s_(watchdog_s) {
        sem_init(&box_->request, 1, 0);
        sem_init(&box_->reply, 1, 0);
    }
    ~PluginProcess() {
        if (pid_ > 0) {
            box_->what = Request::Quit;
            sem_post(&box_->request);
            watchdog_s_ = kFarewell_s;
            watch_.lastWords = awaitReply();
            if (watch_.lastWords.empty()) waitpid(pid_, nullptr, 0);
        }
    }
    PluginProcess(const PluginProcess&) = delete;
    PluginProcess& operator=(const PluginProcess&) = delete;

    Mailbox& box() { return *box_; }

    /** Starts the process: `serve` runs there and never returns. Waits for its first reply. */
    template <class Serve>
    void start(const Serve& serve) {
        pid_ = detail::forkChild("for the plugin");
        if (pid_ == 0) {
            for (int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, SIG_IGN);  // the host decides when to end
            for (int signal : detail::kCrashSignals) std::signal(signal, SIG_DFL);      // the host tells of it
            useCallSlot(box_->slot);
            serve(*box_);
            std::fflush(nullptr);
            sem_post(&box_->reply);
            _exit(0);
        }
        finishCall();
        box_->sharedChange[sizeof box_->sharedChange - 1] = '\0';
        watch_.sharedChange = box_->sharedChange;
    }

    /** One call: the mailbox's inputs are written, its outputs are there afterwards. Throws PluginFault. */
    void call(Request what) {
        if (pid_ <= 0) throw PluginFault("its process is gone", kOnLoss);
        box_->what = what;
        sem_post(&box_->request);
        finishCall();
    }

private:
    void finishCall() {
        const std::string lost = awaitReply();
        if (!lost.empty()) {
            pid_ = -1;
            throw PluginFault(lost, kOnLoss);
        }
        watch_.allocatingTicks = box_->allocatingTicks;
        watch_.firstAllocation = box_->firstAllocation;
        box_->explanation[sizeof box_->explanation - 1] = '\0';
        if (box_->explanation[0]) explainFault(box_->explanation);
        if (box_->how == Reply::Done) return;
        box_->text[sizeof box_->text - 1] = '\0';
        const std::string text = box_->text;
        if (box_->how == Reply::Faulted) throw PluginFault(text, kOnArithmeticChange);
        if (box_->how == Reply::Raised) throw PluginFault(text, kOnRaise);
        if (box_->how == Reply::ThrewError)
            throw Error(box_->errorKind == static_cast<int>(ErrorKind::BadInput) ? ErrorKind::BadInput
                                                                                 : ErrorKind::PluginFailed,
                        "", text);
        throw std::runtime_error(text);
    }

    /** Empty: there is a reply. Otherwise why there will be none; the process is gone then. */
    std::string awaitReply() {
        const Clock::time_point begin = Clock::now();
        for (;;) {
            const timespec deadline = calcDeadline(kLook_ns);
            if (sem_clockwait(&box_->reply, CLOCK_MONOTONIC, &deadline) == 0) return {};
            int status = 0;
            const pid_t ended = waitpid(pid_, &status, WNOHANG);
            if (ended == pid_) return detail::describeEnd(status, where());
            if (ended < 0) return "its process is gone";
            const double waited = std::chrono::duration<double>(Clock::now() - begin).count();
            if (waited < watchdog_s_) continue;
            return detail::endOverdue(pid_, watchdog_s_, where());
        }
    }

    /** In which call it is, of those outside of ticks: " in configure()". */
    std::string where() const {
        return box_->slot.watch.load() ? std::string(" ") + nameCall(box_->slot.tick.load()) : std::string();
    }

    const detail::SharedObject<Mailbox> box_ = detail::makeSharedObject<Mailbox>();
    PluginWatch& watch_;
    pid_t pid_ = -1;
    double watchdog_s_;
};

bool isTick(Request what) {
    return what == Request::Sample || what == Request::Compute || what == Request::Filter || what == Request::Advance;
}

/** The other side: runs the plugin's functions and writes down what they throw. */
template <class Work>
void answer(Mailbox& box, const Work& work) {
    PluginCall call(nullptr, kBeforeFirstTick);
    box.how = Reply::Done;
    box.explanation[0] = '\0';
    const std::int64_t before = countAllocations();
    try {
        work();
        std::snprintf(box.explanation, sizeof box.explanation, "%s", detail::readFaultExplanation());
        if (isTick(box.what)) {
            const std::int64_t tick = box.ticksDone++;
            if (tick >= kWarmUpTicks && countAllocations() != before)
                if (box.allocatingTicks++ == 0) box.firstAllocation = tick;
        }
        if (const char* change = call.undoArithmeticChange()) {
            box.how = Reply::Faulted;
            std::snprintf(box.text, sizeof box.text, kArithmeticChange, change);
        }
    } catch (const PluginFault& e) {  // of a class in Python
        box.how = Reply::Raised;
        std::snprintf(box.text, sizeof box.text, "%s", e.what());
    } catch (const Error& e) {
        box.how = Reply::ThrewError;
        box.errorKind = e.exitCode();
        std::snprintf(box.text, sizeof box.text, "%s", e.what());
    } catch (const std::exception& e) {
        box.how = Reply::Threw;
        std::snprintf(box.text, sizeof box.text, "%s", e.what());
    } catch (...) {
        box.how = Reply::Threw;
        std::snprintf(box.text, sizeof box.text, "something other than a std::exception");
    }
}

// A plugin's calls, per kind.

void serve(CommandSource& plugin, Mailbox& box) {
    if (box.what == Request::Sample) {
        box.status = static_cast<int>(plugin.sample(box.time, box.command));
    } else {
        const JointLimits* limits = plugin.sampleLimits(box.time);
        box.answer = limits != nullptr;
        if (limits) box.limits = *limits;
    }
}

void serve(NominalController& plugin, Mailbox& box) {
    box.status = static_cast<int>(plugin.compute({box.command, box.nominal, box.dynamics, box.tick}, box.wanted));
}

void serve(SafetyFilter& plugin, Mailbox& box) {
    if (box.what == Request::Filter) {
        box.decision.clearReports();
        box.status = static_cast<int>(plugin.filter(
            {box.nominal, box.torque, box.dynamics, box.hasAccelerationRate ? &box.accelerationRate : nullptr},
            box.decision));
    } else if (box.what == Request::ChangeLimits) {
        box.answer = plugin.changeLimits(box.limits);
    } else {
        plugin.skipTicks(box.ticks);
    }
}

void serve(RobustLoop& plugin, Mailbox& box) {
    if (box.what == Request::HoldIntegral)
        plugin.holdIntegral();
    else
        box.status = static_cast<int>(plugin.compute(box.real, box.nominal, box.torque, box.torqueOut));
}

void serve(RealPlant& plugin, Mailbox& box) {
    if (box.what == Request::Advance) {
        box.status = static_cast<int>(plugin.advance(box.torque, box.torqueOut));
    } else if (box.what == Request::AwaitPlant) {
        box.status = static_cast<int>(plugin.read(box.ticks));
    } else {
        box.real = plugin.measured();
        box.actual = plugin.actual();
        const JointVector* external = plugin.externalTorque();
        box.external = external ? *external : JointVector();
        if (const ContactReport* contact = plugin.contact()) box.contact = *contact;
    }
}

/** What the five stand-ins have in common. */
template <class Interface>
class Isolated : public Interface {
public:
    Isolated(const std::function<PluginPtr<Interface>()>& make, PluginWatch& watch, double watchdog_s)
        : process_(watch, watchdog_s) {
        process_.start([&make, &watch](Mailbox& box) { run(make, watch, box); });
        traits_ = copySound(std::get<typename Interface::Traits>(box().traits));
    }
    typename Interface::Traits traits() const override { return traits_; }
    void configure(const RunSetup&, const Parameters&) override {}  // `make` did
    void reset(const MotionState& start) override {
        box().nominal = start;
        process_.call(Request::Reset);
    }

protected:
    Mailbox& box() { return process_.box(); }
    void call(Request what) { process_.call(what); }
    /** The plugin's word on its tick; what is none of the enum's words is a fault. */
    TickStatus tickStatus() {
        return box().status >= 0 && box().status <= static_cast<int>(TickStatus::Faulted)
                   ? static_cast<TickStatus>(box().status)
                   : TickStatus::Faulted;
    }

private:
    /** The life of the other process. */
    static void run(const std::function<PluginPtr<Interface>()>& make, PluginWatch& watch, Mailbox& box) {
        PluginPtr<Interface> plugin(nullptr, nullptr);
        answer(box, [&] {
            plugin = make();
            std::snprintf(box.sharedChange, sizeof box.sharedChange, "%s", watch.sharedChange.c_str());
            const PluginCall asking(&watch, kAsking);
            std::get<typename Interface::Traits>(box.traits) = plugin->traits();
            if constexpr (std::is_same_v<Interface, RealPlant>) {
                box.hasExternalTorque = plugin->externalTorque() != nullptr;
                box.hasContact = plugin->contact() != nullptr;
            }
        });
        for (;;) {
            sem_post(&box.reply);
            while (sem_wait(&box.request) != 0) {
            }  // interrupted
            if (box.what == Request::Quit) break;
            answer(box, [&] {
                if (box.what == Request::Reset) {
                    const PluginCall resetting(&watch, kResetting);
                    plugin->reset(box.nominal);
                } else {
                    serve(*plugin, box);
                }
            });
        }
        plugin.reset();
    }

    PluginProcess process_;
    typename Interface::Traits traits_;
};

class IsolatedCommandSource : public Isolated<CommandSource> {
public:
    using Isolated::Isolated;
    TickStatus sample(double t, MotionCommand& out) override {
        box().time = t;
        call(Request::Sample);
        const MotionCommand& command = box().command;
        if (!isSound(command.q) || !isSound(command.qd)) return TickStatus::Faulted;
        out = command;
        return tickStatus();
    }
    const JointLimits* sampleLimits(double t) override {
        box().time = t;
        call(Request::SampleLimits);
        if (!box().answer) return nullptr;
        limits_ = isSound(box().limits) ? box().limits : JointLimits();  // of no size, and refused for it
        return &limits_;
    }

private:
    JointLimits limits_;
};

class IsolatedController : public Isolated<NominalController> {
public:
    using Isolated::Isolated;
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        box().command = input.command;
        box().nominal = input.nominal;
        box().dynamics = input.dynamics;
        box().tick = input.tick;
        box().wanted.hasAccelerationRate = false;
        call(Request::Compute);
        const ControllerOutput& wanted = box().wanted;
        if (!isSound(wanted.torque) || !isSound(wanted.accelerationRate)) return TickStatus::Faulted;
        output = wanted;
        return tickStatus();
    }
};

class IsolatedFilter : public Isolated<SafetyFilter> {
public:
    using Isolated::Isolated;
    bool changeLimits(const JointLimits& limits) override {
        box().limits = limits;
        call(Request::ChangeLimits);
        return box().answer;
    }
    void skipTicks(std::int64_t ticks) override {
        box().ticks = ticks;
        call(Request::SkipTicks);
    }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override {
        box().nominal = input.nominal;
        box().torque = input.torque;
        box().dynamics = input.dynamics;
        box().hasAccelerationRate = input.accelerationRate != nullptr;
        if (input.accelerationRate) box().accelerationRate = *input.accelerationRate;
        call(Request::Filter);
        const FilterDecision& made = box().decision;
        if (!isSound(made.value) || box().status < 0 || box().status > static_cast<int>(FilterStatus::Ended))
            return FilterStatus::Faulted;
        decision = made;
        return static_cast<FilterStatus>(box().status);
    }
};

class IsolatedRobustLoop : public Isolated<RobustLoop> {
public:
    using Isolated::Isolated;
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override {
        box().real = real;
        box().nominal = nominal;
        box().torque = filterTorque;
        box().torqueOut = torque;
        call(Request::Compute);
        if (!isSound(box().torqueOut)) return TickStatus::Faulted;
        torque = box().torqueOut;
        return tickStatus();
    }
    void holdIntegral() override { call(Request::HoldIntegral); }
};

class IsolatedPlant : public Isolated<RealPlant> {
public:
    IsolatedPlant(const std::function<PluginPtr<RealPlant>()>& make, PluginWatch& watch, double watchdog_s)
        : Isolated(make, watch, watchdog_s),
          hasExternalTorque_(box().hasExternalTorque),
          hasContact_(box().hasContact) {}
    TickStatus read(std::int64_t& ticksPassed) override {
        call(Request::AwaitPlant);
        ticksPassed = box().ticks;
        const TickStatus status = tickStatus();
        fetchState();
        return status;
    }
    void reset(const MotionState& start) override {
        Isolated::reset(start);
        fetchState();
    }
    const JointState& measured() const override { return measured_; }
    const JointState& actual() const override { return actual_; }
    const JointVector* externalTorque() const override { return hasExternalTorque_ ? &external_ : nullptr; }
    const ContactReport* contact() const override { return hasContact_ ? &contact_ : nullptr; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        box().torque = torque;
        call(Request::Advance);
        const TickStatus status = tickStatus();
        if (!isSound(box().torqueOut)) return TickStatus::Faulted;
        applied = box().torqueOut;
        fetchState();
        return status;
    }

private:
    void fetchState() {
        call(Request::ReadPlant);
        const bool areSound = isSound(box().real) && isSound(box().actual);
        measured_ = areSound ? box().real : JointState();  // of no size, and refused for it
        actual_ = areSound ? box().actual : JointState();
        external_ = isSound(box().external) ? box().external : JointVector();  // likewise
        contact_ = box().contact;
    }
    JointState measured_, actual_;
    JointVector external_;
    ContactReport contact_;
    bool hasExternalTorque_, hasContact_;
};

/** In the order of their kinds. */
template <class Interface>
using StandIn = std::tuple_element_t<
    static_cast<std::size_t>(detail::kindOf<Interface>()),
    std::tuple<IsolatedCommandSource, IsolatedController, IsolatedFilter, IsolatedRobustLoop, IsolatedPlant>>;

}  // namespace

template <class Interface>
PluginPtr<Interface> isolatePlugin(const std::function<PluginPtr<Interface>()>& make, PluginWatch& watch,
                                   double watchdog_s) {
    Interface* plugin = new StandIn<Interface>(make, watch, watchdog_s);
    return PluginPtr<Interface>(plugin, [](void* object) { delete static_cast<Interface*>(object); });
}

template PluginPtr<CommandSource> isolatePlugin(const std::function<PluginPtr<CommandSource>()>&, PluginWatch&, double);
template PluginPtr<NominalController> isolatePlugin(const std::function<PluginPtr<NominalController>()>&, PluginWatch&,
                                                    double);
template PluginPtr<SafetyFilter> isolatePlugin(const std::function<PluginPtr<SafetyFilter>()>&, PluginWatch&, double);
template PluginPtr<RobustLoop> isolatePlugin(const std::function<PluginPtr<RobustLoop>()>&, PluginWatch&, double);
template PluginPtr<RealPlant> isolatePlugin(const std::function<PluginPtr<RealPlant>()>&, PluginWatch&, double);

}  // namespace viable
