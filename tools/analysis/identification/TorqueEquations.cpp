#include "analysis/identification/TorqueEquations.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <deque>

#include "analysis/smoothing/Median.h"
#include "analysis/smoothing/Smoothing.h"
#include "core/Text.h"
#include "records/WorkShare.h"
#include "robot/ArmRecursion.h"

namespace viable::detail {

namespace {

/** Shortest window that is chosen [s]: friction figures do not change faster than a joint does. */
constexpr double kLeastWindow_s = 0.1;
/** Least length of a window over the smoothing's, and in readings: the equations must not see what was smoothed. */
constexpr double kWindowsPerSmoothing = 4.0;
constexpr double kReadingsPerWindow = 20.0;
/** The shortest windows of a run over the longest. */
constexpr double kShortWindow = 1.0 / 3.0;
/** A velocity has a sign beyond this many deviations, and beyond this share of the joint's largest. */
constexpr double kSureSign = 5.0;
constexpr double kSlowShare = 0.005;
/** A pause in the record: so many median intervals. */
constexpr double kGap = 5.0;
/** Blocks: long compared with a window, and so many at most. */
constexpr double kWindowsPerBlock = 5.0;
constexpr double kMostBlocks = 40.0;
constexpr int kLeastBlocks = 8;

/** Joint torques of the nominal arm and of what may have to be added to it. */
class TorqueBasis {
public:
    TorqueBasis(const RobotDescription& nominal, bool withPayload, bool withBodies) : nominal_(nominal) {
        if (withPayload) {
            const auto unit = [](int axis) -> Eigen::Vector3d { return Eigen::Vector3d::Unit(axis % 3); };
            std::vector<Eigen::Vector3d> places{Eigen::Vector3d::Zero()};
            for (int axis = 0; axis < 3; ++axis)
                for (const double side : {1.0, -1.0}) places.emplace_back(side * unit(axis));
            for (int axis = 0; axis < 3; ++axis) places.emplace_back(unit(axis) + unit(axis + 1));
            for (const Eigen::Vector3d& place : places) loaded_.emplace_back(viable::withPayload(nominal, 1.0, place));
        }
        for (const Eigen::Vector3d& side : {Eigen::Vector3d::UnitX().eval(), Eigen::Vector3d::UnitY().eval()}) {
            RobotDescription tilted = nominal;
            tilted.gravity += side;
            tilted_.emplace_back(tilted);
        }
        for (int i = 0; withBodies && i < nominal.size(); ++i) {
            JointVector factor = JointVector::Ones(nominal.size());
            factor[i] = 2.0;
            doubled_.emplace_back(withScaledMasses(nominal, factor));
        }
    }

    void realize(const JointVector& q, const JointVector& qd, const JointVector& qdd) {
        nominal_.calcTorque(q, qd, qdd, rigid);
        // Of a point mass of 1 kg the torque is a quadratic in its place: ten places tell all of it.
        const auto calcMore = [&](const ArmRecursion& arm, JointVector& torque) {
            arm.calcTorque(q, qd, qdd, torque);
            torque -= rigid;
        };
        std::array<JointVector, kPayloadColumns> t;
        for (std::size_t i = 0; i < loaded_.size(); ++i) calcMore(loaded_[i], t[i]);
        if (!loaded_.empty()) {
            payload[0] = t[0];
            for (std::size_t i = 0; i < 3; ++i) {
                payload[1 + i] = 0.5 * (t[1 + 2 * i] - t[2 + 2 * i]);
                payload[4 + i] = 0.5 * (t[1 + 2 * i] + t[2 + 2 * i]) - t[0];
            }
            for (std::size_t i = 0; i < 3; ++i) {
                const std::size_t j = (i + 1) % 3;
                payload[7 + i] = t[7 + i] - t[0] - payload[1 + i] - payload[1 + j] - payload[4 + i] - payload[4 + j];
            }
        }
        for (std::size_t i = 0; i < 2; ++i) calcMore(tilted_[i], tilt[i]);
        bodies.resize(doubled_.size());
        for (std::size_t i = 0; i < doubled_.size(); ++i) calcMore(doubled_[i], bodies[i]);
        double size = rigid.cwiseAbs().maxCoeff();
        for (const JointVector& torque : t)
            if (torque.size() > 0) size = std::max(size, torque.cwiseAbs().maxCoeff());
        if (!loaded_.empty())
            for (JointVector& torque : payload) dropRounding(size, torque);
        for (JointVector& torque : bodies) dropRounding(size, torque);
        for (JointVector& torque : tilt) dropRounding(size, torque);
    }

    bool hasPayload() const { return !loaded_.empty(); }

    JointVector rigid;
    std::array<JointVector, kPayloadColumns> payload;
    std::vector<JointVector> bodies;
    std::array<JointVector, 2> tilt;

private:
    /** Differences of torques that are nothing but their rounding must not look as if they told something. */
    static void dropRounding(double size, JointVector& torque) {
        constexpr double kRounding = 1e-11;
        for (int i = 0; i < torque.size(); ++i)
            if (std::abs(torque[i]) < kRounding * size) torque[i] = 0.0;
    }

    ArmRecursion nominal_;
    std::deque<ArmRecursion> loaded_, doubled_, tilted_;  // made in place, never copied
};

/** A record's columns in the order of the robot's joints, and its smoothed motion. */
struct Motion {
    const MotionRecord* record = nullptr;
    std::vector<const MotionRecord::Joint*> joints;
    std::vector<std::array<std::vector<double>, 3>> path;  ///< per joint q, qd, qdd at the record's times
    std::vector<std::vector<double>> velocityDeviation;
    std::vector<double> shaking;   ///< velocity that the smoothed motion does not show [rad/s]
    std::vector<double> margin_s;  ///< around a reversal in which the smoothed motion is not the true one
    std::vector<char> startsAnew;  ///< a pause lies before this sample
    double interval_s = 0.0;
};

std::string quoteNames(const std::vector<std::string>& names) {
    return "`" + join(names, "`, `") + "`";
}

void findJoints(const RobotDescription& nominal, Motion& motion) {
    const MotionRecord& record = *motion.record;
    const std::vector<std::string> names = nominal.jointNames();
    std::vector<std::string> there;
    for (const MotionRecord::Joint& joint : record.joints) {
        there.push_back(joint.name);
        if (std::find(names.begin(), names.end(), joint.name) != names.end()) continue;
        const std::string closest = findClosestName(joint.name, names);
        throw badInput(
            record.source, "the robot `" + nominal.name + "` has no joint `" + joint.name + "`",
            (closest.empty() ? "" : "Did you mean `" + closest + "`? ") + "Its joints are " + quoteNames(names) + ".");
    }
    for (const std::string& name : names) {
        const auto place = std::find(there.begin(), there.end(), name);
        if (place == there.end())
            throw badInput(
                record.source, "the record has no joint `" + name + "` of the robot `" + nominal.name + "`",
                "All joints move each other, so all positions are needed; it has " + quoteNames(there) + ".");
        motion.joints.push_back(&record.joints[static_cast<std::size_t>(place - there.begin())]);
    }
    const auto hasTorques = [](const MotionRecord::Joint* joint) { return !joint->torques.empty(); };
    if (std::none_of(motion.joints.begin(), motion.joints.end(), hasTorques))
        throw badInput(record.source, "the record has no torques",
                       "Friction and masses are found from the torques of the motors at the joints.");
    const std::size_t n = record.times_s.size();
    if (n < kLeastSamples)
        throw badInput(record.source, "the record has " + std::to_string(n) + " rows",
                       "It takes " + std::to_string(kLeastSamples) + " at the very least, and some 10 s of motion.");
    for (const MotionRecord::Joint* joint : motion.joints)
        VIABLE_CHECK(joint->positions.size() == n && (joint->torques.empty() || joint->torques.size() == n),
                     "one position and torque per time");
}

/** @param share  of the records that were read before; `own`: its own */
Motion readMotion(const RobotDescription& nominal, const MotionRecord& record, double share, double own) {
    Motion motion;
    motion.record = &record;
    findJoints(nominal, motion);
    const std::vector<double>& times = record.times_s;
    std::vector<double> intervals;
    for (std::size_t k = 1; k < times.size(); ++k) intervals.push_back(times[k] - times[k - 1]);
    motion.interval_s = calcMedian(std::move(intervals));
    motion.startsAnew.assign(times.size(), 0);
    for (std::size_t k = 1; k < times.size(); ++k)
        motion.startsAnew[k] = times[k] - times[k - 1] > kGap * motion.interval_s;

    const std::size_t joints = motion.joints.size();
    motion.path.resize(joints);
    motion.velocityDeviation.resize(joints);
    motion.margin_s.resize(joints);
    const auto smooth = [&](std::size_t i) {
        const MotionRecord::Joint& joint = *motion.joints[i];
        auto& path = motion.path[i];
        for (auto& order : path) order.assign(times.size(), 0.0);
        std::vector<double>& deviation = motion.velocityDeviation[i];
        deviation.assign(times.size(), 0.0);
        // A joint at rest has nothing to smooth, or so little that a whole count never changes.
        const auto isSame = [&](double q) { return !(q != joint.positions.front()); };
        if (std::isfinite(joint.positions.front()) &&
            std::all_of(joint.positions.begin(), joint.positions.end(), isSame)) {
            path[0].assign(times.size(), joint.positions.front());
            return;
        }
        const SmoothedMotion smoothed =
            smoothMotion(times, joint.positions, record.source + ": joint `" + joint.name + "`");
        motion.margin_s[i] = smoothed.window_s();
        for (std::size_t k = 0; k < times.size(); ++k) {
            const MotionEstimate estimate = smoothed.evaluate(times[k]);
            for (std::size_t order = 0; order < 3; ++order) path[order][k] = estimate.mean[order];
            deviation[k] = estimate.deviation[1];
        }
    };
    WorkShare::forEachAtOnce("smoothing", joints, smooth, countSmoothedAtOnce(times.size()), share, own);
    return motion;
}

/** What of `values` a moving average over 2 h + 1 of them does not hold. */
std::vector<double> removeAverage(const std::vector<double>& values, std::size_t h) {
    std::vector<double> sums(1, 0.0), rest;
    for (const double v : values) sums.push_back(sums.back() + v);
    for (std::size_t k = 0; k < values.size(); ++k) {
        const std::size_t reach = std::min({h, k, values.size() - 1 - k});  // a mean about its own middle
        rest.push_back(values[k] - (sums[k + reach + 1] - sums[k - reach]) / static_cast<double>(2 * reach + 1));
    }
    return rest;
}

/** Standard deviation of the velocity that the smoothed motion does not show: a loop on noisy encoders lets the motors
shake the joint faster than the smoothing follows, and their torques tell how fast [rad/s]. */
double calcShaking(const RobotDescription& nominal, const Motion& motion, std::size_t joint) {
    const std::vector<double>& torques = motion.joints[joint]->torques;
    const std::vector<double>& times = motion.record->times_s;
    if (torques.empty()) return 0.0;
    // The least inertia over some poses of the record: of this joint when all others are free.
    constexpr std::size_t kPoses = 20;
    const ArmRecursion arm(nominal);
    JointVector q(nominal.size());
    JointMatrix M(nominal.size(), nominal.size());
    double inertia = std::numeric_limits<double>::infinity();
    for (std::size_t pose = 0; pose < kPoses; ++pose) {
        for (std::size_t i = 0; i < motion.joints.size(); ++i)
            q[static_cast<int>(i)] = motion.path[i][0][pose * (times.size() - 1) / (kPoses - 1)];
        arm.calcInertia(q, M);
        const int at = static_cast<int>(joint);
        inertia = std::min(inertia, 1.0 / M.llt().solve(JointVector::Unit(nominal.size(), at).eval())[at]);
    }
    std::vector<double> impulse(1, 0.0);
    for (std::size_t k = 0; k + 1 < times.size(); ++k) {
        const double step = motion.startsAnew[k + 1] ? 0.0 : times[k + 1] - times[k];
        impulse.push_back(impulse.back() + (std::isfinite(torques[k]) ? torques[k] * step : 0.0));
    }
    // Twice: once would leave the curvature of torques that change slowly.
    const double half = std::ceil(0.5 * motion.margin_s[joint] / motion.interval_s);
    const std::size_t reach = std::max<std::size_t>(static_cast<std::size_t>(half), 1);
    std::vector<double> rest = removeAverage(removeAverage(impulse, reach), reach);
    for (double& x : rest) x = std::abs(x);
    // The mean square, with jumps of the torque at reversals, which friction takes up, cut off.
    constexpr double kMedian = 0.6745,
                     kCut = 3.0;  // of the normal distribution's size; [deviations]
    const double most = kCut * calcMedian(rest) / kMedian;
    double squares = 0.0;
    for (const double x : rest) squares += std::min(x, most) * std::min(x, most);
    return std::sqrt(squares / static_cast<double>(rest.size())) / inertia;
}

/** Samples [first, last] of a window; its weight is zero at both. */
struct Window {
    std::size_t first, last;
    int run;
};

/** Windows of one joint in one record, where its velocity has a sign. */
std::vector<Window> layWindows(const Motion& motion, std::size_t joint, double window_s, double slow,
                               JointActivity& activity, int& run) {
    std::vector<Window> windows;
    const std::vector<double>& times = motion.record->times_s;
    const MotionRecord::Joint& data = *motion.joints[joint];
    const std::vector<double>& velocity = motion.path[joint][1];
    const auto findSide = [&](std::size_t k) {
        const bool isRead = std::isfinite(data.positions[k]) && std::isfinite(data.torques[k]);
        const double least =
            std::max(slow, kSureSign * std::hypot(motion.velocityDeviation[joint][k], motion.shaking[joint]));
        return !isRead || std::abs(velocity[k]) <= least ? 0 : velocity[k] > 0.0 ? 1 : -1;
    };
    for (std::size_t begin = 0; begin < times.size();) {
        const int side = findSide(begin);
        std::size_t end = begin + 1;
        while (end < times.size() && findSide(end) == side && !motion.startsAnew[end]) ++end;
        if (side != 0) {
            std::size_t first = begin, last = end - 1;
            const double margin = motion.margin_s[joint];
            while (first < last && times[first] < times[begin] + margin) ++first;
            while (last > first && times[last] > times[end - 1] - margin) --last;
            const double length = times[last] - times[first];
            if (length >= kShortWindow * window_s && last - first >= 4) {
                const int halves = std::max(2, static_cast<int>(std::ceil(2.0 * length / window_s)));
                const double half = length / halves;
                const auto findSample = [&](int i) {
                    if (i == halves) return last;
                    const auto at = std::lower_bound(times.begin() + static_cast<std::ptrdiff_t>(first),
                                                     times.begin() + static_cast<std::ptrdiff_t>(last),
                                                     times[first] + half * i - 0.25 * motion.interval_s);
                    return static_cast<std::size_t>(at - times.begin());
                };
                for (int i = 0; i + 2 <= halves; ++i) {
                    const Window w{findSample(i), findSample(i + 2), run};
                    if (w.last >= w.first + 4) windows.push_back(w);
                }
                ++run;
                activity.moving_s += length;
            }
        }
        begin = end;
    }
    return windows;
}

/** The weight 1 - cos over a window, and its integral from the window's begin. */
struct Bell {
    double begin_s, length_s;
    double weigh(double t) const { return (1.0 - std::cos(2.0 * M_PI * (t - begin_s) / length_s)) / length_s; }
    double integrate(double t) const {
        const double s = std::clamp((t - begin_s) / length_s, 0.0, 1.0);
        return s - std::sin(2.0 * M_PI * s) / (2.0 * M_PI);
    }
};

/** d/dt of the torque, by parts: the bell is zero at both ends. */
double averageTorqueRate(const MotionRecord& record, const std::vector<double>& torques, const Window& w, bool isHeld) {
    const Bell bell{record.times_s[w.first], record.times_s[w.last] - record.times_s[w.first]};
    double sum = 0.0;
    for (std::size_t k = w.first; k < w.last; ++k) {
        const double torque = isHeld ? torques[k] : 0.5 * (torques[k] + torques[k + 1]);
        sum -= torque * (bell.weigh(record.times_s[k + 1]) - bell.weigh(record.times_s[k]));
    }
    return sum;
}

double averageTorque(const MotionRecord& record, const std::vector<double>& torques, const Window& w,
                     const std::vector<double>& shares, bool isHeld) {
    const Bell bell{record.times_s[w.first], record.times_s[w.last] - record.times_s[w.first]};
    double sum = 0.0;
    for (std::size_t k = w.first; k < w.last; ++k)
        sum += torques[k] * (isHeld ? bell.integrate(record.times_s[k + 1]) - bell.integrate(record.times_s[k])
                                    : shares[k - w.first]);
    return sum;
}

void addEquations(const Motion& motion, const IdentificationOptions& options, int firstBlock, int blocks,
                  const std::vector<double>& slow, TorqueBasis& basis, std::vector<std::vector<TorqueEquation>>& rows,
                  TorqueEquations& all) {
    const MotionRecord& record = *motion.record;
    const std::vector<double>& times = record.times_s;
    const std::size_t joints = motion.joints.size();
    const double duration = times.back() - times.front();
    std::vector<std::vector<Window>> windows(joints);
    std::vector<std::size_t> begin(joints), active(joints, 0);
    for (std::size_t i = 0; i < joints; ++i) {
        begin[i] = rows[i].size();
        if (motion.joints[i]->torques.empty()) continue;
        int run = rows[i].empty() ? 0 : rows[i].back().run + 1;
        windows[i] = layWindows(motion, i, all.window_s, slow[i], all.joints[i], run);
        for (const Window& w : windows[i]) {
            TorqueEquation row;
            row.joint = static_cast<int>(i);
            row.run = w.run;
            row.sign = motion.path[i][1][w.first] > 0.0 ? 1.0 : -1.0;
            const double from = times[w.first], length = times[w.last] - from;
            row.weight = length / all.window_s;
            const double place = (from + 0.5 * length - times.front()) / duration;
            row.block = firstBlock + std::clamp(static_cast<int>(place * blocks), 0, blocks - 1);
            row.shaking = motion.shaking[i];
            const Bell bell{from, length};
            double sum = 0.0;
            for (std::size_t k = w.first; k <= w.last; ++k) {
                const double before = k > w.first ? times[k - 1] : times[k];
                const double after = k < w.last ? times[k + 1] : times[k];
                row.shares.push_back(0.5 * (after - before) * bell.weigh(times[k]));
                row.speeds.push_back(std::abs(motion.path[i][1][k]));
                row.accelerations.push_back(row.sign * motion.path[i][2][k]);
                sum += row.shares.back();
            }
            for (double& share : row.shares) share /= sum;
            row.torque = averageTorque(record, motion.joints[i]->torques, w, row.shares, options.isTorqueHeld);
            row.torqueRate = averageTorqueRate(record, motion.joints[i]->torques, w, options.isTorqueHeld);
            rows[i].push_back(std::move(row));
        }
    }

    JointVector q(static_cast<int>(joints)), qd(q), qdd(q);
    for (std::size_t k = 0; k < times.size(); ++k) {
        bool isNeeded = false;
        for (std::size_t i = 0; i < joints; ++i) {
            while (active[i] < windows[i].size() && windows[i][active[i]].last < k) ++active[i];
            isNeeded = isNeeded || (active[i] < windows[i].size() && windows[i][active[i]].first <= k);
        }
        if (!isNeeded) continue;
        for (std::size_t i = 0; i < joints; ++i) {
            const int at = static_cast<int>(i);
            q[at] = motion.path[i][0][k];
            qd[at] = motion.path[i][1][k];
            qdd[at] = motion.path[i][2][k];
        }
        basis.realize(q, qd, qdd);
        for (std::size_t i = 0; i < joints; ++i) {
            const int at = static_cast<int>(i);
            for (std::size_t a = active[i]; a < windows[i].size() && windows[i][a].first <= k; ++a) {
                if (windows[i][a].last < k) continue;
                TorqueEquation& row = rows[i][begin[i] + a];
                const double share = row.shares[k - windows[i][a].first];
                row.rigid += share * basis.rigid[at];
                row.acceleration += share * qdd[at];
                for (std::size_t side = 0; side < 2; ++side) row.tilt[side] += share * basis.tilt[side][at];
                if (basis.hasPayload())
                    for (std::size_t c = 0; c < kPayloadColumns; ++c) row.payload[c] += share * basis.payload[c][at];
                row.bodies.resize(basis.bodies.size(), 0.0);
                for (std::size_t b = 0; b < basis.bodies.size(); ++b) row.bodies[b] += share * basis.bodies[b][at];
            }
        }
    }
    for (std::size_t i = 0; i < joints; ++i)
        for (std::size_t r = begin[i]; r < rows[i].size(); ++r) rows[i][r].torque -= rows[i][r].rigid;
}

}  // namespace

TorqueEquations makeTorqueEquations(const RobotDescription& nominal, const std::vector<MotionRecord>& records,
                                    const IdentificationOptions& options) {
    if (records.empty()) throw badInput("", "there is no record to identify from", "Name one log or more.");
    const auto joints = static_cast<std::size_t>(nominal.size());
    TorqueEquations all;
    all.joints.resize(joints);
    std::vector<Motion> motions;
    double smoothing = 0.0, interval = 0.0;
    std::vector<double> slow(joints, 0.0);
    for (const MotionRecord& record : records) {
        const double own = 1.0 / static_cast<double>(records.size());
        motions.push_back(readMotion(nominal, record, own * static_cast<double>(motions.size()), own));
        const Motion& motion = motions.back();
        for (std::size_t i = 0; i < joints; ++i) motions.back().shaking.push_back(calcShaking(nominal, motion, i));
        interval = std::max(interval, motion.interval_s);
        all.duration_s += record.times_s.back() - record.times_s.front();
        for (std::size_t i = 0; i < joints; ++i) {
            smoothing = std::max(smoothing, motion.margin_s[i]);
            for (const double v : motion.path[i][1])
                all.joints[i].largest = std::max(all.joints[i].largest, std::abs(v));
        }
    }
    for (std::size_t i = 0; i < joints; ++i) {
        slow[i] = kSlowShare * all.joints[i].largest;
        double squares = 0.0, count = 0.0;
        for (const Motion& motion : motions)
            for (const double torque : motion.joints[i]->torques)
                if (std::isfinite(torque)) squares += torque * torque, count += 1.0;
        all.joints[i].hasTorques = count > 0.0;
        all.joints[i].torqueRms = count > 0.0 ? std::sqrt(squares / count) : 0.0;
    }
    all.window_s = options.window_s > 0.0
                       ? options.window_s
                       : std::max({kLeastWindow_s, kWindowsPerSmoothing * smoothing, kReadingsPerWindow * interval});
    all.block_s = std::max(kWindowsPerBlock * all.window_s, all.duration_s / kMostBlocks);
    std::vector<int> blocks;
    int sum = 0;
    for (const Motion& motion : motions) {
        const double duration = motion.record->times_s.back() - motion.record->times_s.front();
        blocks.push_back(std::max(1, static_cast<int>(duration / all.block_s)));
        sum += blocks.back();
    }
    if (sum < kLeastBlocks)
        throw badInput(records.front().source,
                       "the records last " + formatNumber(std::round(1e3 * all.duration_s) / 1e3) +
                           " s together, which is too short to tell how sure the figures are",
                       "It takes " + formatNumber(std::ceil(10.0 * kLeastBlocks * all.block_s) / 10.0) +
                           " s at the very least; some 10 to 60 s of varied motion is good.");

    TorqueBasis basis(nominal, options.payload != PayloadModel::None, options.bodyMasses);
    std::vector<std::vector<TorqueEquation>> rows(joints);
    for (std::size_t m = 0; m < motions.size(); ++m) {
        addEquations(motions[m], options, all.blocks, blocks[m], slow, basis, rows, all);
        all.blocks += blocks[m];
    }
    for (auto& own : rows)
        for (TorqueEquation& row : own) all.rows.push_back(std::move(row));
    return all;
}

}  // namespace viable::detail
