#include "viable/tracking/LoopStability.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <unsupported/Eigen/MatrixFunctions>

#include "Paths.h"
#include "tracking/FrozenLoop.h"
#include "tracking/InertiaSample.h"
#include "tracking/PoseTorques.h"

namespace viable {
namespace {

LinearErrorLoop makeLoop(int n, double kr, double kp, double ki) {
    LinearErrorLoop loop;
    loop.kr.setConstant(n, kr);
    loop.kp.setConstant(n, kp);
    loop.ki.setConstant(n, ki);
    return loop;
}

RobotDescription load(const char* name) {
    return loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name);
}

// One joint of 1 kg m^2, velocity part alone: unstable from c = 2 tan(pi / (4 + 4 d)) on, crossing 1 where the phase is
// -90 degrees - (1 + d) omega dt with tan(omega dt / 2) = c / 2.
TEST(LoopStability, MarginsOfOneJointAreThoseOfTheFormula) {
    const RobotDescription robot = load("single_joint");
    const double h = 1e-3;
    for (const int delay : {0, 1, 2, 5, 20}) {
        const double largest = 2.0 * std::tan(kPi / (4.0 * (1.0 + delay))) / h;
        EXPECT_NEAR(findLargestGains(robot, robot.limits, h, delay)[0], largest, 1e-9 * largest);
        for (const double share : {0.9, 0.5, 0.2}) {
            const double c = share * largest * h;
            const LoopMargins m = calcMargins(robot, robot.limits, h, delay, makeLoop(1, c / h, 0.0, 0.0));
            const double angle = 2.0 * std::atan(c / 2.0);
            EXPECT_TRUE(m.isStable);
            EXPECT_NEAR(m.gain, 1.0 / share, 2e-3 / share) << delay;
            EXPECT_NEAR(m.phase_rad, kPi / 2.0 - (1.0 + delay) * angle, 2e-3) << delay;
        }
        EXPECT_FALSE(calcMargins(robot, robot.limits, h, delay, makeLoop(1, 1.01 * largest, 0.0, 0.0)).isStable);
    }
}

/** Spectral radius with all torques times a complex factor: another route to the margins. */
double calcRadius(const RobotDescription& robot, const LinearErrorLoop& loop, const JointMatrix& M, double h, int delay,
                  double gain) {
    const JointMatrix K = detail::calcLoopGain(loop, M);
    return detail::calcSpectralRadius({M, JointVector::Zero(robot.size()), gain * K, loop.kp, loop.ki, h, delay});
}

// On whole arms, at the gain margin found: in some pose the loop becomes unstable there, up or down, and in none before.
TEST(LoopStability, TheGainMarginIsWhereTheLoopBecomesUnstable) {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> draw(0.0, 1.0);
    for (const char* name : {"panda", "ur5e", "indy7", "planar_two_link"})
        for (int k = 0; k < 6; ++k) {
            const RobotDescription robot = load(name);
            const double h = k % 2 ? 1e-3 : 2e-3;
            const int delay = k % 3;
            LinearErrorLoop loop = scaleGains(robot, robot.limits, h, delay);
            // Off the rule, in gains and structure.
            loop.kp *= 0.3 + 2.0 * draw(random);
            loop.ki *= 0.3 + 2.0 * draw(random);
            if (k >= 3) {
                loop.inertiaRate = kInfinity;
                loop.kr = (0.1 + 0.5 * draw(random)) * findLargestGains(robot, robot.limits, h, delay);
            }
            const LoopMargins m = calcMargins(robot, robot.limits, h, delay, loop);
            const auto samples = detail::sampleInertia(robot, robot.limits, 256);
            const auto isStable = [&](double gain) {
                for (const auto& sample : samples)
                    if (calcRadius(robot, loop, sample.M, h, delay, gain) >= 1.0) return false;
                return true;
            };
            EXPECT_EQ(m.isStable, isStable(1.0)) << name << " " << k;
            if (!m.isStable || m.gain > 30.0) continue;
            // The poses that are looked at are those of the fastest and the slowest mode: in others the margin may be a
            // little smaller.
            const double inside = 1.0 + 0.93 * (m.gain - 1.0);
            EXPECT_TRUE(isStable(inside) && isStable(1.0 / inside)) << name << " " << k << " " << m.gain;
            EXPECT_FALSE(isStable(1.02 * m.gain) && isStable(1.0 / (1.02 * m.gain)))
                << name << " " << k << " " << m.gain;
        }
}

// Each joint with gains of its own: what is unstable may be in no pose of the fastest or the slowest mode.
TEST(LoopStability, Fault80StableMeansInEveryPose) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> draw(-1.0, 1.0);
    const double h = 1e-3;
    int unstable = 0, stable = 0;
    for (const char* name : {"panda", "ur5e"})
        for (int k = 0; k < 24; ++k) {
            const RobotDescription robot = load(name);
            const int n = robot.size(), delay = k % 3 == 2 ? 2 : 0;
            const auto samples = detail::sampleInertia(robot, robot.limits, 256);
            const JointVector greatest = detail::findInertiaRange(samples).greatest;
            LinearErrorLoop loop = makeLoop(n, 0.0, 20.0, 0.01);
            loop.kr = 0.2 * findLargestGains(robot, robot.limits, h, delay);
            const int joint = k % 3;
            loop.kr[n - 1] *= 1e-3;
            loop.ki[joint] = std::pow(3.0, draw(random)) * loop.kp[joint] * loop.kr[joint] / greatest[joint];
            bool isStable = true;
            for (const auto& sample : samples) isStable &= calcRadius(robot, loop, sample.M, h, delay, 1.0) < 1.0;
            const LoopMargins m = calcMargins(robot, robot.limits, h, delay, loop);
            EXPECT_EQ(m.isStable, isStable) << name << " " << k;
            if (!m.isStable) EXPECT_EQ(m.joint, joint) << name << " " << k;
            ++(isStable ? stable : unstable);
        }
    EXPECT_GT(unstable, 10);
    EXPECT_GT(stable, 10);
}

TEST(LoopStability, Fault80AJointThatMovesTenTimesMoreElsewhereIsSeenBesideASlowerOne) {
    // Joint 1 is the slowest mode, the same in all poses.
    LinearErrorLoop loop = makeLoop(2, 1.0, 20.0, 0.01);
    loop.kr[0] = 100.0;
    loop.ki[0] = 500.0;
    std::vector<detail::PoseInertia> samples;
    for (int k = 0; k < 100; ++k) {
        JointMatrix M = JointMatrix::Identity(2, 2);
        M(0, 0) = 1.0 + 9.0 * k / 99.0;
        M(1, 1) = 1.0 + 1e-3 * (k == 0);
        samples.push_back({JointVector::Zero(2), M});
    }
    double outermost = 0.0;
    for (const auto* pose : detail::findCriticalPoses(samples, loop, 1e-3, 0))
        outermost = std::max(outermost, std::abs(detail::calcOutermostPole(loop, *pose, 1e-3, 0)));
    EXPECT_GT(outermost, detail::limitRadius(loop));
    double known = 0.0;  // by the fastest and the slowest mode alone
    for (const auto* pose : detail::findCriticalPoses(samples, loop, 1e-3, 0, false))
        known = std::max(known, std::abs(detail::calcOutermostPole(loop, *pose, 1e-3, 0)));
    EXPECT_LT(known, 1.0);
}

// A given k_r as much as one that follows: a delay and the velocity loop bound the others.
TEST(LoopStability, GainsForAGivenKrHaveMarginUnderDelay) {
    for (const char* name : {"indy7", "planar_two_link"})
        for (const int delay : {0, 1, 5}) {
            const RobotDescription robot = load(name);
            LinearErrorLoop given;
            given.kr = 0.3 * findLargestGains(robot, robot.limits, 1e-3, delay);
            const LinearErrorLoop loop = scaleGains(robot, robot.limits, 1e-3, delay, given);
            const LoopMargins m = calcMargins(robot, robot.limits, 1e-3, delay, loop);
            EXPECT_TRUE(m.isEnough()) << name << " " << delay << ": " << formatMargins(m);
            EXPECT_EQ(loop.kr, given.kr);
        }
}

TEST(LoopStability, ConstantGainsHaveEnoughMarginWhereLittleLessOfThemDo) {
    for (const char* name : {"indy7", "planar_two_link", "single_joint"})
        for (const double h : {5e-4, 1e-3, 4e-3}) {
            const RobotDescription robot = load(name);
            const LoopMargins m =
                calcMargins(robot, robot.limits, h, 0, detail::scaleConstantGains(robot, robot.limits, h));
            EXPECT_TRUE(m.isEnough()) << name << " " << h << ": " << formatMargins(m);
        }
}

TEST(LoopStability, GivenGainsStayWithoutAUsableInertia) {
    RobotDescription robot = load("planar_two_link");
    for (JointDescription& joint : robot.joints) joint.body = {};
    robot.actuation.rotorInertia.setZero();
    ASSERT_TRUE(detail::sampleInertia(robot, robot.limits, 10).empty());
    LinearErrorLoop given;
    given.kr.setConstant(2, 7.0);
    const LinearErrorLoop loop = scaleGains(robot, robot.limits, 1e-3, 0, given);
    EXPECT_EQ(loop.kr, given.kr);
    EXPECT_EQ(loop.kp.cwiseAbs().maxCoeff(), 0.0);
}

// In every pose, not only where it was looked.
TEST(LoopStability, ScaledGainsHaveEnoughMarginOnEveryArmAndTick) {
    for (const char* name : {"panda", "ur5e", "indy7", "planar_two_link", "single_joint"})
        for (const double h : {5e-4, 1e-3, 4e-3})
            for (const int delay : {0, 3}) {
                const RobotDescription robot = load(name);
                const LinearErrorLoop loop = scaleGains(robot, robot.limits, h, delay);
                const LoopMargins m = calcMargins(robot, robot.limits, h, delay, loop);
                EXPECT_TRUE(m.isEnough()) << name << " " << h << " " << delay << ": " << formatMargins(m);
                EXPECT_GT(loop.kp.minCoeff(), 0.0);
                for (const auto& sample : detail::sampleInertia(robot, robot.limits, 300)) {
                    for (const double gain : {0.5, 1.0, 1.9})
                        EXPECT_LT(calcRadius(robot, loop, sample.M, h, delay, gain), 1.0) << name;
                    const JointMatrix K = detail::calcLoopGain(loop, sample.M);
                    EXPECT_LE((K.diagonal() - loop.kr).maxCoeff(), 1e-9);
                    EXPECT_LE((K - K.transpose()).cwiseAbs().maxCoeff(), 1e-9 * K.norm());
                }
            }
}

TEST(LoopStability, GivenGainsAreKeptAndTheOthersFitThem) {
    const RobotDescription robot = load("panda");
    LinearErrorLoop given;
    given.kr = 0.3 * findLargestGains(robot, robot.limits, 1e-3, 0);
    const LinearErrorLoop loop = scaleGains(robot, robot.limits, 1e-3, 0, given);
    EXPECT_EQ(loop.kr, given.kr);
    EXPECT_TRUE(std::isinf(loop.inertiaRate));
    EXPECT_GT(loop.kp.minCoeff(), 0.0);
    EXPECT_GT(loop.ki.minCoeff(), 0.0);
    EXPECT_TRUE(calcMargins(robot, robot.limits, 1e-3, 0, loop).isStable);
}

TEST(LoopStability, WithoutGainsNothingIsUnstable) {
    const RobotDescription robot = load("indy7");
    EXPECT_TRUE(calcMargins(robot, robot.limits, 1e-3, 0, makeLoop(6, 0.0, 0.0, 0.0)).isEnough());
    LinearErrorLoop one = makeLoop(6, 0.0, 20.0, 8.0);
    one.kr[2] = 100.0;
    EXPECT_TRUE(calcMargins(robot, robot.limits, 1e-3, 0, one).isStable);
    one.kr[2] = 1e4;
    const LoopMargins unstable = calcMargins(robot, robot.limits, 1e-3, 0, one);
    EXPECT_FALSE(unstable.isStable);
    EXPECT_EQ(unstable.joint, 2);
}

/** The matrix of the loop over a tick without delay, its arm by a matrix exponential: another route than modes. */
Eigen::MatrixXd assembleLoop(const detail::FrozenLoop& l) {
    const Eigen::Index n = l.kp.size();
    const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(n, n), inverse = Eigen::MatrixXd(l.inertia).inverse();
    Eigen::MatrixXd rate = Eigen::MatrixXd::Zero(3 * n, 3 * n);  // of e, de and a torque that stays
    rate.block(0, n, n, n) = I;
    rate.block(n, n, n, n) = -inverse * Eigen::MatrixXd(l.damping.asDiagonal());
    rate.block(n, 2 * n, n, n) = inverse;
    const Eigen::MatrixXd arm = (l.tick_s * rate).exp().topRows(2 * n);
    Eigen::MatrixXd torque = Eigen::MatrixXd::Zero(n, 4 * n);  // of e, de, e before, sum of e
    const Eigen::MatrixXd kp = l.kp.asDiagonal(), ki = l.ki.asDiagonal();
    torque.leftCols(n) = -l.kr * (I / l.tick_s + kp + l.tick_s * ki);
    torque.middleCols(2 * n, n) = l.kr / l.tick_s;
    torque.rightCols(n) = -l.kr * ki;
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(4 * n, 4 * n);
    A.topLeftCorner(2 * n, 2 * n) = arm.leftCols(2 * n);
    A.topRows(2 * n) += arm.rightCols(n) * torque;
    A.block(2 * n, 0, n, n) = I;
    A.block(3 * n, 0, n, n) = l.tick_s * I;
    A.block(3 * n, 3 * n, n, n) = I;
    return A;
}

// Damping from far below to far above what a tick can follow (joint7 of a Panda: damping x tick / inertia = 12).
TEST(FrozenLoop, IsExactForAnyDamping) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> draw(-1.0, 1.0);
    for (int k = 0; k < 300; ++k) {
        const int n = 1 + k % 4;
        const double h = 1e-3;
        Eigen::MatrixXd root(n, n);
        for (double& x : root.reshaped()) x = draw(random);
        detail::FrozenLoop loop;
        loop.inertia = 1e-2 * (root * root.transpose() + 0.1 * Eigen::MatrixXd::Identity(n, n));
        loop.damping = JointVector::Constant(n, std::pow(10.0, 3.0 + 4.0 * draw(random)) * loop.inertia(0, 0));
        loop.kr = JointMatrix(JointVector::Constant(n, 0.2 * loop.inertia(0, 0) / h).asDiagonal());
        loop.kp = JointVector::Constant(n, 20.0);
        loop.ki = JointVector::Constant(n, 8.0);
        loop.tick_s = h;
        const Eigen::EigenSolver<Eigen::MatrixXd> other(assembleLoop(loop), false);
        EXPECT_NEAR(detail::calcSpectralRadius(loop), other.eigenvalues().cwiseAbs().maxCoeff(), 1e-9) << "draw " << k;
    }
}

/** The gains of a loop of one joint without damping, by following it tick by tick until it rests. */
struct FollowedLoop {
    std::array<double, detail::kLoopOutputs> torque{}, step{}, ramp{}, reading{}, variation{}, aged{};

    explicit FollowedLoop(const detail::FrozenLoop& loop) {
        struct State {
            double e = 0.0, v = 0.0, before = 0.0, sum = 0.0;
            std::vector<double> sent;
        };
        const double h = loop.tick_s, M = loop.inertia(0, 0), kr = loop.kr(0, 0), kp = loop.kp[0], ki = loop.ki[0];
        /** A tick under the torque w with the reading error n; returns (e, v, tau_a, integral's part) at its beginning. */
        const auto tick = [&](State& s, double w, double n) {
            const double read = s.e + n, rate = (read - s.before) / h;
            s.sum += h * read;
            const double integral = -kr * ki * s.sum, tau = integral - kr * (rate + kp * read);
            const std::array<double, 4> shown{s.e, s.v, tau, integral};
            s.sent.push_back(tau);
            const double a = (s.sent.front() + w) / M;
            s.sent.erase(s.sent.begin());
            s.before = read;
            s.e += h * s.v + 0.5 * h * h * a;
            s.v += h * a;
            return shown;
        };
        const auto follow = [&](State s, double w, double firstError, const auto& look) {
            s.sent.assign(static_cast<std::size_t>(loop.delayTicks), 0.0);
            std::array<double, 4> now = tick(s, w, firstError);
            for (int k = 0; k < 200000; ++k) {
                const std::array<double, 4> next = tick(s, w, 0.0);
                look(k, std::array<double, 5>{now[0], now[1], now[2], next[2] - now[2], now[3]});
                now = next;
            }
        };
        std::array<double, 5> last{};
        follow({0.0, 1.0 / M, 0.0, 0.0, {}}, 0.0, 0.0, [&](int k, const auto& out) {
            // From the tick before on, in which a torque shows in the step to the next one only.
            if (k == 0) last[3] = out[2];
            for (std::size_t i = k == 0 ? 3 : 0; i < (k == 0 ? 4 : 5); ++i) {
                torque[i] += 0.5 * h * (std::abs(last[i]) + std::abs(out[i]));
                variation[i] += std::abs(out[i] - last[i]);
                aged[i] += std::abs(k - 0.5) * h * std::abs(out[i] - last[i]);
            }
            last = out;
        });
        follow({}, 1.0, 0.0, [&](int k, const auto& out) {
            for (std::size_t i = 0; i < 5; ++i) {
                const double lack = std::abs(out[i] + (i == 2 || i == 4 ? 1.0 : 0.0));
                step[i] = std::max(step[i], std::abs(out[i]));
                // One that begins between the ticks before and at 0 shows in the step to the latter.
                ramp[i] += h * (k > 0 ? std::max(lack, last[i]) : i == 3 ? 0.5 * lack : 0.0);
                last[i] = lack;
            }
        });
        follow({}, 0.0, 1.0, [&](int k, const auto& out) {
            for (std::size_t i = 0; i < 5; ++i) reading[i] += std::abs(out[i]);
            if (k == 0) reading[3] += std::abs(out[2]);  // the step to the tick of the error
        });
        // And the error of the reading before the first.
        std::array<double, 5> most{};
        follow({0.0, 0.0, 1.0, 0.0, {}}, 0.0, 0.0, [&](int, const auto& out) {
            for (std::size_t i = 0; i < 5; ++i) most[i] = std::max(most[i], std::abs(out[i]));
        });
        for (std::size_t i = 0; i < 5; ++i) reading[i] += most[i];
    }
};

/** The error loop of one joint of 0.5 kg m^2 without damping, at 1 kHz. */
detail::FrozenLoop makeOneJoint(double kr, double kp, double ki, int delayTicks = 0) {
    detail::FrozenLoop loop;
    loop.inertia = JointMatrix(JointVector::Constant(1, 0.5).asDiagonal());
    loop.damping = JointVector::Zero(1);
    loop.kr = JointMatrix(JointVector::Constant(1, kr).asDiagonal());
    loop.kp = JointVector::Constant(1, kp);
    loop.ki = JointVector::Constant(1, ki);
    loop.tick_s = 1e-3;
    loop.delayTicks = delayTicks;
    return loop;
}

/** The largest k_r, to rounding, with which it is stable. */
double findStableKr(double kp, double ki, int delayTicks = 0) {
    double stable = 50.0, unstable = 2000.0;
    for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (stable + unstable);
        (detail::calcSpectralRadius(makeOneJoint(middle, kp, ki, delayTicks)) < 1.0 ? stable : unstable) = middle;
    }
    return stable;
}

// Next to the stability limit a pole near -1 (or, with delay, anywhere on the circle) swings for thousands of ticks: seen, too.
TEST(FrozenLoop, SeesWhatOscillatesNextToTheStabilityLimit) {
    for (const int delay : {0, 1, 2})
        for (const double share : {0.3, 0.9, 0.97, 0.99}) {
            const detail::FrozenLoop loop = makeOneJoint(share * findStableKr(20.0, 8.0, delay), 20.0, 8.0, delay);
            SCOPED_TRACE("delay " + std::to_string(delay) + ", k_r " + std::to_string(loop.kr(0, 0)) +
                         ", outermost pole " + std::to_string(detail::calcSpectralRadius(loop)));
            const FollowedLoop followed(loop);
            const detail::LoopGains gains = detail::calcGains(loop);
            for (std::size_t i = 0; i < detail::kLoopOutputs; ++i) {
                double variation = 0.0, aged = 0.0;
                for (const detail::LoopGains::Variation& span : gains.variations) {
                    variation += span.total[i](0, 0);
                    aged += span.aged[i](0, 0);
                }
                const auto expectBound = [&](const char* what, double found, double real, double looser) {
                    EXPECT_GE(found, real * (1.0 - 1e-3)) << what << " of output " << i;
                    EXPECT_LE(found, real * looser) << what << " of output " << i;
                };
                expectBound("torque", gains.torque[i](0, 0), followed.torque[i], 1.02);
                expectBound("step", gains.step[i](0, 0), followed.step[i], 1.02);
                expectBound("ramp", gains.ramp[i](0, 0), followed.ramp[i], 1.1);
                expectBound("reading", gains.reading[i](0, 0), followed.reading[i], 1.05);
                expectBound("variation", variation, followed.variation[i], 1.02);
                expectBound("aged variation", aged, followed.aged[i], 1.3);  // an age counts to a stride's end
            }
        }
}

// A joint whose integral works slowly is followed to its end, also beside one with larger gains that settle soon.
TEST(FrozenLoop, EveryJointIsFollowedToItsEnd) {
    detail::FrozenLoop both;
    both.inertia = JointMatrix(JointVector::Constant(2, 0.5).asDiagonal());
    both.damping = JointVector::Zero(2);
    both.kr = JointMatrix(JointVector::Constant(2, 150.0).asDiagonal());
    both.kp = JointVector::Constant(2, 20.0);
    both.ki.resize(2);
    both.ki << 8.0, 0.01;
    both.tick_s = 1e-3;
    const detail::LoopGains gains = detail::calcGains(both, {1e-2, 1.0, 100.0});
    for (const int joint : {0, 1}) {
        const detail::LoopGains alone =
            detail::calcGains(makeOneJoint(150.0, 20.0, both.ki[joint]), {1e-2, 1.0, 100.0});
        for (std::size_t i = 0; i < detail::kLoopOutputs; ++i) {
            const auto expectSame = [&](const Eigen::MatrixXd& found, const Eigen::MatrixXd& expected) {
                EXPECT_NEAR(found(joint, joint), expected(0, 0), 2e-3 * expected(0, 0))
                    << "joint " << joint << " " << i;
            };
            expectSame(gains.torque[i], alone.torque[i]);
            expectSame(gains.step[i], alone.step[i]);
            expectSame(gains.ramp[i], alone.ramp[i]);
            expectSame(gains.reading[i], alone.reading[i]);
            for (const std::size_t age : {0, 1, 2}) expectSame(gains.earlyTorque[age][i], alone.earlyTorque[age][i]);
        }
    }
}

TEST(FrozenLoop, HasNoGainsWhereAResponseHardlyDiesOut) {
    const detail::FrozenLoop loop = makeOneJoint(findStableKr(1e-3, 1e-3), 1e-3, 1e-3);
    ASSERT_LT(detail::calcSpectralRadius(loop), 1.0);
    EXPECT_TRUE(std::isinf(detail::calcGains(loop).torque[0](0, 0)));
}

// What is no older than an age grows to the whole, what is older falls to nothing; both against the loop tick by tick.
TEST(FrozenLoop, TellsYoungFromOldResponses) {
    const detail::FrozenLoop loop = makeOneJoint(300.0, 40.0, 8.0);
    std::vector<double> ages = {4e-3, 16e-3, 64e-3};
    // Also such as lie between the ticks that are looked at, which are every fourth and later every sixteenth one.
    for (double age = 0.257; age < 3.0; age += 0.037) ages.push_back(age);
    ages.push_back(1e7);
    const detail::LoopGains gains = detail::calcGains(loop, ages);
    ASSERT_EQ(gains.earlyTorque.size(), ages.size());
    const Eigen::MatrixXd A = assembleLoop(loop);
    Eigen::MatrixXd push = Eigen::MatrixXd::Zero(4, 1);
    push(0, 0) = 0.5 * 1e-6 / 0.5;
    push(1, 0) = 1e-3 / 0.5;
    Eigen::MatrixXd kick = Eigen::MatrixXd::Zero(4, 1), pushed = kick;
    kick(1, 0) = 1.0 / 0.5;
    constexpr int kVelocity = static_cast<int>(detail::LoopOutput::Velocity), kTicks = 4000;
    std::vector<double> sum{0.0};
    std::array<std::vector<double>, 2> level{{{0.0}, {0.0}}};  // of position and velocity
    for (int k = 0; k < kTicks; ++k) {
        const double before = std::abs(kick(1, 0));
        kick = A * kick;
        pushed = A * pushed + push;
        sum.push_back(sum.back() + 0.5e-3 * (before + std::abs(kick(1, 0))));
        for (int i : {0, 1}) level[static_cast<std::size_t>(i)].push_back(std::abs(pushed(i, 0)));
    }
    for (std::size_t k = 0; k < ages.size(); ++k) {
        const auto tick = static_cast<std::size_t>(std::min(ages[k] / 1e-3 + 0.5, double(kTicks)));
        EXPECT_NEAR(gains.earlyTorque[k][kVelocity](0, 0), sum[tick], 2e-3 * sum.back()) << ages[k];
        const std::pair<int, std::size_t> outputs[] = {{static_cast<int>(detail::LoopOutput::Position), 0},
                                                       {kVelocity, 1}};
        for (const auto& [output, i] : outputs) {
            const double found = gains.lateStep[k][static_cast<std::size_t>(output)](0, 0);
            const double largest =
                *std::max_element(level[i].begin() + static_cast<std::ptrdiff_t>(tick), level[i].end());
            // A smooth top may lie between two looks. After months nothing is known but what is left.
            EXPECT_GE(found, ages[k] < 1e6 ? largest * (1.0 - 1e-4) : 0.0) << ages[k] << " output " << output;
            EXPECT_LE(found, 1.2 * *std::max_element(level[i].begin(), level[i].end())) << ages[k] << " " << output;
        }
        EXPECT_LE(gains.lateStep[k][kVelocity](0, 0), 1.2 * level[1][std::min<std::size_t>(tick, 64)] + 1e-6)
            << ages[k];
    }
    EXPECT_EQ(gains.earlyTorque.back()[kVelocity](0, 0), gains.torque[kVelocity](0, 0));
}

// No draw of pose, velocities, errors and inaccurate entries has more torque; those at corners have all of it.
TEST(PoseTorques, AreTheLargestOfAllMotions) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> draw(-1.0, 1.0);
    for (const int n : {1, 2, 3, 9}) {
        const auto drawMatrix = [&] {
            Eigen::MatrixXd m(n, n);
            for (double& x : m.reshaped()) x = draw(random);
            return m;
        };
        const auto drawSize = [&] {
            JointVector v(n);
            for (double& x : v) x = 0.5 * (1.0 + draw(random));
            return v;
        };
        detail::PoseTorques torques;
        std::vector<detail::PoseSample> samples(3);
        for (detail::PoseSample& sample : samples) {
            for (int k = 0; k < n; ++k) {
                sample.given.gradient.push_back(drawMatrix());
                sample.given.coriolis.push_back(drawMatrix());
                sample.error.gradient.emplace_back(0.1 * drawMatrix().cwiseAbs());
                sample.error.coriolis.emplace_back(0.1 * drawMatrix().cwiseAbs());
            }
            sample.given.stiffness = drawMatrix().cwiseAbs();
            sample.error.stiffness = 0.1 * drawMatrix().cwiseAbs();
            torques.add(sample);
        }
        const JointVector v = drawSize(), e = drawSize(), de = drawSize();
        const JointVector errorTorque = torques.calcErrorTorque(v, e, de), rate = torques.calcInertiaRate(v, de);
        JointVector reached = JointVector::Zero(n);
        for (int trial = 0; trial < 20000; ++trial) {
            const bool isCorner = trial % 2 == 0;
            const auto drawWithin = [&](const JointVector& size) {
                JointVector x(n);
                for (int i = 0; i < n; ++i) {
                    const double share = draw(random);
                    x[i] = size[i] * (isCorner ? std::copysign(1.0, share) : share);
                }
                return x;
            };
            const detail::PoseSample& sample = samples[static_cast<std::size_t>(trial % 3)];
            const JointVector speed = drawWithin(v), error = drawWithin(de);
            Eigen::MatrixXd C = Eigen::MatrixXd::Zero(n, n), own = C, M = C;
            for (int k = 0; k < n; ++k) {
                const auto at = static_cast<std::size_t>(k);
                const Eigen::MatrixXd real = sample.given.coriolis[at] + draw(random) * sample.error.coriolis[at];
                C += speed[k] * real;
                own += error[k] * real;
                M += speed[k] * (sample.given.gradient[at] + draw(random) * sample.error.gradient[at]);
            }
            const JointVector stiff = (sample.given.stiffness + draw(random) * sample.error.stiffness) * drawWithin(e);
            const JointVector torque = stiff + (C.transpose() - C + own) * error, inertia = M * error;
            EXPECT_TRUE((torque.cwiseAbs().array() <= errorTorque.array()).all());
            EXPECT_TRUE((inertia.cwiseAbs().array() <= rate.array()).all());
            reached = reached.cwiseMax(inertia.cwiseAbs().cwiseQuotient(rate));
        }
        EXPECT_GT(reached.minCoeff(), n <= 3 ? 0.85 : 0.0) << n;
    }
}

}  // namespace
}  // namespace viable
