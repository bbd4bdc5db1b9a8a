#include "RecordedPoses.h"

#include <algorithm>
#include <cmath>

#include "core/MinimumJerk.h"
#include "core/RotationVector.h"
#include "core/Text.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

// `axes` may be written with this few decimals; it is made an exact rotation.
constexpr double kAxesTolerance = 1e-3;
// Rotations nearer than this to a half turn have no unique rotation vector to scale. [rad]
constexpr double kHalfTurnMargin_rad = 0.1;

struct RecordedPosesOptions {
    std::filesystem::path file;
    double start_s = 0.0, scale = 1.0, rotationScale = 1.0, clutch_s = 1.0, smoothing_s = 0.02, maxGap_s = 0.2;
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
    bool reverses = true, holdsInGaps = false;

    template <class V>
    void describe(V& v) {
        v(file, "file",
          "Recording: TUM trajectory (`timestamp tx ty tz qx qy qz qw`), or CSV whose first line names "
          "`time_s,x_m,y_m,z_m,qx,qy,qz,qw` in any order; `#` begins a comment line.")
            .required();
        v(start_s, "start_s", "s", "The motion begins this far into the recording.").atLeast(0);
        v(scale, "scale", "", "Displacements are multiplied by this.").atLeast(0).upTo(100);
        v(rotationScale, "rotation_scale", "", "Rotation vectors are multiplied by this.").atLeast(0).upTo(2);
        v(axes, "axes", "", "Rotation matrix, row by row, from the recording's to the base's axes.");
        v(clutch_s, "clutch_s", "s", "Playing speeds up from standstill, and slows down at the end, within this time.")
            .above(0);
        v(reverses, "at_end", "hold|reverse", "At the end of the recording: stay, or run back and forth.");
        v(smoothing_s, "smoothing_s", "s",
          "Standard deviation of the zero-phase Gaussian that takes noise out; 0: none.")
            .atLeast(0)
            .upTo(0.5);
        v(maxGap_s, "max_gap_s", "s", "Longest time between two samples; a longer one is a gap.").above(0);
        v(holdsInGaps, "gaps", "refuse|hold",
          "Recordings with gaps: refuse them, or let the tool rest in a gap and go on from where it is.");
    }
};

/** An exact rotation. */
Eigen::Matrix3d checkAxes(const Eigen::Matrix3d& axes, const Parameters& parameters) {
    const double deviation = (axes * axes.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    const double determinant = axes.determinant();
    if (!(deviation <= kAxesTolerance) || determinant < 0.0)
        throw badInput(
            parameters.place("axes"),
            detail::format(
                "axes is not a rotation: its rows deviate by %.3g from unit length and right angles (at most %g), "
                "and its determinant is %.6g instead of 1",
                deviation, kAxesTolerance, determinant),
            "Give the recording's axes seen from the robot's base, row by row");
    return Eigen::Quaterniond(axes).normalized().toRotationMatrix();
}

// A part, relative to its first pose, in base axes and scaled, and from there to `begin`, where the tool is then.
std::vector<TimedPose> makeRelative(const std::vector<TimedPose>& samples, const TimedPose& begin,
                                    const RecordedPosesOptions& options, const Parameters& parameters) {
    const Eigen::Matrix3d axes = checkAxes(options.axes, parameters);
    const double scale = options.scale, rotationScale = options.rotationScale;
    const TimedPose& origin = samples.front();
    std::vector<TimedPose> result;
    result.reserve(samples.size());
    result.push_back({0.0, begin.position, begin.orientation});
    for (std::size_t i = 1; i < samples.size(); ++i) {
        const TimedPose& now = samples[i];
        Eigen::Quaterniond turn = now.orientation * origin.orientation.conjugate();
        turn.vec() = axes * turn.vec();
        if (rotationScale != 1.0) {
            const Eigen::Vector3d r = calcRotationVector(turn);
            if (r.norm() > kPi - kHalfTurnMargin_rad)
                throw badInput(
                    parameters.place("rotation_scale"),
                    detail::format("rotation_scale cannot be %g: at %.3f s the recording has turned by %.4g rad from "
                                   "its beginning, and a half turn has no unique direction to scale",
                                   rotationScale, now.time_s, r.norm()),
                    "Set rotation_scale to 1 or use another part of the recording");
            turn = calcRotation(rotationScale * r);
        }
        result.push_back({now.time_s - origin.time_s, begin.position + scale * axes * (now.position - origin.position),
                          turn * begin.orientation});
    }
    return result;
}

}  // namespace

void RecordedPoses::configure(const RunSetup& setup, const Parameters& parameters) {
    start_ = setup.startTool;
    const auto options = parameters.get<RecordedPosesOptions>();
    clutch_s_ = options.clutch_s;
    reverses_ = options.reverses;
    const std::filesystem::path& file = options.file;
    const double start = options.start_s;
    std::vector<std::vector<TimedPose>> parts = readPoseRecording(file, {options.maxGap_s, options.holdsInGaps});
    const double length = parts.back().back().time_s;
    std::size_t left = 0;
    for (std::vector<TimedPose>& part : parts) {
        part = smooth(part, options.smoothing_s);
        const auto isBefore = [](const TimedPose& s, double t) { return s.time_s < t; };
        part.erase(part.begin(), std::lower_bound(part.begin(), part.end(), start, isBefore));
        left += part.size();
    }
    if (left < kFewestSamples)
        throw badInput(
            parameters.place("start_s"),
            detail::format("start_s = %g s leaves %zu samples of a recording of %.6g s, but at least %zu are needed",
                           start, left, length, kFewestSamples),
            "Begin earlier in " + file.string());
    parts_.clear();
    double longest = 0.0, first = 0.0;
    TimedPose now{0.0, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity()};
    for (const std::vector<TimedPose>& part : parts) {
        if (part.size() < kFewestSamples) continue;
        const double duration = part.back().time_s - part.front().time_s;
        longest = std::max(longest, duration);
        if (clutch_s_ > duration) continue;
        if (parts_.empty()) first = part.front().time_s;
        const double begin = parts_.empty() ? 0.0 : std::max(part.front().time_s - first, parts_.back().end(clutch_s_));
        const std::vector<TimedPose> relative = makeRelative(part, now, options, parameters);
        now = relative.back();
        parts_.push_back({begin, {}});
        parts_.back().spline.fit(relative);
    }
    if (parts_.empty() && longest == 0.0)
        throw badInput(parameters.place("gaps"),
                       detail::format("no part of the recording without a gap has %zu samples", kFewestSamples),
                       "Allow longer gaps (max_gap_s), or take another recording than " + file.string());
    if (parts_.empty())
        throw badInput(parameters.place("clutch_s"),
                       detail::format("clutch_s = %g s is longer than the part of the recording in use, %.6g s%s",
                                      clutch_s_, longest, parts.size() > 1 ? " (the longest without a gap)" : ""),
                       "Give a shorter time or a longer part of " + file.string());
}

/** The part that is played at `t`, or was played last. */
const RecordedPoses::Part& RecordedPoses::findPart(double t) const {
    const auto next = std::upper_bound(parts_.begin(), parts_.end(), t,
                                       [](double time, const Part& part) { return time < part.begin_s; });
    return next == parts_.begin() ? *next : *(next - 1);
}

RecordedPoses::Playing RecordedPoses::calcPlaying(const Part& part, double t) const {
    const double length = part.spline.duration();
    const double pass = length + clutch_s_;
    t -= part.begin_s;
    Playing playing{length, 0.0};
    if (t < clutch_s_) {
        const double u = t / clutch_s_;
        playing = {clutch_s_ * calcMinimumJerkIntegral(u), calcMinimumJerk(u).value};
    } else if (t <= length) {
        playing = {t - 0.5 * clutch_s_, 1.0};
    } else if (t < pass) {
        const double u = (pass - t) / clutch_s_;
        playing = {length - clutch_s_ * calcMinimumJerkIntegral(u), calcMinimumJerk(u).value};
    }
    return playing;
}

TickStatus RecordedPoses::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    const double pass = parts_.back().end(clutch_s_);
    bool backwards = false;
    if (reverses_) {
        t = std::fmod(t, 2.0 * pass);
        backwards = t > pass;
        if (backwards) t = 2.0 * pass - t;
    }
    const Part& part = findPart(t);
    Playing playing = calcPlaying(part, t);
    if (backwards) playing.rate = -playing.rate;
    Pose relative;
    Vector6 rate;
    part.spline.calc(playing.time, relative, rate);
    out.space = MotionCommand::Space::Tool;
    out.tool.position = start_.position + relative.position;
    out.tool.orientation = relative.orientation * start_.orientation;
    out.toolTwist = playing.rate * rate;
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::RecordedPoses, "recorded_poses",
              "A recorded motion of a hand or camera (TUM trajectory or CSV).", viable::RecordedPosesOptions)
