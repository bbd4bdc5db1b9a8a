#pragma once

#include "Random.h"
#include "Report.h"
#include "filter/WholeArmBrakingFilter.h"
#include "viable/environment/Surroundings.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** A robot of the project, its model and capsules, read once. */
struct Robot {
    explicit Robot(const char* name);
    Robot(const RobotDescription& d, const ArmGeometry& g) : description(d), geometry(g), model(d) {}
    RobotDescription description;
    ArmGeometry geometry;
    RobotModel model;
};

/** What was wrong in a tick; null: nothing. */
struct Violation {
    const char* what = nullptr;
    double excess = 0.0;
};

/** Position, velocity or acceleration beyond its limit by more than `allowed`. */
Violation checkLimits(const MotionState& state, const JointLimits& limits, double allowed);

/** Wants that change now and then: to and fro, towards a pose, at random, or the tool along a direction, whatever is there. */
class Pusher {
public:
    explicit Pusher(Random& random) : random_(random) {}
    /** Accelerations. */
    JointVector want(const MotionState& state, const Dynamics& dynamics);

private:
    Random& random_;
    JointVector goal_;
    int mode_ = 0, ticksLeft_ = 0;
    double stiffness_ = 1.0;
};

/** An arm of random limits under whole_arm_braking that is pushed about. What is around it and what must hold, a class
derived from it says. */
class PushedArm {
public:
    static constexpr double kTick_s = 1e-3;
    static constexpr double kAllowed = 1e-9, kAllowedTorque = 1e-8;  ///< rounding, as a share of a limit

    std::int64_t passed = 0, stopped = 0, missed = 0, acting = 0, stops = 0;
    bool isRefusedAtRest = false;  ///< a start in which nothing moves and nothing else was in its way

protected:
    PushedArm(Robot& robot, Random& random) : robot_(robot), random_(random), description_(robot.description) {}

    void scaleLimits(double jerk, double acceleration);
    /** Anywhere, or at home; sometimes moving. */
    void drawStart(double movingChance, double largestSpeed, double accelerationPerSpeed);
    void drawOptions(double torqueShareChance, double leastShare);
    /** False: there is no such start. Feeds that are there count. */
    bool configure(int ticks, const ArmGeometry* geometry);

    /** Asks the filter for this tick's decision. */
    FilterStatus decide();
    bool acts(LimitKind kind) const;
    bool misses() { return random_.chance(misses_); }
    /** A tick in which the filter is not asked: the arm goes on along its stop. */
    void followStop();
    void advanceArm() { advanceNominal(decision_, kTick_s, state_); }

    /** The torque that a decision takes. */
    static JointVector findTorque(const MotionState& state, const Dynamics& dynamics, const FilterDecision& decision);
    Violation checkTorque(const JointVector& torque) const;
    /** The state `t` into a tick of this jerk. */
    static MotionState calcState(const MotionState& from, const JointVector& jerk, double t);
    /** The stop of this tick's decision, followed to its end. @param check  (state, its dynamics, jerk): what was wrong */
    template <class Check>
    Violation checkStop(Check&& check) {
        ++stops;
        MotionState s = state_;
        advanceNominal(decision_, kTick_s, s);
        std::array<GridStop, kMaxJoints> left = decision_.stops;
        Dynamics dynamics;
        for (bool moves = true; moves;) {
            robot_.model.calcDynamics(s.q, s.qd, dynamics);
            FilterDecision next;
            next.holdJerk(popJerks(left, moves));
            if (const Violation violation = check(s, dynamics, next); violation.what) return violation;
            advanceNominal(next, kTick_s, s);
        }
        return {};
    }

    Robot& robot_;
    Random& random_;
    RobotDescription description_;
    WholeArmBrakingOptions options_;
    std::unique_ptr<SurroundingsFeed> surroundingsFeed_;
    std::unique_ptr<PeopleFeed> peopleFeed_;
    std::optional<RunSetup> setup_;
    WholeArmBrakingFilter filter_;  // what it was given outlives it
    MotionState state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector torque_;
    double misses_ = 0.0;  ///< share of ticks

private:
    /** @param moves  becomes false where all stops have ended */
    JointVector popJerks(std::array<GridStop, kMaxJoints>& left, bool& moves) const;

    Pusher pusher_{random_};
};

/** What became of the arms of a run. */
struct PushedArms {
    std::int64_t ticks = 0, begun = 0, refused = 0, passed = 0, stopped = 0, missed = 0, acting = 0, stops = 0;

    /** Pushes arms about until the run has its steps. @param add  (arm): takes its other counts */
    template <class Case, class Add>
    void push(Run& run, int ticksPerArm, const Add& add) {
        Robot robots[] = {Robot("indy7"), Robot("panda"), Robot("ur5e")};
        while (run.nextArm()) {
            Random random(run.seed(), run.arm());
            Robot& robot = robots[random.integer(0, 2)];
            const std::string& name = robot.description.name;
            std::unique_ptr<Case> arm;
            while (true) {
                arm = std::make_unique<Case>(robot, random);
                if (arm->begin()) break;
                ++refused;
                if (arm->isRefusedAtRest) run.fail((name + " at rest is refused").c_str(), 1.0);
            }
            ++begun;
            for (int tick = 0; tick < ticksPerArm; ++tick) {
                const Violation violation = arm->tick(tick);
                run.addSteps(robot.description.size());
                ++ticks;
                if (!violation.what) continue;
                run.fail((name + " at tick " + std::to_string(tick) + ": " + violation.what).c_str(), violation.excess);
                break;
            }
            passed += arm->passed;
            stopped += arm->stopped;
            missed += arm->missed;
            acting += arm->acting;
            stops += arm->stops;
            add(*arm);
        }
        run.print();
    }
    double stoppedPercent() const { return 100.0 * static_cast<double>(stopped) / static_cast<double>(ticks); }
};

}  // namespace viable
