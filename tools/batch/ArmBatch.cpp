#include "batch/ArmBatch.h"

#include "config/Draws.h"
#include "core/AtOnce.h"
#include "core/ErrorParts.h"
#include "environment/ArmSurroundings.h"
#include "experiment/CaseBlocks.h"
#include "experiment/CaseChecks.h"
#include "filter/JointBraking.h"
#include "filter/WholeArmBrakingFilter.h"
#include "host/FloatingPointGuard.h"
#include "loop/GuardSetup.h"
#include "loop/PathExtent.h"
#include "robot/ArmRecursion.h"
#include "tracking/ToolFollower.h"
#include "viable/loop/NominalPlant.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

const char* const kArmBatch = "ArmBatch";
constexpr int kMaxArms = 1'000'000;
/** Arms that a thread takes at a time; those that keep clearances take fifteen times as long. */
constexpr int kChunk = 16, kWholeArmChunk = 1;
/** Fewer arm-ticks than this are not worth another thread, whose start takes as long as some of them. */
constexpr std::int64_t kWorthAThread = 64, kWholeArmWorthAThread = 1;
/** How well margins are known, as a share of the limit. */
constexpr double kMarginShare = 1e-6;

std::string nameArm(int arm) {
    return "arm " + std::to_string(arm);
}

/** Arithmetic as it usually is, in this thread and as long as this lives: other libraries of the process may have made it
round otherwise or flush denormals. */
class UsualArithmetic {
public:
    UsualArithmetic() { std::fesetenv(FE_DFL_ENV); }

private:
    FloatingPointGuard guard_;  // sets back
};

/** The real arm of one nominal one. */
struct RealArm {
    explicit RealArm(RunSetup given) : setup(std::move(given)) {}
    RunSetup setup;
    PluginPtr<RealPlant> plant{nullptr, nullptr};
    Nric nric;
    detail::Authority authority;
    JointVector robust;     // added in the tick before [Nm]
    JointVector motors;     // what was asked of them then [Nm]; of size 0 before the first
    JointVector motorStep;  // largest change of that; of size 0: any
};

/** The filter of an arm that keeps clear of what is around. */
struct WholeArm {
    explicit WholeArm(std::shared_ptr<const Surroundings> surroundings) : feed(std::move(surroundings)) {}
    SurroundingsFeed feed;  // a filter takes from its own
    WholeArmBrakingFilter filter;
    std::array<GridStop, kMaxJoints> stops;  // held ready
};

/** What a thread works with. */
struct Scratch {
    MotionState nominal;
    Dynamics dynamics;
    JointVector torque, rate, jerk, applied;
    FilterDecision decision;
    HeldMotion motion;
    // What the action is:
    JointVector action;
    MotionState target;
    Pose tool;
    bool isUsable = false;

    JointState measured;
};

/** What a plant measured; false, and `out` is as it was: it threw, or the reading is of the wrong size. */
bool read(const RealArm& real, JointState& out) {
    try {
        const JointState& measured = real.plant->measured();
        const int n = real.setup.size();
        if (measured.q.size() != n || measured.qd.size() != n) return false;
        out = measured;
        return true;
    } catch (...) {  // a plugin's; it must not end the thread
        return false;
    }
}

/** The real arm's tick; false: it failed. */
bool drive(RealArm& real, Scratch& s) {
    const int n = real.setup.size();
    if (!read(real, s.measured) || !isFinite(s.measured, n)) return false;
    try {
        real.authority.update(s.nominal, s.measured);
        if (real.nric.compute(s.measured, s.nominal, s.motion.torque, real.robust) != TickStatus::Ok) return false;
        const bool isCut = real.authority.cut(s.motion.torque, real.robust);
        if (isCut && real.motorStep.size() > 0 && real.motors.size() > 0)
            detail::limitMotorStep(s.motion.torque, real.motors, real.motorStep, real.robust);
        real.motors = s.motion.torque + real.robust;
        return real.plant->advance(real.motors, s.applied) == TickStatus::Ok && isFinite(s.applied, n);
    } catch (...) {  // a plugin's; it must not end the thread
        return false;
    }
}

}  // namespace

struct ArmBatch::Impl {
    Impl(RobotDescription description, int armCount, double tick, ArmBatchOptions given)
        : robot(std::move(description)),
          options(std::move(given)),
          tick_s(tick),
          n(robot.size()),
          arms(armCount),
          isTool(options.action == BatchAction::ToolPose || options.action == BatchAction::ToolPosition),
          width(options.action == BatchAction::ToolPose       ? 7
                : options.action == BatchAction::ToolPosition ? 3
                                                              : n),
          setup(detail::makeGuardSetup(kArmBatch, robot, tick, options.limits)),
          recursion(std::make_shared<const ArmRecursion>(robot)),
          freedom(robot, setup.limits) {
        if (arms < 1 || arms > kMaxArms)
            throw badInput(kArmBatch, std::to_string(arms) + " arms; allowed is 1 to " + std::to_string(kMaxArms),
                           "Give the number of arms.");
        if (options.threads < 0)
            throw badInput("ArmBatchOptions::threads", std::to_string(options.threads) + "; allowed is 0 and more",
                           "0: one per core.");
        if (!options.environment) detail::refuseSpeedLimits(kArmBatch, robot);
        requireJerkLimits(setup.limits, kArmBatch, kArmBatch, "Set them in ArmBatchOptions::limits.");
        if (options.action == BatchAction::Target) {  // as in ReferenceGuard
            options.filter.objective = Objective::Joint;
            options.filter.gamma = std::min(options.filter.gamma, 1.0 / tick_s);
            still.M.setIdentity(n, n);
            still.b.setZero(n);
            still.gravity.setZero(n);
            still.J.setZero(6, n);
            servos.resize(count(arms));
        }
        if (isTool) tools.resize(count(arms));
        if (options.environment) {
            checkEnvironment(*options.environment);
            detail::refusePeople("ArmBatchOptions::environment", *options.environment, "arms in a batch keep");
            geometry = loadArmGeometry(robot);
            surroundings = makeSurroundings(*options.environment, robot, *geometry, setup.limits);
            for (int arm = 0; arm < arms; ++arm) wholeArms.push_back(std::make_unique<WholeArm>(surroundings));
        }
        limits.assign(count(arms), setup.limits);
        laws.resize(count(arms));
        for (std::vector<double>* values : {&state.q, &state.qd, &state.qdd, &state.jerk, &state.torque, &state.margin})
            values->assign(count(arms) * count(n), 0.0);
        state.acting.assign(count(arms) * count(n), 0);
        state.status.assign(count(arms), GuardStatus::NotStarted);
        state.clearance.assign(count(arms), kNan);
        ticks.assign(count(arms), 0);
        if (options.action == BatchAction::Torque)
            requireDynamics(robot, "ArmBatchOptions::action", "an arm moved by torques");
        if (!options.plant.empty()) {
            requireDynamics(robot, "ArmBatchOptions::plant", "a real arm that takes torques");
            makePlants();
        }
        const JointVector zero = JointVector::Zero(n);
        RunSetup atHome = setup;
        detail::checkGuardStart(kArmBatch, {robot.home, zero, zero}, atHome);
        std::vector<int> all(count(arms));
        for (int arm = 0; arm < arms; ++arm) all[arm] = arm;
        reset(all, std::vector<MotionState>(count(arms), {robot.home, zero, zero}));
    }

    static std::size_t count(int i) { return static_cast<std::size_t>(i); }
    auto row(std::vector<double>& values, int arm) {
        return Eigen::Map<Eigen::VectorXd>(&values[count(arm) * count(n)], n);
    }

    void makePlants() {
        const PluginLoader loader(options.pluginPath);
        const ConfigNode written = parseConfig("real_plant: " + options.plant + "\n", "ArmBatchOptions::plant");
        for (const DrawnKey& key : listDraws(written)) draws[key.keyPath];
        std::map<int, std::pair<LinearErrorLoop, detail::AuthoritySizes>> loops;  // by delay
        for (int arm = 0; arm < arms; ++arm) {
            ConfigNode drawn = written;
            for (auto& [key, value] : resolveDraws(drawn, {options.seed, arm})) draws[key].push_back(value);
            const PluginChoice choice = detail::readPlugin(*drawn.find("real_plant"), PluginKind::RealPlant, loader, n);
            auto one = std::make_unique<RealArm>(setup);
            one->setup.limits = limits[arm];
            one->plant = PluginLoader::create<RealPlant>(choice.plugin);
            one->plant->configure(one->setup, choice.parameters);
            if (one->plant->traits().hasClock)
                throw badInput("ArmBatchOptions::plant", "the plant " + choice.plugin.name + " makes its own ticks",
                               "Use a simulated one, such as simbody.");
            const PlantTraits told = one->plant->traits();
            detail::checkTold(told, n, "the plant " + choice.plugin.name);
            one->setup.delayTicks = told.delayTicks;
            auto found = loops.find(one->setup.delayTicks);
            if (found == loops.end()) {
                LinearErrorLoop scaled = scaleGains(robot, setup.limits, tick_s, one->setup.delayTicks);
                detail::AuthoritySizes sizes = detail::calcAuthority(setup, &scaled, nullptr);
                found = loops.emplace(one->setup.delayTicks, std::pair(std::move(scaled), std::move(sizes))).first;
            }
            const auto& [loop, sizes] = found->second;
            NricOptions nric{loop.kr, loop.kp, loop.ki};
            nric.inertiaRate = loop.inertiaRate;
            if (told.motorRate.size() > 0) nric.motorRate = told.motorRate;
            one->nric.configure(one->setup, nric);
            one->authority = detail::Authority(one->setup, sizes);
            one->motorStep = told.motorRate * tick_s;
            real.push_back(std::move(one));
        }
        for (std::vector<double>* values : {&state.realQ, &state.realQd, &state.motorTorque})
            values->assign(count(arms) * count(n), 0.0);
    }

    /** Throws for a start that cannot be. */
    void configure(WholeArm& whole, const CertifiedBrakingOptions& joints, RunSetup& at) const {
        at.geometry = &*geometry;
        at.surroundings = &whole.feed;
        WholeArmBrakingOptions chosen;
        chosen.joints = joints;
        whole.filter.configure(at, chosen, "ArmBatchOptions::filter");
    }

    /** Throws for a start that cannot be. */
    void check(int arm, const MotionState& start, const CertifiedBrakingOptions& joints, RunSetup& at) const {
        if (!isFinite(start, n))
            throw badInput(nameArm(arm), "its start is of the wrong size or not finite",
                           "Give " + std::to_string(n) + " finite numbers.");
        for (const JointVector* v : {&start.q, &start.qd, &start.qdd})
            if (v->lpNorm<Eigen::Infinity>() > kLargestLimit)
                throw badInput(nameArm(arm), "its start is beyond 1e7 rad, rad/s or rad/s^2", "Check its unit.");
        at.limits = limits[arm];
        at.start = start;
        try {
            if (surroundings) {
                WholeArm checked(surroundings);
                configure(checked, joints, at);
            } else {
                detail::JointBraking().configure(at, joints, "ArmBatchOptions::filter");
            }
        } catch (const Error& e) {
            const ErrorParts parts = getParts(e);
            throw Error(e.kind(), nameArm(arm) + ": " + parts.place, parts.cause, parts.remedy);
        }
    }

    void checkNamed(const std::vector<int>& which, const std::vector<MotionState>& starts) const {
        if (which.size() != starts.size())
            throw badInput("ArmBatch::reset",
                           std::to_string(starts.size()) + " starts for " + std::to_string(which.size()) + " arms",
                           "Give one start for each arm.");
        for (const int arm : which)
            if (arm < 0 || arm >= arms)
                throw badInput("ArmBatch::reset", "there is no arm " + std::to_string(arm),
                               "They are numbered from 0 to " + std::to_string(arms - 1) + ".");
    }

    void reset(const std::vector<int>& which, const std::vector<MotionState>& starts) {
        checkNamed(which, starts);
        RunSetup at = setup;
        for (std::size_t i = 0; i < which.size(); ++i) check(which[i], starts[i], options.filter, at);
        std::exception_ptr first;
        for (std::size_t i = 0; i < which.size(); ++i) {
            try {
                put(which[i], starts[i], at);
            } catch (...) {
                if (!first) first = std::current_exception();
            }
        }
        if (first) std::rethrow_exception(first);
    }

    /** Calls work(begin, end) for all items, `chunk` at a time, in threads. */
    template <class Work>
    void share(int items, int chunk, std::int64_t mostThreads, const Work& work) const {
        const auto workChunk = [&](std::size_t k) {
            const UsualArithmetic usual;
            const int begin = static_cast<int>(k) * chunk;
            work(begin, std::min(items, begin + chunk));
        };
        detail::forEachAtOnce(count((items + chunk - 1) / chunk), workChunk,
                              std::min(threads, static_cast<std::size_t>(mostThreads)));
    }

    void put(int arm, const MotionState& start, RunSetup& at) {
        at.limits = limits[arm];
        at.start = start;
        laws[arm].configure(at, options.filter, "ArmBatchOptions::filter");
        if (!servos.empty()) {
            servos[arm].configure(at.limits, tick_s);
            servos[arm].reset(start);
        }
        ticks[arm] = 0;
        state.clearance[arm] = kNan;
        Dynamics dynamics;
        recursion->calcDynamics(start.q, start.qd, dynamics);
        if (surroundings) {
            WholeArm& whole = *wholeArms[arm];
            configure(whole, options.filter, at);
            for (int i = 0; i < n; ++i) whole.stops[i] = laws[arm].braking().stop(i);
        }
        if (isTool) {
            ToolFollowerOptions tool;
            tool.reference.rotationLength_m =
                options.action == BatchAction::ToolPose ? freedom.calcRotationLength(dynamics.J) : 0.0;
            tools[arm].configure(robot, at.limits, tick_s, start, tool, geometry ? &*geometry : nullptr, recursion);
        }
        row(state.q, arm) = start.q;
        row(state.qd, arm) = start.qd;
        row(state.qdd, arm) = start.qdd;
        row(state.jerk, arm).setZero();
        JointVector torque;
        calcInverseDynamics(dynamics, start.qdd, torque);
        row(state.torque, arm) = torque;
        std::fill_n(&state.acting[count(arm) * count(n)], n, static_cast<signed char>(0));
        fillMargins(arm);
        state.status[arm] = GuardStatus::Failed;  // until its plant, too, is there
        if (!real.empty()) {
            RealArm& one = *real[arm];
            one.plant->reset(start);
            one.nric.reset(start);
            one.authority.reset();
            one.authority.widen(at.limits);
            one.robust.setZero(n);
            one.motors.resize(0);
            JointState measured;
            if (!read(one, measured))
                throw Error(ErrorKind::PluginFailed, nameArm(arm),
                            "its plant gave no reading of " + std::to_string(n) + " joints",
                            "measured() gives one number per joint, also after reset(), and does not throw.");
            row(state.realQ, arm) = measured.q;
            row(state.realQd, arm) = measured.qd;
            row(state.motorTorque, arm) = torque;
        }
        state.status[arm] = GuardStatus::NotStarted;
    }

    void changeLimits(const std::vector<int>& which, const std::vector<JointLimits>& to) {
        if (which.size() != to.size())
            throw badInput("ArmBatch::changeLimits",
                           std::to_string(to.size()) + " limits for " + std::to_string(which.size()) + " arms",
                           "Give one JointLimits for each arm.");
        for (std::size_t i = 0; i < which.size(); ++i) {
            const std::string place = nameArm(which[i]);
            if (which[i] < 0 || which[i] >= arms)
                throw badInput("ArmBatch::changeLimits", "there is no " + place,
                               "They are numbered from 0 to " + std::to_string(arms - 1) + ".");
            if (to[i].size() != n)
                throw badInput(
                    place, "limits of " + std::to_string(to[i].size()) + " joints; the robot has " + std::to_string(n),
                    "Give each bound one number per joint; infinity where there is none.");
            checkLimits(to[i], tick_s, robot.allowLargeAngles, place, robot.jointNames());
            requireJerkLimits(to[i], place, kArmBatch, "Give a jerk limit for every joint and side.");
        }
        for (std::size_t i = 0; i < which.size(); ++i) {
            const std::size_t arm = count(which[i]);
            limits[arm] = to[i];
            laws[arm].changeLimits(to[i]);
            if (surroundings) wholeArms[arm]->filter.changeLimits(to[i]);
            if (!servos.empty()) servos[arm].changeLimits(to[i]);
            if (isTool) tools[arm].changeLimits(to[i]);
            if (!real.empty()) real[arm]->authority.widen(to[i]);
            fillMargins(which[i]);
        }
    }

    void fillMargins(int arm) {
        for (int i = 0; i < n; ++i) {
            const std::size_t at = count(arm) * count(n) + count(i);
            const AxisLimits axis = limits[arm].axis(i);
            const double resolution = kMarginShare * calcLimitScale(axis.positionLower, axis.positionUpper);
            const detail::PathExtent::Accuracy position{axis.positionLower, axis.positionUpper, resolution, resolution};
            const GridStop& stop = surroundings ? wholeArms[arm]->stops[i] : laws[arm].braking().stop(i);
            const detail::PathExtent::Accuracy velocity{-kInfinity, kInfinity, kInfinity, kInfinity};
            detail::PathExtent path(state.q[at], state.qd[at], state.qdd[at], position, velocity);
            for (int k = 0; k < GridStop::kSegments; ++k) {
                const GridStop::Segment segment = stop.remaining(k);
                if (segment.ticks > 0) path.follow(segment.jerk, static_cast<double>(segment.ticks) * tick_s);
            }
            state.margin[at] =
                std::min(axis.positionUpper - path.position.upper, path.position.lower - axis.positionLower);
        }
    }

    void stepArm(int arm, const double* actions, int substeps, Scratch& s) {
        GuardStatus& status = state.status[arm];
        if (status == GuardStatus::Failed) return;
        readAction(actions + count(arm) * count(width), s);
        s.nominal = {row(state.q, arm), row(state.qd, arm), row(state.qdd, arm)};
        s.torque = s.jerk = JointVector::Zero(n);
        std::fill_n(&state.acting[count(arm) * count(n)], n, static_cast<signed char>(0));
        status = GuardStatus::Passed;
        for (int i = 0; i < substeps && status != GuardStatus::Failed; ++i)
            status = std::max(status, tick(arm, s, i + 1 == substeps));
        row(state.q, arm) = s.nominal.q;
        row(state.qd, arm) = s.nominal.qd;
        row(state.qdd, arm) = s.nominal.qdd;
        row(state.jerk, arm) = s.jerk;
        row(state.torque, arm) = s.motion.torque;
        if (!real.empty()) {
            if (read(*real[arm], s.measured)) {
                row(state.realQ, arm) = s.measured.q;
                row(state.realQd, arm) = s.measured.qd;
            } else {
                status = GuardStatus::Failed;
            }
            if (status != GuardStatus::Failed) row(state.motorTorque, arm) = s.applied;
        }
        fillMargins(arm);
    }

    /** s.isUsable false: it is of no use. */
    void readAction(const double* action, Scratch& s) const {
        s.action = Eigen::Map<const Eigen::VectorXd>(action, width);
        const bool isPlace = options.action == BatchAction::Target || isTool;
        s.isUsable = s.action.allFinite() &&
                     s.action.lpNorm<Eigen::Infinity>() <= (isPlace ? kLargestLimit : kLargestAcceleration);
        if (isTool) {
            s.tool = Pose();
            s.tool.position = s.action.head<3>();
            if (options.action == BatchAction::ToolPose) s.tool.orientation.coeffs() = s.action.segment<4>(3);
            s.isUsable = s.isUsable && normalise(s.tool);
        } else {
            s.target = {s.action, JointVector::Zero(n), JointVector::Zero(n)};
        }
    }

    /** What the arm shall do in the coming tick. */
    FilterInput wish(int arm, Scratch& s) {
        switch (options.action) {
            case BatchAction::Target:
                servos[arm].calc(s.nominal, s.target, s.rate);
                return {s.nominal, s.nominal.qdd, still, &s.rate};
            case BatchAction::ToolPose:
            case BatchAction::ToolPosition:
                tools[arm].calc(s.nominal, s.tool, surroundings.get(), static_cast<double>(ticks[arm]) * tick_s,
                                s.rate);
                calcInverseDynamics(s.dynamics, s.nominal.qdd, s.torque);
                return {s.nominal, s.torque, s.dynamics, &s.rate};
            case BatchAction::Acceleration:
                calcInverseDynamics(s.dynamics, s.action, s.torque);
                break;
            case BatchAction::Torque:
                s.torque = s.action;
                break;
        }
        return {s.nominal, s.torque, s.dynamics, nullptr};
    }

    /** Chooses s.jerk. False: the numbers are beyond all arithmetic, and nothing is chosen. */
    bool decide(int arm, Scratch& s, FilterStatus& status) {
        const FilterInput input = wish(arm, s);
        if (!surroundings) {
            detail::JointBraking& law = laws[arm];
            if (law.findDesired(input) != FilterStatus::Passed) return false;
            status = law.braking().choose(s.nominal, law.findMetric(input.dynamics), law.desired(), s.jerk,
                                          s.decision.joints);
            return true;
        }
        WholeArm& whole = *wholeArms[arm];
        const FilterStatus answer = whole.filter.filter(input, s.decision);
        if (answer == FilterStatus::InvalidInput || answer == FilterStatus::Faulted) return false;
        status = answer == FilterStatus::StoppedByPlan ? FilterStatus::Modified : answer;
        s.jerk = s.decision.value;
        whole.stops = s.decision.stops;
        const LimitReport& nearest = s.decision.reports[LimitKind::Clearance];
        state.clearance[arm] = nearest.isKnown ? nearest.margin : kNan;
        return true;
    }

    /** Follows the stop that is held ready: s.jerk. */
    void brake(int arm, Scratch& s) {
        if (surroundings) {
            WholeArm& whole = *wholeArms[arm];
            s.jerk.resize(n);
            for (int i = 0; i < n; ++i) s.jerk[i] = whole.stops[i].popJerk();
            whole.filter.skipTicks(1);
        } else {
            laws[arm].braking().getStored(s.jerk);
            laws[arm].skipTicks(1);
        }
        if (!servos.empty()) servos[arm].skipTicks(1);
        if (isTool) tools[arm].skipTicks(1);
        s.decision.joints = {};
    }

    /** @param isLast  of a step */
    GuardStatus tick(int arm, Scratch& s, bool isLast) {
        // Targets need none; of the last tick the torque is told.
        const bool needsDynamics = options.action != BatchAction::Target || !real.empty() || isLast;
        if (needsDynamics) recursion->calcDynamics(s.nominal.q, s.nominal.qd, s.dynamics);

        FilterStatus status = FilterStatus::StoppedByPlan;
        if (!s.isUsable || !decide(arm, s, status)) brake(arm, s);
        ++ticks[arm];
        s.decision.holdJerk(s.jerk);
        for (int i = 0; i < n; ++i) {
            const JointIntervention& joint = s.decision.joints[i];
            if (joint.limit != LimitKind::None)
                state.acting[count(arm) * count(n) + count(i)] =
                    static_cast<signed char>(static_cast<int>(joint.limit) * (joint.side == LimitSide::Lower ? -1 : 1));
        }

        GuardStatus answer = status == FilterStatus::Passed       ? GuardStatus::Passed
                             : status == FilterStatus::Modified   ? GuardStatus::Limited
                             : status == FilterStatus::Recovering ? GuardStatus::Recovering
                                                                  : GuardStatus::Waiting;
        if (needsDynamics)
            calcHeldMotion({s.nominal, s.torque, s.dynamics, nullptr}, status, s.decision, tick_s, s.motion);
        if (!real.empty() && !drive(*real[arm], s)) answer = GuardStatus::Failed;
        advanceNominal(s.decision, tick_s, s.nominal);
        return answer;
    }

    RobotDescription robot;
    ArmBatchOptions options;
    const double tick_s;
    const int n, arms;
    const bool isTool;  // the action
    const int width;    // numbers of an action
    const std::size_t threads = options.threads > 0 ? count(options.threads) : detail::countCores();  // at most
    const RunSetup setup;
    const std::shared_ptr<const ArmRecursion> recursion;  // of all nominal arms
    const ToolFreedom freedom;
    Dynamics still;  // of unit inertias, for jerks
    std::vector<JointLimits> limits;
    std::vector<detail::JointBraking> laws;
    std::vector<Servo> servos;
    std::vector<ToolFollower> tools;
    std::vector<std::int64_t> ticks;  // since the arm's last reset
    std::optional<ArmGeometry> geometry;
    std::shared_ptr<const Surroundings> surroundings;
    std::vector<std::unique_ptr<WholeArm>> wholeArms;  // none without an environment
    std::vector<std::unique_ptr<RealArm>> real;
    std::map<std::string, std::vector<std::string>> draws;
    ArmBatchState state;
};

ArmBatch::ArmBatch(RobotDescription robot, int arms, double tick_s, ArmBatchOptions options) {
    const UsualArithmetic usual;
    impl_ = std::make_unique<Impl>(std::move(robot), arms, tick_s, std::move(options));
}
ArmBatch::~ArmBatch() = default;
ArmBatch::ArmBatch(ArmBatch&&) noexcept = default;
ArmBatch& ArmBatch::operator=(ArmBatch&&) noexcept = default;

int ArmBatch::size() const {
    return impl_->arms;
}
int ArmBatch::joints() const {
    return impl_->n;
}
int ArmBatch::actionSize() const {
    return impl_->width;
}
double ArmBatch::tick_s() const {
    return impl_->tick_s;
}
const JointLimits& ArmBatch::limits(int arm) const {
    return impl_->limits.at(Impl::count(arm));
}
const ArmBatchState& ArmBatch::state() const {
    return impl_->state;
}
const std::map<std::string, std::vector<std::string>>& ArmBatch::draws() const {
    return impl_->draws;
}
void ArmBatch::reset(const std::vector<int>& arms, const std::vector<MotionState>& starts) {
    const UsualArithmetic usual;
    impl_->reset(arms, starts);
}

std::vector<int> ArmBatch::findUnusable(const std::vector<int>& arms, const std::vector<MotionState>& starts) const {
    const UsualArithmetic usual;
    const Impl& in = *impl_;
    in.checkNamed(arms, starts);
    std::vector<char> isUnusable(arms.size(), 0);
    in.share(static_cast<int>(arms.size()), 1, static_cast<std::int64_t>(arms.size()), [&](int begin, int end) {
        RunSetup at = in.setup;
        CertifiedBrakingOptions strict = in.options.filter;
        strict.recovery = false;
        for (int i = begin; i < end; ++i) {
            try {
                in.check(arms[i], starts[i], strict, at);
            } catch (const Error&) {
                isUnusable[i] = 1;
            }
        }
    });
    std::vector<int> found;
    for (std::size_t i = 0; i < arms.size(); ++i)
        if (isUnusable[i]) found.push_back(static_cast<int>(i));
    return found;
}

void ArmBatch::changeLimits(const std::vector<int>& arms, const std::vector<JointLimits>& limits) {
    const UsualArithmetic usual;
    impl_->changeLimits(arms, limits);
}

void ArmBatch::step(const double* actions, int ticks) {
    Impl& in = *impl_;
    if (ticks < 1) throw badInput("ArmBatch::step", std::to_string(ticks) + " ticks", "Give 1 or more.");
    const std::int64_t worth =
        (static_cast<std::int64_t>(in.arms) * ticks) / (in.surroundings ? kWholeArmWorthAThread : kWorthAThread);
    in.share(in.arms, in.surroundings ? kWholeArmChunk : kChunk, worth, [&](int begin, int end) {
        Scratch scratch;
        for (int arm = begin; arm < end; ++arm) {
            try {
                in.stepArm(arm, actions, ticks, scratch);
            } catch (...) {  // it stands where it was; the others go on
                in.state.status[arm] = GuardStatus::Failed;
            }
        }
    });
}

}  // namespace viable
