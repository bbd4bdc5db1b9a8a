#include <time.h>

#include <cstdio>

#include "Paths.h"
#include "Properties.h"
#include "Walkers.h"
#include "clearance/CapsuleMotion.h"
#include "filter/WholeArmBrakingFilter.h"
#include "limits/SeparationLimit.h"
#include "robot/Segments.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

namespace {

constexpr double kTick_s = 1e-3, kDuration_s = 20.0;
constexpr int kTicks = static_cast<int>(kDuration_s / kTick_s);
/** Contacts are looked for in steps of 0.1 ms. */
constexpr int kLooks = 10;
constexpr double kAllowed = 1e-12, kAllowedTorque = 1e-8;
constexpr double kTorqueShare = 0.9;
constexpr double kMoves = 0.02;  ///< [rad/s]

/** What this thread has computed for, whatever else the machine does. */
double readThreadTime_us() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return 1e6 * static_cast<double>(time.tv_sec) + 1e-3 * static_cast<double>(time.tv_nsec);
}

/** How people are kept apart from. */
enum class Rule : unsigned char {
    None,      ///< not at all
    Filter,    ///< whole_arm_braking
    Textbook,  ///< a protective stop at S = v_h (T_r + T_s) + v_r T_r + B + C + Z, with the worst stop
};

/** Who is about. */
enum class Scene : unsigned char {
    Crowd,  ///< three or four people close to the arm; in half of the runs they go for it
    Quiet,  ///< one who wanders about in a room of 10 m
    Visit,  ///< one who stands beside the arm, and leaves
};
constexpr double kLeaves_s = 4.0, kVisit_s = 10.0;
constexpr int kRestTicks = 200;  ///< so long an arm that rests for a visitor has rested when he leaves

/** What a run came to. */
struct Outcome {
    std::int64_t tooFast = 0, noChoice = 0, moving = 0, beyondLimits = 0, beyondTorque = 0;
    bool restedForVisitor = false;  ///< when the visitor began to leave
    double goesOn_s = kInfinity;    ///< so long after
    double least = kInfinity;
    double toolPath = 0.0, fastest = 0.0, excess = 0.0;  ///< excess: worst one over a joint limit
    std::vector<double> slowing;                         ///< gap to the nearest person when people begin to act [m]
    std::vector<double> tick_us;
};

/** The Indy7, sent from pose to pose among people who are the same whatever the rule. */
class PeopleRun {
public:
    PeopleRun(const RobotDescription& robot, const ArmGeometry& geometry, RobotModel& model, std::uint64_t seed,
              std::int64_t number, Scene scene, Rule rule, double worstSpeed)
        : robot_(robot),
          geometry_(geometry),
          model_(model),
          scene_(scene),
          rule_(rule),
          worstSpeed_(worstSpeed),
          people_(seed, 2 * number),
          goals_(seed, 2 * number + 1),
          walkers_(people_, makeHabits(number, scene), kTick_s),
          feed_(walkers_.people()),
          checker_(robot, geometry, walkers_.people()),
          motion_(robot, geometry.capsules, listRadii(geometry)),
          pose_(motion_.makePose()) {
        state_.q = robot.home;
        state_.qd.setZero(robot.size());
        state_.qdd.setZero(robot.size());
        goal_ = robot.home;
        // The worst stop of the textbook: from the velocity limit, of the joint that takes longest.
        const JointLimits& l = robot.limits;
        for (int i = 0; i < robot.size(); ++i)
            stop_s_ = std::max(
                stop_s_, l.velocity.upper[i] / l.acceleration.upper[i] + l.acceleration.upper[i] / l.jerk.upper[i]);
    }

    Outcome run() {
        model_.calcDynamics(state_.q, state_.qd, dynamics_);
        walkers_.observe(seen_);
        feed_.put(seen_);
        RunSetup setup{robot_, robot_.limits, kTick_s, kDuration_s, state_, dynamics_.tool, nullptr};
        if (rule_ == Rule::Filter) setup.people = &feed_;
        WholeArmBrakingOptions options;
        options.torqueShare = kTorqueShare;
        filter_.configure(setup, options);
        const int ticks = scene_ == Scene::Visit ? static_cast<int>(kVisit_s / kTick_s) : kTicks;
        for (int tick = 0; tick < ticks; ++tick) this->tick(tick);
        return std::move(outcome_);
    }

private:
    static Walkers::Habits makeHabits(std::int64_t number, Scene scene) {
        Walkers::Habits habits;
        if (scene != Scene::Crowd) {
            habits.most = 1;
            habits.contactChance = habits.targetChance = 0.0;
            habits.slowestOf = 1.0;
            habits.farthest_m = 5.0;
            if (scene == Scene::Quiet) return habits;
            habits.farthest_m = 1.0;
            habits.leaves_s = kLeaves_s;
            habits.shortest_s = habits.longest_s = kTick_s;
            return habits;
        }
        habits.least = 3;
        habits.slowest = 0.5;
        habits.slowestOf = 0.5;
        habits.farthest_m = 1.8;
        habits.targetChance = number % 2 == 0 ? 1.0 : 0.0;  // half of the runs
        return habits;
    }
    static std::vector<double> listRadii(const ArmGeometry& geometry) {
        std::vector<double> radii;
        for (const LinkCapsule& capsule : geometry.capsules) radii.push_back(capsule.radius);
        return radii;
    }

    void tick(int number) {
        if (number > 0) {
            walkers_.observe(seen_);
            feed_.put(seen_);
        }
        model_.calcDynamics(state_.q, state_.qd, dynamics_);
        drawGoal(number);
        const bool isStop = rule_ == Rule::Textbook && isTooNear() && number > 0;
        bool acts = isStop;
        if (isStop) {
            JointVector jerk(state_.q.size());
            for (Eigen::Index i = 0; i < jerk.size(); ++i)
                jerk[i] = decision_.stops[static_cast<std::size_t>(i)].popJerk();
            decision_.holdJerk(jerk);
            filter_.skipTicks(1);
        } else {
            acts |= decide();
        }
        if (acts && !acted_) outcome_.slowing.push_back(findNearest());
        acted_ = acts;
        check();
        const Eigen::Vector3d before = dynamics_.tool.position;
        advanceNominal(decision_, kTick_s, state_);
        checkLimits();
        const bool moves = state_.qd.cwiseAbs().maxCoeff() > kMoves;
        outcome_.moving += moves;
        restTicks_ = moves || !acted_ ? 0 : restTicks_ + 1;
        if (number == static_cast<int>(kLeaves_s / kTick_s)) outcome_.restedForVisitor = restTicks_ >= kRestTicks;
        if (outcome_.restedForVisitor && moves)
            outcome_.goesOn_s = std::min(outcome_.goesOn_s, walkers_.time_s() - kLeaves_s);
        const Dynamics last = dynamics_;
        model_.calcDynamics(state_.q, state_.qd, dynamics_);
        outcome_.toolPath += (dynamics_.tool.position - before).norm();
        walkers_.walk(last.tool.position);
    }

    /** A new pose every 1.5 s. */
    void drawGoal(int number) {
        if (number % 1500 == 0)
            for (int i = 0; i < robot_.size(); ++i) {
                const double lower = std::max(robot_.limits.position.lower[i], -2.0);
                const double upper = std::min(robot_.limits.position.upper[i], 2.0);
                goal_[i] = goals_.uniform(0.8 * lower, 0.8 * upper);
            }
    }

    /** @return  people act */
    bool decide() {
        const JointVector wanted = 60.0 * (goal_ - state_.q) - 15.0 * state_.qd;
        const JointVector torque = dynamics_.M * wanted + dynamics_.b;
        const double begin_us = readThreadTime_us();
        const FilterStatus status = filter_.filter({state_, torque, dynamics_}, decision_);
        outcome_.tick_us.push_back(readThreadTime_us() - begin_us);
        outcome_.noChoice += status > FilterStatus::Recovering;
        HeldMotion motion;
        calcHeldMotion({state_, torque, dynamics_}, FilterStatus::Modified, decision_, kTick_s, motion);
        for (Eigen::Index i = 0; i < motion.torque.size(); ++i)
            outcome_.beyondTorque +=
                std::abs(motion.torque[i]) > kTorqueShare * robot_.actuation.torqueLimit[i] * (1.0 + kAllowedTorque);
        bool acts = false;
        for (int i = 0; i < robot_.size(); ++i)
            acts |= decision_.joints[static_cast<std::size_t>(i)].limit == LimitKind::Separation;
        return acts;
    }

    double calcGap(const PersonObservation& person) {
        double least = kInfinity;
        for (std::size_t k = 0; k < geometry_.capsules.size(); ++k) {
            if (geometry_.capsules[k].carrier < 0) continue;
            for (int j = 0; j < person.count; ++j) {
                const PersonCapsule& body = person.capsules[static_cast<std::size_t>(j)];
                const detail::CapsuleMotion::Segment& segment = pose_.segments[k];
                least = std::min(least, detail::calcSegmentDistance(segment.a, segment.b, body.a, body.b) -
                                            body.radius - geometry_.capsules[k].radius);
            }
        }
        return least;
    }

    double findNearest() {
        motion_.calcPose(state_.q, pose_);
        double least = kInfinity;
        for (std::size_t p = 0; p < walkers_.people().size(); ++p) least = std::min(least, calcGap(seen_.people[p]));
        return least;
    }

    bool isTooNear() {
        motion_.calcPose(state_.q, pose_);
        for (std::size_t p = 0; p < walkers_.people().size(); ++p) {
            const Person& person = walkers_.people()[p];
            const double reaction_s = person.latency_s + walkers_.time_s() - seen_.people[p].stamp_s + kTick_s;
            // Braking evenly from the worst speed takes half of what that speed covers in the time.
            const double S = person.maxSpeed * (reaction_s + stop_s_) + worstSpeed_ * reaction_s +
                             worstSpeed_ * stop_s_ / 2.0 + person.error_m;
            if (calcGap(seen_.people[p]) < S) return true;
        }
        return false;
    }

    void check() {
        bool isTooFast = false;
        for (int k = 0; k < kLooks; ++k) {
            const double t = kTick_s * k / kLooks;
            JointVector q(state_.q.size()), qd(state_.q.size());
            for (Eigen::Index i = 0; i < q.size(); ++i) {
                const AxisState s = viable::advance({state_.q[i], state_.qd[i], state_.qdd[i]}, decision_.value[i], t);
                q[i] = s.p;
                qd[i] = s.v;
            }
            walkers_.place(t, places_);
            const detail::SeparationLimit::Sample found = checker_.find(q, qd, places_, kNominalRest);
            isTooFast |= found.isTooFast;
            outcome_.least = std::min(outcome_.least, found.protective);
        }
        outcome_.tooFast += isTooFast;
        outcome_.fastest = std::max(outcome_.fastest, (dynamics_.J.topRows<3>() * state_.qd).norm());
    }

    void checkLimits() {
        const JointLimits& l = robot_.limits;
        const auto isBeyond = [this](const JointVector& x, const JointBounds& b) {
            const double excess = std::max((x - b.upper).maxCoeff(), (b.lower - x).maxCoeff());
            outcome_.excess = std::max(outcome_.excess, excess);
            return excess > kAllowed;
        };
        outcome_.beyondLimits +=
            isBeyond(state_.q, l.position) || isBeyond(state_.qd, l.velocity) || isBeyond(state_.qdd, l.acceleration);
    }

    const RobotDescription& robot_;
    const ArmGeometry& geometry_;
    RobotModel& model_;
    Scene scene_;
    Rule rule_;
    double worstSpeed_;
    Random people_, goals_;
    Walkers walkers_;
    PeopleFeed feed_;
    detail::SeparationLimit checker_;
    detail::CapsuleMotion motion_;
    detail::CapsuleMotion::Pose pose_;
    WholeArmBrakingFilter filter_;
    MotionState state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector goal_;
    PeopleObservation seen_, places_;
    double stop_s_ = 0.0;
    bool acted_ = false;
    int restTicks_ = 0;
    Outcome outcome_;
};

double findShare(std::vector<double> values, double share) {
    if (values.empty()) return kNan;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

/** Of all runs with one rule. */
struct Total {
    const char* name;
    std::int64_t runs = 0, withContact = 0, tooFast = 0, noChoice = 0, beyondLimits = 0, beyondTorque = 0, moving = 0;
    double least = kInfinity, path = 0.0, excess = 0.0;
    std::vector<double> slowing = {}, tick_us = {};

    void add(const Outcome& o) {
        ++runs;
        withContact += o.tooFast > 0;
        tooFast += o.tooFast;
        noChoice += o.noChoice;
        beyondLimits += o.beyondLimits;
        beyondTorque += o.beyondTorque;
        moving += o.moving;
        least = std::min(least, o.least);
        path += o.toolPath;
        excess = std::max(excess, o.excess);
        slowing.insert(slowing.end(), o.slowing.begin(), o.slowing.end());
        tick_us.insert(tick_us.end(), o.tick_us.begin(), o.tick_us.end());
    }
    void print() const {
        std::printf("  worst excess over a joint limit %.2g rad, rad/s or rad/s^2:\n", excess);
        std::printf(
            "  %-15s runs with a contact that is too fast: %lld of %lld (%lld ticks); least gap %.4g m; moving %.1f %% "
            "of the "
            "time; tool path %.1f m\n                  people begin to act at %.3g m (median); ticks p50 %.0f, p99 "
            "%.0f us\n",
            name, static_cast<long long>(withContact), static_cast<long long>(runs), static_cast<long long>(tooFast),
            least, 100.0 * static_cast<double>(moving) / static_cast<double>(runs * kTicks), path,
            findShare(slowing, 0.5), findShare(tick_us, 0.5), findShare(tick_us, 0.99));
    }
};

/** How soon the arm goes on after somebody for whom it rested has begun to leave. */
struct Visits {
    const char* name;
    std::int64_t runs = 0, rested = 0;
    std::vector<double> goesOn_s = {};

    /** @param othersRested  in the same run with the other rule: only these are compared */
    void add(const Outcome& o, bool othersRested) {
        ++runs;
        rested += o.restedForVisitor;
        if (o.restedForVisitor && othersRested) goesOn_s.push_back(o.goesOn_s);
    }
    double median() const { return findShare(goesOn_s, 0.5); }
    bool isMeaningful() const { return goesOn_s.size() >= 10; }
    void print() const {
        std::printf(
            "  %-15s rested for a visitor in %lld of %lld runs; where both rules did (%zu) it goes on %.2f s after he "
            "began to leave (median; 90 %%: %.2f)\n",
            name, static_cast<long long>(rested), static_cast<long long>(runs), goesOn_s.size(), median(),
            findShare(goesOn_s, 0.9));
    }
};

}  // namespace

bool checkPeopleRuns(const Options& options) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry geometry = loadArmGeometry(robot);
    RobotModel model(robot);
    Options runs = options;
    if (runs.steps == Options().steps) runs.steps = 200;
    Run run("people_runs", runs);
    Total none{"without"}, filter{"filter"}, quiet{"filter, quiet"}, textbook{"textbook, quiet"};
    Visits visits{"filter"}, textbookVisits{"textbook"};
    while (run.nextArm()) {
        run.addSteps(1);
        const auto go = [&](Scene scene, Rule rule, double worstSpeed) {
            return PeopleRun(robot, geometry, model, run.seed(), run.arm(), scene, rule, worstSpeed).run();
        };
        const auto check = [&](const Outcome& kept) {
            if (kept.tooFast) run.fail("somebody is touched too fast", -kept.least);
            if (kept.noChoice) run.fail("a tick without a choice", static_cast<double>(kept.noChoice));
            if (kept.beyondLimits) run.fail("a joint limit is passed", static_cast<double>(kept.beyondLimits));
            if (kept.beyondTorque) run.fail("a torque is beyond its share", static_cast<double>(kept.beyondTorque));
        };
        const Outcome free = go(Scene::Crowd, Rule::None, 0.0);
        none.add(free);
        const Outcome kept = go(Scene::Crowd, Rule::Filter, 0.0), calm = go(Scene::Quiet, Rule::Filter, 0.0);
        check(kept);
        check(calm);
        filter.add(kept);
        quiet.add(calm);
        textbook.add(go(Scene::Quiet, Rule::Textbook, free.fastest));
        const Outcome visited = go(Scene::Visit, Rule::Filter, 0.0);
        check(visited);
        const Outcome asTextbook = go(Scene::Visit, Rule::Textbook, free.fastest);
        visits.add(visited, asTextbook.restedForVisitor);
        textbookVisits.add(asTextbook, visited.restedForVisitor);
    }
    run.print();
    none.print();
    filter.print();
    quiet.print();
    textbook.print();
    visits.print();
    textbookVisits.print();
    std::printf("  tool path with the filter over that with the textbook rule: %.2f; time moving: %.2f\n",
                quiet.path / textbook.path,
                static_cast<double>(quiet.moving) / static_cast<double>(std::max<std::int64_t>(1, textbook.moving)));
    if (visits.isMeaningful() && textbookVisits.isMeaningful() && visits.median() > textbookVisits.median())
        run.fail("after a visit the arm goes on later than with the textbook rule", visits.median());
    // Else the runs would show nothing.
    constexpr std::int64_t kEnoughRuns = 100;
    if (none.runs >= kEnoughRuns && 20 * none.withContact < 19 * none.runs)
        run.fail("without the filter nobody is touched too fast in more than 5 % of the runs",
                 static_cast<double>(none.runs - none.withContact));
    run.expectShare("time moving with the filter over that without", filter.moving, none.moving, 0.1);
    return run.isGood();
}

}  // namespace viable
