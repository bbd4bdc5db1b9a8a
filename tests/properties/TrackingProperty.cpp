#include <chrono>

#include "DisturbedArm.h"
#include "ErrorResponse.h"
#include "Properties.h"
#include "Random.h"
#include "TrackingSubjects.h"
#include "core/Text.h"
#include "robot/PoseSampling.h"
#include "viable/braking/Servo.h"

namespace viable {

namespace {

/** Steps of the integrator in a tick; where a run is the worst so far it is repeated with twice as many. */
constexpr int kSteps = 4;
/** What half the step may change, as a share of the bound. */
constexpr double kIntegratorError = 0.01;
/** Some run with the nominal arm at rest comes so near to the bound, or the adversary is weak; with each robot, too, once so
many runs, of one joint each, were made. */
constexpr double kReached = 0.85;
constexpr int kJudgedRuns = 4;
/** The past that a response knows, at most; what is older counts as that [ticks]. */
constexpr int kLongestMemory = 40000, kMovingMemory = 3000;
/** Of the whole effect of pushes, how much of the past must make; the rest is very old. */
constexpr double kEffect = 0.95;
/** Motions of an arm that moves; one that rests, rests in the worst pose. */
constexpr int kMotions = 5;

/** One robot under one kind of disturbance, and how near to its bound the runs came. */
struct Scenario {
    const Subject* subject;
    Kind kind;
    bool isMoving;
    JointLimits limits;
    DisturbanceSet set;
    NricOptions gains;
    std::optional<TrackingBound> bound;
    std::string refusal;
    double bound_s = 0.0;  ///< that its calculation took

    struct Record {
        double ratio = 0.0, integratorError = 0.0;
        std::int64_t arm = 0;
        int joint = 0;
        const char* where = "";
    };
    std::array<Record, 3> worst;  // position, velocity, position as the encoders show it
    std::int64_t runs = 0;

    Scenario(const Subject& of, Kind kind_, bool moves)
        : subject(&of), kind(kind_), isMoving(moves), limits(of.limits), set(select(of.all, kind_)) {
        // At rest nothing but the disturbance is to count.
        if (!moves) setLimits(limits, 1e-3, 1e-3, 1e-3);
        gains = selectGains(of, limits, kind);
    }
    int size() const { return subject->robot.size(); }
    void prepare() {
        if (bound || !refusal.empty()) return;
        const auto begin = std::chrono::steady_clock::now();
        try {
            bound = calcTrackingBound(subject->robot, limits, subject->tick_s, gains, set, "the property");
        } catch (const Error& e) {
            refusal = e.what();
        }
        bound_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    }
};

/** Of the nominal arm, tick by tick. */
struct Motion {
    std::vector<MotionState> states;
    std::vector<JointVector> torque;  ///< tau_c of the tick
    int ticks() const { return static_cast<int>(torque.size()); }
};

/** What is constant in a run. */
struct RealArm {
    RobotDescription robot;
    JointVector friction;  ///< the factor where it is constant
};

/** The output that a run is after. */
struct Target {
    int joint = 0;
    bool isVelocity = false;
    double side = 1.0;
    int tick = 0;
};

/** The worst errors of a run as shares of the bound. */
struct Outcome {
    std::array<double, 3> ratio{};
    std::array<int, 3> joint{};
    std::vector<double> course;  ///< of the target's output, by ticks
};

class TrackingProperty {
public:
    TrackingProperty(const Options& options, bool looksForPoses)
        : run_(looksForPoses ? "tracking_poses" : "tracking", options), looksForPoses_(looksForPoses) {
        for (const char* name :
             {"single_joint", "planar_two_link", "late_two_link", "indy7", "ur5e", "panda", "geared_panda"})
            // One joint is the same in every pose; no constant gains carry a Panda everywhere.
            if (!looksForPoses || (std::string("single_joint") != name && std::string("panda") != name &&
                                   std::string("geared_panda") != name)) {
                subjects_.push_back(std::make_unique<Subject>(loadSubject(name, looksForPoses)));
                subjects_.back()->number = subjects_.size();
            }
        // What says most comes first, for short runs.
        for (const auto& [kind, moves] :
             {std::pair{Kind::Friction, true}, std::pair{Kind::Pushes, false}, std::pair{Kind::Readings, false},
              std::pair{Kind::All, true}, std::pair{Kind::Payload, false}, std::pair{Kind::Known, true},
              std::pair{Kind::Pushes, true}, std::pair{Kind::Payload, true}, std::pair{Kind::Constant, true}})
            for (const auto& subject : subjects_)
                if (!looksForPoses || !moves) scenarios_.emplace_back(*subject, kind, moves);
    }

    bool check() {
        while (run_.nextArm()) {
            Scenario& s = scenarios_[static_cast<std::size_t>(run_.arm() - 1) % scenarios_.size()];
            s.prepare();
            if (!s.bound) run_.addSteps(1);
            if (!s.bound && s.subject->name != "panda") run_.fail("a set that had a bound has none", 0.0);
            Random random(run_.seed(), run_.arm());
            const int runs = s.isMoving ? kMotions : s.kind == Kind::Readings && !looksForPoses_ ? 2 : 1;
            for (int k = 0; s.bound && k < runs; ++k) attack(s, random, k > 0);
        }
        return report();
    }

private:
    // What acts

    /** Of the target at an age, on each joint: the sign is that which the disturbance takes. */
    struct Attack {
        const ErrorResponse* response = nullptr;
        Target target;
    };

    RealArm drawReal(const Scenario& s, Random& random) const {
        const int n = s.size();
        RobotDescription robot = s.subject->robot;
        const JointVector error = s.set.massError.expand(n);
        JointVector factor = JointVector::Ones(n);
        const bool isAlike = random.chance(0.5);
        const double side = random.chance(0.5) ? 1.0 : -1.0;
        for (int i = 0; i < n; ++i) factor[i] += error[i] * (isAlike || random.chance(0.5) ? side : -side);
        robot = withScaledMasses(std::move(robot), factor);
        if (s.set.payload_kg > 0.0 && random.chance(0.85)) {
            const Eigen::Vector3d direction = random.chance(0.5)
                                                  ? Eigen::Vector3d(Eigen::Vector3d::Unit(random.integer(0, 2)) * side)
                                                  : random.direction();
            robot = withPayload(std::move(robot), s.set.payload_kg, s.set.payloadOffset_m * direction);
        }
        if (s.set.baseTilt_rad > 0.0 && robot.gravity.norm() > 0.0) {
            const Eigen::Vector3d axis = robot.gravity.cross(random.direction());
            robot.gravity = Eigen::AngleAxisd(s.set.baseTilt_rad, axis.normalized()) * robot.gravity;
        }
        const FrictionRange range = findFrictionRange(s.set, n);
        JointVector constant = range.largest;
        const bool isBetween = random.chance(0.3), isMixed = random.chance(0.5);
        for (int i = 0; i < n; ++i) {
            if (isBetween)
                constant[i] = random.uniform(range.least[i], range.largest[i]);
            else if (isMixed && random.chance(0.5))
                constant[i] = range.least[i];
        }
        return {std::move(robot), constant};
    }

    // The nominal arm

    JointVector drawStart(const Scenario& s, Random& random) const {
        const JointBounds& p = s.limits.position;
        JointVector q(s.size());
        for (int i = 0; i < s.size(); ++i) q[i] = random.uniform(p.lower[i], p.upper[i]);
        return q;
    }

    /** tau_c as the host calculates it: of the acceleration in the middle of the tick. */
    static void addTick(const ArmRecursion& arm, const MotionState& now, const JointVector& jerk, double h,
                        Motion& motion) {
        JointVector torque;
        arm.calcTorque(now.q, now.qd, now.qdd + 0.5 * h * jerk, torque);
        motion.torque.push_back(torque);
        MotionState next = now;
        for (int i = 0; i < now.q.size(); ++i) {
            const AxisState end = advance({now.q[i], now.qd[i], now.qdd[i]}, jerk[i], h);
            next.q[i] = end.p;
            next.qd[i] = end.v;
            next.qdd[i] = end.a;
        }
        motion.states.push_back(next);
    }

    Motion makeRest(const Scenario& s, const JointVector& q, int ticks) const {
        const JointVector zero = JointVector::Zero(s.size());
        Motion motion;
        motion.states.assign(static_cast<std::size_t>(ticks) + 1, {q, zero, zero});
        JointVector torque;
        ArmRecursion(s.subject->robot).calcTorque(q, zero, zero, torque);
        motion.torque.assign(static_cast<std::size_t>(ticks), torque);
        return motion;
    }

    /** As fast as the limits allow from target to target: across the range, to and fro about a place, anywhere at any
    time, or resting; joints together or each for itself. */
    Motion drawMotion(const Scenario& s, Random& random, int ticks) const {
        const int n = s.size();
        const double h = s.subject->tick_s;
        const ArmRecursion arm(s.subject->robot);
        const JointLimits& l = s.limits;
        Motion motion;
        const JointVector zero = JointVector::Zero(n);
        motion.states.push_back({drawStart(s, random), zero, zero});
        Servo servo;
        servo.configure(l, h);
        servo.reset(motion.states.front());
        enum { Across, ToAndFro, Anywhere, Resting };
        std::array<int, kMaxJoints> kinds{};
        const bool together = random.chance(0.5);
        const int common = random.integer(Across, Anywhere);
        JointVector turn(n), period(n), side(n);
        const double commonTurn = random.uniform(0.2, 1.0), commonPeriod = random.logUniform(0.1, 2.0);
        for (int i = 0; i < n; ++i) {
            kinds[static_cast<std::size_t>(i)] = together ? common : random.integer(Across, Resting);
            turn[i] = together ? commonTurn : random.uniform(0.2, 1.0);
            period[i] = together ? commonPeriod : random.logUniform(0.1, 2.0);
            side[i] = random.chance(0.5) ? 1.0 : -1.0;
        }
        JointVector changed = zero, jerk(n);
        MotionState target = motion.states.front();
        for (int k = 0; k < ticks; ++k) {
            const MotionState now = motion.states.back();
            const double t = k * h;
            for (int i = 0; i < n; ++i) {
                const int kind = kinds[static_cast<std::size_t>(i)];
                const double low = l.position.lower[i], high = l.position.upper[i];
                const double beyond = side[i] > 0.0 ? high : low;
                if (kind == Across) {
                    target.q[i] = beyond;
                    if (std::abs(now.q[i] - beyond) < 1e-6) side[i] = -side[i];
                } else if (kind == ToAndFro) {  // back as soon as it is fast
                    target.q[i] = beyond;
                    if (now.qd[i] * side[i] >= turn[i] * 0.999 * l.velocity.upper[i] ||
                        std::abs(now.q[i] - beyond) < 1e-6)
                        side[i] = -side[i];
                } else if (kind == Anywhere && t >= changed[i]) {
                    target.q[i] = random.uniform(low, high);
                    changed[i] = t + period[i] * random.uniform(0.3, 1.7);
                }
            }
            servo.calc(now, target, jerk);
            addTick(arm, now, jerk, h, motion);
        }
        return motion;
    }

    void checkNominal(const Scenario& s, const Motion& motion) {
        const JointLimits& l = s.limits;
        const auto holds = [](const JointVector& x, const JointBounds& bounds) {
            const JointVector size = 1e-9 * bounds.lower.cwiseAbs().cwiseMax(bounds.upper.cwiseAbs());
            return (x.array() <= (bounds.upper + size).array()).all() &&
                   (x.array() >= (bounds.lower - size).array()).all();
        };
        for (const MotionState& now : motion.states)
            if (!holds(now.q, l.position) || !holds(now.qd, l.velocity) || !holds(now.qdd, l.acceleration))
                return run_.fail("the nominal arm leaves its limits", 0.0);
    }

    static JointMatrix calcInertia(const RobotDescription& robot, const JointVector& q) {
        JointMatrix M;
        ArmRecursion(robot).calcInertia(q, M);
        return M;
    }

    LinearLoop makeLoop(const Scenario& s, const RobotDescription& real, const JointVector& q,
                        const JointVector& damping) const {
        const int n = s.size();
        const NricOptions& g = s.gains;
        return {calcInertia(real, q), damping,           g.kr.expand(n),  g.kp.expand(n),
                g.ki.expand(n),       s.subject->tick_s, s.set.delayTicks};
    }

    /** What jumping friction has on each joint at a velocity, from least to largest [Nm]. */
    static JointVector calcFriction(const Scenario& s, const JointVector& factor, const JointVector& v) {
        const JointFriction& f = s.subject->robot.actuation.friction;
        JointVector torque(s.size());
        for (int i = 0; i < s.size(); ++i)
            torque[i] = factor[i] * (f.coulomb[i] * s.set.breakawayRatio -
                                     f.viscous[i] * std::expm1(-std::abs(v[i]) / f.viscousVelocity[i]));
        return torque;
    }

    // The run

    /** Where stretches of a tick end in which no sign changes, as shares of it. */
    static std::vector<double> listStretches(const Attack* attack, int age, int n) {
        std::vector<double> ends;
        for (int i = 0; attack && i < n; ++i) {
            const double a = attack->response->begin(i, age), b = attack->response->end(i, age);
            if (a * b < 0.0) ends.push_back(a / (a - b));
        }
        std::sort(ends.begin(), ends.end());
        ends.push_back(1.0);
        return ends;
    }

    /** What acts at a share of a tick: pushes as the target suffers from them; friction while it does so. */
    static void act(const Scenario& s, const RealArm& real, const FrictionRange& range, const JointVector& motor,
                    const JointVector& v, const Attack* attack, int age, double share, Acting& acting) {
        const JointFriction& f = s.subject->robot.actuation.friction;
        acting.torque = motor;
        for (int i = 0; i < s.size(); ++i) {
            double factor = range.isConstant ? real.friction[i] : range.least[i];
            if (attack) {
                const double wish = attack->target.side * attack->response->calcAt(i, age, share);
                acting.torque[i] += std::copysign(s.set.externalTorque_Nm[i] + s.set.torqueRipple_Nm[i], wish);
                if (!range.isConstant && wish * v[i] < 0.0) factor = range.largest[i];
            }
            acting.dry[i] = factor * f.coulomb[i] * s.set.breakawayRatio;
            if (factor >= range.largest[i]) acting.dry[i] += s.set.loadFriction[i] * std::abs(acting.torque[i]);
            acting.viscous[i] = factor * f.viscous[i];
        }
    }

    /** @param attack  null: only what is constant. @param ticks  how long */
    Outcome simulate(const Scenario& s, const RealArm& real, const Motion& motion, const Attack* attack,
                     const Target& watched, int ticks, int steps) const {
        const int n = s.size();
        const double h = s.subject->tick_s;
        const RobotDescription& robot = s.subject->robot;
        const FrictionRange range = findFrictionRange(s.set, n);
        DisturbedArm arm(real.robot, robot.actuation.friction.viscousVelocity);
        arm.reset(motion.states.front().q);
        Nric nric;
        RunSetup setup{robot, s.limits, h, ticks * h, motion.states.front(), {}};
        setup.delayTicks = s.set.delayTicks;
        nric.configure(setup, s.gains);
        std::vector<JointVector> sent;
        Outcome out;
        JointState read{motion.states.front().q, JointVector::Zero(n)};
        JointVector robust(n);
        Acting acting{JointVector::Zero(n), JointVector::Zero(n), JointVector::Zero(n)};
        for (int k = 0;; ++k) {
            const MotionState& nominal = motion.states[static_cast<std::size_t>(k)];
            const JointVector e = arm.q() - nominal.q, de = arm.v() - nominal.qd;
            const int age = attack ? attack->response->column(std::max(attack->target.tick - 1 - k, 0)) : 0;
            // The reading: the worst within its error, then whole counts.
            JointVector reading = arm.q();
            for (int i = 0; i < n; ++i) {
                if (attack) {
                    const double effect = attack->target.side * attack->response->reading(i, age);
                    reading[i] += std::copysign(s.set.readingError_rad, effect);
                }
                const double count = robot.encoderStep(i);
                if (count > 0.0) reading[i] = count * std::round(reading[i] / count);
            }
            read.qd = k == 0 ? arm.v() : JointVector((reading - read.q) / h);
            read.q = reading;
            const std::array<JointVector, 3> ratios = {
                e.cwiseAbs().cwiseQuotient(s.bound->position), de.cwiseAbs().cwiseQuotient(s.bound->velocity),
                (reading - nominal.q).cwiseAbs().cwiseQuotient(s.bound->measured)};
            for (std::size_t m = 0; m < ratios.size(); ++m) {
                int joint = 0;
                const double ratio = ratios[m].allFinite() ? ratios[m].maxCoeff(&joint) : kInfinity;
                if (ratio <= out.ratio[m]) continue;
                out.ratio[m] = ratio;
                out.joint[m] = joint;
            }
            out.course.push_back((watched.isVelocity ? de : e)[watched.joint]);
            if (k == ticks) return out;

            const JointVector& tau = motion.torque[static_cast<std::size_t>(k)];
            nric.compute(read, nominal, tau, robust);
            sent.push_back(tau + robust);
            const JointVector& motor = sent[static_cast<std::size_t>(std::max(k - s.set.delayTicks, 0))];
            double begin = 0.0;
            for (const double end : listStretches(attack, age, n)) {
                const double length = end - begin;
                const int parts = std::max(1, static_cast<int>(std::ceil(length * steps - 1e-9)));
                for (int part = 0; part < parts; ++part) {
                    act(s, real, range, motor, arm.v(), attack, age, begin + 0.5 * length, acting);
                    arm.advance(acting, length * h / parts);
                }
                begin = end;
            }
        }
    }

    /** The largest effect on the target that pushes and reading errors have from the start to a tick of number k. */
    std::vector<double> sumEffects(const Scenario& s, const ErrorResponse& response, int ticks) const {
        const JointVector pushes = s.set.externalTorque_Nm.expand(s.size()) + s.set.torqueRipple_Nm.expand(s.size());
        std::vector<double> sum(static_cast<std::size_t>(ticks) + 1, 0.0);
        for (int k = 0; k < ticks; ++k) {
            double now = 0.0;
            if (k < response.ticks())
                for (int i = 0; i < s.size(); ++i)
                    now += pushes[i] * response.calcSize(i, k, s.subject->tick_s) +
                           s.set.readingError_rad * std::abs(response.reading(i, k));
            sum[static_cast<std::size_t>(k) + 1] = sum[static_cast<std::size_t>(k)] + now;
        }
        return sum;
    }

    /** The tick and side at which the target's output is expected to be largest: what the constant disturbances do, and
    what the others add. */
    Target findTick(const Scenario& s, const Motion& motion, const ErrorResponse& response,
                    const std::vector<double>& course, Target target) const {
        const int ticks = motion.ticks(), n = s.size();
        const double h = s.subject->tick_s;
        const std::vector<double> effects = sumEffects(s, response, ticks);
        const FrictionRange range = findFrictionRange(s.set, n);
        const bool jumps = !range.isConstant && range.largest.maxCoeff() > 0.0 && s.isMoving;
        std::vector<JointVector> friction;  // signed
        for (int k = 0; jumps && k < ticks; ++k) {
            const JointVector& v = motion.states[static_cast<std::size_t>(k)].qd;
            friction.push_back(calcFriction(s, range.largest - range.least, v));
            for (int i = 0; i < n; ++i) friction.back()[i] *= v[i] > 0.0 ? -h : v[i] < 0.0 ? h : 0.0;
        }
        double best = -1.0;
        const int stride = jumps ? std::max(1, ticks / 300) : 1;
        for (int k = ticks; k > 0; k -= stride) {
            std::array<double, 2> gained{};
            for (int j = 0; jumps && j < std::min(k, response.ticks()); ++j)
                for (int i = 0; i < n; ++i) {
                    const double effect = friction[static_cast<std::size_t>(k - 1 - j)][i] * response.calcMean(i, j);
                    gained[effect > 0.0 ? 0 : 1] += std::abs(effect);
                }
            for (const int side : {1, -1}) {
                const double expected = side * course[static_cast<std::size_t>(k)] +
                                        effects[static_cast<std::size_t>(k)] + gained[side > 0 ? 0 : 1];
                if (expected <= best) continue;
                best = expected;
                target.tick = k;
                target.side = side;
            }
        }
        return target;
    }

    /** So long as most of the effect of pushes and readings takes. */
    int findMemory(const Scenario& s, const ErrorResponse& response) const {
        const std::vector<double> sum = sumEffects(s, response, response.ticks());
        for (std::size_t k = 0; k < sum.size(); ++k)
            if (sum[k] >= kEffect * sum.back()) return static_cast<int>(k);
        return response.ticks();
    }

    /** A pose at rest, with what is constant there, and what the target is expected to suffer. */
    struct Place {
        JointVector q;
        RealArm real;
        double expected = -1.0;
    };

    double expectAtRest(const Scenario& s, const Target& target, const JointVector& q, const RealArm& real,
                        const ArmRecursion& nominal) const {
        constexpr int kAges = 500;
        const JointVector zero = JointVector::Zero(s.size());
        const ErrorResponse response =
            calcResponse(makeLoop(s, real.robot, q, zero), target.joint, target.isVelocity, kAges);
        JointVector weight, carried;
        ArmRecursion(real.robot).calcTorque(q, zero, zero, weight);
        nominal.calcTorque(q, zero, zero, carried);
        double step = 0.0, peak = 0.0;
        for (int k = 0; k < kAges; ++k) {
            for (int i = 0; i < s.size(); ++i)
                step += s.subject->tick_s * response.calcMean(i, k) * (carried[i] - weight[i]);
            peak = std::max(peak, std::abs(step));
        }
        return peak + sumEffects(s, response, kAges).back();
    }

    /** Where the target is expected to suffer most: of the poses around which the bound looks at the loop; or of these
    and drawn ones, and from the worst of them on uphill. */
    Place choosePlace(const Scenario& s, Random& random, const Target& target) const {
        constexpr int kLoopPoses = 32, kDrawnPoses = 64, kArms = 6, kClimbs = 150;
        const ArmRecursion nominal(s.subject->robot);
        std::vector<JointVector> poses = detail::samplePoses(s.limits, kLoopPoses);
        for (int k = 0; looksForPoses_ && k < kDrawnPoses; ++k) poses.push_back(drawStart(s, random));
        Place best;
        for (int k = 0; k < (s.kind == Kind::Payload ? kArms : 1); ++k) {
            const RealArm real = drawReal(s, random);
            for (const JointVector& q : poses) {
                const double expected = expectAtRest(s, target, q, real, nominal);
                if (expected > best.expected) best = {q, real, expected};
            }
        }
        double size = 0.2;
        for (int k = 0; looksForPoses_ && k < kClimbs; ++k) {
            const JointBounds& p = s.limits.position;
            JointVector q = best.q;
            for (int i = 0; i < s.size(); ++i) q[i] += size * random.uniform(-1.0, 1.0) * (p.upper[i] - p.lower[i]);
            q = q.cwiseMax(p.lower).cwiseMin(p.upper);
            const double expected = expectAtRest(s, target, q, best.real, nominal);
            if (expected > best.expected) {
                best.q = q;
                best.expected = expected;
            } else {
                size = std::max(0.95 * size, 1e-3);
            }
        }
        return best;
    }

    /** @param atStart  of reading errors: the run ends soon after the start */
    void attack(Scenario& s, Random& random, bool atStart) {
        const int n = s.size();
        const double h = s.subject->tick_s;
        Target target{random.integer(0, n - 1), random.chance(0.5), 1.0, 0};
        const JointVector zero = JointVector::Zero(n);
        RealArm real = drawReal(s, random);
        Motion motion;
        ErrorResponse response;
        const bool hasConstants = s.kind == Kind::Payload || s.kind == Kind::All;
        const char* where = "";
        if (s.isMoving) {
            motion = drawMotion(s, random, static_cast<int>(random.uniform(1.0, 4.0) / h));
            checkNominal(s, motion);
        } else {
            const Place place = choosePlace(s, random, target);
            real = place.real;
            response = calcResponse(makeLoop(s, real.robot, place.q, zero), target.joint, target.isVelocity,
                                    hasConstants ? static_cast<int>(1.0 / h) : kLongestMemory);
            // Soon after the start it still counts that the first velocity is read as zero, not as a difference.
            const bool isSoon = atStart && s.kind == Kind::Readings;
            const int late = isSoon ? 0 : static_cast<int>(0.3 / h);
            where = isSoon ? ", start" : "";
            motion = makeRest(s, place.q, hasConstants ? response.ticks() : findMemory(s, response) + late);
        }
        const int ticks = motion.ticks();
        std::vector<double> course(static_cast<std::size_t>(ticks) + 1, 0.0);
        if (s.isMoving || hasConstants) {
            course = simulate(s, real, motion, nullptr, target, ticks, 1).course;
            run_.addSteps(std::int64_t(ticks) * n);
        }
        if (s.isMoving) {
            // Viscous friction damps the error as long as it is there.
            const double share = random.chance(0.5) ? 0.0 : random.uniform(0.0, 1.0);
            const JointFriction& f = s.subject->robot.actuation.friction;
            const JointVector slope =
                s.set.frictionScale.expand(n).cwiseProduct(f.viscous.cwiseQuotient(f.viscousVelocity));
            const auto calcAt = [&](int tick) {
                const MotionState& state = motion.states[static_cast<std::size_t>(tick)];
                JointVector damping = share * slope;
                for (int i = 0; i < n; ++i) damping[i] *= std::exp(-std::abs(state.qd[i]) / f.viscousVelocity[i]);
                return calcResponse(makeLoop(s, real.robot, state.q, damping), target.joint, target.isVelocity,
                                    std::min(ticks, kMovingMemory));
            };
            target = findTick(s, motion, calcAt(ticks / 2), course, target);
            response = calcAt(target.tick);
        } else {
            target = findTick(s, motion, response, course, target);
        }
        const Attack attack{&response, target};
        run_.addSteps(std::int64_t(target.tick) * n);
        const Outcome outcome = simulate(s, real, motion, &attack, target, target.tick, kSteps);
        ++s.runs;
        bool isWorst = false;
        for (std::size_t m = 0; m < outcome.ratio.size(); ++m) isWorst |= outcome.ratio[m] > s.worst[m].ratio;
        if (!isWorst) return;
        const Outcome finer = simulate(s, real, motion, &attack, target, target.tick, 2 * kSteps);
        run_.addSteps(std::int64_t(target.tick) * n);
        for (std::size_t m = 0; m < outcome.ratio.size(); ++m) {
            const double error = std::abs(finer.ratio[m] - outcome.ratio[m]);
            if (!(error <= kIntegratorError * std::max(1.0, finer.ratio[m]))) {
                run_.fail("half the step of the integrator changes a run (share of the bound)", error);
                std::printf("  too coarse: arm %lld, by %.3g\n", static_cast<long long>(run_.arm()), error);
            }
            if (!(finer.ratio[m] <= s.worst[m].ratio))
                s.worst[m] = {finer.ratio[m], error, run_.arm(), finer.joint[m], where};
            if (!(finer.ratio[m] <= 1.0)) {
                const char* const names[] = {"a position error leaves its bound (in bounds)",
                                             "a velocity error leaves its bound (in bounds)",
                                             "a measured error leaves its bound (in bounds)"};
                run_.fail(names[m], finer.ratio[m] - 1.0);
            }
        }
    }

    bool report() {
        run_.print();
        std::printf(
            "  worst error over bound (joint, arm; what half the step of the integrator changes)\n"
            "  start: soon after the start\n");
        std::printf("  %-16s %-9s %-7s %5s %9s  %-32s %-32s %s\n", "robot", "kind", "nominal", "runs", "bound [s]",
                    "position", "velocity", "position as read");
        std::optional<double> reached;
        double weakest = 1.0;
        std::stable_sort(scenarios_.begin(), scenarios_.end(),
                         [](const Scenario& a, const Scenario& b) { return a.subject->number < b.subject->number; });
        for (const Scenario& s : scenarios_) {
            if (!s.bound && s.refusal.empty()) continue;
            std::printf("  %-16s %-9s %-7s ", s.subject->name.c_str(), getName(s.kind), s.isMoving ? "moves" : "rests");
            if (!s.bound) {
                std::printf("no bound: %.120s\n", s.refusal.c_str());
                continue;
            }
            std::printf("%5lld %9.2f ", static_cast<long long>(s.runs), s.bound_s);
            for (const Scenario::Record& r : s.worst)
                std::printf(" %-32s", detail::format("%.4f (%d, %lld%s; %.0e)", r.ratio, r.joint,
                                                     static_cast<long long>(r.arm), r.where, r.integratorError)
                                          .c_str());
            std::printf("\n");
            if (s.isMoving || s.kind != Kind::Pushes) continue;
            const double here = std::max(s.worst[0].ratio, s.worst[1].ratio);
            reached = std::max(reached.value_or(0.0), here);
            if (s.runs >= kJudgedRuns) weakest = std::min(weakest, here);
        }
        const auto visits = [](const Scenario& s) { return s.bound || !s.refusal.empty(); };
        if (run_.arm() > 2 * static_cast<std::int64_t>(scenarios_.size()) &&
            !std::all_of(scenarios_.begin(), scenarios_.end(), visits)) {
            std::printf("INCOMPLETE: a long run has not visited every scenario\n");
            return false;
        }
        if (run_.options().arm == 0 && std::min(reached.value_or(1.0), weakest) < kReached) {
            std::printf("WEAK: pushes on an arm at rest come to %.3g of the bound; expected at least %.3g\n",
                        std::min(reached.value_or(1.0), weakest), kReached);
            return false;
        }
        return run_.isGood();
    }

    Run run_;
    bool looksForPoses_;
    std::vector<std::unique_ptr<Subject>> subjects_;
    std::vector<Scenario> scenarios_;
};

}  // namespace

bool checkTracking(const Options& options) {
    return TrackingProperty(options, false).check();
}

bool checkTrackingPoses(const Options& options) {
    return TrackingProperty(options, true).check();
}

}  // namespace viable
