#include "Balls.h"
#include "clearance/ArmStopCheck.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "DrawnPath.h"
#include "SlidingArm.h"
#include "environment/CollisionChecker.h"

namespace viable {
namespace {

using detail::ArmPath;
using detail::ArmStopCheck;

constexpr double kTick_s = 1e-3;
/** From here on clearances need not be told apart, by the check and by the judge [m]. */
constexpr double kAhead_m = 0.1, kHorizon_m = 0.3;
/** Corner of what is around an arm [m]. */
const Eigen::Vector3d kFar = Eigen::Vector3d::Constant(3.0);

struct Subject {
    explicit Subject(RobotDescription r) : robot(std::move(r)), geometry(loadArmGeometry(robot)) {
        // Joints far out: what is looked at are bounds along paths, wherever they lead.
        robot.limits.position = {JointVector::Constant(robot.size(), -9.0), JointVector::Constant(robot.size(), 9.0)};
    }
    RobotDescription robot;
    ArmGeometry geometry;
};

/** The same of every element [m]. */
ArmStopCheck::Demands makeDemands(const ArmStopCheck& check, double floor, double least, double far) {
    const auto elements = static_cast<std::size_t>(check.elements());
    ArmStopCheck::Demands demands;
    demands.floor.assign(elements, floor);
    demands.least.assign(elements, least);
    demands.reached = demands.least;
    demands.ahead.assign(elements, kAhead_m);
    demands.far.assign(elements, far);
    return demands;
}

/** Thin things, so that a look at one time has little chance to see them. */
Environment drawThinThings(std::mt19937& random) {
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    Environment environment;
    environment.safetyDistance_m = 0.0;
    for (int k = 0; k < 3; ++k) {
        Solid solid;
        solid.name = "thing" + std::to_string(k);
        solid.kind = k == 0 ? Solid::Kind::Sphere : Solid::Kind::Box;
        solid.radius = 0.003;
        solid.size << 0.5 + 0.4 * share(random), 0.5 + 0.4 * share(random), 1e-4;
        solid.pose.translation() << 0.8 * share(random), 0.8 * share(random), 0.4 + 0.6 * share(random);
        solid.pose.linear() =
            Eigen::AngleAxisd(3.0 * share(random),
                              Eigen::Vector3d(share(random), share(random), share(random)).normalized())
                .toRotationMatrix();
        environment.solids.push_back(solid);
    }
    return environment;
}

/** A ball that comes through where the arm is, and goes back. */
MovingSphere drawMovingSphere(std::mt19937& random) {
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    MovingSphere sphere;
    sphere.name = "ball";
    sphere.radius = 0.05;
    for (int k = 0; k < 3; ++k)
        sphere.waypoints.push_back({0.3 * k, {0.8 * share(random), 0.8 * share(random), 0.4 + 0.6 * share(random)}});
    sphere.waypoints.back().position = sphere.waypoints.front().position;
    sphere.repeats = true;
    return sphere;
}

ArmPath drawPath(int n, std::mt19937& random, double size) {
    const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -40.0, 40.0};
    return DrawnPath{JointVector::Constant(n, 1.5), 3.0, 10.0, 40.0, limits}.draw(random, size, kTick_s);
}

// What is proven between looks, against the judge at a few thousand poses of the same path: never too much, and not far off.
TEST(ArmStopCheck, WhatIsProvenBetweenLooksHoldsAtEveryPose) {
    std::mt19937 random(1);
    for (const RobotDescription& robot : loadArms()) {
        const Subject subject(robot);
        const int n = subject.robot.size();
        const JointVector none = JointVector::Constant(n, kInfinity);
        ArmStopCheck check(subject.robot, &subject.geometry, {none, none}, kTick_s);
        ArmStopCheck::Result result = check.makeResult();
        const ArmStopCheck::Demands demands = makeDemands(check, 0.0, detail::bisection::kGuard_m, kAhead_m);
        double tooMuch = -kInfinity, sum = 0.0;
        constexpr int kPaths = 300;
        int clear = 0, refused = 0, near = 0;
        for (int round = 0; round < kPaths; ++round) {
            const Environment environment = drawThinThings(random);
            const Surroundings surroundings(environment, -kFar, kFar, 1.0);
            check.setSurroundings(&surroundings);
            const ArmPath path = drawPath(n, random, round % 3 == 0 ? 1.0 : round % 3 == 1 ? 0.3 : 0.03);
            check.beginTick();
            check.examine(path, 0.0, demands, JointVector::Zero(n), {}, false, result);
            const double proven = *std::min_element(result.proven.begin(), result.proven.end());
            const CollisionChecker checker(subject.robot, subject.geometry, environment);
            double least = kInfinity;
            JointVector q;
            constexpr int kPoses = 2000;
            for (int k = 0; k <= kPoses; ++k) {
                path.calcPositions(path.duration() * k / kPoses, q);
                least = std::min(least, checker.findContact(q, 0.0, kHorizon_m).distance);
            }
            // Of what is too near only that is told; and what is farther than `ahead` need not be told apart.
            if (least < kHorizon_m) tooMuch = std::max(tooMuch, proven - std::max(least, 0.0));
            if (least < 3.0 * detail::bisection::kGuard_m) continue;
            refused += !result.isClear;
            if (!result.isClear) continue;
            ++clear;
            if (least >= kAhead_m) continue;
            ++near;
            sum += least - proven;
        }
        std::printf(
            "  %s: proven less than seen by %.1f mm on average of %d near paths; never more (%.1g m); %d paths that "
            "are clear "
            "by 15 mm taken, %d refused\n",
            subject.robot.name.c_str(), 1e3 * sum / near, near, tooMuch, clear, refused);
        EXPECT_LE(tooMuch, 1e-9);
        EXPECT_GT(near, 15);
        EXPECT_LT(sum / near, 0.015);
        EXPECT_LT(refused, clear / 4);
    }
}

/** A tick and the stops after it. */
struct Begun {
    MotionState state;
    JointVector jerk;
    std::array<GridStop, kMaxJoints> stops;

    ArmPath path() const {
        ArmPath path;
        path.set(state, jerk, stops, kTick_s);
        return path;
    }
    /** With another jerk in its tick, and the shortest stops after that. */
    Begun turn(const JointVector& other, const AxisLimits& limits) const {
        Begun turned{state, other, {}};
        for (int i = 0; i < static_cast<int>(jerk.size()); ++i)
            turned.stops[static_cast<std::size_t>(i)] = planStop(state, i, other[i], limits, kTick_s);
        return turned;
    }
    /** What is left of it some ticks later. */
    Begun skip(std::int64_t ticks) const {
        Begun left = *this;
        const ArmPath all = path();
        all.calcTick(ticks, left.state.q, left.state.qd, left.state.qdd);
        for (int i = 0; i < static_cast<int>(jerk.size()); ++i) {
            GridStop& stop = left.stops[static_cast<std::size_t>(i)];
            stop.skip(ticks - 1);
            left.state.qdd[i] = all.calcAcceleration(i, static_cast<double>(ticks) * kTick_s);
            left.jerk[i] = stop.popJerk();
        }
        return left;
    }
};

// What was found of a path some ticks ago tells how near another jerk's stop would come, without a look at it.
TEST(ArmStopCheck, WhatAnotherJerkWouldBreakIsForeseen) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -400.0, 400.0};
    for (const RobotDescription& robot : loadArms()) {
        const Subject subject(robot);
        const int n = subject.robot.size();
        const JointVector none = JointVector::Constant(n, kInfinity);
        ArmStopCheck check(subject.robot, &subject.geometry, {none, none}, kTick_s);
        ArmStopCheck::Result found = check.makeResult(), after = found, rest = found;
        const auto elements = static_cast<std::size_t>(check.elements());
        const ArmStopCheck::Demands demands = makeDemands(check, -1.0, -1.0, kAhead_m);
        double change = 0.0, error = 0.0;
        int count = 0, carried = 0, most = 0;
        for (int round = 0; round < 400; ++round) {
            const Environment environment = drawThinThings(random);
            const Surroundings surroundings(environment, -kFar, kFar, 1.0);
            check.setSurroundings(&surroundings);
            const auto draw = [&](double size) {
                return JointVector(JointVector::NullaryExpr(n, [&] { return size * share(random); }));
            };
            const Begun drawn =
                Begun{{draw(1.5), draw(1.0), draw(3.0)}, JointVector::Zero(n), {}}.turn(draw(400.0), limits);
            const std::int64_t ticks = 1 + round % 5;
            const Begun now = drawn.skip(ticks), other = now.turn(draw(400.0), limits);
            const ArmPath path = drawn.path(), nowPath = now.path(), otherPath = other.path();
            const double since_s = static_cast<double>(ticks) * kTick_s;
            const auto examine = [&](const ArmPath& one, double time_s, const ArmStopCheck::KnownPaths& known,
                                     ArmStopCheck::Result& result) {
                check.beginTick();
                check.examine(one, time_s, demands, JointVector::Zero(n), known, false, result);
            };
            examine(path, 0.0, {}, found);
            examine(otherPath, since_s, {}, after);
            // What is known and not looked at again was nearest where it was.
            const ArmStopCheck::Known known{path, ticks, found};
            examine(nowPath, since_s, {1, {&known}}, rest);
            for (std::size_t e = 0; e < elements; ++e) {
                const ArmStopCheck::Near &was = found.near[e], &is = rest.near[e];
                if (!was.place.isSeen() || !(was.time_s > since_s) || is.place.onFirst != was.place.onFirst) continue;
                EXPECT_DOUBLE_EQ(is.time_s, was.time_s - since_s);
                ++carried;
            }
            // All that lost the distance are as near to what is asked of them.
            ArmStopCheck::Demands lost = demands;
            int seen = 0;
            for (std::size_t e = 0; e < elements; ++e) {
                const ArmStopCheck::Near& near = found.near[e];
                lost.ahead[e] = near.place.distance;
                seen += near.place.isSeen() && near.time_s > since_s && near.place.distance < lost.far[e];
            }
            RowQp::Rows all;
            check.addForeseenRows(found, since_s, {nowPath, now.jerk, otherPath, other.jerk}, lost, all);
            EXPECT_LE(all.count, seen);
            most = std::max(most, all.count);
            for (std::size_t e = 0; e < elements; ++e) {
                if (!(found.seen[e] < kAhead_m && found.seen[e] > 0.005 && after.seen[e] < kAhead_m)) continue;
                // Of this element alone, by what is asked of it.
                RowQp::Rows rows;
                const auto isBroken = [&](double ahead) {
                    ArmStopCheck::Demands asked = demands;
                    std::fill(asked.ahead.begin(), asked.ahead.end(), -kInfinity);
                    asked.ahead[e] = ahead;
                    rows.clear();
                    return check.addForeseenRows(found, since_s, {nowPath, now.jerk, otherPath, other.jerk}, asked,
                                                 rows);
                };
                if (!isBroken(1.0)) continue;  // the place is passed
                ASSERT_EQ(rows.count, 1);
                const double bound = rows.bound[0];
                EXPECT_TRUE(isBroken(2.0));
                const double size = 1.0 / (rows.bound[0] - bound);
                const double foreseen = 1.0 + size * (rows.normal[0].dot(other.jerk) - bound);
                EXPECT_TRUE(isBroken(foreseen + 1e-9));
                EXPECT_FALSE(isBroken(foreseen - 1e-9));
                EXPECT_EQ(rows.count, 1);  // for what other jerks than that would break
                change += std::pow(after.seen[e] - found.seen[e], 2);
                error += std::pow(after.seen[e] - foreseen, 2);
                ++count;
            }
        }
        std::printf("  %s: %d clearances change by %.2f mm in the mean square, foreseen to %.2f mm\n",
                    subject.robot.name.c_str(), count, 1e3 * std::sqrt(change / count), 1e3 * std::sqrt(error / count));
        EXPECT_GT(count, 50);
        EXPECT_LT(error, 0.04 * change);
        EXPECT_GT(carried, 20);
        EXPECT_GT(most, 2);
    }
}

// Paths that branch off from each other tick by tick, two in each, examined with what is known of the one before and, the
// second one, also of its sibling: what is proven, of clearances and of torques, holds at every pose, though most of it is not
// looked at.
TEST(ArmStopCheck, WhatIsKnownOfOnePathHoldsForTheNext) {
    std::mt19937 random(3);
    for (const RobotDescription& robot : loadArms()) {
        constexpr double kBeyond_m = 0.05;
        const Subject subject(robot);
        const int n = subject.robot.size();
        const JointVector none = JointVector::Constant(n, kInfinity);
        ArmStopCheck check(subject.robot, &subject.geometry, {subject.robot.actuation.torqueLimit, none}, kTick_s);
        ArmStopCheck::Result kept = check.makeResult(), first = kept, result = kept;
        const auto elements = static_cast<std::size_t>(check.elements());
        const ArmStopCheck::Demands demands =
            makeDemands(check, 0.0, detail::bisection::kGuard_m, kAhead_m + kBeyond_m);
        // All of a path is looked at, of every element, and nothing is known.
        ArmStopCheck plain(subject.robot, &subject.geometry, {subject.robot.actuation.torqueLimit, none}, kTick_s);
        ArmStopCheck::Result all = plain.makeResult();
        ArmStopCheck::Demands everything = demands;
        everything.ahead.assign(elements, kInfinity);
        everything.far = everything.ahead;
        std::int64_t compared = 0, close = 0, asked = 0, saved = 0;
        double elementTooMuch = -kInfinity;
        const ArmRecursion arm(subject.robot);
        double tooMuch = -kInfinity, torqueUse = 0.0, sum = 0.0;
        int near = 0;
        constexpr int kChains = 40, kTicks = 40;
        for (int round = 0; round < kChains; ++round) {
            Environment environment = drawThinThings(random);
            environment.spheres.push_back(drawMovingSphere(random));
            const Surroundings surroundings(environment, -kFar, kFar, 1.0);
            check.setSurroundings(&surroundings);
            plain.setSurroundings(&surroundings);
            const CollisionChecker checker(subject.robot, subject.geometry, environment);
            const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -40.0, 40.0};
            const DrawnPath drawn{JointVector::Constant(n, 1.5), 3.0, 10.0, 40.0, limits};
            ArmPath path = drawn.draw(random, round % 3 == 0 ? 1.0 : round % 3 == 1 ? 0.3 : 0.03, kTick_s);
            check.beginTick();
            check.examine(path, 0.0, demands, JointVector::Zero(n), {}, false, kept);
            std::int64_t begin = 0, now = 0;
            for (int tick = 0; tick < kTicks; ++tick) {
                // At times a path goes on for a while before another is looked at.
                const std::int64_t step = tick % 7 == 5 ? std::uniform_int_distribution<>(5, 50)(random) : 1;
                begin += step;
                now += step;
                const double time_s = static_cast<double>(now) * kTick_s;
                const ArmPath sibling = drawn.branchOff(path, begin, random, kTick_s);
                const ArmPath next = drawn.branchOff(path, begin, random, kTick_s);
                const ArmStopCheck::Known known{path, begin, kept}, other{sibling, 0, first};
                check.beginTick();
                check.examine(sibling, time_s, demands, JointVector::Zero(n), {1, {&known}}, false, first);
                check.examine(next, time_s, demands, JointVector::Zero(n), {2, {&known, &other}}, false, result);
                for (std::size_t e = 0; e < elements; ++e)
                    for (const ArmStopCheck::Result* r : {&first, &result}) {
                        ++asked;  // the profile of an element that was looked at is this path's own
                        saved += r->profile[e].lost > 0.0 || r->profile[e].begin_s < 0.0;
                    }
                // Of every element: what is proven with what is known is nowhere more than a look shows.
                if (tick % 4 == 0 || step > 1)
                    for (const auto& [examined, found] : {std::pair(&sibling, &first), std::pair(&next, &result)}) {
                        plain.beginTick();
                        plain.examine(*examined, time_s, everything, JointVector::Zero(n), {}, false, all);
                        for (std::size_t e = 0; e < elements; ++e) {
                            ++compared;
                            close += all.seen[e] - found->proven[e] < 0.01;
                            elementTooMuch = std::max(elementTooMuch, found->proven[e] - all.seen[e]);
                        }
                    }
                if (tick % 4 == 0 || step > 1) {
                    double least = kInfinity;
                    JointVector q, qd, qdd, tau;
                    constexpr int kPoses = 300;
                    for (int k = 0; k <= kPoses; ++k) {
                        next.calcPositions(next.duration() * k / kPoses, q);
                        least = std::min(
                            least, checker.findContact(q, time_s + next.duration() * k / kPoses, kHorizon_m).distance);
                    }
                    const double proven = *std::min_element(result.proven.begin(), result.proven.end());
                    if (least < kHorizon_m) tooMuch = std::max(tooMuch, proven - std::max(least, 0.0));
                    if (result.isClear && least < kAhead_m) {
                        ++near;
                        sum += least - proven;
                    }
                    for (std::int64_t k = 0; k <= next.ticks() && result.torque.bearsTorque; ++k) {
                        next.calcTick(k, q, qd, qdd);
                        arm.calcTorque(q, qd, qdd, tau);
                        torqueUse = std::max(torqueUse, tau.cwiseAbs().cwiseQuotient(result.torque.proven).maxCoeff());
                    }
                }
                if (tick % 3 == 2) continue;  // the path that is known goes on
                path = next;
                begin = 0;
                std::swap(kept, result);
            }
        }
        std::printf(
            "  %s: proven less than seen by %.1f mm on average of %d near paths, never more (%.1g m); torques at "
            "most %.3f of what is proven\n",
            subject.robot.name.c_str(), 1e3 * sum / near, near, tooMuch, torqueUse);
        std::printf(
            "  of %lld elements %lld not looked at; of %lld compared %lld within 10 mm of a look, never more (%.1g "
            "m)\n",
            static_cast<long long>(asked), static_cast<long long>(saved), static_cast<long long>(compared),
            static_cast<long long>(close), elementTooMuch);
        EXPECT_LE(elementTooMuch, 1e-9);
        EXPECT_GT(2 * saved, asked) << "little is taken from what is known";
        EXPECT_GT(close, compared / 100);
        EXPECT_LE(tooMuch, 1e-9);
        EXPECT_GT(near, 15);
        EXPECT_LT(sum / near, 0.015);
        EXPECT_LE(torqueUse, 1.0 + 1e-9);
        EXPECT_GT(torqueUse, 0.5);
    }
}

// One joint moves out and comes back, and where it turns there is a ball of a millimetre: at the beginning and the end of the
// path, and at most looks between, there is room.
TEST(ArmStopCheck, ABallWhereTheArmTurnsIsNotMissed) {
    const Subject subject(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"));
    const int n = subject.robot.size();
    ArmGeometry alone = subject.geometry;
    alone.pairs.clear();
    const JointVector none = JointVector::Constant(n, kInfinity);
    ArmStopCheck check(subject.robot, &alone, {none, none}, kTick_s);
    ArmStopCheck::Result result = check.makeResult();
    const ArmRecursion arm(subject.robot);
    const LinkCapsule& tip = alone.capsules.back();
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -40.0, 40.0};
    int hits = 0;
    for (int round = 0; round < 200; ++round) {
        MotionState s;
        for (JointVector* v : {&s.q, &s.qd, &s.qdd}) v->setZero(n);
        for (double& q : s.q) q = 1.5 * share(random);
        const int moved = round % 3;
        s.qd[moved] = 0.8 + 0.15 * share(random);
        s.qdd[moved] = -12.0;
        const JointVector zero = JointVector::Zero(n);
        const ArmPath path = Begun{s, zero, {}}.turn(zero, limits).path();
        // The ball stands 2 mm in the way of the last capsule's end, where the joint turns.
        constexpr int kPoses = 1000;
        JointVector q, turned = s.q;
        for (int k = 0; k <= kPoses; ++k) {
            path.calcPositions(path.duration() * k / kPoses, q);
            if (q[moved] > turned[moved]) turned = q;
        }
        ArmRecursion::Frames frames;
        arm.calcFrames(turned, frames);
        const auto carrier = static_cast<std::size_t>(tip.carrier), joint = static_cast<std::size_t>(moved);
        const Eigen::Vector3d end = frames.origin[carrier] + frames.rotation[carrier] * tip.b;
        const Eigen::Vector3d ahead = frames.axis[joint].cross(end - frames.origin[joint]).normalized();
        Environment environment;
        environment.safetyDistance_m = 0.0;
        environment.solids.push_back(test::makeBall(end + (tip.radius + 1e-3 - 0.002) * ahead, 1e-3));
        const CollisionChecker checker(subject.robot, alone, environment);
        double least = kInfinity;
        for (int k = 0; k <= kPoses; ++k) {
            path.calcPositions(path.duration() * k / kPoses, q);
            least = std::min(least, checker.findContact(q, 0.0, kHorizon_m).distance);
        }
        const auto isFree = [&](const JointVector& pose) {
            return checker.findContact(pose, 0.0, kHorizon_m).distance > 1.04 * detail::bisection::kGuard_m;
        };
        if (!(least < 0.0 && isFree(s.q) && isFree(q))) continue;
        ++hits;
        const Surroundings surroundings(environment, -kFar, kFar, 1.0);
        check.setSurroundings(&surroundings);
        check.beginTick();
        ArmStopCheck::Demands demands =
            makeDemands(check, 0.0, detail::bisection::kGuard_m, detail::bisection::kGuard_m);
        demands.ahead = demands.far;
        check.examine(path, 0.0, demands, zero, {}, false, result);
        EXPECT_FALSE(result.isClear) << round;
    }
    EXPECT_GT(hits, 100);
}

}  // namespace
}  // namespace viable
